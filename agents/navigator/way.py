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
import numpy.typing as npt

from agents.navigator import search
from agents.navigator.compiled import compiled
from agents.navigator.law import DESPERATE_M, DOUBTFUL_M, FREE, Ints, Law
from agents.navigator.memory import Field, Memory, nearest, within
from swarm import geometry
from swarm.geometry import Floats, Pose, Vec2

Path = npt.NDArray[np.int64]  # (cells, 2) mm, world

EXPANSIONS_MAX = 5000  # in one tick, about 0.8 ms; a longer search goes on in the next one
AGAIN_TICKS = 6  # least between plans when memory has lost something, or there is no way
DEARER, DEARER_CELLS = 1.01, 0.2  # a way that has become dearer by this is planned again
OFF_MM = 500.0  # likewise when the robot is this far off it
AHEAD_CELLS = 25  # where along the way it is looked for
LOOK_MM_MAX = 3000.0
REFUSED_MAX = 6  # sub-goals in a row; beyond them none is looked for
CHORD_MM = 10.0  # a chord may cost this much more in any case
LINE_SIZE = 1000.0


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
        return np.frombuffer(self.path, dtype=np.int64).reshape(-1, 2)

    def planned(self) -> Ints:
        """Read-only view of the costs."""
        return np.frombuffer(self.costs, dtype=np.int32)


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
        index, off_mm = progress(path_mm, *memory.origin_mm, way.index, x_mm, y_mm)
        way = replace(way, index=index)
        needed = off_mm > OFF_MM or way.origin_mm != memory.origin_mm
        if not needed and memory.version != way.version:
            now = cost_along(
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
    needed = needed or (lost and way.ticks >= AGAIN_TICKS)
    if way.search is None and not needed:
        return way
    if way.search is not None and way.search.origin_mm != memory.origin_mm:
        way = replace(way, search=None)
    return _search(law, way, memory, field_mm, pose, tolerance_m)


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
    index = farthest(
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


# --- inner loops; all in mm from the middle of the window ---------------------------------------


@compiled
def distance_at(field_mm: Field, x_mm: float, y_mm: float, cell_mm: int) -> float:
    """Distance to the nearest point, between four cells; beyond the window that of its border."""
    side = field_mm.shape[0]
    x = min(max(x_mm / cell_mm + side // 2, 0.0), side - 1.000001)
    y = min(max(y_mm / cell_mm + side // 2, 0.0), side - 1.000001)
    i, j = int(x), int(y)
    u, w = x - i, y - j
    low = float(field_mm[i, j]) * (1.0 - u) + float(field_mm[i + 1, j]) * u
    high = float(field_mm[i, j + 1]) * (1.0 - u) + float(field_mm[i + 1, j + 1]) * u
    return float(low * (1.0 - w) + high * w)


@compiled
def share_at(shares: Floats, away_mm: float) -> float:
    """v(c) / v_max at a distance to the nearest point."""
    return float(shares[min(int(away_mm), len(shares) - 1)])


@compiled
def progress(
    path_mm: Path, origin_x: int, origin_y: int, index: int, x_mm: float, y_mm: float
) -> tuple[int, float]:
    """Cell of the way that the robot is nearest to, not before the last one, and how far off."""
    best, off2 = index, -1.0
    for place in range(index, min(index + AHEAD_CELLS, len(path_mm))):
        dx = path_mm[place, 0] - origin_x - x_mm
        dy = path_mm[place, 1] - origin_y - y_mm
        away2 = dx * dx + dy * dy
        if off2 < 0.0 or away2 < off2:
            best, off2 = place, away2
    return best, np.sqrt(off2)


@compiled
def cost_along(
    field_mm: Field,
    path_mm: Path,
    origin_x: int,
    origin_y: int,
    index: int,
    x_mm: float,
    y_mm: float,
    cell_mm: int,
    straight: Ints,
    diagonal: Ints,
    near_straight: int,
    near_diagonal: int,
) -> int:
    """Cost of the rest of the way as the field is now, like the search has it; -1: blocked."""
    side = field_mm.shape[0]
    half = side // 2
    robot_i, robot_j = nearest(x_mm / cell_mm) + half, nearest(y_mm / cell_mm) + half
    cost = 0
    for place in range(index, len(path_mm) - 1):  # a step costs what its cell on this side does
        i = nearest((path_mm[place, 0] - origin_x) / cell_mm) + half
        j = nearest((path_mm[place, 1] - origin_y) / cell_mm) + half
        if i < 0 or j < 0 or i >= side or j >= side:
            continue
        next_i = nearest((path_mm[place + 1, 0] - origin_x) / cell_mm) + half
        next_j = nearest((path_mm[place + 1, 1] - origin_y) / cell_mm) + half
        across = i != next_i and j != next_j
        away_mm = int(field_mm[i, j])
        more = int(diagonal[away_mm] if across else straight[away_mm])
        near_cells = search.NEAR_CELLS
        if abs(i - robot_i) <= near_cells and abs(j - robot_j) <= near_cells:
            near = near_diagonal if across else near_straight
            if more < 0 or more > near:
                more = near
        if more < 0:
            return -1
        cost += more
    return cost


@compiled
def chord(
    field_mm: Field,
    from_x: float,
    from_y: float,
    to_x: float,
    to_y: float,
    cell_mm: int,
    shares: Floats,
    radius_mm: float,
    hard_mm: float,
) -> float:
    """Cost of a straight line in free mm, -1 where it is blocked.

    It is blocked where there is less room than the hardest way has; beside a wall that is allowed
    for the first bit, as long as there is more and more of it.
    """
    dx, dy = to_x - from_x, to_y - from_y
    length = np.sqrt(dx * dx + dy * dy)
    count = int(2.0 * length / cell_mm) + 1
    here_mm = distance_at(field_mm, from_x, from_y, cell_mm) - radius_mm
    cost = 0.0
    for step in range(1, count + 1):
        part = step / count
        away_mm = distance_at(field_mm, from_x + part * dx, from_y + part * dy, cell_mm)
        clear_mm = away_mm - radius_mm
        if clear_mm < hard_mm - 10.0 and clear_mm < here_mm + 0.3 * part * length - 10.0:
            return -1.0
        cost += length / count / share_at(shares, away_mm)
    return cost


@compiled
def farthest(
    field_mm: Field,
    path_mm: Path,
    origin_x: int,
    origin_y: int,
    index: int,
    x_mm: float,
    y_mm: float,
    cell_mm: int,
    shares: Floats,
    radius_mm: float,
    hard_mm: float,
    look_mm: float,
    factor: float,
) -> int:
    """Farthest cell of the way whose chord costs hardly more than the way to it."""
    best = index
    before_x, before_y = x_mm, y_mm
    cost = way_mm = 0.0
    refused = 0
    for place in range(index, len(path_mm)):
        to_x = float(path_mm[place, 0] - origin_x)
        to_y = float(path_mm[place, 1] - origin_y)
        dx, dy = to_x - before_x, to_y - before_y
        step_mm = np.sqrt(dx * dx + dy * dy)
        before_x, before_y = to_x, to_y
        cost += step_mm / share_at(shares, distance_at(field_mm, to_x, to_y, cell_mm))
        if place > index:
            way_mm += step_mm
            if way_mm > look_mm:
                break
        straight_on = chord(field_mm, x_mm, y_mm, to_x, to_y, cell_mm, shares, radius_mm, hard_mm)
        if 0.0 <= straight_on <= factor * cost + CHORD_MM:
            best = place
            refused = 0
        else:
            refused += 1
            if refused == REFUSED_MAX:
                break
    dx = path_mm[best, 0] - origin_x - x_mm
    dy = path_mm[best, 1] - origin_y - y_mm
    if best + 1 < len(path_mm) and dx * dx + dy * dy < cell_mm * cell_mm:
        best += 1  # it is there already; whether it can go on is for the guard to say
    return best
