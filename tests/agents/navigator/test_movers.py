"""What moves is found and kept off; what stands is never taken for it."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, inf, sin
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import robot
from agents.navigator import arcs, brake, dodge, memory, movers, segments, tracks
from agents.navigator.law import law
from swarm import geometry
from swarm.geometry import STILL, Pose, Ranges, Twist
from swarm.scenario import Disturbance, RobotSetup
from tests.agents import scenes
from tests.agents.navigator.test_kernels import plain, same

Moving = tuple[float, float, float, float, float]  # x_m, y_m, v_x, v_y, radius_m; at first
STANDING = [(2.0, 2.2, 0.5), (-1.5, 2.0, 0.4), (3.5, -1.0, 0.7), (0.5, -2.5, 0.15)]
STILL_HERE = (0.0, 0.0, 1.0, 0.0)  # x_m, y_m, cosine, sine


def setup_of(**changes: Any) -> RobotSetup:
    return scenes.alone(
        **{"controller": "navigator", "goal": (5.0, 0.0), "acceleration_mps2_max": 2.0, **changes}
    )


def disc(moving: Moving, tick: int) -> scenes.Disc:
    x_m, y_m, v_x, v_y, radius_m = moving
    return (x_m + v_x * tick * scenes.DT_S, y_m + v_y * tick * scenes.DT_S, radius_m)


def noisy(ranges_m: Ranges, sigma_m: float, tick: int) -> Ranges:
    """Other errors in each tick, the same ones whichever test came before."""
    normal = np.random.Generator(np.random.Philox(tick)).standard_normal(len(ranges_m))
    errors_m = sigma_m * np.clip(normal, -3.0, 3.0)
    return (ranges_m + errors_m).astype(np.float32)


def watch(
    discs: Sequence[scenes.Disc],
    moving: Sequence[Moving],
    ticks: int,
    *,
    twist: Twist = STILL,
    sigma_m: float = 0.0,
) -> tuple[movers.State, int]:
    """State after a while on the robot's way, and in how many ticks something moved."""
    setup = setup_of(disturbance=Disturbance(range_sigma_m=sigma_m))
    state, pose, found = movers.State(), scenes.ORIGIN, 0
    for tick in range(ticks):
        discs_now = [*discs, *[disc(one, tick) for one in moving]]
        ranges_m = noisy(scenes.scan(discs_now, pose), sigma_m, tick)
        frame = scenes.frame("robot1", tick, pose, twist, ranges_m)
        state = movers.step(setup, state, frame, ranges_m, (), scenes.DT_S)
        found += len(state.moving()) > 0
        pose = geometry.advance(pose, twist, scenes.DT_S)
    return state, found


@settings(max_examples=25)
@given(
    st.floats(-3.1, 3.1), st.floats(1.2, 2.4), st.floats(-3.1, 3.1), st.floats(0.3, 1.0),
    st.sampled_from([0.0, 0.01]),
)  # fmt: skip
def test_the_velocity_of_what_moves_is_known(
    at_rad: float, at_m: float, to_rad: float, speed_mps: float, sigma_m: float
) -> None:
    # at this place and velocity in the last tick, in front of everything that stands
    ticks = 14
    v_x, v_y = speed_mps * cos(to_rad), speed_mps * sin(to_rad)
    x_m, y_m = at_m * cos(at_rad), at_m * sin(at_rad)
    past_s = (ticks - 1) * scenes.DT_S
    one = (x_m - v_x * past_s, y_m - v_y * past_s, v_x, v_y, 0.25)
    places = [disc(one, tick) for tick in range(ticks)]
    if min(geometry.length(x, y) for x, y, _ in places) < 0.8:
        return  # the robot stands in its way
    standing = [
        (x, y, radius_m)
        for x, y, radius_m in STANDING
        if min(geometry.length(x - px, y - py) for px, py, _ in places) > radius_m + 0.6
        and geometry.length(x, y) > at_m + 0.8
    ]
    state, _ = watch(standing, [one], ticks, sigma_m=sigma_m)
    if max(geometry.length(x, y) for x, y, _ in places) > scenes.RANGE_M - 1.0:
        return  # it has come into sight only now
    moving = state.moving()
    if len(moving) == 0:  # what goes straight away shows no place that was free before
        assert abs(x_m * v_y - y_m * v_x) < 0.8 * at_m * speed_mps
        assert x_m * v_x + y_m * v_y > 0.0
        return
    assert len(moving) == 1
    (row,) = moving
    assert geometry.length(row[tracks.X] - x_m, row[tracks.Y] - y_m) < 0.1
    assert geometry.length(row[tracks.V_X] - v_x, row[tracks.V_Y] - v_y) < 0.25
    assert abs(row[tracks.RADIUS] - 0.25) < 0.08


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(st.floats(-4.0, 6.0), st.floats(-4.0, 4.0), st.floats(0.05, 1.0)), max_size=12
    ),
    st.floats(-1.5, 1.5),
    st.sampled_from([0.0, 0.01]),
)
def test_what_stands_never_moves(
    discs: list[scenes.Disc], rate_radps: float, sigma_m: float
) -> None:
    discs = [one for one in discs if geometry.length(one[0] - 1.0, one[1]) > one[2] + 1.3]
    _, found = watch(discs, [], 50, twist=Twist(0.6, rate_radps), sigma_m=sigma_m)
    assert found == 0


def test_what_has_turned_back_is_known_to_do_so_within_some_ticks() -> None:
    setup, state = setup_of(), movers.State()
    for tick in range(30):
        y_m = -0.8 + 0.8 * scenes.DT_S * (tick if tick < 20 else 40 - tick)
        ranges_m = scenes.scan([(1.2, y_m, 0.25)], scenes.ORIGIN)
        frame = scenes.frame("robot1", tick, ranges_m=ranges_m)
        state = movers.step(setup, state, frame, ranges_m, (), scenes.DT_S)
        if tick == 19:
            assert state.moving()[0, tracks.V_Y] == pytest.approx(0.8, abs=0.1)
        if tick == 24:
            assert state.moving()[0, tracks.V_Y] == pytest.approx(-0.8, abs=0.25)
    # its hits are not on the map, and only those
    assert np.isinf(state.without(ranges_m, 29)).all()
    assert np.isfinite(state.without(ranges_m, 30)).any()


@settings(max_examples=20)
@given(
    st.floats(-3.1, 3.1), st.floats(0.3, 0.9), st.floats(0.3, 0.9), st.floats(1.2, 2.0),
    st.sampled_from([0.0, 0.01]),
)  # fmt: skip
def test_two_that_pass_each_other_stay_two(
    at_rad: float, one_mps: float, other_mps: float, near_m: float, sigma_m: float
) -> None:
    # across the line of sight, 55 cm one behind the other: the one behind is hidden for a while
    setup = setup_of(disturbance=Disturbance(range_sigma_m=sigma_m))
    state, ticks = movers.State(), 50
    (x, y), half_s = geometry.unit(at_rad), 0.5 * ticks * scenes.DT_S
    pair = [
        (away_m * x + v * half_s * y, away_m * y - v * half_s * x, -v * y, v * x, 0.25)
        for away_m, v in ((near_m, one_mps), (near_m + 0.55, -other_mps))
    ]
    known = [False, False]
    for tick in range(ticks):
        discs = [disc(one, tick) for one in pair]
        ranges_m = noisy(scenes.scan(discs, scenes.ORIGIN), sigma_m, tick)
        frame = scenes.frame("robot1", tick, ranges_m=ranges_m)
        state = movers.step(setup, state, frame, ranges_m, (), scenes.DT_S)
        moving = state.moving()
        for number, (x_m, y_m, _) in enumerate(discs):
            off_m = [geometry.length(row[tracks.X] - x_m, row[tracks.Y] - y_m) for row in moving]
            if geometry.length(x_m, y_m) > scenes.RANGE_M - 1.0 or (
                not known[number] and min(off_m, default=1.0) > 0.1
            ):
                continue  # it has come into sight only now
            known[number] = True
            row = moving[int(np.argmin(off_m))]
            _, _, v_x, v_y, radius_m = pair[number]
            assert min(off_m) < 0.1
            assert geometry.length(row[tracks.V_X] - v_x, row[tracks.V_Y] - v_y) < 0.25
            assert abs(row[tracks.RADIUS] - radius_m) < 0.05
    assert known == [True, True]
    assert len(state.moving()) == 2


def test_a_peer_is_no_mover() -> None:
    setup, state = setup_of(), movers.State()
    for tick in range(20):
        there = Pose(1.5, -0.8 + 0.08 * tick, 1.57)
        peer = scenes.peer(scenes.beacon("robot2", there, Twist(1.0, 0.0), tick=tick), tick=tick)
        ranges_m = scenes.scan([(there.x_m, there.y_m, 0.22)], scenes.ORIGIN)
        frame = scenes.frame("robot1", tick, ranges_m=ranges_m)
        state = movers.step(setup, state, frame, ranges_m, [peer], scenes.DT_S)
        assert not len(state.moving())


def among(
    bodies: Sequence[Moving], moving: Sequence[Moving], ticks: int, sigma_m: float = 0.0
) -> list[int]:
    """How many move in each tick, seen by a robot at rest that hears the bodies."""
    setup = setup_of(disturbance=Disturbance(range_sigma_m=sigma_m))
    state, counts = movers.State(), []
    for tick in range(ticks):
        others = []
        for number, (_, _, v_x, v_y, _) in enumerate(bodies):
            x_m, y_m, _ = disc(bodies[number], tick)
            yaw_rad = atan2(v_y, v_x)
            said = scenes.beacon(
                f"robot{number + 2}",
                Pose(x_m, y_m, yaw_rad),
                Twist(geometry.length(v_x, v_y), 0.0),
                tick=tick,
            )
            others.append(scenes.peer(said, tick=tick))
        discs = [disc(one, tick) for one in (*bodies, *moving)]
        ranges_m = noisy(scenes.scan(discs, scenes.ORIGIN), sigma_m, tick)
        frame = scenes.frame("robot1", tick, ranges_m=ranges_m)
        hits_m = scenes.look(setup, ranges_m, others).ranges_m
        state = movers.step(setup, state, frame, hits_m, others, scenes.DT_S)
        counts.append(len(state.moving()))
    return counts


@pytest.mark.parametrize("gap_m", [0.12, 0.3])
def test_what_moves_close_beside_a_peer_is_no_peer(gap_m: float) -> None:
    peer = (1.6, -1.2, 0.0, 0.8, 0.22)
    counts = among([peer], [(1.6, -1.2 + 0.47 + gap_m, 0.0, 0.8, 0.25)], 20)
    assert counts[10:] == [1] * 10


@pytest.mark.parametrize("sigma_m", [0.0, 0.01])
@pytest.mark.parametrize("speed_mps", [0.2, 0.6, 1.0])
def test_what_stands_does_not_move_as_a_peer_uncovers_it(speed_mps: float, sigma_m: float) -> None:
    standing = [(x_m, y_m, 0.0, 0.0, r_m) for x_m, y_m, r_m in ((2.2, 0.1, 0.3), (2.6, 1.2, 0.15))]
    for x_m in (0.8, 1.5):
        peer = (x_m, -0.9, 0.0, speed_mps, 0.22)
        assert max(among([peer], standing, 40, sigma_m)) == 0


@pytest.mark.parametrize("half", [0, 1])
def test_a_body_is_as_large_as_it_is_where_half_of_it_is_unknown(half: int) -> None:
    hits_m = scenes.scan([(1.5, 0.0, 0.3)], scenes.ORIGIN).astype(np.float64)
    on = np.flatnonzero(np.isfinite(hits_m))
    unknown = on[: len(on) // 2] if half else on[len(on) // 2 :]
    raw_m = np.minimum(hits_m, scenes.RANGE_M)
    raw_m[unknown], hits_m[unknown] = np.nan, inf
    units, nobody = memory.beams(scenes.BEAMS).units, np.empty((0, 3))
    found = segments.segments(
        raw_m, hits_m, units, *STILL_HERE, 0.9999, 0.0145, nobody, 0.0, scenes.RANGE_M
    )
    assert len(found) == 1
    assert found[0, segments.SIZE] == pytest.approx(0.3, abs=0.01)
    assert found[0, segments.RANGE] == pytest.approx(1.2, abs=0.01)


@pytest.mark.parametrize("missed", [0.0, 5.0])
def test_what_moves_is_not_forgotten_among_many_that_stand(missed: float) -> None:
    """Unseen for a moment behind one of them, as far as it is known."""
    many = tracks.TRACKS_MAX
    mover = np.zeros((1, tracks.COLUMNS))
    mover[0, [tracks.X, tracks.V_Y, tracks.RADIUS, tracks.MOVES]] = (2.0, 0.5, 0.25, 1.0)
    mover[0, [tracks.COUNT, tracks.MISSED]] = (5.0, missed)
    found = np.zeros((many, segments.COLUMNS))
    for number in range(many):
        found[number, : segments.RANGE] = geometry.unit(0.5 + 0.1 * number)
        found[number, [segments.RANGE, segments.SIZE]] = (4.0, 0.1)
    rays, nothing = memory.beams(scenes.BEAMS), np.empty(0)
    raw_m = np.full(scenes.BEAMS, 1.0)  # something is in front of it
    known = tracks.follow(
        mover, np.zeros((1, tracks.FIT_COLUMNS)), found, raw_m, rays.units, rays.bounds,
        *STILL_HERE, 0.029, scenes.DT_S, 0.0, nothing, np.zeros(4),
    )  # fmt: skip
    assert len(known) == many
    assert known[:, tracks.MOVES].tolist() == [1.0] + [0.0] * (many - 1)


def test_memory_forgets_what_lies_in_discs() -> None:
    setup = setup_of()
    rules = law(setup.navigator, setup.robot.body_radius_m)
    known = memory.empty(rules, scenes.ORIGIN)
    both = scenes.scan([(1.5, 0.0, 0.25), (0.0, 1.5, 0.25)], scenes.ORIGIN)
    one = scenes.scan([(1.5, 0.0, 0.25)], scenes.ORIGIN)
    only, field_mm = memory.observe(rules, known, scenes.ORIGIN, one, one)
    known, _ = memory.observe(rules, known, scenes.ORIGIN, both, both)
    left = memory.cleared(rules, known, np.array([(0.0, 1.5, 0.35)]))
    assert sorted(left.points_mm().tolist()) == sorted(only.points_mm().tolist())
    assert (left.field_mm(rules) == field_mm).all()
    assert memory.cleared(rules, left, np.array([(0.0, 1.5, 0.35)])) is left


def drive(
    setup: RobotSetup, discs: Sequence[scenes.Disc], moving: Sequence[Moving], ticks: int
) -> tuple[float, float, str]:
    """Least gap to what moves, to what stands, and the last mode."""
    state, pose, twist = robot.init(setup), scenes.ORIGIN, STILL
    gaps_m = [inf, inf]
    mode = ""
    for tick in range(ticks):
        now = [disc(one, tick) for one in moving]
        for number, some in enumerate((now, discs)):
            for x_m, y_m, radius_m in some:
                gap_m = geometry.length(x_m - pose.x_m, y_m - pose.y_m) - radius_m - 0.22
                gaps_m[number] = min(gaps_m[number], gap_m)
        frame = scenes.frame("robot1", tick, pose, twist, scenes.scan([*discs, *now], pose))
        state, command = robot.step(setup, state, frame)
        mode = command.beacon.mode
        if mode in ("ARRIVED", "FAILED") and tick > 100:
            break
        twist = brake.reached(setup.robot, twist, command.set_point, setup.dt_s)
        pose = geometry.advance(pose, twist, setup.dt_s)
    return gaps_m[0], gaps_m[1], mode


@pytest.mark.parametrize("angle_rad", [0.3, 1.0, 1.57, 2.2, 3.0, -0.6, -1.57, -2.4])
@pytest.mark.parametrize("speed_mps", [0.4, 0.9])
def test_what_crosses_from_any_side_is_kept_off(angle_rad: float, speed_mps: float) -> None:
    # both would be in the middle of the way at the same time
    meet_s = 2.9
    v_x, v_y = speed_mps * cos(angle_rad), speed_mps * sin(angle_rad)
    one = (2.5 - v_x * meet_s, -v_y * meet_s, v_x, v_y, 0.25)
    if geometry.length(one[0], one[1]) < 0.8:
        one = (one[0] - v_x, one[1] - v_y, v_x, v_y, 0.25)
    moves_m, stands_m, mode = drive(setup_of(), [(2.5, 1.6, 0.3), (2.5, -1.7, 0.4)], [one], 200)
    assert moves_m > 0.04
    assert stands_m > 0.02
    assert mode == "ARRIVED"


@pytest.mark.parametrize("angle_rad", [0.0, 0.8, 1.57, 2.4, 3.14, -0.8, -1.57])
def test_who_stands_at_its_goal_goes_out_of_the_way(angle_rad: float) -> None:
    v_x, v_y = 0.5 * cos(angle_rad), 0.5 * sin(angle_rad)
    one = (-5.0 * v_x, -5.0 * v_y, v_x, v_y, 0.25)
    moves_m, _, mode = drive(setup_of(goal=(0.0, 0.0)), [], [one], 250)
    assert moves_m > 0.02
    assert mode == "ARRIVED"


def test_nothing_is_asked_instead_where_nothing_moves_nearby() -> None:
    setup, asked = setup_of(), Twist(0.7, 0.3)
    far = np.array([(9.0, 0.0, -1.0, 0.0, 0.25), (3.2, 0.5, 0.8, 0.0, 0.25)])
    for moving in (far, far[:0]):
        assert dodge.ask(setup, (1.0, 0.0), asked, asked, moving, np.empty((0, 2))) == asked


def test_state_is_pure_and_survives_the_wire() -> None:
    setup = setup_of()
    state, _ = watch(STANDING, [(1.5, -0.9, 0.0, 0.8, 0.25)], 12)
    assert len(state.moving()) == 1
    ranges_m = scenes.scan([*STANDING, (1.5, -0.13, 0.25)], scenes.ORIGIN)
    frame = scenes.frame("robot1", 12, ranges_m=ranges_m)
    once = movers.step(setup, state, frame, ranges_m, (), scenes.DT_S)
    assert movers.step(setup, state, frame, ranges_m, (), scenes.DT_S) == once
    stored = msgspec.msgpack.decode(msgspec.msgpack.encode(state), type=movers.State)
    assert movers.step(setup, stored, frame, ranges_m, (), scenes.DT_S) == once


def test_compiled_loops_decide_as_the_plain_ones() -> None:
    state, _ = watch(STANDING, [(1.5, -0.9, 0.0, 0.8, 0.25)], 12)
    rays = memory.beams(scenes.BEAMS)
    hits_m = scenes.scan([*STANDING, (1.5, -0.13, 0.25)], scenes.ORIGIN).astype(np.float64)
    raw_m = np.minimum(hits_m, scenes.RANGE_M)
    place = (0.05, 0.02, 0.8, 0.6)
    looks = (raw_m, hits_m, rays.units, *place, 0.9999, 0.0145, np.array([(9.0, 9.0, 0.5)]))
    found = segments.segments(*looks, 0.0, 5.0)
    same(found, plain(segments.segments)(*looks, 0.0, 5.0))
    assert len(found) > 1
    rows, owners = state.rows(), np.zeros((2, scenes.BEAMS), dtype=np.int64)
    fits = arcs.locate(rows, raw_m, hits_m, rays.units, *STILL_HERE, 0.08, 0.0, owners[0])
    same(
        fits,
        plain(arcs.locate)(rows, raw_m, hits_m, rays.units, *STILL_HERE, 0.08, 0.0, owners[1]),
    )
    assert (owners[0] == owners[1]).all()
    assert np.count_nonzero(owners[0] >= 0) > 5
    old = state.scans[-1]
    follows = (
        *(state.rows(), fits, found, raw_m, rays.units, rays.bounds, *place, 0.029, 0.08, 0.01),
        *(np.frombuffer(old.ranges), np.array((old.x_m, old.y_m, old.ahead, old.aside))),
    )
    known = tracks.follow(*follows)
    same(known, plain(tracks.follow)(*follows))
    hides = (known, hits_m, rays.units, *place, 0.01)
    same(tracks.hide(*hides), plain(tracks.hide)(*hides))
    moving = np.array([(1.2, 0.3, -0.8, 0.0, 0.47), (0.9, -0.5, 0.1, 0.3, 0.47)])
    results = []
    for choose in (dodge.choose, plain(dodge.choose)):
        result = np.zeros(2)
        choose(
            *(np.array((0.8, 0.6, 0.9, 0.2)), np.array((1.0, 0.4, 2.5)), np.array((0.32, 0.96))),
            *(0.17, 1.0, 0.1, moving, np.array([(0.4, 0.8), (1.0, -1.0)]), 0.25, 0.08, 10),
            *(dodge.SPEEDS[:2], dodge.RATES[:3], dodge.TURN_S[:1], result),
        )
        results.append(result.tobytes())
    assert results[0] == results[1]
