"""Two runs side by side: equal to the last bit, or where, since when and how far apart."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from swarm import compare, messages, recording
from swarm.messages import TickRecord
from swarm.run import difference

MakeTicks = Callable[..., tuple[TickRecord, ...]]
PLAN = b"""
title = "a"
seed = 1
field.k_r = 30.0
robots = [{name = "robot1"}, {name = "robot2"}]
"""


def write(path: Path, ticks: tuple[TickRecord, ...], toml: bytes = PLAN) -> Path:
    with recording.Writer(path, toml, {}) as writer:
        for record in ticks:
            writer.write(record)
    return path


def moved(record: TickRecord, by_m: float) -> TickRecord:
    truth = record.robots[1]
    pose = msgspec.structs.replace(truth.pose, y_m=truth.pose.y_m + by_m)
    robots = (record.robots[0], msgspec.structs.replace(truth, pose=pose))
    return msgspec.structs.replace(record, robots=robots)


def found(
    tmp_path: Path, a: tuple[TickRecord, ...], b: tuple[TickRecord, ...]
) -> difference.Difference:
    return difference.difference(write(tmp_path / "a.mcap", a), write(tmp_path / "b.mcap", b))


def test_runs_are_equal_when_only_the_wall_clock_differs(
    made_ticks: MakeTicks, tmp_path: Path
) -> None:
    ticks = made_ticks(2, 20, beams=24)
    said = msgspec.structs.replace(
        ticks[3], events=(messages.Event(3, ticks[3].stamp_ns, "recording", None, "disk"),)
    )
    result = found(tmp_path, ticks, (*ticks[:3], said, *ticks[4:]))
    assert (result.equal, result.first, result.fields) == (True, None, ())
    assert (result.ticks_a, result.ticks_b, result.differing_ticks) == (20, 20, 0)


def test_first_difference_and_every_field_are_named(made_ticks: MakeTicks, tmp_path: Path) -> None:
    ticks = made_ticks(2, 20, beams=24)
    other = list(ticks)
    other[7] = moved(ticks[7], 0.25)
    other[9] = moved(ticks[9], -0.5)
    event = messages.Event(12, ticks[12].stamp_ns, "robot-hung", "robot1", "gone")
    other[12] = msgspec.structs.replace(ticks[12], events=(event,))
    result = found(tmp_path, ticks, tuple(other))
    assert not result.equal
    assert result.differing_ticks == 3
    y_m = ticks[7].robots[1].pose.y_m
    assert result.first == difference.First(
        7, ticks[7].stamp_ns * 1e-9, "robot2", "robot.pose.y_m", str(y_m), str(y_m + 0.25)
    )
    assert [(row.field, row.first_tick, row.ticks) for row in result.fields] == [
        ("robot.pose.y_m", 7, 2),
        ("events", 12, 1),
    ]
    assert result.fields[0].apart_max == pytest.approx(0.5)
    assert result.fields[1].apart_max is None


def test_ticks_that_only_one_run_has_are_counted(made_ticks: MakeTicks, tmp_path: Path) -> None:
    ticks = made_ticks(2, 20, beams=24)
    result = found(tmp_path, ticks, ticks[:5] + ticks[6:15])
    assert (result.ticks_a, result.ticks_b, result.differing_ticks) == (20, 14, 6)
    assert result.first is not None
    assert (result.first.tick, result.first.robot, result.first.field) == (5, "world", "tick")
    assert (result.first.a, result.first.b) == ("recorded", "not recorded")


def test_keys_of_the_scenario_that_differ_are_named(made_ticks: MakeTicks, tmp_path: Path) -> None:
    ticks = made_ticks(2, 3, beams=24)
    a = write(tmp_path / "a.mcap", ticks)
    b = write(tmp_path / "b.mcap", ticks, PLAN.replace(b"30.0", b"31.0").replace(b"robot2", b"x"))
    result = difference.difference(a, b)
    assert result.equal
    assert result.scenario == (
        difference.KeyRow("field.k_r", "30.0", "31.0"),
        difference.KeyRow("robots[1].name", "robot2", "x"),
    )


def test_segments_are_compared_as_one_run(made_ticks: MakeTicks, tmp_path: Path) -> None:
    ticks = made_ticks(2, 20, beams=24)
    (tmp_path / "cut").mkdir()
    write(tmp_path / "cut" / "run.mcap", ticks[:12])
    with recording.Writer(tmp_path / "cut", PLAN, {}, segment=1, first_tick=8) as writer:
        for record in ticks[8:]:
            writer.write(record)
    assert difference.difference(tmp_path / "cut", write(tmp_path / "whole.mcap", ticks)).equal


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (float("nan"), float("nan"), []),
        (0.0, -0.0, [("", 0.0)]),
        (1, 1.0, []),
        (True, 1, [("", 0.0)]),
        ((1.0, 2.0), (1.0, 2.5), [("[1]", 0.5)]),
        ((1,), (1, 2), [("length", None)]),
        ({"a": 1}, {"b": 1}, [("a", None), ("b", None)]),
        (None, "x", [("", None)]),
    ],
)
def test_compare_is_to_the_last_bit(
    one: object, other: object, expected: list[tuple[str, float | None]]
) -> None:
    assert [(row.field, row.apart) for row in compare.differences(one, other)] == expected


def test_compare_names_the_first_element_of_an_array_and_how_far_the_worst_is_off() -> None:
    left = messages.array(np.array([np.nan, 1.0, 2.0, np.inf, 4.0], np.float32))
    right = messages.array(np.array([np.nan, 1.0, 2.5, np.inf, 2.0], np.float32))
    (row,) = compare.differences(left, right, "ranges")
    assert row == compare.Difference("ranges[2]", 2.0, 2.5, 2.0)
