"""Who hears whom."""

from __future__ import annotations

import numpy as np
import pytest

from swarm.faults import Deaf, Delay, Duplicate, Fault, Loss, Mute, Partition
from swarm.geometry import STILL
from swarm.messages import Beacon
from tests.world.test_faults import fault, inflicted
from tests.world.test_simulation import HEAD, drive, orders, world_of
from world import radio, simulation
from world.faults import Active
from world.radio import Flags

LINE = np.array([[0.0, 0.0], [6.0, 0.0], [12.0, 0.0]])
EVERYONE = np.ones(3, dtype=np.bool_)


def test_audible_ends_at_the_range_and_leaves_oneself_out() -> None:
    heard = radio.audible(6.0, LINE, EVERYONE)
    assert heard.tolist() == [
        [False, True, False],
        [True, False, True],
        [False, True, False],
    ]
    assert not radio.audible(5.999, LINE, EVERYONE).any()


def test_audible_is_nobody_for_and_from_the_dead() -> None:
    heard = radio.audible(100.0, LINE, np.array([True, False, True]))
    assert heard.tolist() == [
        [False, False, True],
        [False, False, False],
        [True, False, False],
    ]


def test_audible_is_mutual_when_places_are_random() -> None:
    places_m = np.random.default_rng(3).uniform(-10.0, 10.0, (40, 2))
    heard = radio.audible(7.0, places_m, np.ones(40, dtype=np.bool_))
    assert (heard == heard.T).all()
    for one in range(40):
        for other in range(40):
            apart_m = float(np.linalg.norm(places_m[one] - places_m[other]))
            assert heard[one, other] == (one != other and apart_m <= 7.0)


# --- links that fail ----------------------------------------------------------------------------

MESH = np.ones((4, 4), np.bool_) & ~np.eye(4, dtype=np.bool_)


def links(*struck: tuple[Fault, tuple[int, ...]], tick: int = 5, seed: int = 1) -> Flags:
    active = [Active(number, one, rows, 0, None) for number, (one, rows) in enumerate(struck)]
    return radio.carried(MESH, active, seed=seed, tick=tick)


def test_deaf_hears_nobody_and_mute_is_heard_by_nobody() -> None:
    hears_not = MESH.copy()
    hears_not[1] = False
    assert (links((fault(Deaf), (1,))) == hears_not).all()
    assert (links((fault(Mute), (1,))) == hears_not.T).all()


def test_partition_parts_two_groups_that_hear_themselves() -> None:
    heard = links((fault(Partition), (0, 2)))
    assert heard.astype(int).tolist() == [[0, 0, 1, 0], [0, 0, 0, 1], [1, 0, 0, 0], [0, 1, 0, 0]]
    four = links((fault(Partition), (0, 2)), (fault(Partition), (0, 1)))
    assert not four.any()


def test_loss_takes_its_share_of_the_targets_links_in_both_directions() -> None:
    loss = (fault(Loss, probability=0.25), (0,))
    heard = np.array([links(loss, tick=tick) for tick in range(2000)])
    share = heard.mean(axis=0)
    assert (share[1:, 1:] == MESH[1:, 1:]).all()
    assert share[0, 1:] == pytest.approx(0.75, abs=0.035)  # 3 sigma and more
    assert share[1:, 0] == pytest.approx(0.75, abs=0.035)
    assert (heard[:, 0, 1] != heard[:, 1, 0]).mean() == pytest.approx(2 * 0.25 * 0.75, abs=0.04)
    two = np.array([links(loss, loss, tick=tick)[0, 1] for tick in range(2000)])
    assert two.mean() == pytest.approx(0.75**2, abs=0.04)  # each draws for itself


def test_loss_is_the_same_for_those_who_live_whoever_is_dead() -> None:
    active = [Active(0, fault(Loss, probability=0.5), (0, 1, 2, 3), 0, None)]
    for tick in range(20):
        whole = radio.carried(MESH, active, seed=1, tick=tick)
        survivors = MESH.copy()
        survivors[2] = survivors[:, 2] = False
        part = radio.carried(survivors, active, seed=1, tick=tick)
        assert (part == (whole & survivors)).all()


THREE = HEAD + "".join(
    f'[[robots]]\nname = "{name}"\nstart = [{2.0 * x_m}, 0.0, 0.0]\n'
    for x_m, name in enumerate("abc")
)


def heard_by(
    listener: int, ticks: int, *struck: tuple[Fault, tuple[int, ...]], begin: int = 4
) -> list[list[tuple[str, int]]]:
    """What a robot of THREE hears from the tick at which faults begin; all speak in every tick."""
    world = world_of(THREE)
    state = drive(world, simulation.init(world), begin, a=STILL, b=STILL, c=STILL)
    state = inflicted(world, state, *struck)
    heard = []
    for _ in range(ticks):
        state, _ = simulation.relieve(world, state)
        frame = simulation.sense(world, state)[listener]
        heard.append([(beacon.name, beacon.tick) for beacon in frame.beacons])
        state = drive(world, state, 1, a=STILL, b=STILL, c=STILL)
    return heard


def test_delay_brings_older_beacons_and_the_newest_when_it_is_over() -> None:
    late = (fault(Delay, delay_s=0.16, for_s=0.4), (0,))
    assert heard_by(1, 7, late) == [
        [("c", 3)],
        [("c", 4)],
        [("a", 3), ("c", 5)],
        [("a", 4), ("c", 6)],
        [("a", 5), ("c", 7)],
        [("a", 8), ("c", 8)],
        [("a", 9), ("c", 9)],
    ]
    assert heard_by(0, 4, late)[2:] == [[("b", 3), ("c", 3)], [("b", 4), ("c", 4)]]


def test_delays_do_not_add_up_the_longest_counts() -> None:
    struck = (fault(Delay, delay_s=0.16, for_s=0.48), (0,)), (fault(Delay, delay_s=0.32), (0, 1))
    heard = [[tick for name, tick in one if name == "a"] for one in heard_by(1, 8, *struck)]
    assert heard == [[], [], [], [], [3], [4], [5], [6]]


def test_duplicate_brings_the_one_before_after_the_newest() -> None:
    twice = (fault(Duplicate, probability=1.0), (0,))
    assert heard_by(1, 3, twice) == [
        [("a", 3), ("c", 3)],  # what was said before is not known any more
        [("a", 4), ("a", 3), ("c", 4)],
        [("a", 5), ("a", 4), ("c", 5)],
    ]
    late = (fault(Delay, delay_s=0.16), (0,))
    assert heard_by(1, 4, twice, late)[2:] == [
        [("a", 3), ("c", 5)],
        [("a", 4), ("a", 3), ("c", 6)],
    ]
    lost = (fault(Loss, probability=1.0), (0,))
    assert heard_by(1, 2, twice, lost) == [[("c", 3)], [("c", 4)]]


def test_duplicate_draws_its_share() -> None:
    heard = heard_by(1, 400, (fault(Duplicate, probability=0.3), (0,)))
    twice = sum(len([name for name, _ in one if name == "a"]) == 2 for one in heard)
    assert twice / 400 == pytest.approx(0.3, abs=0.07)


def test_frames_with_late_and_double_beacons_are_rebuilt_from_their_records() -> None:
    world = world_of(THREE)
    state = simulation.init(world)
    struck = ((fault(Delay, delay_s=0.24), (0,)), (fault(Duplicate, probability=0.5), (0, 1, 2)))
    beacons: dict[tuple[int, int], Beacon] = {}
    doubles = 0
    for tick in range(20):
        if tick == 3:
            state = inflicted(world, state, *struck)
        frames = simulation.sense(world, state)
        commands = orders(tick, a=STILL, b=STILL, c=STILL)
        record = simulation.record(world, state, frames, commands.values())
        for sent, frame in zip(frames, record.frames, strict=True):
            rebuilt = simulation.frame_of(world.scenario, frame, tick, record.stamp_ns, beacons)
            assert rebuilt == sent
            doubles += len(sent.beacons) > len({beacon.name for beacon in sent.beacons})
        for row, one in enumerate(commands.values()):
            beacons[row, tick] = one.beacon
        state = simulation.step(world, state, commands)
    assert doubles > 5


def test_history_is_kept_only_as_long_as_it_is_needed() -> None:
    world = world_of(THREE)
    state = drive(world, simulation.init(world), 4, a=STILL, b=STILL, c=STILL)
    assert state.history == ()
    struck = (fault(Loss), (0,)), (fault(Delay, delay_s=0.4, for_s=1.6), (0,))
    state = drive(world, inflicted(world, state, *struck), 19, a=STILL, b=STILL, c=STILL)
    assert [len(said) for said in state.history] == [7, 7, 7]  # 5 ticks, one due, one before it
    state, over = simulation.relieve(world, drive(world, state, 1, a=STILL, b=STILL, c=STILL))
    assert len(over) == 1
    assert state.history == ()
