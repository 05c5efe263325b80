"""The table of what is drawn of ticks: a batch in, columns of one entity out.

    batches.batch --draw--> Drawing (path, rows, columns) ...

An entity per kind with an instance per robot, so their number does not grow with the robots.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from dashboards import awareness, plots, scene
from dashboards.batches import Batch, Drawing


def draw(batch: Batch) -> Iterator[Drawing]:
    """All that there is to see; viewers panic over columns without a row, so none has none."""
    for view in VIEWS:
        for drawing in view(batch):
            if len(drawing.rows):
                yield drawing


VIEWS: tuple[Callable[[Batch], Iterator[Drawing]], ...] = (
    scene.bodies,
    scene.passing,
    scene.trails,
    scene.stopped,
    scene.slots,
    scene.links,
    scene.yields,
    scene.leaders,
    scene.forces,
    awareness.draw,
    plots.formation_error,
    plots.tracking,
    plots.gains,
    plots.force_angle,
    plots.clearance,
    plots.speed,
    plots.tick_cost,
    plots.modes,
    plots.faults,
    plots.events,
    plots.state_changes,
    plots.leader_changes,
)
