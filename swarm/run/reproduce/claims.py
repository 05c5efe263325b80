"""What the paper claims of its figures, as measures of recorded runs.

    runs of an experiment --measure--> Verdict: our figure as a text, met or not

Bounds of a formation are those of the scenario's own [expect]; what is not there has a name here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import radians

import msgspec
import numpy as np

from dashboards import tracks
from dashboards.tracks import Tracks
from swarm.metrics import FormationRow, RobotRow, Summary
from swarm.scenario import Obstacle

LINE_M = 0.01  # robots that follow the same line stay this near to it
APART_M = 0.05  # between bodies that have inertia and torque limits
# The angle of the resultant force matches the trajectory: over each whole run the median of its
# difference to the heading is below the first, and below the second for at least this share of the
# time. Near an obstacle straight ahead the force jumps by up to 180 degrees and the body does not,
# so neither a maximum nor a high quantile would mean anything.
FORCE_MEDIAN_RAD = radians(5.0)
FORCE_NEAR_RAD = radians(30.0)
FORCE_NEAR_SHARE = 0.8


class Run(msgspec.Struct, frozen=True, eq=False):
    """One run that was made, with what it came to."""

    summary: Summary
    tracks: Tracks


class Verdict(msgspec.Struct, frozen=True):
    """Our figure, and whether it meets the claim."""

    ours: str
    met: bool


Runs = Sequence[Run]
Measure = Callable[[Runs], Verdict]


# --- any run --------------------------------------------------------------------------------------


def all_arrive_without_contact(runs: Runs) -> Verdict:
    """Every robot of every run arrives and nothing is ever touched."""
    robots = sum(run.summary.robots for run in runs)
    arrived = sum(run.summary.arrived for run in runs)
    contacts = sum(run.summary.collisions for run in runs)
    good = all(run.summary.outcome == "succeeded" for run in runs)
    text = f"{arrived} of {robots} arrive, {contacts} contacts"
    for what, values in (
        ("obstacles", [run.summary.min_clearance_obstacle_m for run in runs]),
        ("robots", [run.summary.min_clearance_robot_m for run in runs]),
    ):
        known = [value for value in values if value is not None]
        text += f", {min(known):.3f} m from {what}" if known else ""
    return Verdict(text, good and arrived == robots and contacts == 0)


def stays_apart(runs: Runs) -> Verdict:
    """Bodies of robots keep APART_M between them."""
    gaps_m = [run.summary.min_clearance_robot_m for run in runs]
    known = [gap_m for gap_m in gaps_m if gap_m is not None]
    if not known:
        return Verdict("one robot only", False)
    return Verdict(f"{min(known):.3f} m (>= {APART_M:g} m)", min(known) >= APART_M)


# --- one robot ------------------------------------------------------------------------------------


def force_matches_trajectory(runs: Runs) -> Verdict:
    """The angle of the resultant force follows the heading, in the worst run of all."""
    median_rad, share = 0.0, 1.0
    for run in runs:
        off_rad = np.abs(tracks.wrap(run.tracks.forces_rad - run.tracks.poses[:, :, 2]))
        off_rad = off_rad[np.isfinite(off_rad)]
        if len(off_rad) == 0:
            return Verdict("no force at all", False)
        median_rad = max(median_rad, float(np.median(off_rad)))
        share = min(share, float(np.mean(off_rad <= FORCE_NEAR_RAD)))
    met = median_rad <= FORCE_MEDIAN_RAD and share >= FORCE_NEAR_SHARE
    return Verdict(
        f"worst field: median {np.degrees(median_rad):.1f} deg from the heading "
        f"(<= {np.degrees(FORCE_MEDIAN_RAD):g}), within {np.degrees(FORCE_NEAR_RAD):g} deg for "
        f"{100.0 * share:.0f} % of the time (>= {100.0 * FORCE_NEAR_SHARE:g} %)",
        met,
    )


# --- encounters -----------------------------------------------------------------------------------


def first_passes_others_wait(runs: Runs) -> Verdict:
    """The robot of the first row never waits, some of the others do."""
    first_s = sum(run.summary.per_robot[0].waiting_s for run in runs)
    others_s = sum(sum(_waiting(run)[1:]) for run in runs)
    name = runs[0].summary.per_robot[0].name
    text = f"{name} waits {first_s:.1f} s, the others {others_s:.1f} s together"
    return Verdict(text, first_s == 0.0 and others_s > 0.0)


def nobody_waits(runs: Runs) -> Verdict:
    """Robots that treat each other as moving obstacles go round each other instead."""
    total_s = sum(sum(_waiting(run)) for run in runs)
    return Verdict(f"{total_s:.1f} s of waiting", total_s == 0.0)


def _waiting(run: Run) -> list[float]:
    return [row.waiting_s for row in run.summary.per_robot]


# --- formations -----------------------------------------------------------------------------------


def reforms(runs: Runs) -> Verdict:
    """The formation stands again soon after the last robot has avoided something."""
    settling_s = _formation(runs).settling_s
    bound_s = runs[0].tracks.scenario.expect.formation_settling_s
    assert bound_s is not None
    if settling_s is None:
        return Verdict("never settles", False)
    text = f"settles {settling_s:.2f} s after the last switch (<= {bound_s:g} s)"
    return Verdict(text, settling_s <= bound_s)


def errors_converge(runs: Runs) -> Verdict:
    """Every follower is in its slot at the end, wherever it was in between."""
    bound_m = runs[0].tracks.scenario.expect.formation_error_m_final
    assert bound_m is not None
    largest_m = _formation(runs).error_m_max
    rows = _followers(runs)
    finals_m = [row.final_error_m for row in rows if row.final_error_m is not None]
    if len(finals_m) < len(rows) or not rows or largest_m is None:
        return Verdict("a follower has no slot at the end", False)
    text = (
        f"from at most {largest_m:.2f} m to "
        + ", ".join(f"{final_m:.3f}" for final_m in finals_m)
        + f" m (<= {bound_m:g} m)"
    )
    return Verdict(text, max(finals_m) <= bound_m)


def mirrors(runs: Runs) -> Verdict:
    """The paths of the scenario's mirror pairs are images of each other, at every moment."""
    expect = runs[0].tracks.scenario.expect
    symmetry_m, bound_m = _formation(runs).symmetry_m, expect.formation_symmetry_m
    assert symmetry_m is not None
    assert bound_m is not None
    return Verdict(f"{symmetry_m:.3f} m apart at most (<= {bound_m:g} m)", symmetry_m <= bound_m)


def on_one_line(*names: str) -> Measure:
    """Measure: the named robots stay on the x axis."""

    def measure(runs: Runs) -> Verdict:
        path = runs[0].tracks
        off_m = [float(np.abs(path.poses[:, path.scenario.row(name), 1]).max()) for name in names]
        text = ", ".join(f"{name} {value:.4f} m" for name, value in zip(names, off_m, strict=True))
        return Verdict(f"off the line: {text} (<= {LINE_M:g} m)", max(off_m) <= LINE_M)

    return measure


def turn_back_and_pass_below(*names: str) -> Measure:
    """Measure: the named robots leave the gap, turn back and pass the last obstacle below.

    Of the way between the centre of the gap (the first obstacle's x) and the last obstacle's:
    it is highest behind the gap, where the first obstacle has ended, so it did not just go down
    from there; from that point it comes down by a body's diameter or more; and wherever it crosses
    the last obstacle's x, on the line between two ticks, the whole body is below that.
    """

    def measure(runs: Runs) -> Verdict:
        path = runs[0].tracks
        gap, last = path.obstacles[0], path.obstacles[-1]
        found = [_turns_back(path, path.scenario.row(name), gap, last) for name in names]
        text = ", ".join(
            f"{name} {'never gets there' if way is None else way.text()}"
            for name, way in zip(names, found, strict=True)
        )
        return Verdict(text, all(way is not None and way.met for way in found))

    return measure


class _Way(msgspec.Struct, frozen=True):
    """Of one robot, between the gap and the last obstacle."""

    highest_y_m: float
    passes_y_m: float  # highest of its crossings of the obstacle's x
    met: bool

    def text(self) -> str:
        return f"rises to y {self.highest_y_m:.2f} m and passes at {self.passes_y_m:.2f} m"


def _turns_back(path: Tracks, row: int, gap: Obstacle, last: Obstacle) -> _Way | None:
    assert gap.circle is not None
    assert last.circle is not None
    x_m, y_m = path.poses[:, row, 0], path.poses[:, row, 1]
    body_m = path.scenario.robots[row].body_radius_m
    leaves = np.flatnonzero(x_m >= gap.circle[0])
    beyond = x_m >= last.circle[0]
    before = np.flatnonzero(beyond[1:] != beyond[:-1])
    if len(leaves) == 0 or len(before) == 0:
        return None
    highest = leaves[0] + int(np.argmax(y_m[leaves[0] : before[0] + 1]))
    share = (last.circle[0] - x_m[before]) / (x_m[before + 1] - x_m[before])
    passes_m = float((y_m[before] + share * (y_m[before + 1] - y_m[before])).max())
    met = (
        x_m[highest] > gap.circle[0] + gap.circle[2]
        and y_m[highest] - passes_m >= 2.0 * body_m
        and passes_m + body_m < last.circle[1] - last.circle[2]
    )
    return _Way(float(y_m[highest]), passes_m, bool(met))


def _formation(runs: Runs) -> FormationRow:
    formation = runs[0].summary.formation
    assert formation is not None
    return formation


def _followers(runs: Runs) -> list[RobotRow]:
    run = runs[0]
    return [
        row
        for number, row in enumerate(run.summary.per_robot)
        if run.tracks.scenario.slot(number) is not None
    ]
