"""Who goes first in the open, what is believed of what is announced, and when not to go round."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.navigator import cells, gaps, right_of_way, roundabout, table
from agents.navigator.aim import Aim
from swarm.geometry import Floats, Pose, Vec2, length, wrap_angle
from swarm.messages import Intent, Passage
from tests.agents import scenes
from tests.agents.navigator.test_movers import setup_of

DT_S = 0.08
place_m = st.floats(-5.0, 5.0)


def row(place: Vec2, target: Vec2, velocity: Vec2 = (0.0, 0.0), share: float = 0.5) -> Floats:
    """One that is on its way, of radius 0.2 m and at most 1 m/s."""
    there = np.zeros(table.COLUMNS)
    there[[table.X, table.Y, table.U_X, table.U_Y]] = (*place, *velocity)
    there[[table.TARGET_X, table.TARGET_Y, table.SPEED, table.RADIUS]] = (*target, 1.0, 0.2)
    there[[table.ACTIVE, table.SHARE, table.RISK]] = (1.0, share, 1.0)
    return there


@settings(max_examples=50, deadline=None)
@given(
    starts=st.tuples(place_m, place_m, place_m, place_m),
    goals=st.tuples(place_m, place_m, place_m, place_m),
    speeds=st.tuples(st.floats(0.3, 2.0), st.floats(0.3, 2.0)),
)
def test_who_gets_there_sooner_makes_less_room_and_the_other_as_much_more(
    starts: tuple[float, ...], goals: tuple[float, ...], speeds: tuple[float, float]
) -> None:
    shares, times_s = [], []
    for me, peer in ((0, 1), (1, 0)):
        x_m, y_m = starts[2 * me], starts[2 * me + 1]
        rows = np.array(
            [
                row(
                    (starts[2 * peer] - x_m, starts[2 * peer + 1] - y_m),
                    (goals[2 * peer] - x_m, goals[2 * peer + 1] - y_m),
                )
            ]
        )
        rows[0, table.SPEED] = speeds[peer]
        to_go_m = length(goals[2 * me] - x_m, goals[2 * me + 1] - y_m)
        table.prefer_nearer(rows, to_go_m, speeds[me])
        shares.append(float(rows[0, table.SHARE]))
        times_s.append(to_go_m / speeds[me])
    assert abs(sum(shares) - 1.0) < 1e-9
    assert min(shares) >= 0.5 - table.SHARE_SOONER
    if abs(times_s[0] - times_s[1]) > 1e-6:
        assert (times_s[0] < times_s[1]) == (shares[0] < shares[1])


def test_who_stands_at_its_goal_keeps_its_share() -> None:
    rows = np.array([row((1.0, 0.0), (1.0, 0.0), share=table.SHARE_PARKED)])
    table.prefer_nearer(rows, 5.0, 1.0)
    assert rows[0, table.SHARE] == table.SHARE_PARKED


def test_less_is_believed_of_one_that_the_guard_holds() -> None:
    assert table.believed((0.6, 0.8), 1.0) == (0.6, 0.8)
    assert table.believed((0.6, 0.8), -1.2) == (0.6, 0.8)
    held = table.believed((0.6, 0.8), 0.0)
    assert abs(length(*held) - table.BELIEVED) < 1e-9
    assert held[0] * 0.8 == held[1] * 0.6  # the same direction
    assert length(*held) < length(*table.believed((0.6, 0.8), 0.5)) < 1.0
    assert table.believed((0.0, 0.0), 0.0) == (0.0, 0.0)


def test_who_stops_at_its_goal_does_not_fear_what_stands_beyond_it() -> None:
    def speed_mps(goal: Vec2, away_m: float) -> float:
        beyond = row((away_m, 0.0), (away_m, 0.0), share=table.SHARE_PARKED)
        still = (0.0, 0.0)
        choice = cells.choose(
            0.0, 0.4, 0.0, still, still, 0.2, 1.0, beyond[None, :], np.empty((0, 2)),
            keeps_right=False, parked=False, slow_mps=0.4, free_m=9.0, goal=goal,
        )  # fmt: skip
        return choice.speed_mps if abs(choice.direction_rad) < 0.1 else 0.0

    assert speed_mps((0.0, 0.0), 0.8) == 0.0
    assert speed_mps((0.25, 0.0), 0.8) > 0.0
    assert speed_mps((0.25, 0.0), 0.5) == 0.0  # there is no room at that goal


def crossing(x_m: float, y_m: float) -> Floats:
    """One that meets who drives along x at 1 m/s, as far off as x_m."""
    return row((x_m, y_m - x_m), (x_m, y_m + 3.0))[None, :]


def test_a_centre_is_not_kept_for_conflicts_elsewhere() -> None:
    near = crossing(2.0, 0.0)
    state, _ = roundabout.step(
        roundabout.State(), (0.0, 0.0), (9.0, 0.0), 0.0, 1.0, 0.2, near, DT_S
    )
    first = state.centre
    far = crossing(5.0, 0.0)
    ticks = 0
    while state.centre == first and ticks < 100:
        state, _ = roundabout.step(state, (0.0, 0.0), (9.0, 0.0), 0.0, 1.0, 0.2, far, DT_S)
        ticks += 1
    assert abs(ticks * DT_S - roundabout.MEMORY_S) < 2.0 * DT_S
    assert state.centre is not None
    assert abs(state.centre[0] - 5.0) < 0.5


@settings(max_examples=100, deadline=None)
@given(
    centre=st.tuples(place_m, place_m),
    target=st.tuples(place_m, place_m),
    ring_m=st.floats(0.3, 6.0),
    meets=st.floats(0.5, 4.0),
)
def test_nobody_goes_round_away_from_its_goal(
    centre: Vec2, target: Vec2, ring_m: float, meets: float
) -> None:
    way_rad = float(np.arctan2(target[1], target[0]))
    _, turn = roundabout.step(
        roundabout.State(centre, ring_m=ring_m), (0.0, 0.0), target, way_rad, 1.0, 0.2,
        crossing(meets, 0.0), DT_S,
    )  # fmt: skip
    if turn is not None:
        assert abs(wrap_angle(turn.direction_rad - way_rad)) <= roundabout.TURN_RAD_MAX + 1e-9
        assert abs(wrap_angle(turn.direction_rad - way_rad)) < 0.6 * pi


def test_who_stands_at_its_goal_believes_who_wants_to_pass() -> None:
    """Who is held by its guard means it: only the one that stands in its way can end that."""
    intent = Intent((-1.0, 0.0), (-3.0, 0.0), True)
    others = [scenes.peer(scenes.beacon("robot2", Pose(1.0, 0.0, pi), intent=intent))]
    parked, _ = table.of(others, 0.0, 0.0, parked=True)
    going, _ = table.of(others, 0.0, 0.0)
    assert parked[0, table.U_X] == -1.0
    assert going[0, table.U_X] == -table.BELIEVED


def test_a_holder_of_a_gap_that_gets_nowhere_turns_aside_as_others_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    holding = gaps.State(Passage(True, (1.0, 0.0), (1.0, 0.0), 1))
    monkeypatch.setattr(gaps, "step", lambda *_: (holding, gaps.Rule(None, waits=False)))
    aim = Aim(0.0, 1.0, (9.0, 0.0), 9.0, is_last=True, open_mps=1.0)
    rows = np.array([row((0.0, 0.45), (0.0, 0.45), share=table.SHARE_PARKED)])
    state, turned_rad = right_of_way.State(), 0.0
    nothing = np.empty((0, 2))
    for tick in range(60):
        state, course = right_of_way.step(
            *(setup_of(), state, scenes.frame(tick=tick), aim, (9.0, 0.0)),
            *((), rows, (), nothing, nothing, DT_S),
            parked=False,
        )
        turned_rad = max(turned_rad, abs(course.direction_rad))
    assert turned_rad > 0.5 * pi


@pytest.mark.parametrize("off_rad", [0.3, 0.8, 1.2, 1.36, 1.5])
def test_it_chooses_nothing_that_brings_it_nearer_to_one_it_all_but_touches(off_rad: float) -> None:
    """The guard would refuse that, in this tick and in all to come."""
    rows = np.array([row((0.452, 0.0), (0.3, 0.0), share=table.SHARE_OPEN)])
    still = (0.0, 0.0)
    choice = cells.choose(
        off_rad, 1.0, off_rad, still, still, 0.2, 1.0, rows, np.empty((0, 2)),
        keeps_right=False, parked=False, slow_mps=1.0,
    )  # fmt: skip
    assert choice.speed_mps * np.cos(choice.direction_rad) <= 1e-9
    assert choice.speed_mps > 0.0 or off_rad < 0.5


def test_what_keeps_no_rules_may_come_a_little_nearer_still() -> None:
    """The guard knows no bound of it: to find no free cell beside it at all is worse."""
    rows = np.array([row((0.452, 0.0), (0.3, 0.0), share=table.SHARE_OPEN)] * 2)
    rows[1, table.RISK] = table.LAWLESS
    lawful_m, lawless_m = cells.keeps(0.2, rows)
    assert lawful_m == pytest.approx(0.452)
    assert lawless_m == pytest.approx(0.452 - cells.NEARER_M)
