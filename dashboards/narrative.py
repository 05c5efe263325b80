"""A run in words, for somebody who was not there.

    Course, Summary, Incident ... --tell--> paragraphs: what was run, how it ended, what went wrong

Every figure in it is one of the summary's, or of an incident.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from dashboards import course
from dashboards.course import Course
from dashboards.incidents import Incident
from swarm import faults, metrics, movers
from swarm.scenario import Scenario

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
NAMED_MAX = 4  # robots; more are counted
TOLD_MAX = 8  # incidents; the table has them all

# What a fault does, behind the names of those whom it strikes.
STRUCK = {
    "kill": "was killed (SIGKILL)",
    "restart": "was killed, to be started again",
    "hang": "was stopped (SIGSTOP)",
    "slow": "began to answer late",
    "loss": "began to lose beacons",
    "delay": "heard and was heard with a delay",
    "duplicate": "began to get beacons twice",
    "partition": "was cut off from the others",
    "deaf": "went deaf",
    "mute": "went mute",
    "dropout": "lost beams of the lidar",
    "sensor-stuck": "had a lidar that stuck",
    "noise": "had a noisy lidar",
    "bias": "had a lidar with a bias",
    "nan": "had a lidar without a valid reading",
    "actuator-stuck": "had motors that stuck",
    "weak": "had weak motors",
    "dead": "had motors that were dead",
    "corrupt": "got garbage on its topics",
    "disk-full": "found its disk full",
}
OUTCOMES = {
    "succeeded": "It succeeded",
    "collided": "It failed by collision",
    "timeout": "It ran out of time",
    "failed": "It failed",
}


class Story(msgspec.Struct, frozen=True):
    """The run in words."""

    lead: str  # one sentence: the most important
    before: tuple[str, ...]  # what was run, and how it ended
    incidents: tuple[str, ...]  # the first TOLD_MAX
    after: tuple[str, ...]

    @property
    def paragraphs(self) -> tuple[str, ...]:
        """All of it."""
        return (*self.before, *self.incidents, *self.after)


def tell(seen: Course, summary: metrics.Summary, found: Sequence[Incident]) -> Story:
    """Words for a run."""
    more = (
        f"{_count(len(found) - TOLD_MAX)} more incidents are in the table below."
        if len(found) > TOLD_MAX
        else ""
    )
    return Story(
        _tied(_lead(summary, found))[0],
        _tied(_setting(seen.path.scenario, summary), f"{_ending(summary)} {_closeness(seen)}"),
        _tied(*(_incident(seen.path.scenario, summary, one) for one in found[:TOLD_MAX])),
        _tied(more, _leaders(seen, summary, found), _yielding(seen), _expectations(summary)),
    )


# --- the parts ----------------------------------------------------------------------------------


def _lead(summary: metrics.Summary, found: Sequence[Incident]) -> str:
    """One sentence, with the worst that happened."""
    arrived = (
        "the robot is where it should be"
        if summary.arrived == summary.robots == 1
        else f"all {_word(summary.robots)} robots are where they should be"
        if summary.arrived == summary.robots
        else f"{_word(summary.arrived)} of {_word(summary.robots)} robots arrived"
        if summary.arrived
        else f"none of {_word(summary.robots)} robots arrived"
    )
    text = f"{OUTCOMES[summary.outcome]} after {summary.sim_time_s:.1f} s: {arrived}"
    leaders = [one for one in found if one.led]
    if leaders:
        one = leaders[0]
        who = names(one.robots)
        who = "the leader" if who == "leader" else f"the leader, {who},"
        text += f"; {who} {_struck(one)} at {one.time_s:.2f} s"
        text += (
            f", and {_span(one.successor_s)} all followed {one.successor}"
            if one.successor and one.successor_s is not None
            else " and nobody took its place"
        )
    elif found:
        text += f"; {_word(len(found))} incident{'s' if len(found) > 1 else ''}"
    return f"{text}."


def _setting(scenario: Scenario, summary: metrics.Summary) -> str:
    count = len(scenario.robots)
    who = f"{_count(count)} robot{'s' if count > 1 else ''}"
    formation = scenario.formation
    led = "" if formation is None else formation.leader
    what = (
        f" in formation behind {'their leader' if led == 'leader' else led}"
        if formation is not None
        else ""
        if any(robot.goal is not None for robot in scenario.robots)
        else " with nowhere to go"
    )
    obstacles = len(scenario.obstacles) + (
        scenario.random_obstacles.count if scenario.random_obstacles is not None else 0
    )
    among = f" among {_word(obstacles)} obstacle{'s' if obstacles > 1 else ''}" if obstacles else ""
    moving = len(movers.moving(scenario.obstacles))
    if 0 < moving < obstacles:
        among += f", {_word(moving)} of them moving"
    elif moving:
        among += f" that move{'s' if moving == 1 else ''}"
    how = (
        "all in one process, in lock-step"
        if summary.bus == "memory"
        else "in lock-step"
        if summary.bus not in ("memory", "zenoh") and summary.clock == "lockstep"
        else "each a process of its own over Zenoh, "
        + ("in lock-step" if summary.clock == "lockstep" else "in real time")
    )
    planned = len(scenario.faults)
    asked = (
        f" {_count(planned)} fault{'s were' if planned > 1 else ' was'} planned: "
        f"{_listed([faults.text_of(fault) for fault in scenario.faults])}."
        if planned
        else " No fault was planned."
    )
    return (
        f"{who}{what}{among}; scenario {summary.scenario}, seed {summary.seed}, "
        f"{how}, with a tick of {scenario.dt_s:g} s.{asked}"
    )


def _ending(summary: metrics.Summary) -> str:
    text = f"{OUTCOMES[summary.outcome]} after {summary.sim_time_s:.2f} s"
    if summary.makespan_s is not None:
        text += f", the last robot having arrived at {summary.makespan_s:.2f} s"
    groups: dict[str, list[str]] = {}
    for row in summary.per_robot:
        reason = f" ({row.reason})" if row.reason else ""
        groups.setdefault(f"{row.outcome}{reason}", []).append(row.name)
    if set(groups) != {"arrived"}:
        text += ": " + ", ".join(
            f"{names(who)} {_became(outcome)}" for outcome, who in groups.items()
        )
    touched = summary.collisions + summary.collisions_excused
    text += (
        "; nothing touched anything."
        if touched == 0
        else f"; {_word(touched)} bod{'ies' if touched > 1 else 'y'} touched something."
    )
    formation = summary.formation
    if formation is not None and formation.error_m_max is not None:
        text += f" The formation was out of shape by at most {formation.error_m_max:.2f} m"
        text += (
            f" and by {formation.error_m_final:.3f} m at the end."
            if formation.error_m_final is not None
            else "; at the end nobody followed a live leader."
        )
    return text


def _became(outcome: str) -> str:
    kind, _, reason = outcome.partition(" ")
    words = {
        "arrived": "arrived",
        "collided": "collided",
        "killed": "was killed and did not come back",
        "failed": "was lost",
        "blocked": "gave up",
        "timeout": "did not arrive in time",
    }
    return f"{words[kind]} {reason}".strip()


def _closeness(seen: Course) -> str:
    parts = []
    robots, obstacle = course.nearest_robot(seen), course.nearest_obstacle(seen)
    if robots is not None:
        parts.append(
            f"{_metres(robots.distance_m)} between {robots.robot} and {robots.to} "
            f"at {robots.time_s:.2f} s"
        )
    if obstacle is not None:
        parts.append(
            f"{_metres(obstacle.distance_m)} from {obstacle.robot} to an obstacle "
            f"at {obstacle.time_s:.2f} s"
        )
    return f"The least distances of surfaces were {' and '.join(parts)}." if parts else ""


def _incident(scenario: Scenario, summary: metrics.Summary, one: Incident) -> str:
    """What happened, why, and how it was taken; a few sentences."""
    when = f"At {one.time_s:.2f} s (tick {one.tick})"
    who = names(one.robots) if one.robots else "the world"
    led = ", which led the formation," if one.led else ""
    cause = f", as asked for by {one.cause}" if one.injected else f": {one.cause}"
    texts = [f"{when} {who}{led} {_struck(one)}{cause}."]
    if one.kind == "fault failed":
        texts = [f"{when} a fault could not be carried out: {one.cause}."]
    if one.detected_s is not None and one.led:
        texts.append(f"Nobody followed it any more {_span(one.detected_s)}.")
    elif one.detected_s is not None:
        texts.append(f"It was taken for lost {_span(one.detected_s)}.")
    if one.led:
        texts.append(_succession(scenario, summary, one))
    if one.back_s is not None and not one.robots:
        texts.append("It was started again and went on where it had been.")
    elif one.back_s is not None:
        texts.append(
            f"{_span(one.back_s).capitalize()} a new process of {who} went on, remembering nothing."
        )
    elif one.over_s is not None:
        texts.append(f"It was over {_span(one.over_s)}.")
    if one.shape is not None and one.shape.most_m is not None:
        texts.append(_shape_text(one))
    return " ".join(texts)


def _succession(scenario: Scenario, summary: metrics.Summary, one: Incident) -> str:
    if not one.successor or one.successor_s is None:
        left = summary.sim_time_s - one.time_s
        return (
            f"Nobody took its place in the {left:.1f} s that were left: "
            "the others had nobody to follow."
        )
    term = next(row.term for row in summary.leaders if row.tick > one.tick)
    again = " again" if one.successor in one.robots else ""
    return f"All followed {one.successor}{again} {_span(one.successor_s)}, in term {term}."


def _shape_text(one: Incident) -> str:
    shape = one.shape
    assert shape is not None
    assert shape.most_m is not None
    text = f"The formation was then out of shape by at most {shape.most_m:.2f} m"
    if shape.before_m is not None:
        text += f" ({shape.before_m:.2f} m just before)"
    if shape.settled_s is None:
        return f"{text} and did not settle within 0.1 m."
    if shape.settled_s == 0.0:
        return f"{text}."
    return f"{text}; {_span(shape.settled_s)} everyone was within 0.1 m of its slot again."


def _leaders(seen: Course, summary: metrics.Summary, found: Sequence[Incident]) -> str:
    """Changes of the leader that no incident accounts for."""
    told = {(one.tick, one.successor) for one in found if one.successor}
    dt_s = seen.path.scenario.dt_s
    changes = []
    for before, row in pairwise(summary.leaders):
        if not any(
            tick <= row.tick and name == row.name and tick >= before.tick for tick, name in told
        ):
            changes.append(f"{row.name} at {row.tick * dt_s:.2f} s (term {row.term})")
    if not changes:
        return ""
    if len(changes) > NAMED_MAX:
        return f"The leader changed {_word(len(changes))} times more, as the table below tells."
    return f"The leader changed without such a cause: to {_listed(changes)}."


def _yielding(seen: Course) -> str:
    found = course.waits(seen)
    if not found:
        return "Nobody had to wait for anybody."
    times = sum(one.times for one in found)
    longest = max(found, key=lambda one: one.longest_s)
    return (
        f"Robots gave way to each other {'once' if times == 1 else f'{_word(times)} times'}, "
        f"{sum(one.total_s for one in found):.1f} s in all; the longest wait was {longest.robot}'s "
        f"for {longest.to}, {longest.longest_s:.2f} s."
    )


def _expectations(summary: metrics.Summary) -> str:
    met, missed = summary.expect.met, summary.expect.missed
    if not met and not missed:
        return ""
    if not missed:
        if len(met) == 1:
            return "The one expectation of the scenario is met."
        return f"All {_word(len(met))} expectations of the scenario are met."
    return (
        f"{_count(len(missed))} of {_word(len(met) + len(missed))} "
        f"expectation{'s' if len(met) + len(missed) > 1 else ''} of the scenario "
        f"{'are' if len(missed) > 1 else 'is'} missed: {_listed(missed)}."
    )


# --- words --------------------------------------------------------------------------------------


def names(who: Sequence[str]) -> str:
    """Names as a person lists them; many are counted."""
    if len(who) > NAMED_MAX:
        return f"{_word(len(who))} robots"
    return _listed(who)


def _listed(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"


def _tied(*texts: str) -> tuple[str, ...]:
    """Texts that are not empty, with no line break between a figure and its unit."""
    return tuple(
        re.sub(r"(?<=[0-9]) (?=(s|m)\b)", "\u00a0", text.strip()) for text in texts if text.strip()
    )


def _struck(one: Incident) -> str:
    words = {
        "lost": "was lost",
        "hung": "hung",
        "missing": "did not come up",
        "collision": "collided",
        "world restarted": "was started again",
        **STRUCK,
    }
    text = words.get(one.kind, one.kind)
    return text.replace("was ", "were ", 1) if len(one.robots) > 1 else text


def _span(seconds: float | None) -> str:
    return "" if seconds is None else "at once" if seconds == 0.0 else f"after {seconds:.2f} s"


def _metres(distance_m: float) -> str:
    return f"{round(distance_m, 3) + 0.0:.3f} m"  # never minus zero


def _word(number: int) -> str:
    return NUMBERS[number] if 0 <= number < len(NUMBERS) else str(number)


def _count(number: int) -> str:
    """The same at the beginning of a sentence."""
    return _word(number).capitalize()
