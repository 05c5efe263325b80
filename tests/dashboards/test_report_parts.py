"""What the report is made of, by hand: waiting, distances, traffic, what processes used."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dashboards import course, incidents, traffic
from swarm import messages, metrics
from swarm.messages import TickRecord
from swarm.run import report as reading
from swarm.run import sampler
from swarm.run.sampler import Sample
from swarm.scenario import Scenario

MadeTicks = Callable[..., tuple[TickRecord, ...]]
MadeScenario = Callable[[int], Scenario]
replace = msgspec.structs.replace


def changed(
    records: tuple[TickRecord, ...], tick: int, change: Callable[[TickRecord], TickRecord]
) -> tuple[TickRecord, ...]:
    return tuple(change(one) if one.tick == tick else one for one in records)


def yielding(record: TickRecord, row: int, to: str) -> TickRecord:
    robots = list(record.robots)
    robots[row] = replace(robots[row], beacon=replace(robots[row].beacon, yields_to=to))
    return replace(record, robots=tuple(robots))


def summary(seen: course.Course) -> metrics.Summary:
    return metrics.summary(seen.score, metrics.Facts(scenario="made", run="run-1", bus="memory"))


def test_waits_count_spells_by_whom_they_were_for(
    made_ticks: MadeTicks, made_scenario: MadeScenario
) -> None:
    records = made_ticks(3, 12)
    for tick, to in ((2, "robot1"), (3, "robot1"), (4, "robot3"), (7, "robot1"), (11, "robot1")):
        records = changed(records, tick, lambda one, to=to: yielding(one, 1, to))
    first, second = course.waits(course.follow(made_scenario(3), (), records))
    assert (first.robot, first.to, first.times) == ("robot2", "robot1", 3)
    assert (first.total_s, first.longest_s) == (pytest.approx(0.32), pytest.approx(0.16))
    assert first.first_s == pytest.approx(0.16)
    assert (second.to, second.times, second.total_s) == ("robot3", 1, pytest.approx(0.08))


def test_nearest_is_the_closest_pair_with_a_live_robot(
    made_ticks: MadeTicks, made_scenario: MadeScenario
) -> None:
    def closer(record: TickRecord) -> TickRecord:
        robots = list(record.robots)
        x_m, y_m = robots[0].pose.x_m, robots[0].pose.y_m
        robots[2] = replace(robots[2], pose=replace(robots[2].pose, x_m=x_m + 0.5, y_m=y_m))
        robots[1] = replace(robots[1], alive=False)
        return replace(record, robots=tuple(robots))

    seen = course.follow(made_scenario(3), (), changed(made_ticks(3, 10), 6, closer))
    found = course.nearest_robot(seen)
    assert found is not None
    assert {found.robot, found.to} == {"robot1", "robot3"}
    assert found.distance_m == pytest.approx(0.5 - 2 * 0.22)
    assert found.time_s == pytest.approx(0.48)
    assert found.distance_m == pytest.approx(summary(seen).min_clearance_robot_m)
    assert np.isnan(seen.clearance_robot_m[6, 1])


def test_traffic_counts_what_was_expected_and_what_came(
    made_ticks: MadeTicks, made_scenario: MadeScenario
) -> None:
    """Tick 5 lacks a frame and its command, tick 8 a command, tick 6 two beacons."""

    def fewer(record: TickRecord) -> TickRecord:
        if record.tick == 6:
            frame = record.frames[0]
            heard = messages.array(frame.heard.numpy()[:0])
            return replace(record, frames=(replace(frame, heard=heard), *record.frames[1:]))
        frames = record.frames[1:] if record.tick == 5 else record.frames
        return replace(record, frames=frames, commands=record.commands[1:])

    records = made_ticks(3, 20)
    for tick in (5, 6, 8):
        records = changed(records, tick, fewer)
    seen = course.follow(made_scenario(3), (), records)
    frame, command, beacon, event = traffic.rows(seen, summary(seen))
    assert (frame.expected, frame.came, frame.lost) == (60, 59, 1)
    assert (command.expected, command.came) == (59, 19 * 3 - 2)  # tick 0 has none
    assert (frame.gap_ms_max, command.gap_ms_max) == (pytest.approx(160.0), pytest.approx(160.0))
    # 19 ticks, 3 listeners, 2 speakers; who has no frame cannot listen; two were lost
    assert (beacon.expected, beacon.came, beacon.lost) == (19 * 6 - 2, 19 * 6 - 4, 2)
    # from tick 4 (no frame at 5, none heard at 6) to 7, and elsewhere every tick
    assert beacon.gap_ms_max == pytest.approx(240.0)
    assert beacon.late == 0
    assert event.came == 1


def test_late_and_repeated_beacons_are_told_apart(
    made_ticks: MadeTicks, made_scenario: MadeScenario
) -> None:
    def older(record: TickRecord) -> TickRecord:
        frame = record.frames[0]
        pairs = np.array([(1, 3), (1, 2), (2, 5)], np.int32)  # late, again, and just in time
        heard = messages.array(pairs)
        return replace(record, frames=(replace(frame, heard=heard), *record.frames[1:]))

    records = changed(made_ticks(3, 10), 4, lambda one: replace(one, frames=one.frames[1:]))
    records = changed(records, 5, lambda one: replace(one, frames=one.frames[1:]))
    seen = course.follow(made_scenario(3), (), changed(records, 6, older))
    assert seen.links.again == 1
    assert list(np.flatnonzero(seen.links.age_ticks)) == [1, 3]
    assert seen.links.age_ticks[3] == 1
    beacon = traffic.rows(seen, summary(seen))[2]
    assert (beacon.late, beacon.late_ms_max) == (1, pytest.approx(160.0))


def test_loss_that_nobody_asked_for_is_an_incident(
    made_ticks: MadeTicks, made_scenario: MadeScenario
) -> None:
    def lost(record: TickRecord) -> TickRecord:
        event = messages.Event(
            record.tick, record.stamp_ns, "robot-lost", "robot2", "its token is gone"
        )
        return replace(record, events=(event,))

    seen = course.follow(made_scenario(3), (), changed(made_ticks(3, 20), 15, lost))
    first, second = incidents.incidents(seen, summary(seen))
    assert (first.kind, first.injected, first.tick) == ("kill", True, 10)
    assert (second.kind, second.injected, second.tick) == ("lost", False, 15)
    assert (second.robots, second.cause) == (("robot2",), "its token is gone")


# --- processes ----------------------------------------------------------------------------------


def test_sampler_looks_once_a_second_at_who_lives(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    clock = [5.0]
    watch = sampler.Sampler(tmp_path, lambda: clock[0])
    asked: list[float] = []

    def living() -> dict[str, int]:
        asked.append(clock[0])
        return {"world": os.getpid(), "gone": 2**22 + 1}  # beyond the kernel's largest pid

    for now_s in (5.0, 5.4, 5.99, 6.0, 6.5):
        clock[0] = now_s
        watch.look(living)
    watch.look(living, at_once=True)
    assert asked == [5.0, 6.0, 6.5]
    samples = sampler.read(tmp_path)
    assert [(one.wall_s, one.name) for one in samples] == [
        (0.0, "world"),
        (1.0, "world"),
        (1.5, "world"),
    ]
    assert all(one.memory_bytes > 1_000_000 and one.cpu_s > 0.0 for one in samples)


def test_samples_of_a_killed_supervisor_are_read_but_for_the_broken_line(tmp_path: Path) -> None:
    assert sampler.read(tmp_path) == ()
    (tmp_path / "logs").mkdir()
    whole = msgspec.json.encode(Sample(0.0, "world", 7, 0.5, 1000))
    (tmp_path / "logs" / sampler.FILE_NAME).write_bytes(whole + b"\n" + whole[:20])
    assert sampler.read(tmp_path) == (Sample(0.0, "world", 7, 0.5, 1000),)


def test_processes_of_one_name_are_added_up() -> None:
    rows = reading.process_rows(
        [
            Sample(0.0, "robot1", 10, 0.5, 30_000_000),
            Sample(2.0, "robot1", 10, 1.5, 40_000_000),
            Sample(5.0, "robot1", 11, 0.25, 20_000_000),  # started again
            Sample(6.0, "robot1", 11, 0.5, 20_000_000),
        ]
    )
    [row] = rows
    assert (row.name, row.processes, row.cpu_s) == ("robot1", 2, 2.0)
    assert row.cpu_mean == pytest.approx(1.25 / 3.0)
    assert row.cpu_most == pytest.approx(0.5)
    assert row.memory_mb_max == pytest.approx(40.0)


def test_loads_add_up_robots_and_keep_the_largest() -> None:
    samples = [
        Sample(time_s, name, pid, cpu_s, memory)
        for time_s, scale in ((0.0, 0.0), (1.0, 1.0), (2.0, 3.0))
        for name, pid, cpu_s, memory in (
            ("world", 1, 0.4 * scale, 60_000_000),
            ("supervisor", 2, 0.1 * scale, 50_000_000),
            ("robot1", 3, 0.2 * scale, 30_000_000),
            ("robot2", 4, 0.1 * scale, 35_000_000),
        )
    ]
    loads = {one.name: one for one in reading.loads(samples)}
    assert list(loads) == ["world", "supervisor", "all robots", "largest robot"]
    assert loads["world"].cpu[1:] == pytest.approx([0.4, 0.8])
    assert loads["all robots"].cpu[1:] == pytest.approx([0.3, 0.6])
    assert loads["largest robot"].cpu[1:] == pytest.approx([0.2, 0.4])
    assert loads["largest robot"].memory_mb == pytest.approx([35.0, 35.0, 35.0])
    assert reading.loads(samples[:4]) == ()
