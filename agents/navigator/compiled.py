"""Inner loops: compiled once and kept on disk where numba is there, plain Python where it is not.

Both decide alike to the bit: no fused or reordered arithmetic is allowed, and angles go in as
numbers, so that no sine of a compiler's own is ever used.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import TypeVar, cast

F = TypeVar("F", bound=Callable[..., object])

if importlib.util.find_spec("numba") is None:

    def compiled(function: F) -> F:
        """The same function: slower by far, but the same decisions."""
        return function

else:
    import numba

    def compiled(function: F) -> F:
        """The same function as machine code; `.py_func` of it is the plain one."""
        return cast(F, numba.njit(cache=True, fastmath=False)(function))
