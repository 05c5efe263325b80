"""Metrics of records written by hand, one definition at a time."""

from __future__ import annotations

import hashlib
import struct
from math import inf, pi, sqrt

import msgspec
import pytest

from swarm import metrics
from swarm.geometry import STILL, Pose, Twist
from swarm.messages import (
    Array,
    Beacon,
    Command,
    Event,
    Leadership,
    Mode,
    Passage,
    RobotRecord,
    Slot,
    TickRecord,
    Trace,
)
from swarm.scenario import Expect, Scenario, decode

HEAD = 'title = "test"\nseed = 7\ndt_s = 0.1\nduration_s = 30.0\n'
LONE = HEAD + '[[robots]]\nname = "a"\nstart = [0.0, 0.0, 0.0]\ngoal = [3.0, 4.0]\n'
PAIR = LONE + '[[robots]]\nname = "b"\nstart = [0.0, -2.0, 0.0]\ngoal = [3.0, -2.0]\n'
# The slot of b is 1 m straight behind a: bearing 0.
CONVOY = (
    HEAD
    + '[[robots]]\nname = "a"\nstart = [0.0, 0.0, 0.0]\ngoal = [10.0, 0.0]\n'
    + '[[robots]]\nname = "b"\nstart = [-1.0, 0.0, 0.0]\n'
    + '[[robots]]\nname = "c"\nstart = [-2.0, 0.0, 0.0]\n'
    + '[formation]\nleader = "a"\n'
)
FACTS = metrics.Facts(scenario="test", run="run1", bus="memory")
A_LEADS = Leadership(0, (0, 0, 0, 0), "a")
B_LEADS = Leadership(1, (1, 0, 0, 1), "b")


def plan_of(text: str) -> Scenario:
    return decode(text.encode(), "test.toml")


def beacon(
    name: str,
    tick: int,
    *,
    mode: Mode = "GO",
    leadership: Leadership | None = None,
    heading_rad: float = 0.0,
    slot: Slot | None = None,
    goal: tuple[float, float] | None = None,
    yields_to: str | None = None,
    silent: bool = False,
    passage: Passage | None = None,
) -> Beacon:
    return Beacon(
        name,
        tick,
        0,
        Pose(0.0, 0.0, 0.0),
        STILL,
        0.22,
        1.0,
        mode,
        False,
        (0, 0, 0, 0),
        slot=slot,
        leadership=leadership,
        leader_tick=None if leadership is None or silent else tick,
        goal=goal,
        formation_heading_rad=heading_rad,
        yields_to=yields_to,
        passage=passage,
    )


def body(
    x_m: float,
    y_m: float,
    said: Beacon | None = None,
    *,
    alive: bool = True,
    contact: bool = False,
    clearance_m: float = inf,
    yaw_rad: float = 0.0,
) -> RobotRecord:
    pose = Pose(x_m, y_m, yaw_rad)
    return RobotRecord(alive, contact, pose, Twist(0.5, 0.1), Twist(0.6, 0.2), said, clearance_m)


class Film:
    """A run, shot tick by tick."""

    def __init__(self, text: str) -> None:
        self.plan = plan_of(text)
        self.score = metrics.begin(self.plan)
        self.tick = -1

    def shoot(
        self, *robots: RobotRecord, times: int = 1, events: tuple[Event, ...] = (), held: str = ""
    ) -> None:
        for _ in range(times):
            self.tick += 1
            trace = Trace(Array("<f4", (0,), b""), limited_by=held)
            commands = tuple(
                Command(setup.name, self.tick, 0, STILL, beacon(setup.name, self.tick), trace)
                for setup, robot in zip(self.plan.robots, robots, strict=True)
                if robot.alive
            )
            record = TickRecord(self.tick, 0, robots, (), commands, events)
            metrics.observe(self.score, record)

    def convoy(
        self,
        a: tuple[float, float],
        b: tuple[float, float],
        c: tuple[float, float],
        *,
        times: int = 1,
        modes: Mode = "FORM",
        heading_rad: float = 0.0,
    ) -> None:
        """Three robots of CONVOY in which all follow a."""
        self.shoot(
            body(*a, beacon("a", 0, leadership=A_LEADS, heading_rad=heading_rad)),
            body(*b, beacon("b", 0, leadership=A_LEADS, mode=modes)),
            body(*c, beacon("c", 0, leadership=A_LEADS, mode="FORM")),
            times=times,
        )

    @property
    def summary(self) -> metrics.Summary:
        return metrics.summary(self.score, FACTS)


# --- the object itself --------------------------------------------------------------------------


def test_summary_has_exactly_the_promised_keys_in_order() -> None:
    film = Film(CONVOY)
    film.convoy((0.0, 0.0), (-1.0, 0.0), (-2.0, 0.0))
    built = msgspec.to_builtins(film.summary)
    assert list(built) == [
        "scenario",
        "run",
        "seed",
        "clock",
        "bus",
        "robots",
        "arrived",
        "outcome",
        "collisions",
        "collisions_excused",
        "ticks",
        "sim_time_s",
        "wall_time_s",
        "real_time_factor",
        "min_clearance_obstacle_m",
        "min_clearance_robot_m",
        "makespan_s",
        "path_ratio_mean",
        "per_robot",
        "formation",
        "priority",
        "leaders",
        "faults",
        "late_commands",
        "commands_total",
        "recording",
        "world_restarts",
        "state_hash",
        "expect",
    ]
    assert list(built["per_robot"][0]) == [
        "name",
        "outcome",
        "arrival_s",
        "path_m",
        "final_error_m",
        "yields",
        "waiting_s",
        "restarts",
        "reason",
    ]
    assert list(built["formation"]) == ["error_m_max", "error_m_final", "settling_s", "symmetry_m"]
    assert list(built["priority"]) == [
        "yields",
        "waiting_s_max",
        "grants",
        "double_grants",
        "guard_interventions",
    ]
    assert list(built["leaders"][0]) == ["tick", "name", "term"]
    assert list(built["expect"]) == ["met", "missed"]


def test_summary_passes_on_what_only_the_shell_knows() -> None:
    film = Film(LONE)
    film.shoot(body(0.0, 0.0), times=11)
    facts = metrics.Facts(
        scenario="lone",
        run="run7",
        bus="zenoh",
        clock="realtime",
        wall_time_s=0.5,
        late_commands=3,
        recording=metrics.RecordingRow(expected=9, written=8, lost=1),
        restarts={"a": 2},
    )
    result = metrics.summary(film.score, facts)
    assert (result.scenario, result.run, result.bus, result.clock) == (
        "lone",
        "run7",
        "zenoh",
        "realtime",
    )
    assert (result.ticks, result.sim_time_s, result.real_time_factor) == (10, 1.0, 2.0)
    assert (result.late_commands, result.commands_total) == (3, 11)
    assert result.recording is not None
    assert result.recording.lost == 1
    assert result.per_robot[0].restarts == 2
    assert result.state_hash is None  # real time is not repeatable


def test_summary_is_null_where_nothing_applies() -> None:
    film = Film(LONE)
    film.shoot(body(0.0, 0.0))
    result = film.summary
    assert result.min_clearance_obstacle_m is None
    assert result.min_clearance_robot_m is None
    assert result.makespan_s is None
    assert result.path_ratio_mean is None
    assert result.formation is None
    assert result.wall_time_s is None
    assert result.real_time_factor is None
    assert result.recording is None
    assert (result.priority.grants, result.priority.double_grants) == (0, 0)
    assert b"Infinity" not in msgspec.json.encode(result)


# --- gaps ---------------------------------------------------------------------------------------


def test_grants_of_gaps_are_counted_and_those_to_both_sides_at_once() -> None:
    film = Film(PAIR)
    there, back, elsewhere = (
        Passage(True, (2.0, 0.0), (1.0, 0.0), 3),
        Passage(True, (2.8, 0.1), (-1.0, 0.0), 5),
        Passage(True, (2.0, 9.0), (-1.0, 0.0), 5),
    )
    wants = msgspec.structs.replace(there, holds=False)

    def shoot(one: Passage | None, other: Passage | None, times: int = 1) -> None:
        film.shoot(
            body(0.0, 0.0, beacon("a", 0, passage=one)),
            body(0.0, -2.0, beacon("b", 0, passage=other)),
            times=times,
        )

    def counted() -> tuple[int, int]:
        priority = film.summary.priority
        return priority.grants, priority.double_grants

    shoot(wants, None, 3)
    assert counted() == (0, 0)
    shoot(there, elsewhere, 3)
    assert counted() == (2, 0)
    shoot(there, back, 3)
    assert counted() == (2, 1)
    shoot(None, back)
    shoot(there, back)
    assert counted() == (3, 2)


# --- arriving -----------------------------------------------------------------------------------


def test_arrival_is_the_first_tick_of_the_final_unbroken_stay() -> None:
    film = Film(LONE)  # goal (3, 4), tolerance 0.1 m
    for y_m in (0.0, 3.95, 3.8, 3.9000001, 4.0, 4.05):
        film.shoot(body(3.0, y_m))
    row = film.summary.per_robot[0]
    assert row.outcome == "arrived"
    assert row.arrival_s == pytest.approx(0.3)
    assert row.final_error_m == pytest.approx(0.05)
    assert film.summary.makespan_s == pytest.approx(0.3)


def test_path_ratio_is_the_way_gone_over_the_straight_one() -> None:
    film = Film(LONE)
    for place in ((0.0, 0.0), (3.0, 0.0), (3.0, 4.0)):  # 7 m instead of 5
        film.shoot(body(*place))
    assert film.summary.per_robot[0].path_m == pytest.approx(7.0)
    assert film.summary.path_ratio_mean == pytest.approx(7.0 / 5.0)


def test_path_ratio_leads_through_the_way_points() -> None:
    film = Film(LONE + "via = [[3.0, 0.0]]\n")
    for place in ((0.0, 0.0), (3.0, 0.0), (3.0, 4.0)):
        film.shoot(body(*place))
    assert film.summary.path_ratio_mean == pytest.approx(1.0)


def test_path_ratio_of_a_follower_ends_at_its_final_slot() -> None:
    film = Film(CONVOY)
    film.convoy((0.0, 0.0), (-1.0, 0.0), (-2.0, 0.0))
    film.convoy((5.0, 3.0), (4.0, 4.0), (3.0, 3.0))
    film.convoy((10.0, 0.0), (9.0, 0.0), (8.0, 0.0))
    ratio = (sqrt(34.0) * 2.0 + sqrt(41.0) * 2.0 + sqrt(34.0) * 2.0) / 30.0
    assert film.summary.path_ratio_mean == pytest.approx(ratio)


@pytest.mark.parametrize(
    ("b_error_m", "a_x_m", "arrived"),
    [(0.079, 9.91, 3), (0.081, 9.91, 2), (0.0, 9.89, 0)],  # tolerances 0.08 m and 0.1 m
)
def test_followers_arrive_in_their_slots_once_the_leader_has(
    b_error_m: float, a_x_m: float, arrived: int
) -> None:
    film = Film(CONVOY)
    film.convoy((a_x_m, 0.0), (a_x_m - 1.0, b_error_m), (a_x_m - 2.0, 0.0))
    assert film.summary.arrived == arrived


def test_ended_two_seconds_after_the_last_arrival() -> None:
    film = Film(PAIR)
    film.shoot(body(3.0, 4.0), body(0.0, -2.0), times=5)
    film.shoot(body(3.0, 4.0), body(3.0, -2.0), times=20)
    assert metrics.ended(film.score) is None
    film.shoot(body(3.0, 4.0), body(3.0, -2.0))
    assert metrics.ended(film.score) == "arrived"
    assert film.summary.outcome == "succeeded"
    assert film.summary.makespan_s == pytest.approx(0.5)


def test_ended_waits_ten_more_seconds_while_the_formation_is_worse_than_expected() -> None:
    film = Film(CONVOY + "[expect]\nformation_error_m_final = 0.02\n")
    film.convoy((10.0, 0.0), (9.0, 0.05), (8.0, 0.0), times=120)
    assert metrics.ended(film.score) is None
    film.convoy((10.0, 0.0), (9.0, 0.05), (8.0, 0.0))
    assert metrics.ended(film.score) == "arrived"
    patient = Film(CONVOY + "[expect]\nformation_error_m_final = 0.02\n")
    patient.convoy((10.0, 0.0), (9.0, 0.05), (8.0, 0.0), times=30)
    patient.convoy((10.0, 0.0), (9.0, 0.019), (8.0, 0.0))
    assert metrics.ended(patient.score) == "arrived"


def test_ended_at_the_duration_in_a_timeout_or_without_goals_in_success() -> None:
    film = Film(PAIR.replace("30.0", "1.0"))
    film.shoot(body(0.0, 0.0), body(3.0, -2.0), times=10)
    assert metrics.ended(film.score) is None
    film.shoot(body(0.0, 0.0), body(3.0, -2.0))
    assert metrics.ended(film.score) == "timeout"
    assert film.summary.outcome == "timeout"
    assert film.summary.makespan_s is None
    assert [row.outcome for row in film.summary.per_robot] == ["timeout", "arrived"]
    idle = Film(HEAD.replace("30.0", "1.0") + "[line]\ncount = 2\n")
    idle.shoot(body(0.0, 0.0), body(0.0, 1.5), times=11)
    assert metrics.ended(idle.score) == "duration"
    assert idle.summary.outcome == "succeeded"
    assert idle.summary.arrived == 2
    assert idle.summary.per_robot[0].arrival_s is None


def test_ended_when_nobody_is_left_to_arrive() -> None:
    film = Film(PAIR)
    film.shoot(body(0.0, 0.0, alive=False), body(0.0, -2.0))
    assert metrics.ended(film.score) is None
    film.shoot(body(0.0, 0.0, alive=False), body(0.0, -2.0, contact=True))
    assert metrics.ended(film.score) == "stranded"


# --- outcomes -----------------------------------------------------------------------------------

KILL = Event(1, 100_000_000, "fault", "b", "kill", fault="kill")
LOST = Event(1, 100_000_000, "robot-lost", "b")


@pytest.mark.parametrize(
    ("a", "b", "event", "outcomes", "outcome"),
    [
        ({}, {"alive": False}, KILL, ["arrived", "killed"], "succeeded"),
        ({}, {"alive": False}, LOST, ["arrived", "failed"], "failed"),
        ({}, {"contact": True}, None, ["arrived", "collided"], "collided"),
        ({"contact": True}, {"alive": False}, LOST, ["collided", "failed"], "collided"),
        ({"alive": False}, {"alive": False}, KILL, ["failed", "killed"], "failed"),
    ],
)
def test_outcome_says_the_worst_that_happened(
    a: dict[str, bool],
    b: dict[str, bool],
    event: Event | None,
    outcomes: list[str],
    outcome: str,
) -> None:
    film = Film(PAIR)
    film.shoot(body(3.0, 4.0), body(0.0, -2.0))
    events = () if event is None else (event,)
    robots = (body(3.0, 4.0, **a), body(0.0, -2.0, **b))  # type: ignore[arg-type]
    film.shoot(*robots, events=events)
    film.shoot(*robots)
    assert [row.outcome for row in film.summary.per_robot] == outcomes
    assert film.summary.outcome == outcome


def test_outcome_is_failed_when_every_robot_was_killed() -> None:
    film = Film(LONE)
    film.shoot(body(0.0, 0.0))
    film.shoot(
        body(0.0, 0.0, alive=False), events=(Event(1, 0, "fault", "a", "kill", fault="kill"),)
    )
    assert film.summary.per_robot[0].outcome == "killed"
    assert film.summary.outcome == "failed"


def test_outcome_is_that_of_the_others_when_a_fault_excuses_a_contact() -> None:
    film = Film(PAIR)
    film.shoot(body(3.0, 4.0), body(0.0, -2.0))
    touched = msgspec.structs.replace(body(0.0, -2.0, contact=True), excused=True)
    film.shoot(body(3.0, 4.0), touched)
    result = film.summary
    assert [row.outcome for row in result.per_robot] == ["arrived", "collided"]
    assert (result.collisions, result.collisions_excused) == (0, 1)
    assert result.outcome == "succeeded"
    assert result.makespan_s == 0.0
    film.shoot(body(3.0, 4.0, contact=True), touched)
    assert (film.summary.collisions, film.summary.collisions_excused) == (1, 1)
    assert film.summary.outcome == "collided"


def test_outcome_is_failed_when_excused_contacts_leave_nobody() -> None:
    film = Film(LONE)
    film.shoot(msgspec.structs.replace(body(0.0, 0.0, contact=True), excused=True))
    assert film.summary.outcome == "failed"


def test_faults_have_a_row_for_each_robot_and_last_until_they_are_over() -> None:
    film = Film(PAIR)
    begun = tuple(
        Event(0, 0, "fault", name, "loss", fault="loss", number=number)
        for name, number in (("a", 0), ("b", 0), ("b", 1))
    )
    film.shoot(body(3.0, 4.0), body(0.0, -2.0), events=begun)
    over = Event(1, 0, "fault-over", "b", "loss", fault="loss", number=0)
    film.shoot(body(3.0, 4.0), body(0.0, -2.0), events=(over,))
    film.shoot(body(3.0, 4.0), body(0.0, -2.0, alive=False), events=(LOST,))
    result = film.summary
    assert [(row.kind, row.target, row.tick, row.over_s) for row in result.faults] == [
        ("loss", "a", 0, None),
        ("loss", "b", 0, 0.1),
        ("loss", "b", 0, None),
    ]
    assert [row.detected_s for row in result.faults] == [None, None, None]
    assert result.per_robot[1].outcome == "failed"  # lost all the same: links are no excuse


def test_outcome_forgets_a_kill_when_the_robot_is_back() -> None:
    film = Film(PAIR)
    film.shoot(body(3.0, 4.0), body(0.0, -2.0))
    film.shoot(body(3.0, 4.0), body(0.0, -2.0, alive=False), events=(KILL,))
    film.shoot(body(3.0, 4.0), body(0.0, -2.0))
    film.shoot(body(3.0, 4.0), body(0.0, -2.0, alive=False), events=(LOST,))
    assert film.summary.per_robot[1].outcome == "failed"


def test_outcome_is_no_excuse_when_a_fault_hits_a_robot_already_lost() -> None:
    film = Film(PAIR)
    film.shoot(body(3.0, 4.0), body(0.0, -2.0, alive=False), events=(LOST,))
    film.shoot(body(3.0, 4.0), body(0.0, -2.0, alive=False), events=(KILL,))
    assert film.summary.per_robot[1].outcome == "failed"


def test_run_ends_two_seconds_after_the_last_has_arrived_or_given_up() -> None:
    film = Film(PAIR)
    no_way = msgspec.structs.replace(beacon("b", 0, mode="FAILED"), reason="enclosed")
    film.shoot(body(0.0, 0.0), body(0.0, -2.0, no_way), times=30)
    assert metrics.ended(film.score) is None
    film.shoot(body(3.0, 4.0), body(0.0, -2.0, no_way), times=20)
    assert metrics.ended(film.score) is None
    film.shoot(body(3.0, 4.0), body(0.0, -2.0, no_way))
    assert metrics.ended(film.score) == "blocked"
    rows = film.summary.per_robot
    assert [(row.outcome, row.reason) for row in rows] == [("arrived", ""), ("blocked", "enclosed")]
    met, missed = metrics.check(Expect(blocked=1, arrived=2), film.summary)
    assert (met, missed) == (["blocked >= 1: 1"], ["arrived >= 2: 1"])


def test_run_goes_on_when_a_robot_recovers() -> None:
    film = Film(LONE)
    film.shoot(body(1.0, 0.0, beacon("a", 0, mode="FAILED")), times=19)
    film.shoot(body(1.0, 0.0, beacon("a", 0)))
    film.shoot(body(1.0, 0.0, beacon("a", 0, mode="FAILED")), times=20)
    assert metrics.ended(film.score) is None
    film.shoot(body(1.0, 0.0, beacon("a", 0, mode="FAILED")))
    assert metrics.ended(film.score) == "blocked"


def test_outcome_is_blocked_when_a_robot_has_given_up() -> None:
    film = Film(LONE)
    film.shoot(body(1.0, 0.0, beacon("a", 0, mode="FAILED")))
    assert film.summary.per_robot[0].outcome == "blocked"
    assert film.summary.outcome == "timeout"


def test_collisions_count_the_bodies_that_touched() -> None:
    film = Film(PAIR)
    film.shoot(body(0.0, 0.0), body(0.0, -2.0))
    film.shoot(body(0.0, -1.0, contact=True), body(0.0, -1.44, contact=True))
    assert film.summary.collisions == 2


# --- clearances, waiting, guards ----------------------------------------------------------------


def test_clearances_are_the_smallest_ever_between_surfaces_of_the_living() -> None:
    film = Film(PAIR)
    film.shoot(body(0.0, 0.0, clearance_m=2.0), body(0.0, -2.0, clearance_m=3.0))
    film.shoot(body(0.0, 0.0, clearance_m=0.7), body(0.0, -1.0, clearance_m=3.0))
    film.shoot(body(0.0, 0.0, clearance_m=0.9), body(0.0, -2.0, clearance_m=0.1, alive=False))
    assert film.summary.min_clearance_obstacle_m == 0.7
    assert film.summary.min_clearance_robot_m == pytest.approx(1.0 - 0.44)
    film.shoot(body(0.0, -1.3, clearance_m=0.9), body(0.0, -2.0, alive=False))
    assert film.summary.min_clearance_robot_m == pytest.approx(0.7 - 0.44)  # one of them lives
    film.shoot(body(0.0, -1.4, alive=False), body(0.0, -2.0, alive=False))
    assert film.summary.min_clearance_robot_m == pytest.approx(0.7 - 0.44)


def test_yields_count_how_often_and_waiting_how_long() -> None:
    film = Film(PAIR)
    for name in (None, "b", "b", None, "b", "c", None):
        film.shoot(body(0.0, 0.0, beacon("a", 0, yields_to=name)), body(0.0, -2.0))
    row = film.summary.per_robot[0]
    assert row.yields == 2
    assert row.waiting_s == pytest.approx(0.4)
    assert film.summary.priority.yields == 2
    assert film.summary.priority.waiting_s_max == pytest.approx(0.4)


def test_guard_interventions_count_when_a_guard_begins_to_hold_back() -> None:
    film = Film(LONE)
    for held in ("", "brake", "b", "", "brake"):
        film.shoot(body(0.0, 0.0), held=held)
    assert film.summary.priority.guard_interventions == 2


# --- formation ----------------------------------------------------------------------------------


def test_formation_error_is_from_the_slot_behind_the_leaders_published_heading() -> None:
    film = Film(CONVOY)
    film.convoy((0.0, 0.0), (-1.0, 0.0), (-2.0, 0.3))
    film.convoy((1.0, 1.0), (1.0, 0.0), (1.0, -0.9), heading_rad=pi / 2.0)  # slots (1, 0), (1, -1)
    formation = film.summary.formation
    assert formation is not None
    assert formation.error_m_max == pytest.approx(0.3)
    assert formation.error_m_final == pytest.approx(0.1)
    assert metrics.formation_error_now(film.score, "c") == pytest.approx(0.1)
    assert metrics.formation_error_now(film.score, "a") is None  # a leader has no slot
    errors_m = [row.final_error_m for row in film.summary.per_robot]
    assert errors_m == pytest.approx([sqrt(82.0), 0.0, 0.1], abs=1e-12)


def test_formation_error_counts_a_positive_bearing_to_the_right() -> None:
    right = CONVOY.replace("[-1.0, 0.0, 0.0]", "[-1.0, -1.0, 0.0]")  # like robot2 of Table I
    film = Film(right)
    slot = film.plan.slot(1)
    assert slot is not None
    assert slot.bearing_rad == pytest.approx(pi / 4.0)
    film.convoy((5.0, 0.0), (4.0, -1.0), (3.0, 0.0))
    assert metrics.formation_error_now(film.score, "b") == pytest.approx(0.0, abs=1e-12)


def test_formation_error_follows_the_leader_and_slot_that_an_election_gave() -> None:
    film = Film(CONVOY)
    film.convoy((0.0, 0.0), (-1.0, 0.0), (-2.0, 0.0))
    a = body(0.0, 0.0, beacon("a", 0, leadership=A_LEADS), alive=False)
    orphans = [
        body(x, 0.0, beacon(n, 0, leadership=A_LEADS)) for n, x in (("b", -1.0), ("c", -2.0))
    ]
    kill = Event(1, 0, "fault", "a", "kill", fault="kill")
    film.shoot(a, *orphans, events=(kill,))
    assert metrics.formation_error_now(film.score, "b") is None  # nobody to be measured by
    b = body(9.95, 0.0, beacon("b", 0, leadership=B_LEADS, goal=(10.0, 0.0)))
    film.shoot(a, b, orphans[1])
    c = body(8.8, 0.0, beacon("c", 0, leadership=B_LEADS, slot=Slot(1.0, 0.0)))
    film.shoot(a, b, c)
    c = body(9.0, 0.0, beacon("c", 0, leadership=B_LEADS, slot=Slot(1.0, 0.0)))
    film.shoot(a, b, c)
    result = film.summary
    assert metrics.formation_error_now(film.score, "c") == pytest.approx(0.05)
    assert [row.outcome for row in result.per_robot] == ["killed", "arrived", "arrived"]
    # b leads from tick 2, but c agrees in tick 3, and is near its slot in tick 4.
    assert [(row.tick, row.name, row.term) for row in result.leaders] == [(0, "a", 0), (3, "b", 1)]
    (fault,) = result.faults
    assert (fault.kind, fault.target, fault.tick) == ("kill", "a", 1)
    assert fault.detected_s == pytest.approx(0.2)
    assert fault.recovered_s == pytest.approx(0.3)


def test_old_leader_that_follows_is_measured_by_its_slot() -> None:
    film = Film(CONVOY)
    b = body(5.0, 0.0, beacon("b", 0, leadership=B_LEADS, goal=(10.0, 0.0)))
    a = body(3.7, 0.0, beacon("a", 0, leadership=B_LEADS, slot=Slot(1.0, 0.0)))
    c = body(3.0, 0.0, beacon("c", 0, leadership=B_LEADS, slot=Slot(2.0, 0.0)))
    film.shoot(a, b, c)
    assert metrics.formation_error_now(film.score, "a") == pytest.approx(0.3)
    assert metrics.formation_error_now(film.score, "b") is None


def test_leaders_are_named_when_all_who_live_agree() -> None:
    film = Film(CONVOY)
    rivals = [A_LEADS, B_LEADS, B_LEADS]

    def shoot(a_lives: bool, *claims: Leadership, silent: bool = False) -> None:
        names = ("a", "b", "c")
        said = [
            beacon(name, 0, leadership=claim, silent=silent)
            for name, claim in zip(names, claims, strict=True)
        ]
        film.shoot(
            body(0.0, 0.0, said[0], alive=a_lives), body(1.0, 0.0, said[1]), body(2.0, 0.0, said[2])
        )

    shoot(True, *rivals)
    shoot(True, A_LEADS, A_LEADS, A_LEADS, silent=True)  # who is silent is not followed
    shoot(False, A_LEADS, A_LEADS, A_LEADS)  # nor is it agreed while the leader is dead
    assert film.summary.leaders == []
    shoot(False, *rivals)
    shoot(True, *rivals)
    shoot(True, B_LEADS, B_LEADS, B_LEADS)
    assert [(row.tick, row.name, row.term) for row in film.summary.leaders] == [(3, "b", 1)]


def test_settling_runs_from_the_last_leaving_of_avoid_until_all_errors_are_small() -> None:
    film = Film(CONVOY)
    for mode, error_m in (
        ("FORM", 0.0),
        ("AVOID", 0.5),
        ("AVOID", 0.5),
        ("FORM", 0.3),  # tick 3: it has left
        ("FORM", 0.1),
        ("FORM", 0.09),  # tick 5: below 0.1
        ("FORM", 0.0),
    ):
        film.convoy((0.0, 0.0), (-1.0, error_m), (-2.0, 0.0), modes=mode)  # type: ignore[arg-type]
    formation = film.summary.formation
    assert formation is not None
    assert formation.settling_s == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("modes", "errors_m", "settling_s"),
    [
        (("FORM", "FORM"), (0.5, 0.0), None),  # never in AVOID
        (("AVOID", "FORM"), (0.5, 0.5), None),  # never settled
        (("FORM", "AVOID"), (0.0, 0.0), None),  # still in AVOID
        (("AVOID", "FORM"), (0.05, 0.0), 0.0),  # never unsettled
    ],
)
def test_settling_is_null_when_it_does_not_apply_or_never_came(
    modes: tuple[Mode, ...], errors_m: tuple[float, ...], settling_s: float | None
) -> None:
    film = Film(CONVOY)
    for mode, error_m in zip(modes, errors_m, strict=True):
        film.convoy((0.0, 0.0), (-1.0, error_m), (-2.0, 0.0), modes=mode)
    formation = film.summary.formation
    assert formation is not None
    assert formation.settling_s == settling_s


def test_symmetry_is_the_worst_of_both_coordinates_over_pairs_and_ticks() -> None:
    film = Film(CONVOY + '[expect]\nmirror_pairs = [["b", "c"]]\n')
    film.convoy((0.0, 0.0), (-1.0, 1.0), (-1.02, -1.0))
    film.convoy((0.0, 0.0), (-1.0, 1.0), (-1.0, -1.03))
    film.convoy((0.0, 0.0), (-1.0, 1.0), (-1.01, -1.0))
    formation = film.summary.formation
    assert formation is not None
    assert formation.symmetry_m == pytest.approx(0.03)


# --- state hash ---------------------------------------------------------------------------------


def test_state_hash_is_the_documented_stream() -> None:
    film = Film(LONE)
    said = beacon("a", 0, leadership=A_LEADS)
    film.shoot(body(1.0, 2.0, yaw_rad=0.5))
    film.shoot(body(1.5, 2.0, said, contact=True, alive=False))
    encoded = msgspec.msgpack.encode(said)
    stream = struct.pack("<q", 0)
    stream += b"\x01" + struct.pack("<5d", 1.0, 2.0, 0.5, 0.5, 0.1) + b"\x00"
    stream += struct.pack("<2d", 0.6, 0.2) + struct.pack("<I", 0)
    stream += struct.pack("<q", 1)
    stream += b"\x00" + struct.pack("<5d", 1.5, 2.0, 0.0, 0.5, 0.1) + b"\x01"
    stream += struct.pack("<2d", 0.6, 0.2) + struct.pack("<I", len(encoded)) + encoded
    assert film.summary.state_hash == hashlib.sha256(stream).hexdigest()


def test_state_hash_ignores_traces_events_and_the_shell() -> None:
    plain, other = Film(LONE), Film(LONE)
    plain.shoot(body(0.0, 0.0))
    other.shoot(
        body(0.0, 0.0, clearance_m=0.5), held="brake", events=(Event(0, 0, "start", None, "hello"),)
    )
    facts = metrics.Facts(scenario="x", run="run2", bus="zenoh", wall_time_s=3.0)
    assert plain.summary.state_hash == metrics.summary(other.score, facts).state_hash


# --- expectations -------------------------------------------------------------------------------


def test_check_compares_each_key_in_its_direction() -> None:
    film = Film(PAIR)
    film.shoot(body(0.0, 0.0, clearance_m=0.4), body(0.0, -2.0, clearance_m=0.5))
    film.shoot(body(3.0, 4.0, clearance_m=0.4), body(2.0, -2.0, clearance_m=0.5))
    expect = Expect(
        outcome="succeeded",
        arrived=1,
        collisions=0,
        path_ratio_mean=0.9,
        min_clearance_obstacle_m=0.3,
        min_clearance_robot_m=2.0,
        formation_error_m_final=0.1,
        priority_waiting_s_max=0.0,
    )
    met, missed = metrics.check(expect, film.summary)
    assert met == [
        "arrived >= 1: 1",
        "collisions <= 0: 0",
        "min_clearance_obstacle_m >= 0.3: 0.4",
        "priority_waiting_s_max <= 0: 0",
    ]
    assert missed == [
        "outcome == succeeded: timeout",
        "path_ratio_mean <= 0.9: 1",
        "min_clearance_robot_m >= 2: 1.56",
        "formation_error_m_final <= 0.1: none",
    ]


def test_check_knows_every_key_that_a_scenario_may_expect() -> None:
    film = Film(CONVOY + '[expect]\nmirror_pairs = [["b", "c"]]\n')
    film.convoy((10.0, 0.0), (9.0, 0.0), (8.0, 0.0))
    keys = [key for key in Expect.__struct_fields__ if key != "mirror_pairs"]
    limits = {key: "succeeded" if key == "outcome" else 1 for key in keys}
    met, missed = metrics.check(Expect(**limits), film.summary)  # type: ignore[arg-type]
    assert sorted(text.split(" ")[0] for text in met + missed) == sorted(keys)


def test_summary_holds_what_the_scenario_expects() -> None:
    film = Film(LONE + "[expect]\narrived = 1\ncollisions = 0\n")
    film.shoot(body(0.0, 0.0))
    assert film.summary.expect.met == ["collisions <= 0: 0"]
    assert film.summary.expect.missed == ["arrived >= 1: 0"]
