"""Swarms in memory that lose their leader, their followers or each other, and go on.

Repeat by hand:  swarm run two-obstacles --bus memory --fault kill:leader@9.6
"""

from __future__ import annotations

import pytest

from swarm import metrics, scenario
from swarm.messages import TickRecord
from swarm.run import library, lockstep

OBSTACLES_END_M = 8.5  # of two-obstacles


class Film:
    """A run of a built-in scenario with faults, watched tick by tick."""

    def __init__(self, name: str, *faults: str) -> None:
        _, where, data = library.read_scenario(name)
        self.plan = scenario.decode(data, where, faults=faults, settings=["duration_s=120.0"])
        self.errors_m: list[float | None] = []
        self.passed_tick: int | None = None  # last obstacle behind all who live
        self._score = metrics.begin(self.plan)
        conduct = lockstep.run(self.plan, [self._watch])
        facts = metrics.Facts(scenario=name, run="test", bus="memory")
        self.summary = metrics.summary(conduct.score, facts)

    def _watch(self, record: TickRecord) -> None:
        metrics.observe(self._score, record)
        self.errors_m.append(self._score.error_m)
        behind = all(
            robot.pose.x_m - 0.22 > OBSTACLES_END_M for robot in record.robots if robot.alive
        )
        if behind and self.passed_tick is None:
            self.passed_tick = record.tick

    def ends_well(self, arrived: int) -> None:
        assert self.summary.collisions == 0
        assert (self.summary.outcome, self.summary.arrived) == ("succeeded", arrived)

    def terms(self) -> list[tuple[str, int]]:
        return [(row.name, row.term) for row in self.summary.leaders]


def test_survivors_of_a_dead_leader_agree_reform_and_arrive() -> None:
    film = Film("two-obstacles", "kill:leader@9.6")
    film.ends_well(arrived=5)
    assert film.terms() == [("leader", 0), ("robot2", 1)]
    assert film.summary.leaders[1].tick - 120 <= 12  # 1 s
    assert film.passed_tick is not None
    within = film.errors_m[film.passed_tick : film.passed_tick + 125]  # 10 s
    assert min(error_m for error_m in within if error_m is not None) <= 0.05
    (fault,) = film.summary.faults
    assert fault.detected_s is not None
    assert fault.detected_s <= 0.64
    assert fault.recovered_s is not None


@pytest.mark.parametrize(
    ("faults", "arrived", "last"),
    [
        (("hang:leader@9.6+4",), 6, "robot2"),
        (("restart:leader@9.6+2",), 6, "robot2"),
        (("restart:robot4@9.6+2",), 6, "leader"),
        (("partition:leader/robot1/robot3@9.6+3.04",), 6, "robot2"),
        (("loss:all@0,probability=0.2",), 6, "leader"),
        (("dead:leader@9.6+6",), 6, "robot2"),
        (("kill:leader@24", "kill:robot2@27.2"), 4, "robot5"),
        (("kill:leader@32.0",), 5, "robot2"),  # its body stands on the goal
    ],
)
def test_formation_survives(faults: tuple[str, ...], arrived: int, last: str) -> None:
    film = Film("two-obstacles", *faults)
    film.ends_well(arrived)
    assert film.summary.leaders[-1].name == last
    assert film.errors_m[-1] is not None
    assert film.errors_m[-1] <= 0.05


def test_last_of_two_arrives_alone() -> None:
    text = (
        'title = "two"\nseed = 1\ndt_s = 0.08\nduration_s = 60.0\n'
        '[line]\ncount = 2\ngoal = [6.0, 0.0]\n[formation]\nleader = "robot1"\n'
    )
    plan = scenario.decode(text.encode(), "test", faults=["kill:robot1@2.4"])
    facts = metrics.Facts(scenario="two", run="test", bus="memory")
    summary = metrics.summary(lockstep.run(plan).score, facts)
    assert [row.outcome for row in summary.per_robot] == ["killed", "arrived"]
    assert summary.outcome == "succeeded"
