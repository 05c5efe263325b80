"""Two runs side by side, tick by tick: where they part, and which fields ever differ.

A ---ticks--> |                 |--> the first difference: tick, robot, field, both values
B ---ticks--> | compare, to the |--> how many ticks differ
| last bit        |--> per field: since when, how often, how far apart
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm import compare, recording
from swarm.messages import TickRecord

ROWS_MAX = 200  # fields and keys of the scenario that are listed; the rest is counted
TICK_FIELD = "tick"  # what differs when one of the runs does not have a tick at all

_INDEX = re.compile(r"\[\d+\]")
_encoder = msgspec.msgpack.Encoder()


class First(msgspec.Struct, frozen=True):
    """Where two runs part."""

    tick: int
    time_s: float
    robot: str  # or world
    field: str
    a: str
    b: str


class FieldRow(msgspec.Struct, frozen=True):
    """One field of all robots, without indices."""

    field: str
    first_tick: int
    ticks: int  # in so many it differs
    apart_max: float | None  # largest difference of two numbers; None where there are none


class KeyRow(msgspec.Struct, frozen=True):
    """A key of the scenario."""

    key: str
    a: str
    b: str


class Difference(msgspec.Struct, frozen=True):
    """What `swarm diff` found."""

    equal: bool
    ticks_a: int
    ticks_b: int
    differing_ticks: int  # those that only one run has among them
    first: First | None
    fields: tuple[FieldRow, ...]  # by first tick
    fields_more: int  # not listed
    scenario: tuple[KeyRow, ...]
    scenario_more: int
    cut: tuple[bool, bool]  # whether a recording is not whole


class _Tally(msgspec.Struct):
    first_tick: int
    last_tick: int
    ticks: int = 1
    apart_max: float | None = None


def difference(path_a: Path, path_b: Path) -> Difference:
    """Compare two recordings; raises RecordingError when one cannot be read."""
    a, b = recording.read(path_a), recording.read(path_b)
    plan_a, plan_b = _table(a.scenario_toml), _table(b.scenario_toml)
    keys = [
        KeyRow(found.field, compare.shown(found.one), compare.shown(found.other))
        for found in compare.differences(plan_a, plan_b)
    ]
    names = _names(plan_a)
    first: First | None = None
    fields: dict[str, _Tally] = {}
    ticks_a = ticks_b = differing = 0
    for one, other in _side_by_side(a.ticks, b.ticks):
        ticks_a += one is not None
        ticks_b += other is not None
        record = one or other
        assert record is not None
        differs = False
        for robot, found in _tick_differences(one, other, names):
            differs = True
            if first is None:
                shown = compare.shown(found.one), compare.shown(found.other)
                first = First(record.tick, record.stamp_ns * 1e-9, robot, found.field, *shown)
            _add(fields, record.tick, found)
        differing += differs
    rows = [
        FieldRow(field, tally.first_tick, tally.ticks, tally.apart_max)
        for field, tally in sorted(fields.items(), key=lambda item: item[1].first_tick)
    ]
    return Difference(
        equal=differing == 0,
        ticks_a=ticks_a,
        ticks_b=ticks_b,
        differing_ticks=differing,
        first=first,
        fields=tuple(rows[:ROWS_MAX]),
        fields_more=max(0, len(rows) - ROWS_MAX),
        scenario=tuple(keys[:ROWS_MAX]),
        scenario_more=max(0, len(keys) - ROWS_MAX),
        cut=(a.cut, b.cut),
    )


def _side_by_side(
    a: Iterator[TickRecord], b: Iterator[TickRecord]
) -> Iterator[tuple[TickRecord | None, TickRecord | None]]:
    """Records of the same tick together; None where a run does not have it."""
    one, other = next(a, None), next(b, None)
    while one is not None or other is not None:
        if other is None or (one is not None and one.tick < other.tick):
            yield one, None
            one = next(a, None)
        elif one is None or other.tick < one.tick:
            yield None, other
            other = next(b, None)
        else:
            yield one, other
            one, other = next(a, None), next(b, None)


def _tick_differences(
    one: TickRecord | None, other: TickRecord | None, names: Sequence[str]
) -> Iterator[tuple[str, compare.Difference]]:
    if one is None or other is None:
        there, absent = "recorded", "not recorded"
        yield (
            compare.WORLD,
            compare.Difference(
                TICK_FIELD, absent if one is None else there, absent if other is None else there
            ),
        )
    elif _encoder.encode(one) != _encoder.encode(other):  # most ticks end here
        yield from compare.tick_differences(one, other, names)


def _add(fields: dict[str, _Tally], tick: int, found: compare.Difference) -> None:
    name = _INDEX.sub("", found.field)
    tally = fields.setdefault(name, _Tally(tick, tick))
    if tally.last_tick != tick:
        tally.last_tick = tick
        tally.ticks += 1
    if found.apart is not None:
        tally.apart_max = max(found.apart, tally.apart_max or 0.0)


def _table(toml: bytes) -> dict[str, Any]:
    """A scenario as plain tables; empty when it cannot be read."""
    try:
        return tomllib.loads(toml.decode())
    except (ValueError, RecursionError):
        return {}


def _names(plan: dict[str, Any]) -> list[str]:
    try:
        return [str(row["name"]) for row in plan["robots"]]
    except (KeyError, TypeError):
        return []


# --- for people ---------------------------------------------------------------------------------


def show(found: Difference) -> None:
    """Print what was found."""
    console = Console()

    def say(text: str, style: str = "") -> None:
        console.print(Text(text, style=style), soft_wrap=True)

    say(f"A has {found.ticks_a} ticks, B has {found.ticks_b}")
    for letter, cut in zip("AB", found.cut, strict=True):
        if cut:
            say(f"{letter} is not whole: compared as far as it can be read", "yellow")
    for row in found.scenario:
        say(f"scenario: {row.key}: {row.a} in A, {row.b} in B")
    if found.scenario_more:
        say(f"scenario: {found.scenario_more} more keys differ")
    if found.equal:
        say("equal", "green")
        return
    if found.first is not None:
        where = found.first
        say(f"first difference at tick {where.tick} ({where.time_s:.2f} s): ", "bold")
        say(f"  {where.robot}: {where.field}\n  A {where.a}\n  B {where.b}")
    say(f"{found.differing_ticks} of {max(found.ticks_a, found.ticks_b)} ticks differ, in:")
    table = Table(box=None, pad_edge=False)
    for name in ("FIELD", "SINCE TICK", "TICKS", "AT MOST"):
        table.add_column(name, justify="left" if name == "FIELD" else "right")
    for row_ in found.fields:
        apart = "" if row_.apart_max is None else f"{row_.apart_max:.6g}"
        table.add_row(row_.field, str(row_.first_tick), str(row_.ticks), apart)
    console.print(table)
    if found.fields_more:
        say(f"... {found.fields_more} more fields")
    say("DIFFERENT", "bold red")
