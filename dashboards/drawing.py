"""What the pictures are made of: scene, ways, bodies at equal times, bars of modes, legends.

Upon white: the colours of the live views for bodies, the same hues darker for lines.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon

from dashboards import stage
from dashboards.tracks import NOBODY, WAITS, Tracks
from swarm import movers
from swarm.geometry import Floats

BODIES_MAX = 14  # positions of a robot along its way, at most
STEPS_S = (1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 20.0, 50.0)  # between them
LINE_SHARE = 0.7  # of a colour's brightness
INK = "#2d3748"
FAINT = "#a0aec0"
OBSTACLE = "#cbd5e0"
LEGEND_COLUMNS = 8  # of robots' names; beyond it they take another row
WAITS_COLOUR = "#f56565"
# Points; the leader's gold is near to other yellows upon white, and others follow in its line.
RIM, LEADER_RIM = 0.7, 2.2
LINE, LEADER_LINE = 1.4, 3.0
LineStyle = Literal["-", ":"] | tuple[float, tuple[int, int]]
DASHED: LineStyle = (0.0, (4, 2))


def colours(path: Tracks, share: float = 1.0) -> list[str]:
    """Each robot's colour, the same in every picture of it."""
    return [f"#{rgba:08x}" for rgba in stage.dimmed(stage.colours(path.scenario), share)]


def bounds(paths: Iterable[Tracks], margin_m: float = 0.8) -> tuple[float, float, float, float]:
    """(x_min, y_min, x_max, y_max) of all that is known beforehand and all ways."""
    boxes = []
    for path in paths:
        x_min, y_min, x_max, y_max = stage.bounds(path.scenario, path.obstacles, margin_m)
        x_m, y_m = path.poses[:, :, 0], path.poses[:, :, 1]
        boxes.append((x_min, y_min, -x_max, -y_max))
        boxes.append(
            (
                x_m.min() - margin_m,
                y_m.min() - margin_m,
                -x_m.max() - margin_m,
                -y_m.max() - margin_m,
            )
        )
    least = np.array(boxes).min(axis=0)
    return float(least[0]), float(least[1]), float(-least[2]), float(-least[3])


def frame(axes: Axes, box: tuple[float, float, float, float]) -> None:
    """Axes in metres with equal scales, around a box of `bounds`."""
    x_min, y_min, x_max, y_max = box
    axes.set_aspect("equal")
    axes.set_xlim(x_min, x_max)
    axes.set_ylim(y_min, y_max)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(color=FAINT, alpha=0.25)
    axes.set_axisbelow(True)


def scene(axes: Axes, path: Tracks) -> None:
    """Obstacles, a cross at every goal; of what moves its way, and where it begins."""
    for obstacle in path.obstacles:
        if obstacle.circle is not None and obstacle.path is not None:
            x, y, radius_m = obstacle.circle
            axes.plot(
                *np.array([(x, y), *obstacle.path]).T, color=FAINT, linewidth=LINE, linestyle=":"
            )
            axes.add_patch(
                Circle((x, y), radius_m, facecolor=OBSTACLE, edgecolor=INK, linestyle=":")
            )
        elif obstacle.circle is not None:
            x, y, radius_m = obstacle.circle
            axes.add_patch(Circle((x, y), radius_m, facecolor=OBSTACLE, edgecolor=INK))
        else:
            corners = np.array(obstacle.polygon)
            axes.add_patch(Polygon(corners, facecolor=OBSTACLE, edgecolor=INK))
    for robot in path.scenario.robots:
        if robot.goal is not None:
            axes.plot(*robot.goal, marker="x", markersize=9, color=INK, zorder=5)


def ways(axes: Axes, path: Tracks, style: LineStyle = "-", colour: str | None = None) -> None:
    """Where everyone went, each in a colour of its own unless told otherwise."""
    for row, own in enumerate(colours(path, LINE_SHARE)):
        axes.plot(
            path.poses[:, row, 0],
            path.poses[:, row, 1],
            color=colour or own,
            linewidth=LEADER_LINE if leads(path, row) else LINE,
            linestyle=style,
            zorder=2,
        )


def title(path: Tracks) -> str:
    """What ran, and what wheels it ran on where they are no ideal ones."""
    torques_nm = {
        robot.wheel_torque_nm_max for robot in path.scenario.robots if robot.motion == "dynamic"
    }
    if not torques_nm:
        return path.scenario.title
    return f"{path.scenario.title}, motors of {max(torques_nm):g} N m"


def line_style(row: int) -> LineStyle:
    """Dashed in rows 2 and 5: curves of mirrored robots lie on each other, so both are seen."""
    return DASHED if row % 3 == 2 else "-"


def leads(path: Tracks, row: int) -> bool:
    """Whether a robot begins as the formation's leader."""
    formation = path.scenario.formation
    return formation is not None and path.scenario.robots[row].name == formation.leader


def equal_step_s(path: Tracks) -> float:
    """Time between the positions that are drawn: the least of STEPS_S that gives few enough."""
    fitting = [step_s for step_s in STEPS_S if path.times_s[-1] / step_s <= BODIES_MAX]
    return fitting[0] if fitting else STEPS_S[-1]


def moments(path: Tracks, step_s: float) -> list[int]:
    """Indices of the ticks nearest to 0, step, 2 step, ... seconds."""
    count = int(path.times_s[-1] / step_s + 1e-9) + 1
    return [int(np.abs(path.times_s - number * step_s).argmin()) for number in range(count)]


def links(axes: Axes, path: Tracks, tick: int) -> None:
    """Faint lines from leaders to their followers: the shape of the formation at that time."""
    if path.scenario.formation is None:
        return
    for (x_m, y_m, _), led in zip(path.poses[tick], path.leaders[tick], strict=True):
        if led == NOBODY:
            continue
        leader = path.poses[tick, led]
        axes.plot([leader[0], x_m], [leader[1], y_m], color=FAINT, linewidth=0.6, zorder=1.5)


def bodies(axes: Axes, path: Tracks, moments: Iterable[int], *, numbered: bool = False) -> None:
    """Bodies in their true size at some ticks, with a line where they head or with their number.

    One that has not moved since is not drawn again; the rim of a formation's leader is thick.
    Obstacles that move are rings at the same ticks.
    """
    ticks = list(moments)
    for mover in movers.moving(path.obstacles):
        for time_s in path.times_s[ticks].tolist():
            centre = movers.place(mover, time_s)
            axes.add_patch(Circle(centre, mover.radius_m, fill=False, edgecolor=FAINT, zorder=1))
    for row, colour in enumerate(colours(path)):
        radius_m = path.scenario.robots[row].body_radius_m
        rim = LEADER_RIM if leads(path, row) else RIM
        drawn: Floats | None = None
        for tick in ticks:
            pose = path.poses[tick, row]
            if drawn is not None and np.abs(pose[:2] - drawn).max() < 0.5 * radius_m:
                continue
            drawn = pose[:2]
            x_m, y_m, yaw_rad = pose
            axes.add_patch(
                Circle(
                    (x_m, y_m), radius_m, facecolor=colour, edgecolor=INK, linewidth=rim, zorder=3
                )
            )
            if numbered:
                axes.text(
                    x_m, y_m, str(row + 1), fontsize=7, ha="center", va="center_baseline", zorder=4
                )
            else:
                nose = (x_m + radius_m * np.cos(yaw_rad), y_m + radius_m * np.sin(yaw_rad))
                axes.plot([x_m, nose[0]], [y_m, nose[1]], color=INK, linewidth=0.9, zorder=4)


def bars(axes: Axes, path: Tracks) -> None:
    """One bar a robot, coloured by what it was doing."""
    names = [robot.name for robot in path.scenario.robots]
    ends_s = np.append(path.times_s[1:], path.times_s[-1])
    for row in range(len(names)):
        first = 0
        for state, group in groupby(states[row] for states in path.states):
            last = first + len(list(group)) - 1
            start_s = path.times_s[first]
            length_s, colour = ends_s[last] - start_s, state_colour(state)
            axes.barh(row, length_s, left=start_s, height=0.72, color=colour)
            first = last + 1
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlim(0.0, max(path.times_s[-1], path.scenario.dt_s))
    axes.set_xlabel("time [s]")


def state_colour(state: str) -> str:
    """As in the live views, which have none for waiting."""
    return WAITS_COLOUR if state == WAITS else f"#{stage.STATE_COLOURS[state]:08x}"


def dot(label: str) -> Line2D:
    """Legend's handle for positions."""
    return Line2D([], [], color=FAINT, marker="o", linestyle="", markeredgecolor=INK, label=label)


def legend_of_states(figure: Figure, paths: Iterable[Tracks]) -> None:
    """Below: the states that occur, in the order of the live views."""
    seen = {state for path in paths for states in path.states for state in states}
    handles = [
        Patch(color=state_colour(state), label=state)
        for state in (*stage.STATE_COLOURS, WAITS)
        if state in seen
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)


def legend_of_robots(
    figure: Figure, path: Tracks, rows: Iterable[int] | None = None, *, dashed: bool = False
) -> None:
    """Above: colours and names, with the curves' line styles."""
    fills, lines = colours(path), colours(path, LINE_SHARE)
    shown = range(len(fills)) if rows is None else rows
    handles = [
        Line2D(
            [],
            [],
            color=lines[row],
            linestyle=line_style(row) if dashed else "-",
            marker="o",
            markersize=8,
            markerfacecolor=fills[row],
            markeredgecolor=INK,
            markeredgewidth=LEADER_RIM if leads(path, row) else RIM,
            label=path.scenario.robots[row].name,
        )
        for row in shown
    ]
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=min(len(handles), LEGEND_COLUMNS),
        frameon=False,
    )
