"""Compiled inner loops decide as the plain ones do, to the bit."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from agents.navigator import brake, chords, forces, memory, points, search, sight, speed
from agents.navigator.law import law
from swarm.scenario import Navigator

RULES = law(Navigator(cell_m=0.1, window_m=6.0), 0.22)
SIDE, CELL, REACH = RULES.side_cells, RULES.cell_mm, RULES.reach_mm
RANDOM = np.random.Generator(np.random.Philox(7))
POINTS = (RANDOM.integers(-2500, 2500, (60, 2))).astype(np.int16)
RAYS = memory.beams(72)
HITS = np.where(RANDOM.random(72) < 0.6, 0.4 + 2.0 * RANDOM.random(72), np.inf).astype(np.float32)
NEAR = RANDOM.uniform(-1.0, 1.0, (40, 2))
FIELD = np.full((SIDE, SIDE), REACH, dtype=np.uint16)
points.stamp(FIELD, POINTS[:25], 0, 25, CELL, REACH)
PATH = np.array([(100 * i - 2000, 50 * i - 900) for i in range(40)], dtype=np.int64)


def plain(kernel: Callable[..., Any]) -> Callable[..., Any]:
    return getattr(kernel, "py_func", kernel)


def same(one: Any, other: Any) -> None:
    one, other = (part if isinstance(part, tuple) else (part,) for part in (one, other))
    for left, right in zip(one, other, strict=True):
        assert np.asarray(left).tobytes() == np.asarray(right, np.asarray(left).dtype).tobytes()


CALLS: list[tuple[Callable[..., Any], tuple[Any, ...]]] = [
    (points.nearest, (-2.5,)),
    (points.diamond, (-0.3, -0.7)),
    (points.bin_of, (RAYS.bounds, -0.3, 0.7)),
    (
        points.remember,
        (
            *(POINTS, np.zeros(60, dtype=np.uint8), 4000, HITS, HITS),
            *(RAYS.units, RAYS.bounds, 12.5, -70.25, 0.6, 0.8, 50, 3000, 2.75),
        ),
    ),
    (
        points.gather,
        (
            *(POINTS, np.zeros(60, dtype=np.uint8), HITS, RAYS.units),
            *(12.5, -70.25, 0.6, 0.8, 15.5, -60.25, 1500.0),
        ),
    ),
    (points.is_beside, (0.3, 0.7, 1.0, 1.0, 0.3)),
    (
        points.is_clear,
        (
            *(POINTS, np.zeros(60, dtype=np.uint8), HITS, RAYS.units),
            *(12.5, -70.25, 0.6, 0.8, 15.5, -60.25, 0.2, 0.1, 0.01),
        ),
    ),
    (
        sight.scan,
        (
            np.where(RANDOM.random(72) < 0.1, np.nan, HITS).astype(np.float32),
            np.array([(-1.0, 0.1, 1.005, 0.6), (0.1, 0.2, 0.23, 0.5), (2.0, 1.0, 2.24, 0.3)]),
            *(
                RAYS.units,
                RAYS.bounds,
                24,
                0.05,
                2.0,
                0.4,
                0.966,
                np.zeros((24, 2), dtype=np.int64),
            ),
        ),
    ),
    (
        sight.link,
        (np.where(HITS < 2.0, HITS, np.inf), 1.8, 0.3, 0.996, np.zeros((72, 2), dtype=np.int64)),
    ),
    (
        sight.hide,
        (
            HITS,
            np.array([(-1.0, 0.1, 1.005, 0.6), (0.1, 0.2, 0.23, 0.5)]),
            *(RAYS.units, RAYS.bounds, HITS.copy()),
        ),
    ),
    (chords.distance_at, (FIELD, 123.4, -456.7, CELL)),
    (chords.share_at, (RULES.shares, 321.9)),
    (chords.progress, (PATH, 0, 0, 3, -1000.5, -333.25)),
    (
        chords.cost_along,
        (
            *(FIELD, PATH, 0, 0, 3, -1000.5, -333.25, CELL, RULES.straight, RULES.diagonal),
            *(RULES.near_straight, RULES.near_diagonal),
        ),
    ),
    (
        chords.chord,
        (FIELD, -1000.5, -333.25, 700.0, 450.0, CELL, RULES.shares, RULES.radius_mm, 10.0),
    ),
    (
        chords.farthest,
        (
            *(FIELD, PATH, 0, 0, 3, -1600.5, -700.25, CELL, RULES.shares),
            *(RULES.radius_mm, 10.0, 1400.0, 1.03),
        ),
    ),
    (
        speed.along,
        (
            *(FIELD, PATH, 0, 0, 9, -1600.5, -700.25, -1100.0, -450.0, CELL, RULES.shares),
            *(1.0, 0.2, 2.8, 0.05, 1.2),
        ),
    ),
    (
        forces.field,
        (NEAR, memory.beams(72).bounds, 0.6, 0.8, 0.22, 0.45, 0.01, 0.1, 0.08),
    ),
    (brake.slower, (0.7, -1.3, 0.1, 0.2)),
    (brake.places, (0.9, -1.3, 0.1, 0.9, 0.08, 0.6, 0.8, 14)),
    (brake.nearest_of, (NEAR,)),
    (brake.room_of, (NEAR, 0.22, 0.05)),
    (
        brake.first_free,
        (
            *(NEAR + 0.45, np.array(brake.SHARES)),
            np.array([1.0, 0.5, 2.5, 0.16, 0.64, 0.144, 0.12, 0.08, 0.2, 0.05]),
            *(0.9, -1.3, 1.0, -1.0, 0.6, 0.8),
        ),
    ),
    (brake.keeps_off, (NEAR, brake.places(0.9, -1.3, 0.1, 0.9, 0.08, 0.6, 0.8, 14), 0.25)),
    (search.estimate, (5, -7)),
    (search.line_key, (5, -7, 1, 2, 600, 800)),
]
NAMES = [plain(kernel).__name__ for kernel, _ in CALLS]


@pytest.mark.parametrize(("kernel", "arguments"), CALLS, ids=NAMES)
def test_a_compiled_loop_decides_as_the_plain_one(
    kernel: Callable[..., Any], arguments: tuple[Any, ...]
) -> None:
    one, other = copy.deepcopy(arguments), copy.deepcopy(arguments)
    same(kernel(*one), plain(kernel)(*other))
    for filled, expected in zip(one, other, strict=True):
        if isinstance(filled, np.ndarray):
            assert filled.tobytes() == expected.tobytes()


def test_stamping_and_unstamping_are_the_same_compiled_and_plain() -> None:
    fields = []
    for stamp, unstamp in (
        (points.stamp, points.unstamp),
        (plain(points.stamp), plain(points.unstamp)),
    ):
        field = np.full((SIDE, SIDE), REACH, dtype=np.uint16)
        stamp(field, POINTS, 0, 40, CELL, REACH)
        unstamp(field, POINTS[:10].copy(), POINTS[10:40].copy(), CELL, REACH)
        fields.append(field.tobytes())
    assert fields[0] == fields[1]


@pytest.mark.parametrize("goal", [(50, 12), (500, 30)])
def test_a_search_is_the_same_compiled_and_plain(goal: tuple[int, int]) -> None:
    found = []
    for seed, expand, trace in (
        (search.seed, search.expand, search.trace),
        (plain(search.seed), plain(search.expand), plain(search.trace)),
    ):
        costs = np.full(SIDE * SIDE, search.NOT_REACHED, dtype=np.int32)
        steps = np.full(SIDE * SIDE, search.UNTOUCHED, dtype=np.uint8)
        keys, cells = np.zeros(4 * SIDE * SIDE, np.int64), np.zeros(4 * SIDE * SIDE, np.int32)
        size = seed(FIELD, RULES.straight, costs, steps, keys, cells, 8, 30, *goal, 990, 70, 1.0)
        size, end = expand(
            *(FIELD, RULES.straight, RULES.diagonal, RULES.near_straight, RULES.near_diagonal),
            *(costs, steps, keys, cells, size, 8, 30, 990, 70, 100_000),
        )
        assert end == search.FOUND
        found.append((size, costs.tobytes(), trace(costs, steps, 8, 30, SIDE).tobytes()))
    assert found[0] == found[1]
