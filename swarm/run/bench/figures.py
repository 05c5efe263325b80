"""What a benchmark says: rows of figures, each beside what it is compared with, and its budget.

Wall and CPU seconds differ from machine to machine, so a row's `ratio` to a `floor` measured in the
same rounds is what counts; a bare figure means something only beside `Machine.calibration_s`.
"""

from __future__ import annotations

import importlib.metadata
import math
import os
import platform
import statistics
import time
from collections.abc import Sequence
from typing import Literal

import msgspec

# What a budget bounds: the figure from above or below, or the ratio to the floor from above.
Bound = Literal["figure <=", "figure >=", "ratio <="]

CALIBRATION_ADDITIONS = 200_000  # about 10 ms
CALIBRATION_PASSES = 5
VERSIONS = ("msam-swarm", "eclipse-zenoh", "mcap", "msgspec", "numpy", "rerun-sdk")


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One figure of a benchmark."""

    name: str  # "benchmark: what"
    size: int  # robots
    figure: float
    unit: str
    smallest: float  # of the rounds
    largest: float
    rounds: int
    floor: float | None = None  # in the unit of the figure
    over: str = ""  # what the floor is
    ratio: float | None = None  # figure over floor, median of the rounds' own ratios
    budget: float | None = None
    bound: Bound | None = None
    ok: bool = True  # within the budget, or there is none


class Machine(msgspec.Struct, frozen=True):
    """Where it was measured."""

    cores: int
    python: str
    system: str
    calibration_s: float  # a fixed loop of plain Python, best of some
    load_average: tuple[float, float, float]  # 1, 5, 15 min, before the start


class Found(msgspec.Struct, frozen=True):
    """All that `swarm bench` found."""

    machine: Machine
    versions: dict[str, str]
    tiny: bool
    rows: tuple[Row, ...]


def row(
    name: str,
    size: int,
    values: Sequence[float],
    unit: str,
    *,
    floors: Sequence[float] = (),
    over: str = "",
    budget: float | None = None,
    bound: Bound | None = None,
) -> Row:
    """Row of the rounds' values: medians, or the best round where it is the figure that is bound.

    An absolute figure is that of its best round, because whatever else runs on the machine can
    only make it worse; a ratio is the median.

    Args:
        floors: of the same rounds, one for each value; none without a floor.
        budget: None where the size is not the one that the budget is for.
    """
    figure = statistics.median(values)
    if bound == "figure <=":
        figure = min(values)
    elif bound == "figure >=":
        figure = max(values)
    floor = ratio = None
    if floors:
        floor = statistics.median(floors)
        ratio = statistics.median(
            value / below for value, below in zip(values, floors, strict=True)
        )
    compared = ratio if bound == "ratio <=" else figure
    ok = True
    if budget is not None:
        assert bound is not None
        assert compared is not None
        ok = compared >= budget if bound == "figure >=" else compared <= budget
    return Row(
        name=name,
        size=size,
        figure=figure,
        unit=unit,
        smallest=min(values),
        largest=max(values),
        rounds=len(values),
        floor=floor,
        over=over,
        ratio=ratio,
        budget=budget,
        bound=None if budget is None else bound,
        ok=ok,
    )


def at_most(name: str, size: int, values: Sequence[float], unit: str, budget: float | None) -> Row:
    """Row of an absolute figure, the less the better."""
    return row(name, size, values, unit, budget=budget, bound="figure <=")


def calibrate() -> float:
    """Seconds of the calibrating loop, best of some: the speed of this machine now."""
    best_s = math.inf
    for _ in range(CALIBRATION_PASSES):
        begin_s = time.thread_time()
        loop(CALIBRATION_ADDITIONS)
        best_s = min(best_s, time.thread_time() - begin_s)
    return best_s


def loop(additions: int) -> float:
    """Fixed work in plain Python."""
    total = 0.0
    for number in range(additions):
        total += number * 0.5
    return total


def machine() -> Machine:
    """The one that runs this, now."""
    load = os.getloadavg()
    return Machine(
        cores=os.cpu_count() or 1,
        python=platform.python_version(),
        system=platform.platform(),
        calibration_s=calibrate(),
        load_average=load,
    )


def versions() -> dict[str, str]:
    """Of all that is measured."""
    return {name: importlib.metadata.version(name) for name in VERSIONS}
