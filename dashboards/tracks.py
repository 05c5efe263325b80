"""A whole run as arrays, for pictures and for claims about it.

    TickRecord ... --collect--> Tracks --tracking_errors--> e of eq. 47

Slots are those of the metrics, so a picture shows what the summary's figures were taken from.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2, nan

import msgspec
import numpy as np
import numpy.typing as npt

from swarm import errors, metrics
from swarm.geometry import TAU, Floats
from swarm.messages import RobotRecord, TickRecord
from swarm.scenario import Obstacle, Scenario

WAITS = "waits"  # shown instead of the mode while a robot yields to another
NOBODY = -1  # instead of a row

States = tuple[tuple[str, ...], ...]  # (ticks, robots)
Rows = npt.NDArray[np.int64]


class Tracks(msgspec.Struct, frozen=True, eq=False):
    """One run; world frame."""

    scenario: Scenario
    obstacles: tuple[Obstacle, ...]
    times_s: Floats  # (ticks,)
    poses: Floats  # (ticks, robots, 3): x_m, y_m, yaw_rad
    slots: Floats  # (ticks, robots, 2) m, nan for who follows nobody
    forces_rad: Floats  # (ticks, robots) angle of the resultant of eq. 38, nan without a force
    states: States  # mode of each robot, or WAITS
    leaders: Rows  # (ticks, robots) row of the leader that each follows, NOBODY when it has none


def collect(
    scenario: Scenario,
    obstacles: tuple[Obstacle, ...],
    records: Iterable[TickRecord],
    score: metrics.Score | None = None,
) -> Tracks:
    """Tracks of a run from its records in order.

    Args:
        score: one that has begun, for who wants it afterwards.
    Raises:
        RecordingError: there is no record.
    """
    rows = {robot.name: row for row, robot in enumerate(scenario.robots)}
    score = metrics.begin(scenario) if score is None else score
    times_s: list[float] = []
    poses, slots, forces_rad = [], [], []
    states: list[tuple[str, ...]] = []
    leaders: list[list[int]] = []
    for record in records:
        metrics.observe(score, record)
        times_s.append(record.stamp_ns * 1e-9)
        poses.append([(one.pose.x_m, one.pose.y_m, one.pose.yaw_rad) for one in record.robots])
        slots.append(
            [
                (nan, nan) if tally.target is None or not tally.follows else tally.target
                for tally in score.tallies
            ]
        )
        angles_rad = [nan] * len(rows)
        for command in record.commands:
            x, y = command.trace.forces.resultant
            if x != 0.0 or y != 0.0:
                angles_rad[rows[command.robot]] = atan2(y, x)
        forces_rad.append(angles_rad)
        states.append(_states(record))
        leaders.append([_leader(robot, record, rows) for robot in record.robots])
    if not times_s:
        raise errors.RecordingError(f"{scenario.title}: expected ticks to draw, got none")
    return Tracks(
        scenario=scenario,
        obstacles=obstacles,
        times_s=np.array(times_s),
        poses=np.array(poses),
        slots=np.array(slots),
        forces_rad=np.array(forces_rad),
        states=tuple(states),
        leaders=np.array(leaders),
    )


def _leader(robot: RobotRecord, record: TickRecord, rows: dict[str, int]) -> int:
    """Row of whom a live robot follows, if that one lives; a leader follows itself."""
    if not robot.alive or robot.beacon is None or robot.beacon.leadership is None:
        return NOBODY
    row = rows.get(robot.beacon.leadership.name, NOBODY)
    return row if row != NOBODY and record.robots[row].alive else NOBODY


def _states(record: TickRecord) -> tuple[str, ...]:
    return tuple(
        "collided"
        if robot.contact
        else "dead"
        if not robot.alive
        else "silent"
        if robot.beacon is None
        else WAITS
        if robot.beacon.yields_to is not None
        else robot.beacon.mode
        for robot in record.robots
    )


def wrap(angles_rad: Floats) -> Floats:
    """Same directions in [-pi, pi)."""
    wrapped: Floats = (angles_rad + TAU / 2.0) % TAU - TAU / 2.0
    return wrapped


def followers(tracks: Tracks) -> npt.NDArray[np.intp]:
    """Rows of the robots that have a slot at any time."""
    return np.flatnonzero(np.isfinite(tracks.slots[:, :, 0]).any(axis=0))


def tracking_errors(tracks: Tracks) -> tuple[Floats, Floats, Floats]:
    """Errors of all robots behind the leader that each follows, nan for who follows nobody.

    Eq. 47, desired minus actual, from the true poses and for the centres of the bodies (the
    controller uses points a little before them), by the nominal slot also while the robot avoids
    something and has another for a while.

    Returns:
        (ticks, robots) distance error in m, bearing error in rad as seen from the leader, and
        the distance of the robot from its slot in m.
    """
    positions = tracks.poses[:, :, :2]
    led = np.maximum(tracks.leaders, 0)  # where nobody leads there is no slot either
    origin = np.take_along_axis(positions, led[:, :, None], axis=1)
    desired, actual = tracks.slots - origin, positions - origin
    distance_m = _lengths(desired) - _lengths(actual)
    bearing_rad = wrap(
        np.arctan2(desired[:, :, 1], desired[:, :, 0])
        - np.arctan2(actual[:, :, 1], actual[:, :, 0])
    )
    return distance_m, bearing_rad, _lengths(tracks.slots - positions)


def _lengths(vectors: Floats) -> Floats:
    lengths: Floats = np.sqrt((vectors**2).sum(axis=-1))
    return lengths
