"""Inner loops: compiled once and kept on disk where numba is there, plain Python where it is not.

Both decide alike to the bit: no fused or reordered arithmetic is allowed, and angles go in as
numbers, so that no sine of a compiler's own is ever used.

numba is loaded by the first loop that is called: commands that drive no robot do without it. It
takes what it kept for good as long as the loop's own file has not changed, whatever became of
loops and constants in other files that it was made with. So it is kept under a name made from all
of them.
"""

from __future__ import annotations

import importlib.resources
import importlib.util
import os
import tempfile
import zlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., object])


class Loop:
    """A function that becomes machine code when it is first called; `py_func` is the plain one."""

    def __init__(self, function: FunctionType) -> None:
        self.py_func = function
        self.__name__ = function.__name__
        self._code: Callable[..., object] | None = None

    def __call__(self, *arguments: object) -> object:
        return (self._code or self.code())(*arguments)

    def code(self) -> Callable[..., object]:
        """Machine code; loops that it calls are given to the compiler as such."""
        if self._code is None:
            plain = self.py_func
            around = dict(plain.__globals__)
            for name in plain.__code__.co_names:
                found = around.get(name)
                if isinstance(found, Loop):
                    around[name] = found.code()
                elif isinstance(found, ModuleType):
                    around[name] = _with_code(found, plain.__code__.co_names)
            copy = FunctionType(plain.__code__, around, plain.__name__, plain.__defaults__)
            copy.__qualname__, copy.__module__ = plain.__qualname__, plain.__module__
            self._code = _numba().njit(cache=True, fastmath=False)(copy)
            # From now on its module has the machine code itself, which saves a call each time.
            if plain.__globals__.get(plain.__name__) is self:
                plain.__globals__[plain.__name__] = self._code
        assert self._code is not None
        return self._code


def _with_code(module: ModuleType, names: Sequence[str]) -> ModuleType:
    """A module as the compiler takes it: with machine code for those of its loops."""
    loops = {name: loop for name in names if isinstance(loop := vars(module).get(name), Loop)}
    if not loops:
        return module
    shown = ModuleType(module.__name__)
    vars(shown).update(vars(module))
    vars(shown).update({name: loop.code() for name, loop in loops.items()})
    return shown


@cache
def _numba() -> Any:
    numba: ModuleType = importlib.import_module("numba")
    config: Any = numba.config
    config.CACHE_DIR = str(folder())
    return numba


def is_kept() -> bool:
    """Whether there is machine code of these sources already, so that it need only be loaded."""
    return any(folder().rglob("*.nbi"))


@cache
def folder() -> Path:
    """Where the machine code of these sources is kept."""
    here = importlib.resources.files("agents.navigator")
    sources = sorted((part.name, part) for part in here.iterdir() if part.name.endswith(".py"))
    version = zlib.crc32(b"".join(part.read_bytes() for _, part in sources))
    return _cache(Path(str(here))) / f"compiled-{version:08x}"


def _cache(folder: Path) -> Path:
    """Where machine code is kept: beside the sources, or where they cannot be written, at home."""
    if os.access(folder, os.W_OK):
        return folder / "__pycache__"
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    kept = Path(home) / "msam-swarm"
    try:
        kept.mkdir(parents=True, exist_ok=True)
    except OSError:
        return Path(tempfile.mkdtemp(prefix="msam-swarm-"))
    return kept


if importlib.util.find_spec("numba") is None:

    def compiled(function: F) -> F:
        """The same function: slower by far, but the same decisions."""
        return function

else:

    def compiled(function: F) -> F:
        """The same function as machine code."""
        return cast(F, Loop(cast(FunctionType, function)))
