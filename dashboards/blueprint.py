"""What a viewer shows at first: the scene, errors and clearances, events, states of the robots."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from dashboards import stage
from swarm.scenario import Obstacle, Scenario

TRAIL_S = 25.0  # of each robot's way that is shown


def blueprint(scenario: Scenario, obstacles: Sequence[Obstacle]) -> rrb.Blueprint:
    """Layout for one scenario; travels inside the .rrd."""
    x_min, y_min, x_max, y_max = stage.bounds(scenario, obstacles)
    scene = rrb.Spatial2DView(
        name="Scene",
        origin="/",
        contents="/world/**",
        background=list(stage.BACKGROUND),
        visual_bounds=rrb.VisualBounds2D(x_range=[x_min, x_max], y_range=[-y_max, -y_min]),
        overrides={"world/trails": _last(TRAIL_S)},
    )
    left: list[rrb.View | rrb.Container] = [scene]
    if len(scenario.robots) <= stage.STATE_ROBOTS_MAX:
        left.append(rrb.StateTimelineView(name="Modes", origin="/robots", contents="/robots/**"))
    right: list[rrb.View | rrb.Container] = [
        _plot("Clearance [m]", "clearance"),
        _plot("Speed [m/s]", "speed"),
        rrb.Tabs(
            _events(),
            rrb.TextDocumentView(name="Run", origin="/info"),
            active_tab=0,
        ),
    ]
    if scenario.formation is not None:
        right.insert(0, _plot("Formation error [m]", "formation_error_max", "formation_error"))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*left, row_shares=[5.0, 2.5][: len(left)]),
            rrb.Vertical(*right),
            column_shares=[5.0, 2.5],
        ),
        rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _plot(name: str, *entities: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=name,
        origin="/plots",
        contents=[f"/plots/{entity}" for entity in entities],
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
