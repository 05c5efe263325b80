"""The pictures of the paper, drawn from recorded runs.

    Tracks --trajectories, encounters | fields, force_angles | tracking--> Figure --png--> bytes

As in the paper: equal scales, positions at equal times, angles of the resultant force, tracking
errors of all followers, and a bar of modes for each robot. Colours are those of the live views,
bodies as they are there and lines darker, because the ground here is white.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from dashboards import drawing, tracks
from dashboards.tracks import Tracks

DPI = 100
WIDTH_IN = 14.0
LETTERS = "abcdefghijklmnopqrstuvwxyz"


def png(figure: Figure) -> bytes:
    """PNG of a figure; its size is that of the figure times DPI."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DPI)
    return stream.getvalue()


def trajectories(path: Tracks) -> Figure:
    """Ways of a formation with everyone's position at equal times (Fig. 13, 15, 17)."""
    x_min, y_min, x_max, y_max = drawing.bounds([path])
    shape = (y_max - y_min) / (x_max - x_min)
    figure = Figure(figsize=(WIDTH_IN, round(1.1 + (WIDTH_IN - 0.6) * shape, 1)))
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    step_s = drawing.equal_step_s(path)
    drawing.scene(axes, path)
    for tick in drawing.moments(path, step_s):
        drawing.links(axes, path, tick)
    drawing.ways(axes, path)
    drawing.bodies(axes, path, [*drawing.moments(path, step_s), len(path.times_s) - 1])
    drawing.frame(axes, (x_min, y_min, x_max, y_max))
    drawing.legend_of_robots(figure, path)
    axes.set_title(f"{drawing.title(path)}: positions every {step_s:g} s, and the last")
    return figure


def tracking(path: Tracks) -> Figure:
    """Tracking errors of all followers and the modes of all robots (Fig. 14, 16, 18)."""
    figure = Figure(figsize=(WIDTH_IN, 10.5))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(4, 1, sharex=True, height_ratios=[3.0, 3.0, 3.0, 2.4])
    errors(panels[:3], path)
    drawing.bars(panels[3], path)
    drawing.legend_of_robots(figure, path, tracks.followers(path), dashed=True)
    drawing.legend_of_states(figure, [path])
    panels[0].set_title(f"{drawing.title(path)}: errors of the followers by their nominal slots")
    return figure


def errors(panels: Sequence[Axes], path: Tracks) -> None:
    """Errors of all followers: in distance and bearing from their leader, and from their slots."""
    distance_m, bearing_rad, off_m = tracks.tracking_errors(path)
    lines = drawing.colours(path, drawing.LINE_SHARE)
    for axes, values, label in (
        (panels[0], distance_m, "distance error [m]"),
        (panels[1], np.degrees(bearing_rad), "bearing error [deg]"),
        (panels[2], off_m, "distance from the slot [m]"),
    ):
        for row in tracks.followers(path):
            axes.plot(
                path.times_s,
                values[:, row],
                color=lines[row],
                linewidth=1.8,
                linestyle=drawing.line_style(row),
            )
        axes.axhline(0.0, color=drawing.INK, linewidth=0.6)
        axes.set_ylabel(label)
        axes.grid(color=drawing.FAINT, alpha=0.3)


def encounters(paths: Mapping[str, Tracks]) -> Figure:
    """Robots that meet, numbered where they are at equal times, and who waits (Fig. 12).

    Panels go down the left column, then down the right one.
    """
    rows = ceil(len(paths) / 2)
    columns = ceil(len(paths) / rows)
    boxes = [drawing.bounds([path]) for path in paths.values()]
    shapes = [(y_max - y_min) / (x_max - x_min) for x_min, y_min, x_max, y_max in boxes]
    heights_in: list[float] = []
    for row in range(rows):
        heights_in += (1.1 + (WIDTH_IN / 2.0 - 0.9) * max(shapes[row::rows]), 1.7)
    figure = Figure(figsize=(WIDTH_IN / 2.0 * columns, round(0.6 + sum(heights_in), 1)))
    figure.set_layout_engine("constrained")
    grid = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=heights_in)
    for number, (title, path) in enumerate(paths.items()):
        column, row = divmod(number, rows)
        axes, bars = grid[2 * row][column], grid[2 * row + 1][column]
        step_s = drawing.equal_step_s(path)
        drawing.scene(axes, path)
        drawing.ways(axes, path)
        drawing.bodies(axes, path, drawing.moments(path, step_s), numbered=True)
        drawing.frame(axes, boxes[number])
        axes.set_title(f"({LETTERS[number]}) {title}: positions every {step_s:g} s")
        drawing.bars(bars, path)
    for spare in grid[2 * (len(paths) % rows) :, -1] if len(paths) % rows else ():
        spare.set_visible(False)
    drawing.legend_of_states(figure, paths.values())
    return figure


def fields(pairs: Sequence[Mapping[str, Tracks]]) -> Figure:
    """One robot across random fields, a panel each, a line for each controller (Fig. 10)."""
    columns = min(4, len(pairs))
    rows = ceil(len(pairs) / columns)
    side_in = WIDTH_IN / 4.0
    figure = Figure(figsize=(max(side_in * columns, 2.0 * side_in), 0.6 + side_in * rows))
    figure.set_layout_engine("constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    own = drawing.colours(next(iter(pairs[0].values())), drawing.LINE_SHARE)[0]
    styles: tuple[tuple[drawing.LineStyle, str], ...] = (
        ("-", own),
        (drawing.DASHED, drawing.INK),
        (":", drawing.INK),
    )
    for axes, pair in zip(grid.flat, pairs, strict=False):
        for (style, colour), path in zip(styles, pair.values(), strict=False):
            drawing.ways(axes, path, style, colour)
        first = next(iter(pair.values()))
        drawing.scene(axes, first)
        drawing.bodies(axes, first, drawing.moments(first, drawing.equal_step_s(first)))
        drawing.frame(axes, drawing.bounds(pair.values()))
        axes.set_title(f"seed {first.scenario.seed}")
        axes.label_outer()
    for axes in list(grid.flat)[len(pairs) :]:
        axes.set_visible(False)
    names = list(pairs[0])
    step_s = drawing.equal_step_s(next(iter(pairs[0].values())))
    handles = [
        Line2D([], [], color=colour, linestyle=style, label=f"controller {name}")
        for (style, colour), name in zip(styles, names, strict=False)
    ]
    handles.append(drawing.dot(f"{names[0]}, every {step_s:g} s"))
    figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False)
    return figure


def force_angles(paths: Mapping[str, Tracks]) -> Figure:
    """Angle of the resultant force and the heading over time, a panel each (Fig. 11)."""
    figure = Figure(figsize=(WIDTH_IN, 0.6 + 3.2 * len(paths)))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(len(paths), 1, sharex=True, sharey=True, squeeze=False)
    for axes, (title, path) in zip(panels.flat, paths.items(), strict=True):
        force_angle(axes, path)
        axes.set_title(title)
    panels[-1][0].set_xlabel("time [s]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
    return figure


def force_angle(axes: Axes, path: Tracks, row: int = 0) -> None:
    """Angle of one robot's resultant force and its heading over time."""
    # Unwrapped beside the heading: a reversal then shows as the half turn that it asks for.
    yaw_rad = np.unwrap(path.poses[:, row, 2])
    force_rad = yaw_rad + tracks.wrap(path.forces_rad[:, row] - yaw_rad)
    line = drawing.colours(path, drawing.LINE_SHARE)[row]
    axes.plot(
        path.times_s, np.degrees(force_rad), color=line, linewidth=2.0, label="resultant force"
    )
    axes.plot(
        path.times_s,
        np.degrees(yaw_rad),
        color=drawing.INK,
        linewidth=1.0,
        linestyle=drawing.DASHED,
        label="heading of the robot",
    )
    axes.set_ylabel("angle from +x [deg]")
    axes.yaxis.set_major_locator(MultipleLocator(45.0))
    axes.grid(color=drawing.FAINT, alpha=0.3)
    axes.set_xlim(left=0.0)
