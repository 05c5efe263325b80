"""The search for the cheapest way: A* from the goal back to the robot, over as many ticks as need.

    seeds: goal, or border of the window --expand--> cost to the goal of every cell reached
    robot's cell --trace--> cells of the way

Of equally cheap ways the straightest is taken; of two that mirror each other the one to the right
of the straight line.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agents.navigator.compiled import compiled
from agents.navigator.law import FREE, Ints
from agents.navigator.points import Field

Keys = npt.NDArray[np.int64]
Steps = npt.NDArray[np.uint8]

BUSY, FOUND, NO_WAY = 0, 1, 2
NOT_REACHED = 2**31 - 1
SEED = 8  # instead of a step: the way ends here
UNTOUCHED = 255
# Around the robot and around what it is heading for, cells count as passable whatever is there.
NEAR_CELLS = 3
# A key is the estimated cost of the way, then how far it is from the straight line, then the side.
LINE_BITS = 24
LINE_MAX = (1 << (LINE_BITS - 1)) - 1


DIAGONAL = 1414  # cost of a free cell across: FREE times the root of 2, rounded as the law does


@compiled
def estimate(cells_x: int, cells_y: int) -> int:
    """Cost of the way over so many cells were all of them free."""
    ax, ay = abs(cells_x), abs(cells_y)
    return FREE * (max(ax, ay) - min(ax, ay)) + DIAGONAL * min(ax, ay)


@compiled
def line_key(i: int, j: int, start_i: int, start_j: int, line_x: int, line_y: int) -> int:
    """Distance of a cell from the line start to goal, and its side: the left one is larger."""
    cross = line_x * (j - start_j) - line_y * (i - start_i)
    aside = min(abs(cross), LINE_MAX)
    return aside * 2 + (1 if cross > 0 else 0)


@compiled
def push(keys: Keys, cells: Ints, size: int, key: int, cell: int) -> int:
    """Add to the heap; nothing happens when it is full. Returns its size."""
    if size == len(keys):
        return size
    place = size
    while place > 0:
        parent = (place - 1) >> 1
        if keys[parent] <= key:
            break
        keys[place] = keys[parent]
        cells[place] = cells[parent]
        place = parent
    keys[place] = key
    cells[place] = cell
    return size + 1


@compiled
def pop(keys: Keys, cells: Ints, size: int) -> int:
    """Take the first off the heap, which the caller has read. Returns its size."""
    size -= 1
    key = keys[size]
    cell = cells[size]
    place = 0
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[place] = keys[child]
        cells[place] = cells[child]
        place = child
    keys[place] = key
    cells[place] = cell
    return size


@compiled
def seed(
    field_mm: Field,
    straight: Ints,
    costs: Ints,
    steps: Steps,
    keys: Keys,
    cells: Ints,
    start_i: int,
    start_j: int,
    goal_i: int,
    goal_j: int,
    line_x: int,
    line_y: int,
    radius_cells: float,
) -> int:
    """Where ways may end: the goal's cell, else those around it, else the border towards it.

    Args:
        costs, steps, keys, cells: of the search, to be filled.
        radius_cells: so near to a goal that cannot be reached itself is near enough.
    Returns:
        size of the heap; 0: no way ends there.
    """
    side = field_mm.shape[0]
    size = 0
    if 0 <= goal_i < side and 0 <= goal_j < side:
        whole = straight[int(field_mm[goal_i, goal_j])] >= 0
        span = 0 if whole else int(radius_cells)
        for i in range(max(0, goal_i - span), min(side, goal_i + span + 1)):
            for j in range(max(0, goal_j - span), min(side, goal_j + span + 1)):
                away = np.sqrt(float((i - goal_i) ** 2 + (j - goal_j) ** 2))
                if away > radius_cells and span > 0:
                    continue
                if straight[int(field_mm[i, j])] < 0:
                    continue
                cell = i * side + j
                costs[cell] = int(FREE * away + 0.5)
                steps[cell] = SEED
                f = int(costs[cell]) + estimate(i - start_i, j - start_j)
                key = (f << LINE_BITS) + line_key(i, j, start_i, start_j, line_x, line_y)
                size = push(keys, cells, size, key, cell)
        return size
    # The goal lies outside: only differences between border cells matter, and stay small numbers.
    least = -1
    for turn in range(2):
        for edge in range(4 * (side - 1)):
            along = edge % (side - 1)
            which = edge // (side - 1)
            i, j = along, 0
            if which == 1:
                i, j = side - 1, along
            elif which == 2:
                i, j = side - 1 - along, side - 1
            elif which == 3:
                i, j = 0, side - 1 - along
            if straight[int(field_mm[i, j])] != FREE:
                continue
            away = estimate(i - goal_i, j - goal_j)
            if turn == 0:
                if least < 0 or away < least:
                    least = away
                continue
            cell = i * side + j
            costs[cell] = away - least
            steps[cell] = SEED
            f = int(costs[cell]) + estimate(i - start_i, j - start_j)
            key = (f << LINE_BITS) + line_key(i, j, start_i, start_j, line_x, line_y)
            size = push(keys, cells, size, key, cell)
    return size


@compiled
def expand(
    field_mm: Field,
    straight: Ints,
    diagonal: Ints,
    near_straight: int,
    near_diagonal: int,
    costs: Ints,
    steps: Steps,
    keys: Keys,
    cells: Ints,
    size: int,
    start_i: int,
    start_j: int,
    line_x: int,
    line_y: int,
    expansions_max: int,
) -> tuple[int, int]:
    """Go on searching until the robot's cell is reached, the heap is empty, or for so long.

    Returns:
        size of the heap, and BUSY, FOUND or NO_WAY.
    """
    side = field_mm.shape[0]
    start = start_i * side + start_j
    expansions = 0
    while size > 0:
        key = keys[0]
        cell = int(cells[0])
        if cell == start:
            return size, FOUND
        if expansions == expansions_max:
            return size, BUSY
        size = pop(keys, cells, size)
        i, j = cell // side, cell % side
        cost = int(costs[cell])
        if (key >> LINE_BITS) > cost + estimate(i - start_i, j - start_j):
            continue  # a cheaper way to this cell has been expanded already
        expansions += 1
        step = -1
        for di in range(-1, 2):
            for dj in range(-1, 2):
                if di == 0 and dj == 0:
                    continue
                step += 1
                ni, nj = i + di, j + dj
                if ni < 0 or nj < 0 or ni >= side or nj >= side:
                    continue
                there = ni * side + nj
                if costs[there] <= cost:
                    continue  # every step costs something
                away_mm = int(field_mm[ni, nj])
                more = int(straight[away_mm] if di == 0 or dj == 0 else diagonal[away_mm])
                if abs(ni - start_i) <= NEAR_CELLS and abs(nj - start_j) <= NEAR_CELLS:
                    near = near_straight if di == 0 or dj == 0 else near_diagonal
                    if more < 0 or more > near:
                        more = near
                if more < 0:
                    continue
                total = cost + more
                if total < costs[there]:
                    costs[there] = total
                    steps[there] = step
                    f = total + estimate(ni - start_i, nj - start_j)
                    key = (f << LINE_BITS) + line_key(ni, nj, start_i, start_j, line_x, line_y)
                    size = push(keys, cells, size, key, there)
    return size, NO_WAY


@compiled
def trace(costs: Ints, steps: Steps, start_i: int, start_j: int, side: int) -> Ints:
    """(cells, 3) columns, rows and costs to the goal of the cells from the robot's to the last."""
    way = np.empty((side * side, 3), dtype=np.int32)
    i, j = start_i, start_j
    count = 0
    while count < side * side:
        cell = i * side + j
        way[count, 0] = i
        way[count, 1] = j
        way[count, 2] = costs[cell]
        count += 1
        step = int(steps[cell])
        if step >= SEED:
            break
        place = step if step < 4 else step + 1  # the middle of the nine is no step
        i -= place // 3 - 1
        j -= place % 3 - 1
    return way[:count]
