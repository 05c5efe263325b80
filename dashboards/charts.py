"""The figures of a report: those of the paper, and what happened when, on one axis of time.

    Course, Incident ... --draw--> Figure of each name --svg--> text that takes the page's colours

Incidents have the same number everywhere: in the figures, in the table and in the words.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from dashboards import course, drawing, figures, tracks
from dashboards.course import Course
from dashboards.incidents import Incident
from swarm import metrics
from swarm.geometry import Floats
from swarm.score import SETTLED_M

WIDTH_IN = 12.0
LINES_MAX = 12  # robots; the lines of more of them are one band
ANGLES_MAX = 6  # robots whose forces are drawn: who led, who was struck, then the first
STEPS_DEG = (1.0, 5.0, 15.0, 45.0, 90.0, 180.0, 360.0)  # between ticks of angles
NEAR_M = 2.5  # distances beyond this are cut off
BAD = "#c53030"
GOOD = "#2f855a"
BAND = "#718096"
# Of the page, instead of the figures' own; the rest of the colours suit both grounds.
THEME = {drawing.INK: "ink", "#000000": "ink", drawing.FAINT: "faint", drawing.OBSTACLE: "solid"}
THEME |= {BAD: "bad", GOOD: "good", BAND: "muted"}
STYLE: dict[Any, Any] = {
    "font.size": 12.0,
    "axes.titlesize": 13.0,
    "axes.edgecolor": drawing.FAINT,
    "text.color": drawing.INK,
    "axes.labelcolor": drawing.INK,
    "xtick.color": drawing.INK,
    "ytick.color": drawing.INK,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "swarm",  # the same run gives the same page
}


class Load(msgspec.Struct, frozen=True, eq=False):
    """What one kind of process used over the time on the wall."""

    name: str
    wall_s: Floats
    cpu: Floats  # shares of one core
    memory_mb: Floats


class Chart(msgspec.Struct, frozen=True):
    """A figure that can be drawn."""

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]


def charts(
    seen: Course,
    summary: metrics.Summary,
    found: Sequence[Incident],
    loads: Sequence[Load] = (),
) -> tuple[Chart, ...]:
    """The figures that this run has anything for, in the order of the page."""
    path = seen.path
    shown = [
        Chart(
            "timeline",
            "What each robot did, and what happened to it",
            "Colours: the mode of each robot. Gold line: it leads. Numbers: incidents, as in the "
            "table. Cross: it is gone; triangle: it is back.",
            lambda: timeline(seen, summary, found),
        ),
        Chart(
            "trajectories",
            "Where everybody went",
            "Bodies in true size at equal times, a line where they head; red crosses: where a "
            "robot was lost.",
            lambda: trajectories(seen, found),
        ),
    ]
    if len(tracks.followers(path)):
        shown += [
            Chart(
                "tracking",
                "Tracking errors of the followers",
                "Desired minus actual, by the nominal slot behind the leader that each follows "
                "(Fig. 14, 16 and 18 of the paper).",
                lambda: tracking(seen, found),
            ),
            Chart(
                "formation",
                "Formation error and how it settled",
                f"The largest distance of a follower from its slot. Shaded: from an incident until "
                f"everyone was within {SETTLED_M:g} m again.",
                lambda: formation(seen, found),
            ),
        ]
    if np.isfinite(seen.clearance_robot_m).any() or np.isfinite(seen.clearance_obstacle_m).any():
        shown.append(
            Chart(
                "clearances",
                "Clearances",
                f"From surface to surface, of live robots; dark: the smallest. Beyond {NEAR_M:g} m "
                "cut off.",
                lambda: clearances(seen, found),
            )
        )
    if np.isfinite(path.forces_rad).any():
        shown.append(
            Chart(
                "angles",
                "Angle of the resultant force",
                "Beside the heading of the robot (Fig. 11 of the paper).",
                lambda: angles(seen, summary, found),
            )
        )
    if loads:
        shown.append(
            Chart(
                "processes",
                "What the processes used",
                "Sampled once a second. Memory is resident: pages shared with others are counted "
                "in each.",
                lambda: processes(loads),
            )
        )
    return tuple(shown)


def png(chart: Chart) -> bytes:
    """PNG of a figure, upon white."""
    with mpl.rc_context(STYLE):
        return figures.png(chart.draw())


def svg(chart: Chart, colours: Mapping[str, str]) -> str:
    """SVG of a figure, to stand in a page that has the variables of THEME.

    Args:
        colours: more of the figure's colours -> variables of the page.
    """
    stream = io.StringIO()
    with mpl.rc_context({**STYLE, "svg.hashsalt": chart.name}):
        figure = chart.draw()
        figure.savefig(
            stream, format="svg", transparent=True, metadata={"Date": None, "Creator": None}
        )
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'<g id="[^"]*"', "<g", text)  # the same in every figure
    variables = {**colours, **THEME}
    text = re.sub(
        r"#[0-9a-f]{6}\b",
        lambda match: f"var(--{variables[match[0]]})" if match[0] in variables else match[0],
        text,
    )
    label = chart.title.replace('"', "")
    return re.sub(
        r'<svg [^>]*?viewBox="([^"]*)"[^>]*>',
        rf'<svg viewBox="\1" role="img" aria-label="{label}" xmlns:xlink="http://www.w3.org/1999/xlink">',
        text,
        count=1,
    )


# --- the figures --------------------------------------------------------------------------------


def timeline(seen: Course, summary: metrics.Summary, found: Sequence[Incident]) -> Figure:
    """A bar of modes for each robot, who leads, who is gone and back, and all incidents."""
    path = seen.path
    rows = len(path.scenario.robots)
    figure = _figure(1.7 + 0.34 * rows)
    axes = figure.add_subplot()
    drawing.bars(axes, path)
    for row, start_s, end_s in _tenures(seen, summary):
        axes.plot(
            [start_s, end_s],
            [row - 0.42, row - 0.42],
            color="#b7791f",
            linewidth=3.0,
            solid_capstyle="butt",
        )
    names = [robot.name for robot in path.scenario.robots]
    for one in found:
        if one.kind not in _GONE:
            continue
        for name in one.robots:
            row = names.index(name)
            axes.plot(one.time_s, row, marker="X", markersize=11, color=BAD, markeredgecolor="w")
        back_s = one.back_s if one.back_s is not None else one.over_s
        if len(one.robots) == 1 and back_s is not None:
            axes.plot(
                one.time_s + back_s,
                names.index(one.robots[0]),
                marker="^",
                markersize=11,
                color=GOOD,
                markeredgecolor="w",
            )
    _mark([axes], found)
    drawing.legend_of_states(figure, [path])
    return figure


def trajectories(seen: Course, found: Sequence[Incident]) -> Figure:
    """Ways of all, and where robots were lost."""
    path = seen.path
    figure = figures.trajectories(path)
    axes = figure.axes[0]
    axes.set_title(f"positions every {drawing.equal_step_s(path):g} s, and the last")
    names = [robot.name for robot in path.scenario.robots]
    for number, one in enumerate(found, 1):
        if one.kind not in _GONE:
            continue
        tick = min(int(np.searchsorted(seen.ticks, one.tick)), len(seen.ticks) - 1)
        for name in one.robots:
            x_m, y_m, _ = path.poses[tick, names.index(name)]
            axes.plot(x_m, y_m, marker="X", markersize=13, color=BAD, markeredgecolor="w", zorder=6)
            axes.annotate(
                f"{number}: {name}, {one.time_s:g} s",
                (x_m, y_m),
                xytext=(10.0, 12.0),
                textcoords="offset points",
                color=BAD,
                zorder=7,
            )
    return figure


def tracking(seen: Course, found: Sequence[Incident]) -> Figure:
    """Errors of all followers."""
    path = seen.path
    figure = _figure(8.4)
    panels = figure.subplots(3, 1, sharex=True)
    figures.errors(panels, path)
    _mark(panels, found)
    if len(tracks.followers(path)) <= LINES_MAX:
        drawing.legend_of_robots(figure, path, tracks.followers(path), dashed=True)
    _over_time(panels, path)
    return figure


def formation(seen: Course, found: Sequence[Incident]) -> Figure:
    """Largest error of the followers, and how long it took to settle."""
    path = seen.path
    figure = _figure(3.4)
    axes = figure.add_subplot()
    for one in found:
        if one.shape is not None and one.shape.settled_s:
            axes.axvspan(
                one.time_s, one.time_s + one.shape.settled_s, color=BAD, alpha=0.12, linewidth=0
            )
    axes.plot(path.times_s, course.formation_error_m(seen), color=drawing.INK, linewidth=1.8)
    axes.axhline(SETTLED_M, color=GOOD, linestyle=drawing.DASHED, linewidth=1.2)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("largest error [m]")
    _mark([axes], found)
    _over_time([axes], path)
    return figure


def clearances(seen: Course, found: Sequence[Incident]) -> Figure:
    """Distances of surfaces over time."""
    path = seen.path
    shown = [
        (values, label)
        for values, label in (
            (seen.clearance_obstacle_m, "to obstacles [m]"),
            (seen.clearance_robot_m, "between robots [m]"),
        )
        if np.isfinite(values).any()
    ]
    figure = _figure(0.8 + 2.5 * len(shown))
    panels: list[Axes] = list(figure.subplots(len(shown), 1, sharex=True, squeeze=False).flat)
    lines = drawing.colours(path, drawing.LINE_SHARE)
    for axes, (values, label) in zip(panels, shown, strict=True):
        known = np.where(np.isfinite(values), values, np.inf)
        if values.shape[1] <= LINES_MAX:
            for row, colour in enumerate(lines):
                axes.plot(path.times_s, values[:, row], color=colour, linewidth=1.0, alpha=0.8)
        else:
            middle = np.minimum(np.median(known, axis=1), 10.0 * NEAR_M)
            axes.fill_between(
                path.times_s, known.min(axis=1), middle, color=BAND, alpha=0.3, linewidth=0
            )
        least = known.min(axis=1)
        axes.plot(
            path.times_s,
            np.where(np.isfinite(least), least, np.nan),
            color=drawing.INK,
            linewidth=2.0,
        )
        top = float(np.quantile(least[np.isfinite(least)], 0.98))
        axes.set_ylim(min(0.0, float(least.min())), min(max(1.3 * top, 0.5), NEAR_M))
        axes.set_ylabel(label)
    _mark(panels, found)
    _over_time(panels, path)
    return figure


def angles(seen: Course, summary: metrics.Summary, found: Sequence[Incident]) -> Figure:
    """Force and heading of those who matter most, a panel each."""
    path = seen.path
    names = [robot.name for robot in path.scenario.robots]
    order = [
        *(row.name for row in summary.leaders),
        *(name for one in found if len(one.robots) <= ANGLES_MAX for name in one.robots),
        *names,
    ]
    rows = [
        names.index(name)
        for name in dict.fromkeys(order)
        if np.isfinite(path.forces_rad[:, names.index(name)]).any()
    ]
    shown = sorted(rows[:ANGLES_MAX])
    columns = 1 if len(shown) == 1 else 2
    height = -(-len(shown) // columns)
    figure = _figure(0.9 + 2.1 * height)
    grid = figure.subplots(height, columns, sharex=True, squeeze=False)
    for axes, row in zip(grid.flat, shown, strict=False):
        figures.force_angle(axes, path, row)
        low, high = axes.get_ylim()
        step_deg = next((step for step in STEPS_DEG if high - low < 5.0 * step), STEPS_DEG[-1])
        axes.yaxis.set_major_locator(MultipleLocator(step_deg))
        axes.set_title(names[row], loc="left")
        axes.set_xlim(0.0, path.times_s[-1] or path.scenario.dt_s)
        axes.set_ylabel("angle [deg]")
        _mark([axes], [one for one in found if names[row] in one.robots], numbered=False)
    for axes in list(grid.flat)[len(shown) :]:
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    handles = [
        Line2D([], [], color=BAND, linewidth=2.0, label="resultant force"),
        Line2D([], [], color=drawing.INK, linestyle=drawing.DASHED, label="heading"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=2, frameon=False)
    return figure


def processes(loads: Sequence[Load]) -> Figure:
    """CPU and memory over the time on the wall."""
    figure = _figure(4.6)
    panels = figure.subplots(2, 1, sharex=True)
    wheel = ("#3182ce", BAND, "#dd6b20", "#38a169")
    for load, colour in zip(loads, wheel, strict=False):
        panels[0].step(
            load.wall_s, 100.0 * load.cpu, where="pre", color=colour, label=load.name, linewidth=1.8
        )
        panels[1].plot(load.wall_s, load.memory_mb, color=colour, linewidth=1.8)
    panels[0].set_ylabel("CPU [% of a core]")
    panels[1].set_ylabel("memory [MB]")
    for axes in panels:
        axes.set_ylim(bottom=0.0)
        axes.grid(color=drawing.FAINT, alpha=0.3)
        axes.set_xlim(left=0.0)
    panels[-1].set_xlabel("time on the wall [s]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False)
    return figure


# --- what they share ----------------------------------------------------------------------------

_GONE = ("kill", "restart", "hang", "lost", "hung", "missing", "collision")


def _figure(height_in: float) -> Figure:
    figure = Figure(figsize=(WIDTH_IN, round(height_in, 1)))
    figure.set_layout_engine("constrained")
    return figure


def _over_time(panels: Sequence[Axes], path: tracks.Tracks) -> None:
    for axes in panels:
        axes.grid(color=drawing.FAINT, alpha=0.3)
        axes.set_xlim(0.0, max(path.times_s[-1], path.scenario.dt_s))
    panels[-1].set_xlabel("time [s]")


def _mark(panels: Sequence[Axes], found: Sequence[Incident], *, numbered: bool = True) -> None:
    """A line through all panels at each incident, its number above."""
    for axes in panels:
        for one in found:
            axes.axvline(one.time_s, color=BAD, linewidth=1.1, linestyle=drawing.DASHED, zorder=1)
    if not numbered:
        return
    for time_s, numbers in _by_time(found).items():
        panels[0].annotate(
            ",".join(numbers),
            (time_s, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0.0, 3.0),
            textcoords="offset points",
            ha="center",
            va="bottom",
            color=BAD,
            fontweight="bold",
        )


def _by_time(found: Sequence[Incident]) -> dict[float, list[str]]:
    result: dict[float, list[str]] = {}
    for number, one in enumerate(found, 1):
        result.setdefault(one.time_s, []).append(str(number))
    return result


def _tenures(seen: Course, summary: metrics.Summary) -> Iterator[tuple[int, float, float]]:
    """Row, start and end in s of everyone's time as the leader; the dead do not lead."""
    scenario = seen.path.scenario
    names = [robot.name for robot in scenario.robots]
    starts = [(row.tick, row.name) for row in summary.leaders]
    for (start, name), (end, _) in pairwise([*starts, (int(seen.ticks[-1]), "")]):
        row = names.index(name)
        first, last = (int(np.searchsorted(seen.ticks, tick)) for tick in (start, end))
        gone = np.flatnonzero(~seen.alive[first : last + 1, row])
        if len(gone):
            last = first + int(gone[0])
        yield row, float(seen.path.times_s[first]), float(seen.path.times_s[last])
