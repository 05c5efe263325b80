"""Where two ticks differ: by robot and field, to the last bit.

    TickRecord, TickRecord --tick_differences--> (robot, Difference) ...
    any value, any value   --differences-------> Difference ...

Numbers are compared as bytes: NaN is equal to itself, and 0.0 is not -0.0.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from math import isnan
from typing import Any

import msgspec
import numpy as np

from swarm.messages import Array, Command, Event, FrameRecord, TickRecord

WORLD = "world"  # whose fields those of no robot are
ABSENT = "(none)"
# What happens by the wall clock, or only to who was started again, is no difference of two runs.
WALL_CLOCK_EVENTS = frozenset(("recording", "message-rejected", "world-resumed"))

_DOUBLE = struct.Struct("<d")


class Difference(msgspec.Struct, frozen=True):
    """One field that is not the same."""

    field: str  # path from the compared value, such as pose.x_m or ranges[17]
    one: Any
    other: Any
    apart: float | None = None  # of numbers; of arrays the most, when the field is but the first


def differences(one: Any, other: Any, path: str = "") -> Iterator[Difference]:
    """Every field in which two values differ, depth first, in the order of the fields."""
    if isinstance(one, Array) and isinstance(other, Array):
        yield from _array_differences(one, other, path)
    elif isinstance(one, msgspec.Struct) and type(one) is type(other):
        for name in one.__struct_fields__:
            yield from differences(getattr(one, name), getattr(other, name), _join(path, name))
    elif isinstance(one, (tuple, list)) and isinstance(other, (tuple, list)):
        if len(one) != len(other):
            yield Difference(_join(path, "length"), len(one), len(other))
        for index, (left, right) in enumerate(zip(one, other, strict=False)):
            yield from differences(left, right, f"{path}[{index}]")
    elif isinstance(one, dict) and isinstance(other, dict):
        for key in [*one, *(key for key in other if key not in one)]:
            yield from differences(
                one.get(key, ABSENT), other.get(key, ABSENT), _join(path, str(key))
            )
    elif not _same(one, other):
        yield Difference(path, one, other, _apart(one, other))


def tick_differences(
    one: TickRecord, other: TickRecord, names: Sequence[str] = (), *, events: bool = True
) -> Iterator[tuple[str, Difference]]:
    """Every field in which two records of the same tick differ, with the robot's name.

    In the order in which a tick comes about: what is so, what happened, what was sensed, what
    was answered.

    Args:
        names: of the robots, in the order of the rows.
    """
    yield from _of(WORLD, one.stamp_ns, other.stamp_ns, "stamp_ns")
    if len(one.robots) != len(other.robots):
        yield from _of(WORLD, len(one.robots), len(other.robots), "robots.length")
    for row, (left, right) in enumerate(zip(one.robots, other.robots, strict=False)):
        yield from _of(_name(names, row), left, right, "robot")
    if events:
        yield from _event_differences(one.events, other.events)
    frames: tuple[dict[int, FrameRecord], ...] = tuple(
        {frame.row: frame for frame in record.frames} for record in (one, other)
    )
    for row in sorted(frames[0].keys() | frames[1].keys()):
        yield from _of(_name(names, row), frames[0].get(row), frames[1].get(row), "frame")
    commands: tuple[dict[tuple[str, int], Command], ...] = tuple(
        {(command.robot, command.tick): command for command in record.commands}
        for record in (one, other)
    )
    for key in [*commands[0], *(key for key in commands[1] if key not in commands[0])]:
        yield from _of(key[0], commands[0].get(key), commands[1].get(key), "command")


def shown(value: Any) -> str:
    """A value for people, on one line and not too long."""
    if value is None:
        return ABSENT
    text = f"a {type(value).__name__}" if isinstance(value, (Command, FrameRecord)) else str(value)
    return text if len(text) <= 200 else f"{text[:197]}..."


def _of(robot: str, one: Any, other: Any, path: str) -> Iterator[tuple[str, Difference]]:
    for difference in differences(one, other, path):
        yield robot, difference


def _event_differences(
    one: Iterable[Event], other: Iterable[Event]
) -> Iterator[tuple[str, Difference]]:
    """Events side by side, each by who it is about."""
    lasting = [
        [event for event in events if event.kind not in WALL_CLOCK_EVENTS]
        for events in (one, other)
    ]
    for left, right in zip_longest(*lasting):
        about = left or right
        yield from _of(about.robot or WORLD, _event_text(left), _event_text(right), "events")


def _event_text(event: Event | None) -> str:
    return ABSENT if event is None else f"{event.kind} {event.robot or ''} {event.text}".strip()


def _array_differences(one: Array, other: Array, path: str) -> Iterator[Difference]:
    if (one.dtype, one.shape) != (other.dtype, other.shape):
        yield Difference(_join(path, "shape"), (one.dtype, one.shape), (other.dtype, other.shape))
        return
    if one.data == other.data:
        return
    bits = np.dtype("<u8" if one.dtype == "<f8" else "<u4")
    unequal = np.flatnonzero(np.frombuffer(one.data, bits) != np.frombuffer(other.data, bits))
    left, right = (array.numpy().reshape(-1)[unequal].astype(float) for array in (one, other))
    with np.errstate(invalid="ignore"):
        apart = np.abs(left - right)
    numbers = apart[~np.isnan(apart)]
    yield Difference(
        f"{path}[{unequal[0]}]",
        left[0].item(),
        right[0].item(),
        numbers.max().item() if len(numbers) else None,
    )


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, bool) or isinstance(other, bool):
        return one is other
    numbers = isinstance(one, (int, float)) and isinstance(other, (int, float))
    if numbers and not (isinstance(one, int) and isinstance(other, int)):
        return _DOUBLE.pack(one) == _DOUBLE.pack(other)
    return bool(one == other)


def _apart(one: Any, other: Any) -> float | None:
    if isinstance(one, (int, float)) and isinstance(other, (int, float)):
        apart = abs(float(one) - float(other))
        return None if isnan(apart) else apart
    return None


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _name(names: Sequence[str], row: int) -> str:
    return names[row] if 0 <= row < len(names) else f"row {row}"
