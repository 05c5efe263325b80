"""The scene: robots where they are and were, and what they are to each other.

Every view takes a batch and gives one entity: one instance per robot, or per pair of robots.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr

from dashboards import batches, snapshot, stage
from dashboards.batches import Batch, Drawing, frame_of
from dashboards.snapshot import YAW
from swarm import movers
from swarm.geometry import Floats
from swarm.messages import FrameRecord

FORCE_LENGTH_M_MAX = 1.0  # arrow of an endless force
FORCE_HALF = 6.0  # force whose arrow has half that length
CROSS = np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])  # strokes, in radii
CROWN = 1.45  # ring around who leads, in radii of its body


def bodies(batch: Batch) -> Iterator[Drawing]:
    """A disc for each robot, and an arrow from its centre to the rim where it looks."""
    robots = batch.positions.shape[1]
    counts = [robots] * len(batch.all)
    yaw_rad = batch.motion[:, :, YAW]
    ahead = batch.radii_m[:, None] * np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=2)
    discs = batches.points(batch.positions, counts)
    noses = batches.arrows(batch.positions, ahead, counts)
    yield Drawing("world/bodies", batch.all, [*discs, *noses])


def passing(batch: Batch) -> Iterator[Drawing]:
    """A disc for each obstacle that moves."""
    found = movers.moving(batch.scenario.obstacles)
    if found:
        dt_s = batch.scenario.dt_s
        places_m = np.array([movers.places_m(found, tick * dt_s) for tick in batch.ticks.tolist()])
        counts = [len(found)] * len(batch.all)
        yield Drawing("world/movers", batch.all, batches.points(places_m, counts))


def trails(batch: Batch) -> Iterator[Drawing]:
    """Where each robot was, in pieces of which the view shows those of the last seconds."""
    for number, trail in enumerate(stage.TRAILS):
        rows, corners = batches.corners(batch, number)
        if len(rows):
            steps = np.stack([corners[:-1], corners[1:]], axis=2).reshape(-1, 2, 2)
            counts = [corners.shape[1]] * len(rows)
            yield Drawing(trail.path, rows, batches.strips(steps, counts))


def stopped(batch: Batch) -> Iterator[Drawing]:
    """Each body that is dead or has touched something is crossed out."""
    flags = batch.stopped
    if flags.any() or batch.before.stopped:
        reach_m = np.broadcast_to(batch.radii_m, flags.shape)[flags][:, None, None, None]
        strokes = batch.positions[flags][:, None, None] + reach_m * CROSS
        counts = [len(CROSS) * int(number) for number in flags.sum(axis=1)]
        yield Drawing("world/stopped", batch.all, batches.strips(strokes.reshape(-1, 2, 2), counts))


def slots(batch: Batch) -> Iterator[Drawing]:
    """Where each follower should be, and how far that is from it: all robots, nan is not drawn."""
    if batch.scenario.formation is None or not len(batch.detail):
        return
    counts = [batch.slots.shape[1]] * len(batch.detail)
    errors = np.stack([batch.positions[batch.detail], batch.slots], axis=2).reshape(-1, 2, 2)
    marks = batches.points(batch.slots, counts)
    yield Drawing("world/slots", batch.detail, [*marks, *batches.strips(errors, counts)])


def leaders(batch: Batch) -> Iterator[Drawing]:
    """A ring around everyone who says that it leads."""
    who = [[batch.rows[name] for name, _ in company.leads] for company in batch.companies]
    counts = [len(rows) for rows in who]
    if not any(counts) and not batch.before.leads:
        return
    rows = np.array([row for one in who for row in one], np.intp)
    at = np.repeat(batch.detail, counts)
    reach_m = (CROWN * batch.radii_m[rows])[:, None, None]
    rings = batch.positions[at, rows][:, None] + reach_m * stage.RING
    yield Drawing("world/leaders", batch.detail, batches.strips(rings, counts))


def yields(batch: Batch) -> Iterator[Drawing]:
    """An arrow from each robot that waits to the one it waits for."""
    counts = [len(company.yields) for company in batch.companies]
    if not any(counts) and not batch.before.yields:
        return
    pairs = np.array(
        [pair for company in batch.companies for pair in company.yields], np.intp
    ).reshape(-1, 2)
    at = np.repeat(batch.detail, counts)
    origins = batch.positions[at, pairs[:, 0]]
    vectors = batch.positions[at, pairs[:, 1]] - origins
    yield Drawing("world/yields", batch.detail, batches.arrows(origins, vectors, counts))


def links(batch: Batch) -> Iterator[Drawing]:
    """Who hears whom: both ways, or one way only. Of a large swarm whom the focus hears."""
    if not len(batch.detail):
        return
    places: list[int] = []  # in detail
    frames: list[FrameRecord] = []
    everyone = len(batch.rows) <= snapshot.DETAIL_ROBOTS
    for place, (row, company) in enumerate(zip(batch.detail, batch.companies, strict=True)):
        focus = None if everyone else frame_of(batch.records[row], company.focus)
        found = batch.records[row].frames if everyone else () if focus is None else (focus,)
        frames += found
        places += [place] * len(found)
    lengths = [frame.heard.shape[0] for frame in frames]
    heard = np.frombuffer(b"".join([frame.heard.data for frame in frames]), "<i4")
    speakers = heard[::2].astype(np.intp)
    hearers = np.repeat(np.array([frame.row for frame in frames], np.intp), lengths)
    at = np.repeat(np.array(places, np.intp), lengths)
    both = np.ones(len(at), bool)
    if everyone:
        table = np.zeros((len(batch.detail), len(batch.rows), len(batch.rows)), bool)
        table[at, hearers, speakers] = True
        both = table[at, speakers, hearers]
        once = ~both | (hearers < speakers)
        at, hearers, speakers, both = at[once], hearers[once], speakers[once], both[once]
    rows = batch.detail[at]
    lines = np.stack([batch.positions[rows, speakers], batch.positions[rows, hearers]], axis=1)
    shades = np.where(both, stage.LINK, stage.LINK_ONE_WAY).astype(np.uint32)
    counts = np.bincount(at, minlength=len(batch.detail)).tolist()
    yield Drawing("world/links", batch.detail, batches.strips(lines, counts, shades))


def forces(batch: Batch) -> Iterator[Drawing]:
    """Arrows of the terms of eq. 38, long forces compressed: |arrow| = max |F| / (|F| + half)."""
    if not len(batch.detail):
        return
    table = batch.traces[:, :, batches.FORCES].reshape(len(batch.detail), -1, len(stage.FORCES), 2)
    lengths = np.sqrt((table**2).sum(axis=3, keepdims=True))
    arrows = table * (FORCE_LENGTH_M_MAX / (lengths + FORCE_HALF))
    some = lengths[..., 0] > 0.0  # without a command it is nan, so no
    origins = np.broadcast_to(batch.positions[batch.detail][:, :, None], arrows.shape)
    terms = slice(0, len(stage.FORCE_TERMS))
    yield _forces(batch, "world/forces/terms", origins, arrows, some, terms)
    yield _forces(batch, "world/forces/resultant", origins, arrows, some, slice(-1, None))


def _forces(
    batch: Batch, path: str, origins: Floats, arrows: Floats, some: batches.Flags, which: slice
) -> Drawing:
    flags = some[:, :, which]
    counts: Sequence[int] = flags.sum(axis=(1, 2)).tolist()
    shades = np.broadcast_to(np.array(stage.FORCE_COLOURS, np.uint32)[which], flags.shape)
    columns = rr.Arrows2D.columns(
        origins=origins[:, :, which][flags],
        vectors=arrows[:, :, which][flags],
        colors=shades[flags],
    )
    return Drawing(path, batch.detail, [*columns.partition(counts)])
