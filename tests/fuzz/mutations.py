"""Ways to damage bytes and values, all drawn from one `random.Random`."""

from __future__ import annotations

import random
from collections.abc import Callable
from math import inf, nan
from typing import Any

import msgspec

NUMBERS = (
    0, -0.0, 1, -1, 0.5, 1e-320, 1e308, -1e308, nan, inf, -inf, 2**31, -(2**31) - 1, 2**32, 2**40,
    2**53 + 1, 2**63 - 1, -(2**63), 2**64 - 1, 255, 256, 65_536, 1e6 + 1, 1e-9,
)  # fmt: skip
TEXTS = (
    "",
    "robot1",
    "leader",
    "world",
    "a" * 33,
    "A",
    "-",
    "\x00",
    "\n",
    "é",
    "\ud7ff",
    "x" * 5000,
)
OTHERS = (None, True, False, [], {}, b"", b"\x00" * 9, [[]], {"": None}, [0] * 300)


def value(draw: random.Random) -> Any:
    """Something that seldom belongs where it is put."""
    kind = draw.randrange(6)
    if kind < 2:
        return draw.choice(NUMBERS)
    if kind == 2:
        return draw.choice(TEXTS)
    if kind == 3:
        return draw.choice(OTHERS)
    if kind == 4:
        return nested(draw.randrange(1, 60))
    return draw.uniform(-10.0, 10.0)


def nested(depth: int) -> Any:
    """A list in a list in a list."""
    result: Any = 0
    for _ in range(depth):
        result = [result]
    return result


def damaged(draw: random.Random, data: bytes, other: bytes = b"") -> bytes:
    """Bytes after one to four accidents; `other` lends pieces."""
    result = bytearray(data)
    for _ in range(draw.randrange(1, 5)):
        draw.choice(ACCIDENTS)(draw, result, other)
    return bytes(result)


def _flip(draw: random.Random, data: bytearray, other: bytes) -> None:
    if data:
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)


def _set(draw: random.Random, data: bytearray, other: bytes) -> None:
    if data:
        data[draw.randrange(len(data))] = draw.choice((0, 1, 0x7F, 0x80, 0xC0, 0xC1, 0xDD, 0xFF))


def _cut(draw: random.Random, data: bytearray, other: bytes) -> None:
    del data[draw.randrange(len(data) + 1) :]


def _remove(draw: random.Random, data: bytearray, other: bytes) -> None:
    at = draw.randrange(len(data) + 1)
    del data[at : at + draw.choice((1, 2, 8, 100, 3000))]


def _insert(draw: random.Random, data: bytearray, other: bytes) -> None:
    at = draw.randrange(len(data) + 1)
    data[at:at] = draw.randbytes(draw.choice((1, 2, 8, 100, 3000)))


def _overwrite(draw: random.Random, data: bytearray, other: bytes) -> None:
    at = draw.randrange(len(data) + 1)
    length = draw.choice((1, 8, 100, 3000))
    data[at : at + length] = bytes(length) if draw.random() < 0.5 else draw.randbytes(length)


def _repeat(draw: random.Random, data: bytearray, other: bytes) -> None:
    at = draw.randrange(len(data) + 1)
    data[at:at] = data[at : at + draw.choice((1, 8, 100, 3000))]


def _swap(draw: random.Random, data: bytearray, other: bytes) -> None:
    if len(data) < 4:
        return
    a, b, c = sorted(draw.randrange(len(data) + 1) for _ in range(3))
    data[a:c] = data[b:c] + data[a:b]


def _splice(draw: random.Random, data: bytearray, other: bytes) -> None:
    if other:
        at, start = draw.randrange(len(data) + 1), draw.randrange(len(other))
        piece = other[start : start + draw.choice((8, 100, 3000))]
        data[at : at + len(piece)] = piece


ACCIDENTS: tuple[Callable[[random.Random, bytearray, bytes], None], ...] = (
    _flip, _flip, _set, _cut, _remove, _insert, _overwrite, _repeat, _swap, _splice,
)  # fmt: skip


def altered(draw: random.Random, tree: Any, times: int = 1) -> Any:
    """Plain lists and tables with some of their nodes replaced, removed, doubled or renamed."""
    for _ in range(times):
        tree = _altered(draw, tree)
    return tree


def _altered(draw: random.Random, tree: Any) -> Any:
    branches = isinstance(tree, (list, dict)) and len(tree) > 0
    if not branches or draw.random() < 0.08:
        return _near(draw, tree)
    if isinstance(tree, dict):
        key = draw.choice(list(tree))
        choice = draw.randrange(12)
        if choice == 0:
            return {name: tree[name] for name in tree if name != key}
        if choice == 1:
            return {**tree, draw.choice((*TEXTS[:4], f"{key}_", key.upper())): value(draw)}
        return {**tree, key: _altered(draw, tree[key])}
    index = draw.randrange(len(tree))
    choice = draw.randrange(12)
    if choice == 0:
        return tree[:index] + tree[index + 1 :]
    if choice == 1:
        return tree[:index] + [tree[index]] * draw.choice((2, 3, 40)) + tree[index + 1 :]
    return [*tree[:index], _altered(draw, tree[index]), *tree[index + 1 :]]


def _near(draw: random.Random, old: Any) -> Any:
    """Another value, often of the same kind, so that it gets further."""
    if draw.random() < 0.5 and isinstance(old, (int, float)) and not isinstance(old, bool):
        return draw.choice((old * draw.uniform(-2.0, 2.0), old + 1, -old, *NUMBERS[:4]))
    if draw.random() < 0.3 and isinstance(old, bytes):
        return damaged(draw, old)
    return value(draw)


def altered_message(draw: random.Random, payload: bytes) -> bytes:
    """msgpack of a message some of whose fields are not what they should be."""
    tree = altered(draw, msgspec.msgpack.decode(payload), draw.randrange(1, 4))
    try:
        return msgspec.msgpack.encode(tree)
    except (OverflowError, ValueError):  # a number, or a text, that msgpack does not have
        return damaged(draw, payload)
