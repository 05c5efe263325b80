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
    events = rrb.TextLogView(name="Events", origin="/events")
    plots: list[rrb.View | rrb.Container] = [
        _plot("Clearance [m]", "clearance"),
        rrb.Tabs(
            events,
            _plot("Speed [m/s]", "speed"),
            rrb.TextDocumentView(name="Run", origin="/info"),
            active_tab=0,
        ),
    ]
    if scenario.formation is not None:
        plots.insert(0, _plot("Formation error [m]", "formation_error", "formation_error_max"))
    below: list[rrb.View | rrb.Container] = [rrb.Horizontal(*plots)]
    shares = [3.0, 1.6]
    if len(scenario.robots) <= stage.STATE_ROBOTS_MAX:
        below.append(rrb.StateTimelineView(name="Modes", origin="/robots", contents="/robots/**"))
        shares.append(1.2)
    return rrb.Blueprint(
        rrb.Vertical(scene, *below, row_shares=shares),
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


def _last(duration_s: float) -> rrb.VisibleTimeRanges:
    return rrb.VisibleTimeRanges(
        timeline="sim_time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-duration_s),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
