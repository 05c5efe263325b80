"""One leader per connected group, soon, whatever happened before.

The election's step alone is driven, over random graphs that change, lose, delay and repeat what is
said, with robots that die, come back, or cannot lead for a while.
"""

from __future__ import annotations

import random
from collections import deque
from itertools import permutations

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import election, peers
from swarm.messages import Beacon, Leadership
from tests.agents import scenes

PATIENCE = 6  # ticks: 0.5 s of 0.08 s
BOUND = 13  # ticks for each step of a group's diameter
DISTURBED_TICKS = 60


class Node(msgspec.Struct):
    """One robot, as far as elections go."""

    name: str
    key: tuple[int, int, int, int]
    state: election.State
    incarnation: int = 0
    alive: bool = True
    awake: bool = True
    fit: bool = True
    tick: int = -1
    known: tuple[Beacon, ...] = ()
    said: Beacon | None = None


class Group:
    """Robots on a graph; whatever happens to them is drawn from one seed."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.count = self.random.choice([1, 2, 2, 3, 4, 5, 6, 9])
        keys = self.random.sample(range(100), self.count)
        leader = self.random.randrange(self.count)
        self.nodes = [self.born(row, key, row == leader) for row, key in enumerate(keys)]
        self.edges: set[tuple[int, int]] = set()
        self.late: list[tuple[int, int, Beacon]] = []  # due tick, listener, what was said
        self.tick = 0
        self.loss = self.random.choice([0.0, 0.2, 0.5])
        self.oldest = self.random.choice([0, 3, 6])  # ticks by which a beacon may come late
        self.rewire()

    def born(self, row: int, key: int, leads: bool, incarnation: int = 0) -> Node:
        name, rank = f"robot{row}", (1, key, 0, row)
        state = election.init(
            name, rank, leads=leads, incarnation=incarnation, patience_ticks=PATIENCE
        )
        return Node(name, rank, state, incarnation)

    def rewire(self) -> None:
        """All in a line, in two halves, or at random: links go both ways."""
        order = self.random.sample(range(self.count), self.count)
        kind = self.random.choice(["line", "all", "halves", "random"])
        pairs = [(one, other) for one in order for other in order if one != other]
        half = set(order[: self.count // 2])
        share = self.random.random()
        self.edges = set()
        for one, other in pairs:
            if one > other:
                continue
            near = abs(order.index(one) - order.index(other)) == 1
            if (
                (kind == "line" and near)
                or kind == "all"
                or (kind == "halves" and (one in half) == (other in half))
                or (kind == "random" and self.random.random() < share)
            ):
                self.edges |= {(one, other), (other, one)}

    def disturb(self) -> None:
        """Perhaps something happens before this tick."""
        draw = self.random.random()
        node = self.nodes[self.random.randrange(self.count)]
        if draw < 0.05:
            self.rewire()
        elif draw < 0.08:
            node.alive = False
        elif draw < 0.12 and not node.alive:
            row = self.nodes.index(node)
            self.nodes[row] = self.born(row, node.key[1], False, node.incarnation + 1)
        elif draw < 0.14:
            node.fit = not node.fit
        elif draw < 0.17:
            node.awake = not node.awake

    def step(self, calm: bool) -> None:
        """Everybody hears what was said in the tick before, and answers."""
        self.tick += 1
        heard: list[list[Beacon]] = [[] for _ in self.nodes]
        for due, row, beacon in self.late:
            if due == self.tick:
                heard[row].append(beacon)
        self.late = [item for item in self.late if item[0] > self.tick]
        for speaker, listener in sorted(self.edges):
            said = self.nodes[speaker].said
            if said is None or said.tick != self.tick - 1:
                continue
            if not calm and self.oldest and self.random.random() < 0.2:
                after = self.random.randint(1, self.oldest)
                self.late.append((self.tick + after, listener, said))
            if calm or self.random.random() >= self.loss:
                heard[listener].append(said)
        for row, node in enumerate(self.nodes):
            if node.alive and node.awake:
                self.random.shuffle(heard[row])
                self.think(node, heard[row])

    def think(self, node: Node, heard: list[Beacon]) -> None:
        node.known = peers.remember(node.known, heard, node.name, self.tick, PATIENCE)
        before = node.state
        node.state = election.step(
            before,
            node.name,
            node.key,
            node.known,
            self.tick,
            self.tick - node.tick,
            fit=node.fit,
            patience_ticks=PATIENCE,
        )
        node.tick = self.tick
        check_growth(before, node.state)
        followed = election.is_followed(node.state, PATIENCE)
        node.said = scenes.beacon(
            node.name,
            scenes.ORIGIN,
            tick=self.tick,
            incarnation=node.incarnation,
            priority=node.key,
            leadership=node.state.leadership,
            leader_tick=node.state.leader_tick if followed else None,
            fit=node.fit and node.state.listen_ticks == 0,
        )

    def components(self) -> list[tuple[list[Node], int]]:
        """Connected groups of those that live, each with its diameter."""
        live = {row for row, node in enumerate(self.nodes) if node.alive and node.awake}
        found: list[tuple[list[Node], int]] = []
        left = set(live)
        while left:
            first = min(left)
            rows = set(self.distances(first, live))
            left -= rows
            reach = [max(self.distances(row, live).values()) for row in rows]
            found.append(([self.nodes[row] for row in sorted(rows)], max(reach)))
        return found

    def distances(self, start: int, live: set[int]) -> dict[int, int]:
        steps, queue = {start: 0}, deque([start])
        while queue:
            at = queue.popleft()
            for one, other in self.edges:
                if one == at and other in live and other not in steps:
                    steps[other] = steps[at] + 1
                    queue.append(other)
        return steps


def check_growth(before: election.State, after: election.State) -> None:
    """A robot's claim only ever rises, and so does the sign of life within one."""
    if before.leadership is None:
        return
    assert after.leadership is not None
    if after.leadership == before.leadership:
        assert after.leader_tick >= before.leader_tick
    else:
        assert election.is_higher(after.leadership, before.leadership)


def followed_by(nodes: list[Node]) -> set[Leadership | None]:
    return {
        node.state.leadership if election.is_followed(node.state, PATIENCE) else None
        for node in nodes
    }


@settings(max_examples=250)
@given(st.integers(0, 2**32 - 1))
def test_every_group_soon_follows_one_leader_that_lives(seed: int) -> None:
    group = Group(seed)
    for _ in range(DISTURBED_TICKS):
        group.disturb()
        group.step(calm=False)
    for node in group.nodes:
        node.awake = True
    while group.late:
        group.step(calm=True)
    settled_at = group.tick
    groups = [(nodes, max(1, diameter)) for nodes, diameter in group.components()]
    for _ in range(max([BOUND * diameter for _, diameter in groups], default=0) + 2 * BOUND):
        group.step(calm=True)
        for nodes, diameter in groups:
            if group.tick - settled_at > BOUND * diameter:
                assert len(followed_by(nodes) - {None}) <= 1
    for nodes, _ in groups:
        (claim,) = followed_by(nodes)
        leaders = [node for node in nodes if node.state.leads]
        if any(node.fit for node in nodes):
            assert claim is not None
            assert [node.name for node in leaders] == [claim.name]
            assert leaders[0].fit
        else:
            assert claim is None


def settle(group: Group, ticks: int) -> list[set[Leadership | None]]:
    seen = []
    for _ in range(ticks):
        group.step(calm=True)
        seen.append(followed_by([node for node in group.nodes if node.alive]))
    return seen


def wired(count: int, *pairs: tuple[int, int]) -> Group:
    """Robots with keys in their order, the first of which leads, linked in a line or as told."""
    group = Group(0)
    group.count, group.late, group.loss, group.oldest = count, [], 0.0, 0
    group.nodes = [group.born(row, row, row == 0) for row in range(count)]
    links = pairs or [(row, row + 1) for row in range(count - 1)]
    group.edges = {*links, *[(other, one) for one, other in links]}
    return group


def test_best_of_those_left_takes_over_a_tick_after_the_silence() -> None:
    group = wired(4, *[(one, other) for one in range(4) for other in range(one)])
    settle(group, 5)
    group.nodes[0].alive = False
    seen = settle(group, 9)
    old, new = Leadership(0, (1, 0, 0, 0), "robot0"), Leadership(1, (1, 1, 0, 1), "robot1")
    # Said once more before it died; silent for 6 ticks after that; the claim is heard one later.
    assert seen == [{old}] * 7 + [{new, None}, {new}]


def test_signs_of_life_reach_the_end_of_a_long_line() -> None:
    group = wired(12)
    settle(group, 60)
    assert settle(group, 40) == [{Leadership(0, (1, 0, 0, 0), "robot0")}] * 40


def test_leader_that_returns_follows_the_one_elected_meanwhile() -> None:
    group = wired(3, (0, 1), (0, 2), (1, 2))
    settle(group, 3)
    group.nodes[0].awake = False
    settle(group, 20)
    group.nodes[0].awake = True
    new = Leadership(1, (1, 1, 0, 1), "robot1")
    assert settle(group, 2) == [{new}] * 2
    group.nodes[0] = group.born(0, 0, leads=True, incarnation=1)
    assert settle(group, 2) == [{new}] * 2
    assert not group.nodes[0].state.leads


def test_halves_that_meet_again_follow_the_later_term() -> None:
    group = wired(4, *[(one, other) for one in range(4) for other in range(one)])
    settle(group, 3)
    whole, group.edges = group.edges, {(0, 1), (1, 0), (2, 3), (3, 2)}
    old, new = Leadership(0, (1, 0, 0, 0), "robot0"), Leadership(1, (1, 2, 0, 2), "robot2")
    assert settle(group, 12)[-1] == {old, new}
    group.edges = whole
    assert settle(group, 1) == [{new}]


def test_leader_that_cannot_lead_is_replaced_and_does_not_come_back() -> None:
    group = wired(3, (0, 1), (0, 2), (1, 2))
    settle(group, 3)
    group.nodes[0].fit = False
    new = Leadership(1, (1, 1, 0, 1), "robot1")
    assert settle(group, 10)[-1] == {new}
    group.nodes[0].fit = True
    assert settle(group, 10) == [{new}] * 10


def test_leader_goes_on_when_nobody_could_replace_it() -> None:
    group = wired(1)
    settle(group, 3)
    group.nodes[0].fit = False
    assert settle(group, 20)[-1] == {None}
    group.nodes[0].fit = True
    assert settle(group, 1) == [{Leadership(0, (1, 0, 0, 0), "robot0")}]


def test_last_one_leads_itself_and_a_restarted_one_listens_first() -> None:
    group = wired(2)
    settle(group, 3)
    group.nodes[0].alive = False
    assert settle(group, 10)[-1] == {Leadership(1, (1, 1, 0, 1), "robot1")}
    group.nodes[1] = group.born(1, 1, leads=False, incarnation=1)
    seen = settle(group, 14)
    assert seen[:12] == [{None}] * 12
    assert seen[-1] == {Leadership(1, (1, 1, 0, 1), "robot1")}


@pytest.mark.parametrize("age", range(1, 7))
def test_late_beacons_of_a_dead_leader_do_not_raise_it(age: int) -> None:
    group = wired(3, (0, 1), (0, 2), (1, 2))
    settle(group, 3)
    last = group.nodes[0].said
    assert last is not None
    group.nodes[0].alive = False
    for after in range(age):  # the same one again and again
        group.late += [(group.tick + 1 + after, row, last) for row in (1, 2)]
    seen = settle(group, 12)
    new = Leadership(1, (1, 1, 0, 1), "robot1")
    assert seen[-4:] == [{new}] * 4


def test_order_of_claims_is_total() -> None:
    ranked = [
        Leadership(2, (1, -500, 0, 4), "robot4"),
        Leadership(1, (0, 0, 0, 0), "leader"),
        Leadership(1, (1, -707, 785, 1), "robot1"),
        Leadership(1, (1, -707, 785, 1), "robot9"),
    ]
    for order in permutations(ranked):
        state = election.State()
        for tick, claim in enumerate(order):
            heard = [scenes.beacon(claim.name, scenes.ORIGIN, tick=tick, leadership=claim)]
            state = election.step(
                state, "robot5", (9, 0, 0, 5), heard, tick, 1, fit=True, patience_ticks=PATIENCE
            )
        assert state.leadership == ranked[0]
