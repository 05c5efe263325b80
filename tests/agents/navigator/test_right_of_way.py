"""Claims, roundabout, cells: what they promise, and that inner loops decide as plain ones do."""

from __future__ import annotations

import random
from collections.abc import Callable
from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import peers
from agents.navigator import announce, cells, gaps, roundabout, stuck, table, walls
from swarm.geometry import Floats, Pose, Twist
from swarm.messages import Beacon, Intent, Passage

DT_S = 0.08
SPEED_MPS = 1.0
LOSSES_MAX = 5
RANDOM = np.random.Generator(np.random.Philox(3))


def beacon(name: str, tick: int, x_m: float, passage: Passage | None) -> Beacon:
    return Beacon(
        name, tick, 0, Pose(x_m, 0.0, 0.0), Twist(SPEED_MPS, 0.0), 0.2, SPEED_MPS, "GO", False,
        (0, 0, 0, 0), intent=Intent(), passage=passage,
    )  # fmt: skip


def granted(
    mine: Passage, name: str, tick: int, x_m: float, known: tuple[Beacon, ...], end_m: float
) -> bool:
    """What this robot makes of what it has heard."""
    others = peers.now(known, Pose(x_m, 0.0, 0.0), tick, DT_S)
    near = [other for peer in others if (other := gaps.same_gap(mine, peer)) is not None]
    against = [one for one in near if not (one.holds and one.along_m < -gaps.EMERGED_M)]
    along_m, _ = gaps.of_axis(mine, (x_m, 0.0))
    return gaps.grant(mine, name, tick, along_m, end_m, SPEED_MPS, [], against)


def test_two_opposing_claims_are_never_both_granted_to_enter(
    request: pytest.FixtureRequest,
) -> None:
    count = request.config.getoption("--crowds")
    settings(max_examples=2 * count)(opposing_claims)()


@given(
    starts=st.tuples(st.floats(0.9, 5.0), st.floats(0.9, 5.0)),
    since=st.tuples(st.integers(0, 20), st.integers(0, 20)),
    length_m=st.floats(0.2, 4.0),
    loss=st.floats(0.0, 1.0),
    seed=st.integers(0, 2**48),
)
def opposing_claims(
    starts: tuple[float, float],
    since: tuple[int, int],
    length_m: float,
    loss: float,
    seed: int,
) -> None:
    """Both drive on when granted and stand before the mouth else; each passes in the end."""
    half_m = 0.5 * length_m
    x_m = [-half_m - starts[0], half_m + starts[1]]
    axes = [(1.0, 0.0), (-1.0, 0.0)]
    mouths = [(-half_m, 0.0), (half_m, 0.0)]
    names = ["a", "b"]
    claims: list[Passage | None] = [None, None]
    known: list[tuple[Beacon, ...]] = [(), ()]
    said: list[Beacon | None] = [None, None]
    lost = [0, 0]
    draw = random.Random(seed)
    passed = [False, False]
    for tick in range(300):
        new: list[Beacon | None] = [None, None]
        for row in (0, 1):
            heard = said[1 - row]
            if heard is not None:
                if lost[row] < LOSSES_MAX and draw.random() < loss:
                    lost[row] += 1
                    heard = None
                else:
                    lost[row] = 0
            known[row] = peers.remember(
                known[row], [heard] if heard is not None else [], names[row], tick, 6
            )
            if claims[row] is None and not passed[row] and tick >= since[row]:
                claims[row] = Passage(False, mouths[row], axes[row], tick)
            mine = claims[row]
            if mine is not None:
                holds = granted(mine, names[row], tick, x_m[row], known[row], length_m)
                mine = Passage(holds, mine.mouth, mine.axis, mine.since)
                along_m, _ = gaps.of_axis(mine, (x_m[row], 0.0))
                if holds or along_m < -gaps.WAIT_BEFORE_M:
                    x_m[row] += axes[row][0] * SPEED_MPS * DT_S
                if along_m > length_m + 0.5:
                    mine, passed[row] = None, True
                claims[row] = mine
            new[row] = beacon(names[row], tick, x_m[row], mine)
        said = new
        inside = [
            claim is not None
            and claim.holds
            and -gaps.INSIDE_M < gaps.of_axis(claim, (x_m[row], 0.0))[0] < length_m
            for row, claim in enumerate(claims)
        ]
        assert not all(inside)
    assert passed == [True, True]


def test_the_ring_is_as_wide_as_those_on_it_need() -> None:
    eight = [pi * number / 4.0 - pi for number in range(8)]
    assert abs(roundabout.radius(roundabout.gap(eight), 0.6) - 0.3 / np.sin(pi / 8.0)) < 1e-9
    near = [0.0, 0.2, 0.4]  # the rest of the ring is not known
    assert abs(roundabout.radius(roundabout.gap(near), 0.6) - 0.3 / np.sin(0.1)) < 1e-9
    assert roundabout.radius(roundabout.gap([1.0, 1.0]), 0.6) <= roundabout.RADIUS_M_MAX


def test_one_that_comes_the_other_way_is_passed_on_its_left_side() -> None:
    rows = np.zeros((1, table.COLUMNS))
    rows[0, [table.X, table.U_X, table.TARGET_X]] = (4.0, -1.0, -6.0)
    rows[0, [table.SPEED, table.RADIUS, table.ACTIVE, table.SHARE, table.RISK]] = (
        1.0, 0.2, 1.0, 0.5, 1.0,
    )  # fmt: skip
    state, turn = roundabout.step(
        roundabout.State(), (0.0, 0.0), (10.0, 0.0), 0.0, 1.0, 0.2, rows, DT_S
    )
    assert state.centre is not None
    assert abs(state.centre[0] - 2.0) < 1e-9
    assert turn is not None
    assert -0.5 < turn.direction_rad < 0.0
    assert turn.share == 1.0  # there is room


def test_who_stands_at_its_goal_stays_until_somebody_is_near() -> None:
    def speed_mps(away_m: float, parked: bool) -> float:
        rows = np.zeros((1, table.COLUMNS))
        rows[0, [table.X, table.U_X, table.SPEED, table.RADIUS]] = (away_m, -1.0, 1.0, 0.2)
        rows[0, [table.SHARE, table.RISK]] = (0.5, 1.0)
        still = (0.0, 0.0)
        choice = cells.choose(
            0.0, 0.0, 0.0, still, still, 0.2, 1.0, rows, np.empty((0, 2)),
            keeps_right=False, parked=parked, slow_mps=1.0,
        )  # fmt: skip
        return choice.speed_mps

    assert speed_mps(1.3, parked=False) > 0.0
    assert speed_mps(1.3, parked=True) == 0.0
    assert speed_mps(0.6, parked=True) > 0.0


def test_a_ring_does_not_jump_as_neighbours_come_into_sight() -> None:
    rows = np.zeros((3, table.COLUMNS))
    for row, angle_rad in enumerate((0.0, pi / 2.0, -pi / 2.0)):
        x_m, y_m = 3.0 + 3.0 * np.cos(angle_rad), 3.0 * np.sin(angle_rad)
        rows[row, [table.X, table.Y, table.TARGET_X, table.TARGET_Y]] = (x_m, y_m, 6.0 - x_m, -y_m)
    rows[:, [table.SPEED, table.ACTIVE, table.RISK]] = 1.0
    rows[:, table.RADIUS], rows[:, table.SHARE] = 0.2, 0.5
    place, target = (0.0, 0.0), (6.0, 0.0)
    few, _ = roundabout.step(roundabout.State(), place, target, 0.0, 1.0, 0.2, rows[:1], DT_S)
    more, _ = roundabout.step(few, place, target, 0.0, 1.0, 0.2, rows, DT_S)
    new, _ = roundabout.step(roundabout.State(), place, target, 0.0, 1.0, 0.2, rows, DT_S)
    assert few.ring_m < more.ring_m < new.ring_m
    assert more.ring_m - few.ring_m < 0.1 * (new.ring_m - few.ring_m)


def test_who_is_too_near_behind_another_on_a_ring_falls_back() -> None:
    bearings = [0.1, 0.1 + 2.0 * pi / 8.0, -1.0, 3.0]
    spacing_m = 0.6
    ring_m = roundabout.radius(2.0 * pi / 8.0, spacing_m)
    assert abs(roundabout.zipped(bearings, spacing_m, ring_m) - 1.0) < 1e-9
    bearings[1] = 0.1 + 0.75 * 2.0 * pi / 8.0
    assert abs(roundabout.zipped(bearings, spacing_m, ring_m) - 0.75) < 1e-9
    bearings[1] = 0.1  # beside it: one that stands must not stop it
    assert roundabout.zipped(bearings, spacing_m, ring_m) == roundabout.SHARE_MIN
    assert roundabout.zipped([0.1], spacing_m, ring_m) == 1.0


def test_a_ring_of_many_keeps_where_it_is() -> None:
    assert roundabout.steady(0) == roundabout.steady(roundabout.FEW) == 1.0
    assert roundabout.steady(3 * roundabout.FEW) < 0.15


def test_alone_in_the_open_the_cheapest_cell_is_the_way() -> None:
    nobody, nothing = np.empty((0, table.COLUMNS)), np.empty((0, 2))
    choice = cells.choose(
        0.3, 1.0, 0.3, (0.0, 0.0), (0.0, 0.0), 0.2, 1.0, nobody, nothing,
        keeps_right=False, parked=False, slow_mps=1.0,
    )  # fmt: skip
    assert abs(choice.direction_rad - 0.3) < 1e-12
    assert choice.speed_mps == 1.0


def test_who_stands_in_the_open_turns_aside_for_a_moment() -> None:
    state, turned = stuck.State(), []
    for _ in range(120):
        state = stuck.step(state, (0.0, 0.0), 5.0, DT_S, free=True)
        turned.append(state.turn_rad())
    assert min(turned) < 0.0 < max(turned)  # right first, then left
    waiting = stuck.State()
    for _ in range(120):
        waiting = stuck.step(waiting, (0.0, 0.0), 5.0, DT_S, free=False)
        assert waiting.turn_rad() == 0.0


def wall() -> Floats:
    """Hits of a wall at x = 2 with a gap of 0.8 m, from the origin."""
    y_m = np.concatenate((np.arange(0.4, 3.0, 0.07), -np.arange(0.4, 3.0, 0.07)))
    return np.stack((np.full(len(y_m), 2.0), y_m), axis=1)


PATH = np.stack((np.arange(0.0, 5.0, 0.2), np.zeros(25)), axis=1)
CORRIDOR = np.stack((np.tile(np.arange(-1.5, 2.0, 0.07), 2), np.repeat((0.5, -0.3), 50)), axis=1)
NOBODY = np.empty((0, table.COLUMNS))


def test_a_gap_between_walls_is_found_and_one_between_posts_is_not() -> None:
    found = np.zeros(5)
    walls.find(wall(), PATH, NOBODY, 0.55, 1.05, found)
    assert abs(found[0] - 0.8) < 1e-9
    assert np.allclose(found[1:], (2.0, 0.0, 1.0, 0.0))
    found = np.zeros(5)
    walls.find(np.array([(2.0, 0.4), (2.0, -0.4)]), PATH, NOBODY, 0.55, 1.05, found)
    assert found[0] == 0.0


def peers_rows() -> Floats:
    rows = RANDOM.uniform(-3.0, 3.0, (12, table.COLUMNS))
    rows[:, table.SPEED] = 1.0
    rows[:, table.RADIUS] = 0.2
    rows[:, [table.ACTIVE, table.RISK]] = 1.0
    rows[:, table.SHARE] = 0.5
    return rows


BODY = np.array((0.0, 0.0, 1.0, 0.0, 0.8, 0.2, 0.144, 0.64))
CALLS: list[tuple[Callable[..., Any], tuple[Any, ...]]] = [
    (announce.path, (BODY, DT_S, 2, np.empty((8, 2)))),
    (announce.turn, (1.7,)),
    (walls.find, (wall(), PATH, peers_rows()[:2], 0.55, 1.05, np.zeros(5))),
    (walls.end, (wall(), 2.0, 0.0, 1.0, 0.0, 0.7)),
    (walls.inside, (CORRIDOR, PATH, 0.55, 1.05, np.zeros(5))),
    (
        roundabout.conflicts,
        (6.0, 1.0, 1.0, 0.2, peers_rows(), np.zeros(12), np.zeros(5)),
    ),
    (
        cells.least,
        (
            *(0.6, 0.8, 1.0, 0.4, 0.5, 0.1, 0.9, 0.1, 0.2, 1.0),
            *(peers_rows(), RANDOM.uniform(-2.0, 2.0, (40, 2)), cells.UNITS, cells.SPEEDS),
            *(True, 1.0, 0.0, 0.7, 0.5, 2.5, np.zeros(3)),
        ),
    ),
]


@pytest.mark.parametrize(("kernel", "arguments"), CALLS, ids=[call[0].__name__ for call in CALLS])
def test_inner_loops_decide_as_plain_ones_do(
    kernel: Callable[..., Any], arguments: tuple[Any, ...]
) -> None:
    plain = getattr(kernel, "py_func", kernel)
    one, other = (
        [part.copy() if isinstance(part, np.ndarray) else part for part in arguments]
        for _ in range(2)
    )
    with np.errstate(all="ignore"):
        results = kernel(*one), plain(*other)
    assert np.array(results[0], float).tobytes() == np.array(results[1], float).tobytes()
    for left, right in zip(one, other, strict=True):
        if isinstance(left, np.ndarray):
            assert left.tobytes() == right.tobytes()
