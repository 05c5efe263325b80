"""Families from public benchmark data, when its files are there: BARN, collision avoidance.

barn.json, collision_avoidance.json --decode--> Barn, Avoidance --> groups
"""

from __future__ import annotations

from functools import partial
from math import atan2
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

from swarm import errors
from swarm.run.bench.navigation import cases
from swarm.run.bench.navigation.cases import Case, Group
from swarm.scenario import Coordinate, Obstacle, Point, Positive

BARN, AVOIDANCE = "barn.json", "collision_avoidance.json"
BARN_RADII_M = (0.215, 0.33)  # of the benchmark's own robot, and a stout one
AVOIDANCE_PATIENCE = 8.0  # times the straight way at the preferred speed

T = TypeVar("T")


class World(msgspec.Struct, frozen=True):
    """One static world of BARN."""

    index: int
    optimal_path_m: Positive
    cylinders_xy_m: tuple[Point, ...]


class Barn(msgspec.Struct, frozen=True):
    """Worlds of one size, with the same start and goal."""

    cylinder_radius_m: Positive
    start: tuple[Coordinate, Coordinate, Coordinate]
    goal: Point
    goal_tolerance_m: Positive
    timeout_s: Positive
    speed_mps_max: Positive
    worlds: Annotated[tuple[World, ...], Meta(min_length=1)]


class Disc(msgspec.Struct, frozen=True, array_like=True):
    """One robot of a case."""

    start_x_m: Coordinate
    start_y_m: Coordinate
    goal_x_m: Coordinate
    goal_y_m: Coordinate
    speed_mps: Positive
    radius_m: Positive


class Avoidance(msgspec.Struct, frozen=True):
    """Discs of different size and speed, by their number."""

    goal_tolerance_m: Positive
    cases: dict[str, Annotated[tuple[tuple[Disc, ...], ...], Meta(min_length=1)]]


def groups(folder: Path) -> tuple[tuple[Group, ...], tuple[str, ...]]:
    """All sizes there are, and a line for each file that is not there.

    Raises UsageError when a file is damaged.
    """
    found: list[Group] = []
    missing: list[str] = []
    barn, avoidance = _read(folder / BARN, Barn), _read(folder / AVOIDANCE, Avoidance)
    if barn is None:
        missing.append(f"barn: skipped, there is no {folder / BARN} (--data DIR)")
    else:
        found += [
            Group(
                family="barn",
                size=f"{radius_m:g}m",
                count=len(barn.worlds),
                make=partial(barn_world, barn, radius_m),
            )
            for radius_m in BARN_RADII_M
        ]
    if avoidance is None:
        missing.append(
            f"collision-avoidance: skipped, there is no {folder / AVOIDANCE} (--data DIR)"
        )
    else:
        found += [
            Group(
                family="collision-avoidance",
                size=size,
                count=len(some),
                make=partial(avoidance_case, avoidance, size),
            )
            for size, some in avoidance.cases.items()
        ]
    return tuple(found), tuple(missing)


def barn_world(barn: Barn, radius_m: float, number: int) -> Case:
    """One world: through the cylinders to within the tolerance of the goal."""
    world = barn.worlds[number]
    parameters = msgspec.structs.replace(
        cases.NEUTRAL,
        body_radius_m=radius_m,
        speed_mps_max=barn.speed_mps_max,
        goal_tolerance_m=barn.goal_tolerance_m,
    )
    return cases.case(
        "barn",
        f"{radius_m:g}m",
        number,
        [cases.robot(0, barn.start, barn.goal, parameters)],
        duration_s=barn.timeout_s,
        obstacles=[
            Obstacle(circle=(x_m, y_m, barn.cylinder_radius_m)) for x_m, y_m in world.cylinders_xy_m
        ],
        bounds_s=(world.optimal_path_m / barn.speed_mps_max,),
        scored=True,
    )


def avoidance_case(avoidance: Avoidance, size: str, number: int) -> Case:
    """One case: each disc at its preferred speed, all of them done within their own time."""
    robots = [
        cases.robot(
            row,
            (
                disc.start_x_m,
                disc.start_y_m,
                atan2(disc.goal_y_m - disc.start_y_m, disc.goal_x_m - disc.start_x_m),
            ),
            (disc.goal_x_m, disc.goal_y_m),
            msgspec.structs.replace(
                cases.NEUTRAL,
                body_radius_m=disc.radius_m,
                speed_mps_max=disc.speed_mps,
                goal_tolerance_m=avoidance.goal_tolerance_m,
            ),
        )
        for row, disc in enumerate(avoidance.cases[size][number])
    ]
    return cases.case("collision-avoidance", size, number, robots, patience=AVOIDANCE_PATIENCE)


def _read(path: Path, type_: type[T]) -> T | None:
    try:
        return msgspec.json.decode(path.read_bytes(), type=type_)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError) as error:
        raise errors.UsageError(
            f"{path}: expected the benchmark's data, got: {error}; mend or remove it"
        ) from error
