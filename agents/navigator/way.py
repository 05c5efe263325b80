"""The way to the goal: planned when it has to be, followed by a sub-goal that cuts its corners.

    field, target --search--> path      path, pose --progress--> index --chords--> sub-goal

The navigation function is the cost of the cheapest way, integral ds / v(c), over what is
remembered; what is not known is free. What is found out later only makes ways dearer, so a plan
whose own cost has not risen is still the best: it is made again when that has, or when memory has
lost something.
"""

from __future__ import annotations

import msgspec
import numpy as np

from agents.navigator import chords, search
from agents.navigator.chords import Path
from agents.navigator.law import DESPERATE_M, DOUBTFUL_M, FREE, Ints, Law
from agents.navigator.memory import Memory, within
from agents.navigator.points import Field, nearest
from swarm import geometry
from swarm.geometry import Pose, Vec2

EXPANSIONS_MAX = 5000  # in one tick, about 0.8 ms; a longer search goes on in the next one
AGAIN_TICKS = 6  # least between plans when memory has lost something, or there is no way
DEARER, DEARER_CELLS = 1.01, 0.2  # a way that has become dearer by this is planned again
OFF_MM = 500.0  # likewise when the robot is this far off it
LOOK_MM_MAX = 3000.0
LINE_SIZE = 1000.0
NOWHERE = (2**62, 2**62)  # origin of no window


class Search(msgspec.Struct, frozen=True):
    """A search that is not done yet, as bytes of arrays."""

    origin_mm: tuple[int, int]
    field: bytes
    costs: bytes
    steps: bytes
    keys: bytes
    cells: bytes
    start: tuple[int, int]
    line: tuple[int, int]
    version: int  # of the memory that it searches


class Way(msgspec.Struct, frozen=True):
    """The way that is followed, and the search for the next one."""

    target: Vec2
    path: bytes = b""  # (cells, 2) int64 mm, world, from the robot on; none: no way is known
    costs: bytes = b""  # (cells,) int32 from each to the last, when planned
    index: int = 0  # of the cell that the robot is nearest to
    version: int = -1  # of the memory that it was planned in
    ticks: int = 0  # since then
    origin_mm: tuple[int, int] = (0, 0)  # of its window, on whose border it may end
    hard_mm: float = 0.0  # as little room as its hardest bit has, by the law's steps
    search: Search | None = None
    closed: bool = False  # there is none

    def path_mm(self) -> Path:
        """Read-only view."""
        return np.ndarray((len(self.path) // 16, 2), np.int64, self.path)

    def planned(self) -> Ints:
        """Read-only view of the costs."""
        return np.ndarray((len(self.costs) // 4,), np.int32, self.costs)


def step(
    law: Law,
    way: Way | None,
    memory: Memory,
    field_mm: Field,
    pose: Pose,
    target: Vec2,
    tolerance_m: float,
) -> Way:
    """Way at this tick: followed on, planned again where need be.

    Args:
        tolerance_m: so near to a target that is blocked is near enough.
    """
    replace = msgspec.structs.replace
    if way is None or way.target != target:
        way = Way(target)
    way = replace(way, ticks=way.ticks + 1)
    x_mm, y_mm = within(memory, pose.x_m, pose.y_m)
    needed = not way.path and not way.closed
    if way.path:
        path_mm, planned = way.path_mm(), way.planned()
        index, off_mm = chords.progress(path_mm, *memory.origin_mm, way.index, x_mm, y_mm)
        way = replace(way, index=index)
        needed = off_mm > OFF_MM or way.origin_mm != memory.origin_mm
        if not needed and memory.version != way.version:
            now = chords.cost_along(
                field_mm,
                path_mm,
                *memory.origin_mm,
                index,
                x_mm,
                y_mm,
                law.cell_mm,
                law.straight,
                law.diagonal,
                law.near_straight,
                law.near_diagonal,
            )
            before = int(planned[index]) - int(planned[-1])
            needed = now < 0 or now > DEARER * before + DEARER_CELLS * FREE
    lost = memory.grown > way.version or (way.closed and memory.version != way.version)
    opened = way.closed and memory.grown > way.version
    needed = needed or opened or (lost and way.ticks >= AGAIN_TICKS)
    if way.search is None and not needed:
        return way
    if way.search is not None and way.search.origin_mm != memory.origin_mm:
        way = replace(way, search=None)
    return _search(law, way, memory, field_mm, pose, tolerance_m)


def towards(way: Way, target: Vec2) -> Way:
    """The same way, followed until there is one to a target that has moved on."""
    return msgspec.structs.replace(way, target=target, origin_mm=NOWHERE, search=None, closed=False)


def _search(
    law: Law, way: Way, memory: Memory, field_mm: Field, pose: Pose, tolerance_m: float
) -> Way:
    """Way after a tick of searching."""
    side = law.side_cells
    replace = msgspec.structs.replace
    goal_mm = within(memory, *way.target)
    goal = _cell(law, *goal_mm)
    if way.search is None:
        start = _cell(law, *within(memory, pose.x_m, pose.y_m))
        start = (min(max(start[0], 0), side - 1), min(max(start[1], 0), side - 1))
        costs = np.full(side * side, search.NOT_REACHED, dtype=np.int32)
        steps = np.full(side * side, search.UNTOUCHED, dtype=np.uint8)
        keys = np.empty(4 * side * side, dtype=np.int64)
        cells = np.empty(4 * side * side, dtype=np.int32)
        line = _line(start, goal)
        version = memory.version
        size = search.seed(
            field_mm,
            law.straight,
            costs,
            steps,
            keys,
            cells,
            *start,
            *goal,
            *line,
            1000.0 * tolerance_m / law.cell_mm,
        )
    else:
        old = way.search
        start, line, version = old.start, old.line, old.version
        field_mm = np.frombuffer(old.field, dtype=np.uint16).reshape(side, side)
        costs = np.frombuffer(old.costs, dtype=np.int32).copy()
        steps = np.frombuffer(old.steps, dtype=np.uint8).copy()
        keys = np.empty(4 * side * side, dtype=np.int64)
        cells = np.empty(4 * side * side, dtype=np.int32)
        size = len(old.keys) // 8
        keys[:size] = np.frombuffer(old.keys, dtype=np.int64)
        cells[:size] = np.frombuffer(old.cells, dtype=np.int32)
    size, found = search.expand(
        field_mm,
        law.straight,
        law.diagonal,
        law.near_straight,
        law.near_diagonal,
        costs,
        steps,
        keys,
        cells,
        size,
        *start,
        *line,
        EXPANSIONS_MAX,
    )
    if found == search.BUSY:
        going = Search(
            memory.origin_mm,
            field_mm.tobytes(),
            costs.tobytes(),
            steps.tobytes(),
            keys[:size].tobytes(),
            cells[:size].tobytes(),
            start,
            line,
            version,
        )
        return replace(way, search=going)
    if found == search.NO_WAY:
        return Way(way.target, version=version, closed=True)
    traced = search.trace(costs, steps, *start, side)
    path_mm = (traced[:, :2].astype(np.int64) - law.half_cells) * law.cell_mm
    path_mm += np.array(memory.origin_mm)
    if (int(traced[-1, 0]), int(traced[-1, 1])) == goal:
        path_mm[-1] = (nearest(1000.0 * way.target[0]), nearest(1000.0 * way.target[1]))
    return Way(
        way.target,
        path_mm.tobytes(),
        traced[:, 2].tobytes(),
        version=version,
        origin_mm=memory.origin_mm,
        hard_mm=_hardest_mm(law, field_mm, traced),
    )


def _hardest_mm(law: Law, field_mm: Field, traced: Ints) -> float:
    """Room that a way asks for: as usual, or less where it has bits with less."""
    i, j = traced[search.NEAR_CELLS + 1 :, 0], traced[search.NEAR_CELLS + 1 :, 1]
    least_mm = float(field_mm[i, j].min(initial=law.reach_mm)) - law.radius_mm
    steps_mm = (law.hard_mm, 1000.0 * DOUBTFUL_M, 1000.0 * DESPERATE_M)
    return next((step_mm for step_mm in steps_mm if least_mm >= step_mm), steps_mm[-1])


def subgoal(
    law: Law,
    way: Way,
    memory: Memory,
    field_mm: Field,
    pose: Pose,
    look_m: float,
    chord_factor: float,
) -> tuple[Vec2, int]:
    """Point of the way to drive to straight on, world, and its index."""
    if not way.path:
        return way.target, 0
    x_mm, y_mm = within(memory, pose.x_m, pose.y_m)
    path_mm = way.path_mm()
    index = chords.farthest(
        field_mm,
        path_mm,
        *memory.origin_mm,
        way.index,
        x_mm,
        y_mm,
        law.cell_mm,
        law.shares,
        law.radius_mm,
        way.hard_mm,
        min(1000.0 * look_m, LOOK_MM_MAX),
        chord_factor,
    )
    there_x_mm, there_y_mm = path_mm[index].tolist()
    return (there_x_mm / 1000.0, there_y_mm / 1000.0), index


def _cell(law: Law, x_mm: float, y_mm: float) -> tuple[int, int]:
    return (
        nearest(x_mm / law.cell_mm) + law.half_cells,
        nearest(y_mm / law.cell_mm) + law.half_cells,
    )


def _line(start: tuple[int, int], goal: tuple[int, int]) -> tuple[int, int]:
    """Direction from the robot to the goal, in whole numbers that are not too large."""
    x, y = float(goal[0] - start[0]), float(goal[1] - start[1])
    size = geometry.length(x, y)
    if size == 0.0:
        return (0, 0)
    return (nearest(LINE_SIZE * x / size), nearest(LINE_SIZE * y / size))
