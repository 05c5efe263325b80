"""What a viewer shows at first: the scene, errors and clearances, events, states of the robots."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from dashboards import stage
from swarm.scenario import Obstacle, Scenario

Part = rrb.View | rrb.Container


def blueprint(scenario: Scenario, obstacles: Sequence[Obstacle]) -> rrb.Blueprint:
    """Layout for one scenario; travels inside the .rrd."""
    return layout(
        formation=scenario.formation is not None,
        lanes=len(scenario.robots) <= stage.STATE_ROBOTS_MAX,
        bounds=stage.bounds(scenario, obstacles),
    )


def layout(
    *, formation: bool, lanes: bool, bounds: tuple[float, float, float, float] | None
) -> rrb.Blueprint:
    """Layout for any run.

    Args:
        formation: there are errors of a formation to plot.
        lanes: each robot has a time line, else there are counts of robots in each mode.
        bounds: x_min, y_min, x_max, y_max of the scene, m; None: what there is to see.
    """
    visible = None
    if bounds is not None:
        x_min, y_min, x_max, y_max = bounds
        visible = rrb.VisualBounds2D(x_range=[x_min, x_max], y_range=[-y_max, -y_min])
    scene = rrb.Spatial2DView(
        name="Scene",
        origin="/",
        contents="/world/**",
        background=list(stage.BACKGROUND),
        visual_bounds=visible,
        overrides={trail.path: _last(trail.last_s) for trail in stage.TRAILS},
    )
    below: Part = rrb.StateTimelineView(
        name="Leader, and what each robot does", origin="/", contents=["/swarm/**", "/robots/**"]
    )
    if not lanes:
        below = rrb.Tabs(_plot("Robots in each mode", "modes"), below, active_tab=0)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, below, row_shares=[5.0, 2.7]),
            rrb.Vertical(*_plots(formation), row_shares=[1.0, 1.0, 1.0, 1.3]),
            column_shares=[5.0, 2.7],
        ),
        rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _plots(formation: bool) -> list[Part]:
    """Errors, distances and speeds in sight, what explains them behind tabs."""
    clearance = _plot("Clearance [m]", "clearance")
    speed = _plot("Speed [m/s]", "speed")
    angle = _plot("Angle of the resultant force [rad]", "force_angle")
    cost = _plot("Tick [ms]", "tick_cost")
    texts = rrb.Tabs(
        _events(), rrb.TextDocumentView(name="How to read it", origin="/info"), active_tab=0
    )
    if not formation:
        return [clearance, speed, rrb.Tabs(angle, cost, active_tab=0), texts]
    errors = rrb.Tabs(
        _plot("Formation error [m]", "formation_error"),
        _plot("Along [m]", "tracking_distance"),
        _plot("Bearing [rad]", "tracking_bearing"),
        _plot("PID gains", "gains"),
        active_tab=0,
    )
    return [errors, clearance, rrb.Tabs(speed, angle, cost, active_tab=0), texts]


def _plot(name: str, entity: str) -> rrb.TimeSeriesView:
    """A curve or more, with the marks of what goes wrong."""
    return rrb.TimeSeriesView(
        name=name,
        origin="/plots",
        contents=[f"/plots/{entity}", "/plots/faults"],
        axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _events() -> rrb.TextLogView:
    kinds = (rrb.encodings.TextLogColumnKind.LogLevel, rrb.encodings.TextLogColumnKind.Body)
    return rrb.TextLogView(
        name="Events",
        origin="/events",
        columns=rrb.TextLogColumns(
            timeline_columns=[rrb.encodings.TimelineColumn("sim_time")],
            text_log_columns=[rrb.encodings.TextLogColumn(kind) for kind in kinds],
        ),
    )


def _last(duration_s: float) -> rrb.VisibleTimeRanges:
    return rrb.VisibleTimeRanges(
        timeline="sim_time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-duration_s),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
