"""The paper again: measures of claims on runs made by hand, the table, and one figure for real."""

from __future__ import annotations

import html.parser
import importlib.resources
import json
import struct
from collections.abc import Callable, Iterator, Sequence
from math import atan2, cos, pi, radians, sin
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dashboards import tracks
from swarm import messages, metrics, recording, runs, scenario
from swarm.geometry import STILL, Pose, Vec2
from swarm.messages import Beacon, Command, Forces, Leadership, RobotRecord, TickRecord, Trace
from swarm.run import library, reproduce
from swarm.run.reproduce import claims, encounters
from swarm.run.reproduce.claims import Run
from swarm.scenario import Scenario
from tests.run import processes
from world import scene

Ways = dict[str, list[Vec2]]  # corners of the way of each robot; others stand at their starts

TICKS = 200


def built_in(name: str) -> Scenario:
    data = importlib.resources.files("world.scenarios").joinpath(f"{name}.toml").read_bytes()
    return scenario.decode(data, name)


def made_run(
    plan: Scenario,
    ways: Ways,
    *,
    force_off_rad: Callable[[int], float] = lambda tick: 0.0,
    waits: dict[str, range] | None = None,
    avoids: range = range(0),
    touches: str | None = None,
) -> Run:
    """Run of robots that go along their ways at even paces, everyone heading along +x.

    Args:
        force_off_rad: angle of the force from the heading at a tick.
        waits: ticks in which a robot yields; avoids: ticks in which followers are in AVOID.
    """
    records = []
    corners = {robot.name: ways.get(robot.name, [robot.start[:2]]) for robot in plan.robots}
    for tick in range(TICKS):
        places = {name: place(way, tick / (TICKS - 1)) for name, way in corners.items()}
        records.append(made_tick(plan, tick, places, force_off_rad, waits or {}, avoids, touches))
    score = metrics.begin(plan)
    for record in records:
        metrics.observe(score, record)
    facts = metrics.Facts(scenario="made", run="made", bus="memory")
    return Run(metrics.summary(score, facts), tracks.collect(plan, scene.obstacles(plan), records))


def made_tick(
    plan: Scenario,
    tick: int,
    places: dict[str, Vec2],
    force_off_rad: Callable[[int], float],
    waits: dict[str, range],
    avoids: range,
    touches: str | None,
) -> TickRecord:
    robots, commands = [], []
    stamp_ns = plan.stamp_ns(tick)
    for row, robot in enumerate(plan.robots):
        pose = Pose(*places[robot.name], 0.0)
        slot = plan.slot(row)
        beacon = Beacon(
            name=robot.name,
            tick=tick,
            incarnation=0,
            pose=pose,
            twist=STILL,
            body_radius_m=0.22,
            speed_mps_max=1.0,
            mode="GO" if slot is None else "AVOID" if tick in avoids else "FORM",
            arrived=False,
            priority=(1, 0, 0, row),
            slot=slot,
            leadership=None
            if plan.formation is None
            else Leadership(0, (0, 0, 0, 0), plan.formation.leader),
            yields_to=plan.robots[row - 1].name if tick in waits.get(robot.name, ()) else None,
        )
        touch = robot.name == touches
        robots.append(RobotRecord(True, touch, pose, STILL, STILL, beacon, 1.0))
        angle_rad = force_off_rad(tick)
        trace = Trace(
            messages.array(np.zeros(0, np.float32)),
            forces=Forces(resultant=(50.0 * cos(angle_rad), 50.0 * sin(angle_rad))),
        )
        commands.append(Command(robot.name, tick, stamp_ns, STILL, beacon, trace))
    return TickRecord(tick, stamp_ns, tuple(robots), (), tuple(commands))


def place(way: Sequence[Vec2], share: float) -> Vec2:
    """Point at a share of the corners passed, straight between them."""
    at = share * (len(way) - 1)
    first = min(int(at), len(way) - 2) if len(way) > 1 else 0
    if len(way) == 1:
        return way[0]
    (x0, y0), (x1, y1) = way[first], way[first + 1]
    part = at - first
    return x0 + part * (x1 - x0), y0 + part * (y1 - y0)


def formation_way(plan: Scenario, off_m: dict[str, float] | None = None) -> Ways:
    """Everyone goes straight to its final slot; `off_m` puts some beside theirs in y."""
    leader = plan.robots[0]
    assert leader.goal is not None
    d_x, d_y = leader.goal[0] - leader.start[0], leader.goal[1] - leader.start[1]
    return {
        one.name: [
            one.start[:2],
            (one.start[0] + d_x, one.start[1] + d_y + (off_m or {}).get(one.name, 0.0)),
            (one.start[0] + d_x, one.start[1] + d_y + (off_m or {}).get(one.name, 0.0)),
        ]
        for one in plan.robots
    }


# --- claims ---------------------------------------------------------------------------------------


def test_arrival_without_contact_is_met_only_by_all() -> None:
    plan = built_in("two-obstacles")
    good = made_run(plan, formation_way(plan))
    verdict = claims.all_arrive_without_contact([good])
    assert verdict.met
    assert verdict.ours == "6 of 6 arrive, 0 contacts, 1.000 m from obstacles, 0.974 m from robots"
    late = made_run(plan, formation_way(plan, {"robot4": 0.3}))
    assert claims.all_arrive_without_contact([late]).ours.startswith("5 of 6 arrive")
    assert not claims.all_arrive_without_contact([good, late]).met
    touched = made_run(plan, formation_way(plan), touches="robot2")
    assert not claims.all_arrive_without_contact([touched]).met


@pytest.mark.parametrize(("apart_m", "met"), [(0.491, True), (0.489, False)])
def test_robots_stay_apart_when_their_surfaces_do(apart_m: float, met: bool) -> None:
    plan = built_in("two-obstacles")
    run = made_run(plan, {"robot1": [(-1.0, 1.0), (apart_m, 1.0), (apart_m, 0.0)]})
    assert claims.stays_apart([run]).met is met


FORCES: dict[str, tuple[Callable[[int], float], bool]] = {
    "along": (lambda tick: 0.0, True),
    "always a little beside": (lambda tick: radians(4.9), True),
    "always too much beside": (lambda tick: -radians(5.1), False),
    "reversed for 19 %": (lambda tick: pi if tick % 100 < 19 else 0.0, True),
    "reversed for 21 %": (lambda tick: pi if tick % 100 < 21 else 0.0, False),
}


@pytest.mark.parametrize("name", FORCES)
def test_force_matches_the_trajectory_when_it_points_there(name: str) -> None:
    angle, met = FORCES[name]
    plan = built_in("single-robot")
    run = made_run(plan, {}, force_off_rad=angle)
    assert claims.force_matches_trajectory([run]).met is met
    along = made_run(plan, {})
    assert claims.force_matches_trajectory([along, run]).met is met  # the worst run counts


def test_first_passes_when_only_others_wait() -> None:
    plan = built_in("head-on-star")
    others = made_run(plan, {}, waits={"robot2": range(10, 35), "robot6": range(50, 60)})
    verdict = claims.first_passes_others_wait([others])
    assert verdict.met
    assert verdict.ours == "robot1 waits 0.0 s, the others 2.8 s together"
    assert not claims.nobody_waits([others]).met
    first = made_run(plan, {}, waits={"robot1": range(3, 4), "robot2": range(10, 35)})
    assert not claims.first_passes_others_wait([first]).met
    nobody = made_run(plan, {})
    assert not claims.first_passes_others_wait([nobody]).met
    assert claims.nobody_waits([nobody]).met


@pytest.mark.parametrize(("off_m", "met"), [(0.0499, True), (0.0501, False)])
def test_mirrors_holds_for_paths_that_are_images(off_m: float, met: bool) -> None:
    plan = built_in("two-obstacles")
    assert claims.mirrors([made_run(plan, formation_way(plan, {"robot5": off_m}))]).met is met


@pytest.mark.parametrize(("off_m", "met"), [(-0.0099, True), (0.0101, False)])
def test_one_line_holds_for_all_named_at_every_tick(off_m: float, met: bool) -> None:
    plan = built_in("two-obstacles")
    ways: Ways = {"robot4": [(-2.0, 0.0), (5.0, off_m), (12.0, 0.0)]}
    measure = claims.on_one_line("leader", "robot4")
    corner = made_run(plan, {**ways, "robot4": [(-2.0, off_m), (12.0, 0.0)]})
    assert measure([corner]).met is met
    assert claims.on_one_line("leader")([corner]).met


@pytest.mark.parametrize(("off_m", "met"), [(0.019, True), (0.021, False)])
def test_errors_converge_when_every_follower_ends_in_its_slot(off_m: float, met: bool) -> None:
    plan = built_in("two-obstacles")
    run = made_run(plan, formation_way(plan, {"robot3": -off_m}))
    verdict = claims.errors_converge([run])
    assert verdict.met is met
    assert f"0.000, 0.000, {off_m:.3f}, 0.000, 0.000 m (<= 0.02 m)" in verdict.ours


def test_reforms_when_errors_are_small_soon_after_the_last_switch() -> None:
    # robot3 leaves its slot by 1 m half way and is back at the end: below 0.1 m from tick 190 on
    plan = built_in("two-obstacles")
    ways = formation_way(plan)
    ways["robot3"] = [(-2.0, 2.0), (7.0, 3.0), (16.0, 2.0)]
    ways = {name: [way[0], place(way, 0.5), way[-1]] for name, way in ways.items()}
    for name, way in ways.items():
        x_m = (way[0][0] + way[2][0]) / 2.0
        ways[name] = [way[0], (x_m, way[1][1]), way[2]]
    soon = made_run(plan, ways, avoids=range(50, 160))
    verdict = claims.reforms([soon])
    assert verdict.met
    assert verdict.ours == "settles 2.40 s after the last switch (<= 3 s)"
    late = made_run(plan, ways, avoids=range(50, 150))
    assert not claims.reforms([late]).met
    never = made_run(plan, formation_way(plan, {"robot3": 0.5}), avoids=range(5))
    assert claims.reforms([never]).ours == "never settles"


START, GAP, END = (-2.0, 2.0), (7.0, 0.3), (22.0, 1.6)
WAYS_PAST_THE_THIRD: dict[str, tuple[list[Vec2], bool]] = {
    "rises, turns back and passes below": ([START, GAP, (10.0, 1.0), (14.0, -1.1), END], True),
    "only its centre passes below": (
        [START, GAP, (10.0, 1.0), (13.0, -0.41), (15.0, -0.41), END],
        False,
    ),
    "its body just passes below": (
        [START, GAP, (10.0, 1.0), (13.0, -0.43), (15.0, -0.43), END],
        True,
    ),
    "passes above": ([START, GAP, (10.0, 1.0), (14.0, 3.2), END], False),
    "goes down from the gap on": ([START, GAP, (10.0, -0.5), (14.0, -1.1), END], False),
    "was below already": ([START, GAP, (9.0, -0.6), (10.0, -0.5), (14.0, -0.9), END], False),
    "comes back and passes above after all": (
        [START, GAP, (10.0, 1.0), (14.5, -1.1), (13.0, 3.2), (14.5, 3.3), END],
        False,
    ),
    "never gets there": ([START, GAP, (10.0, 1.0), (13.0, -1.0)], False),
}


@pytest.mark.parametrize("name", WAYS_PAST_THE_THIRD)
def test_turn_back_and_pass_below_reads_the_recorded_path(name: str) -> None:
    way, met = WAYS_PAST_THE_THIRD[name]
    run = made_run(built_in("three-obstacles"), {"robot3": way})
    assert claims.turn_back_and_pass_below("robot3")([run]).met is met


# --- the table ------------------------------------------------------------------------------------


def test_figures_cover_every_one_of_the_paper() -> None:
    known = reproduce.figures()
    assert set(known) >= {f"fig{number}" for number in range(10, 19)}
    for name, figure in known.items():
        made = {experiment.name for experiment in figure.experiments}
        assert figure.pictures, name
        assert figure.claims, name
        assert {one for picture in figure.pictures for one in picture.of} <= made
        assert {one for claim in figure.claims for one in claim.of} <= made
    pictures = [picture.name for figure in known.values() for picture in figure.pictures]
    assert len(set(pictures)) == len(pictures)


def test_experiments_are_scenarios_that_decode_with_their_settings() -> None:
    plans: dict[str, tuple[str, Scenario]] = {}
    for figure in reproduce.figures().values():
        for one in figure.experiments:
            data = library.built_in()[one.scenario].read_bytes()
            plan = scenario.decode(data, one.name, settings=one.settings, seed=one.seed)
            before = plans.setdefault(one.name, (one.command, plan))
            assert before == (one.command, plan)  # a name means one run, whichever figure asks
    assert len({command for command, _ in plans.values()}) == len(plans)
    assert plans["single-robot-paper-5"][1].seed == 5
    assert plans["star-mutual-paper"][1].field.k_e == encounters.MUTUAL_K_E


def test_torque_figure_is_there_when_robots_can_have_torques() -> None:
    assert "fig13-torque" not in reproduce.figures(robot_fields=["controller"])
    figure = reproduce.figures(robot_fields=["controller", "motion"])["fig13-torque"]
    assert figure.experiments[0].command == "swarm run two-obstacles --set robot.motion=dynamic"
    assert [claim.measure for claim in figure.claims] == [
        claims.all_arrive_without_contact,
        claims.stays_apart,
    ]


def test_formations_expect_what_the_claims_are_measured_by() -> None:
    for name, final_m in (
        ("two-obstacles", 0.02),
        ("three-obstacles", 0.03),
        ("random-field", 0.02),
    ):
        expect = built_in(name).expect
        assert expect.formation_error_m_final == final_m
        assert expect.formation_settling_s == 3.0
    assert built_in("two-obstacles").expect.formation_symmetry_m == 0.05


def test_star_has_three_pairs_that_change_places_through_the_centre() -> None:
    robots = built_in("head-on-star").robots
    for one, other in zip(robots[::2], robots[1::2], strict=True):
        assert one.goal == other.start[:2]
        assert other.goal == one.start[:2]
        for robot in (one, other):
            x_m, y_m, yaw_rad = robot.start
            assert x_m**2 + y_m**2 == pytest.approx(49.0)
            assert tracks.wrap(np.array(atan2(-y_m, -x_m) - yaw_rad)) == pytest.approx(0.0)


# --- for real -------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    processes.end_all(tmp_path)


class Reader(html.parser.HTMLParser):
    """What a page refers to, and the cells of its first table."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.rows = 0
        self.tables = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]
        self.tables += tag == "table"
        self.rows += tag == "tr" and self.tables == 1


def test_reproduce_draws_a_figure_and_meets_its_claims(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done = processes.swarm(
        folder, "reproduce", "fig13", "--bus", "memory", "--out", "out", "--json"
    )
    assert done.returncode == 0, done.stderr
    assert "[1/1] two-obstacles: succeeded" in done.stderr
    assert done.stdout.count("\n") == 1
    found = msgspec.json.decode(done.stdout, type=reproduce.Reproduction)
    assert found.ok
    assert found.bus == "memory"
    assert [claim.met for claim in found.claims] == [True] * 4
    out = folder / "out"
    assert {path.name for path in out.iterdir()} == {"fig13.png", "index.html", "runs"}
    data = (out / "fig13.png").read_bytes()
    assert struct.unpack(">II", data[16:24]) == (1400, 710)
    run = out / "runs" / "two-obstacles"
    assert recording.verify(run / runs.MCAP).complete
    assert not (run / runs.RRD).exists()
    summary = json.loads((run / runs.SUMMARY).read_bytes())
    assert [row.state_hash for row in found.runs] == [summary["state_hash"]]
    reader = Reader()
    reader.feed((out / "index.html").read_text("utf-8"))
    assert reader.rows == 1 + len(found.claims)
    assert all(address.startswith(("data:", "#")) for address in reader.addresses)
    assert sum(address.startswith("data:image/png") for address in reader.addresses) == 1
    again = processes.here(monkeypatch, capsys, folder, "reproduce fig13 --out out")
    assert again.returncode == 2
    assert "expected an empty folder" in again.stderr


def test_claim_that_is_not_met_is_exit_1_and_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(claims, "FORCE_MEDIAN_RAD", -1.0)
    monkeypatch.setattr("setproctitle.setproctitle", lambda title: None)
    line = "reproduce fig11 --seeds 1 --bus memory --out out"
    done = processes.here(monkeypatch, capsys, folder, line)
    assert done.returncode == 1
    assert done.stdout.count("NOT MET") == 2
    assert "0 of 2 claims met, 2 runs" in done.stdout
    assert (folder / "out" / "index.html").read_text("utf-8").count("NOT MET") == 4
