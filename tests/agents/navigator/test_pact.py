"""No two robots touch, whatever they ask for and whatever beacons are lost."""

from __future__ import annotations

import random
from math import cos, pi, sin

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import peers
from agents.navigator import admission, announce, brake, estimate, pact, pledge
from swarm.geometry import STILL, Pose, Twist
from swarm.messages import Beacon
from swarm.run.bench.navigation.cases import NEUTRAL
from swarm.scenario import Disturbance, Robot, Scenario
from tests.agents.navigator import crowd
from world import motion

ROUNDING_M = 1e-6


MAKES = st.builds(
    crowd.Make,
    radius_m=st.sampled_from((0.2, 0.1, 0.5)),
    speed_mps=st.sampled_from((1.0, 0.5, 2.0)),
    acceleration_mps2=st.sampled_from((2.0, 1.0, 4.0)),
    turn_acceleration_radps2=st.sampled_from((8.0, 4.0, 12.0)),
)
CROWDS = st.lists(MAKES, min_size=2, max_size=4)
LOSSES = st.sampled_from((0.0, 0.2, 0.6, 0.9))
SEEDS = st.integers(0, 2**48)
# Errors lean one way, and are the worst declared ones.
DECLARED = Disturbance(position_sigma_m=0.01, yaw_sigma_rad=0.0087, speed_error=0.05)


def test_robots_keep_apart_whatever_they_ask_for(request: pytest.FixtureRequest) -> None:
    count = request.config.getoption("--crowds")
    gone_m = 0.0

    @settings(max_examples=count)
    @given(makes=CROWDS, loss=LOSSES, seed=SEEDS)
    def keep_apart(makes: list[crowd.Make], loss: float, seed: int) -> None:
        nonlocal gone_m
        gap_m, way_m = crowd.least_gap_m(random.Random(seed), makes, loss)
        assert gap_m >= -ROUNDING_M
        gone_m += way_m

    keep_apart()
    assert gone_m > 2.0 * count  # or nobody moves, and nothing is tested


def test_robots_keep_apart_whatever_disturbs_them(request: pytest.FixtureRequest) -> None:
    """Their bodies, where they truly are."""
    count = request.config.getoption("--crowds")
    gone_m = 0.0

    @settings(max_examples=count)
    @given(makes=CROWDS, loss=LOSSES, latency_ticks=st.integers(0, 3), seed=SEEDS)
    def keep_apart(makes: list[crowd.Make], loss: float, latency_ticks: int, seed: int) -> None:
        nonlocal gone_m
        declared = msgspec.structs.replace(DECLARED, latency_ticks=latency_ticks)
        draw = random.Random(seed)
        gap_m, way_m = crowd.least_gap_m(draw, makes, loss, declared=declared)
        assert gap_m >= -ROUNDING_M
        gone_m += way_m

    keep_apart()
    assert gone_m > 2.0 * count


def test_the_guard_decides_alike_compiled_and_plain(monkeypatch: pytest.MonkeyPatch) -> None:
    admit = pact.admit
    plain = getattr(admit, "py_func", admit)
    calls = 0

    def both(*arguments: object) -> None:
        nonlocal calls
        calls += 1
        others = [part.copy() if isinstance(part, np.ndarray) else part for part in arguments]
        with np.errstate(all="ignore"):
            admit(*arguments)
            plain(*others)
        for one, other in zip(arguments, others, strict=True):
            if isinstance(one, np.ndarray):
                assert one.tobytes() == np.asarray(other).tobytes()

    monkeypatch.setattr(pact, "admit", both)
    crowd.least_gap_m(random.Random(2), [crowd.Make(0.2, 1.0, 2.0, 8.0)] * 3, 0.2)
    assert calls > 50


@given(
    yaw_rad=st.floats(-3.1, 3.1),
    speed_mps=st.floats(-0.4, 1.0),
    turn_rate_radps=st.floats(-2.5, 2.5),
)
def test_the_announced_way_is_the_one_that_the_body_goes(
    yaw_rad: float, speed_mps: float, turn_rate_radps: float
) -> None:
    pose = Pose(1.0, -2.0, yaw_rad)
    asked = Twist(speed_mps, turn_rate_radps)
    twist = motion.limited(NEUTRAL, asked, asked, dt_s=0.08)
    brakes = (0.9 * 2.0 * 0.08, 8.0 * 0.08)
    body = [pose.x_m, pose.y_m, cos(yaw_rad), sin(yaw_rad)]
    body += [twist.speed_mps, twist.turn_rate_radps, *brakes]
    told = announce.places(body, 12, 0.08)
    set_point = twist
    for tick in range(12):
        pose, twist = motion.step(NEUTRAL, pose, twist, set_point, dt_s=0.08)
        assert abs(pose.x_m - told[tick, 0]) + abs(pose.y_m - told[tick, 1]) < 1e-9
        set_point = Twist(*brake.slower(twist.speed_mps, twist.turn_rate_radps, *brakes))
    assert twist.speed_mps == 0.0


@given(
    speed_mps=st.floats(-2.0, 2.0),
    turn_rate_radps=st.floats(-4.0, 4.0),
    change=st.tuples(st.floats(-0.3, 0.3), st.floats(-1.0, 1.0)),
)
def test_what_is_reached_is_what_the_world_makes_of_it(
    speed_mps: float, turn_rate_radps: float, change: tuple[float, float]
) -> None:
    asked = Twist(speed_mps, turn_rate_radps)
    twist = motion.limited(NEUTRAL, asked, asked, dt_s=0.08)
    goal = Twist(twist.speed_mps + change[0], twist.turn_rate_radps + change[1])
    world = motion.limited(NEUTRAL, twist, goal, dt_s=0.08)
    v_mps, w_radps = admission.reached(
        twist.speed_mps,
        twist.turn_rate_radps,
        goal.speed_mps,
        goal.turn_rate_radps,
        np.array((2.0 * 0.08, 8.0 * 0.08)),
        np.array((1.0, 0.4, 2.5)),
        NEUTRAL.half_track_m,
    )
    assert abs(v_mps - world.speed_mps) < 1e-12
    assert abs(w_radps - world.turn_rate_radps) < 1e-12


@settings(max_examples=200)
@given(angle_rad=st.floats(-50.0, 50.0))
def test_turns_without_the_sines_of_a_compiler(angle_rad: float) -> None:
    cosine, sine = announce.turn(angle_rad)
    assert abs(cosine - cos(angle_rad)) < 1e-12
    assert abs(sine - sin(angle_rad)) < 1e-12


@pytest.mark.parametrize(
    ("yaw_rad", "asked"), [(0.0, Twist(0.0, 2.0)), (-pi / 2.0, Twist(0.5, 0.0))]
)
def test_who_seems_too_near_all_at_once_may_still_turn_and_leave(
    yaw_rad: float, asked: Twist
) -> None:
    """Noise that shows it nearer to a peer than was announced keeps it from coming nearer only."""
    plan = Scenario(
        title="jam", seed=0, dt_s=0.08, duration_s=60.0, disturbance=DECLARED,
        robots=tuple(
            [Robot(name=name, start=(0.0, y_m, 0.0), goal=(9.0, 0.0), controller="navigator")
             for name, y_m in (("robot1", 0.0), ("robot2", 1.0))]
        ),
    )  # fmt: skip
    mine, other = (plan.setup(row.name) for row in plan.robots)
    doubt = estimate.Doubt(0.02, 0.02)
    told, heard = (pledge.promise(setup, STILL, doubt) for setup in (mine, other))
    stands, beside = Pose(0.0, 0.0, yaw_rad), Pose(0.0, told.keep_m + heard.keep_m, 0.0)
    own, peer = (
        Beacon(name, 0, 0, pose, STILL, 0.2, 1.0, "GO", False, (0, 0, 0, 0), promise=promise)
        for name, pose, promise in (("robot1", stands, told), ("robot2", beside, heard))
    )
    shown = msgspec.structs.replace(stands, y_m=0.01)
    others = peers.now([peer], shown, 1, 0.08)
    where = estimate.State(1, shown, doubt, stands, doubt)
    _, held = pact.hold(
        mine, pact.send(mine, pact.State(), own), 1, shown, STILL, asked, others, [],
        crowd.NOTHING, where, stands,
    )  # fmt: skip
    assert held is not None
    assert held.part == 1.0
    assert held.set_point != STILL
    assert held.corrects == (asked.speed_mps > 0.0)  # away by more than it seems too near


NUMBERS = st.floats(-3.0, 3.0)


@given(st.lists(NUMBERS, min_size=10, max_size=10))
def test_what_is_free_is_shared_and_all_of_it(numbers: list[float]) -> None:
    rows = np.zeros((2, announce.COLUMNS))
    for row, (x_m, y_m, yaw_rad, v_mps, w_radps) in zip(
        rows, (numbers[:5], numbers[5:]), strict=True
    ):
        row[:6] = (x_m, y_m, cos(yaw_rad), sin(yaw_rad), v_mps, w_radps)
    mine, theirs = admission.share(rows[0], rows[1]), admission.share(rows[1], rows[0])
    assert abs(mine + theirs - 1.0) < 1e-12
    assert 1.0 - admission.MOST - 1e-12 <= mine <= admission.MOST + 1e-12


def test_who_follows_may_use_more_of_it_than_who_leads() -> None:
    rows = np.zeros((2, announce.COLUMNS))
    rows[:, 2], rows[:, 4], rows[1, 0] = 1.0, 1.0, 0.7
    assert admission.share(rows[0], rows[1]) == admission.MOST
    rows[1, 2] = -1.0  # they meet
    assert admission.share(rows[0], rows[1]) == admission.EVEN


@given(NUMBERS, NUMBERS, st.floats(-pi, pi), st.floats(0.0, 1.0))
def test_a_move_uses_what_it_uses_along_the_worst_normal_of_a_cone(
    x_m: float, y_m: float, normal_rad: float, sine: float
) -> None:
    normal = np.array((cos(normal_rad), sin(normal_rad)))
    used_m = admission.used(x_m, y_m, normal, sine)
    half_rad = pi if sine >= 1.0 else float(np.arcsin(sine))
    turns = normal_rad + np.linspace(-half_rad, half_rad, 361)
    along_m = (x_m * np.cos(turns) + y_m * np.sin(turns)).max()
    assert along_m - 1e-9 <= used_m <= along_m + 1e-3


@given(
    make=MAKES,
    v_mps=st.floats(-0.3, 1.0),
    w_radps=st.floats(-2.0, 2.0),
    set_v_mps=st.floats(-0.3, 1.0),
    set_w_radps=st.floats(-2.5, 2.5),
    off=st.tuples(*(st.floats(-1.0, 1.0),) * 3),
)
def test_a_newer_announcement_is_no_further_off_than_a_cone_allows_for(
    make: crowd.Make,
    v_mps: float,
    w_radps: float,
    set_v_mps: float,
    set_w_radps: float,
    off: tuple[float, float, float],
) -> None:
    """Poses shown are off by as much as is declared, and the way of a tick too."""
    dt_s, errors = 0.08, np.array((0.03, 0.026, 0.05))
    brakes = (brake.BRAKES_SHARE * make.acceleration_mps2, make.turn_acceleration_radps2)
    before = np.array(
        (
            *(0.3, -0.2, cos(0.4), sin(0.4), make.speed_mps * v_mps, w_radps),
            *(brakes[0] * dt_s, brakes[1] * dt_s, 0.3),
        )
    )
    old = np.empty((announce.TICKS_MAX, 2))
    announce.path(before, dt_s, 1, old)
    first = np.empty((1, 2))
    announce.path(before, dt_s, 0, first)
    v, w = admission.reached(
        before[4], before[5], make.speed_mps * set_v_mps, set_w_radps,
        np.array((make.acceleration_mps2 * dt_s, make.turn_acceleration_radps2 * dt_s)),
        np.array((make.speed_mps, make.speed_mps, 2.5)), 0.1,
    )  # fmt: skip
    turn_rad = 0.4 + before[5] * dt_s * (1.0 + off[1] * errors[2]) + 2.0 * off[2] * errors[1]
    shown = first[0] + off[0] * errors[2] * (first[0] - before[:2])
    shown[0] += 2.0 * off[0] * errors[0]
    after = before.copy()
    after[:6] = (*shown, cos(turn_rad), sin(turn_rad), v, w)
    new = np.empty((announce.TICKS_MAX, 2))
    announce.path(after, dt_s, 0, new)
    row = np.zeros(admission.FASTEST + 1)
    row[: announce.COLUMNS], row[admission.FASTEST] = before, make.speed_mps
    moved = np.empty(announce.TICKS_MAX)
    admission.changed(row, errors, dt_s, moved)
    off_m = np.sqrt(((new - old) ** 2).sum(axis=1))
    assert (off_m <= moved + 1e-9).all()


def test_what_is_free_is_moved_on_by_a_tick() -> None:
    """As the last one from there on; unknown where there is no link, nothing behind the end."""
    told = np.array((1.0, 2.0, 3.0)).tobytes()
    assert np.frombuffer(pact.after_tick(told, 4)).tolist() == [2.0, 3.0, 3.0, 3.0]
    assert np.frombuffer(pact.after_tick(told, 1)).tolist() == [2.0]
    assert np.frombuffer(pact.after_tick(told[:8], 2)).tolist() == [0.0, 0.0]
    assert np.frombuffer(pact.after_tick(b"", 2)).tolist() == [-1.0, -1.0]
