"""Inner loops: compiled once and kept on disk where numba is there, plain Python where it is not.

Both decide alike to the bit: no fused or reordered arithmetic is allowed, and angles go in as
numbers, so that no sine of a compiler's own is ever used.

numba takes what it kept for good as long as the loop's own file has not changed, whatever became
of loops and constants in other files that it was made with. So it is kept under a name made from
all of them.
"""

from __future__ import annotations

import importlib.resources
import importlib.util
import zlib
from collections.abc import Callable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., object])

if importlib.util.find_spec("numba") is None:

    def compiled(function: F) -> F:
        """The same function: slower by far, but the same decisions."""
        return function

else:
    import numba

    _FOLDER = importlib.resources.files("agents.navigator")
    _SOURCES = sorted((part.name, part) for part in _FOLDER.iterdir() if part.name.endswith(".py"))
    _VERSION = zlib.crc32(b"".join(part.read_bytes() for _, part in _SOURCES))
    _config: Any = numba.config
    _config.CACHE_DIR = str(_FOLDER.joinpath("__pycache__", f"compiled-{_VERSION:08x}"))

    def compiled(function: F) -> F:
        """The same function as machine code; `.py_func` of it is the plain one."""
        return cast(F, numba.njit(cache=True, fastmath=False)(function))
