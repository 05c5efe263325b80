"""What others reached, and what is expected of us: figures to read beside ours.

Measured by us in one neutral simulator (kinematic discs, scenes of its own, 4,532 runs) unless a
row says otherwise: alike in kind, not the same runs, so never to be compared one to one.
"""

from __future__ import annotations

import msgspec

NEUTRAL = (
    "Rows in brackets: peers in a neutral simulator (kinematic discs of 0.2 m, 1 m/s, 2.5 rad/s, "
    "2 m/s2, 8 rad/s2, lidar 5 m, 0.08 s; 4,532 runs, scenes of its own): not one to one."
)
BARN_NOTE = (
    "BARN published elsewhere (Gazebo, other physics): DWA success 85 %, score 0.159; "
    "best entries about 0.40 to 0.476."
)


class Published(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of one peer for one group; None where there is none."""

    family: str
    size: str
    who: str
    success: float | None = None  # share of its runs
    makespan_ratio: float | None = None
    time_ratio: float | None = None
    path_ratio: float | None = None
    score: float | None = None


def _series(
    family: str,
    sizes: tuple[str, ...],
    who: str,
    percents: tuple[float, ...] = (),
    **columns: tuple[float | None, ...],
) -> tuple[Published, ...]:
    """Rows of one peer over the sizes of a family; no percents: nothing known of its successes."""
    return tuple(
        Published(
            family=family,
            size=size,
            who=who,
            success=percents[number] / 100.0 if percents else None,
            **{name: values[number] for name, values in columns.items()},
        )
        for number, size in enumerate(sizes)
    )


_SWAP = ("4", "8", "16", "32", "64")
_PAIRS = ("lanes", "star")
_RANDOM = tuple(f"{count}x{area}m2" for count in (10, 20, 50) for area in (16, 8, 4))
_BARN = ("0.215m", "0.33m")

PEERS: tuple[Published, ...] = (
    *_series(
        "circle-swap",
        _SWAP,
        "ORCA",
        (95, 95, 90, 95, 100),
        makespan_ratio=(1.61, 4.09, 2.93, 2.07, 1.95),
    ),
    *_series(
        "circle-swap",
        _SWAP,
        "VFH+",
        (95, 100, 100, 90, 67),
        makespan_ratio=(1.8, 5.7, 5.6, 4.8, 4.4),
    ),
    *_series(
        "circle-swap",
        _SWAP[:3],
        "ir-sim rvo",
        (91, 100, 91),
        makespan_ratio=(1.20, 1.77, 2.69),
    ),
    *_series(
        "circle-swap",
        _SWAP,
        "central roundabout plan",
        makespan_ratio=(1.04, 1.08, 1.15, 1.14, 1.13),
    ),
    *_series("pairs", _PAIRS, "ORCA", makespan_ratio=(1.05, 1.12)),
    *_series("pairs", _PAIRS, "ir-sim rvo", makespan_ratio=(1.15, 1.23)),
    *_series("pairs", _PAIRS, "APF", makespan_ratio=(1.43, 3.05)),
    *_series("pairs", _PAIRS, "reference", makespan_ratio=(1.00, 1.02)),
    *_series(
        "random",
        _RANDOM,
        "ORCA",
        (96, 98, 90, 90, 90, 90, 68, 48, 48),
        time_ratio=(1.25, 1.37, 1.82, 1.22, 1.39, 1.84, 1.22, 1.40, 1.99),
    ),
    *_series(
        "random",
        _RANDOM,
        "VFH+",
        (100, 100, 96, 100, 100, 92, 96, 82, 50),
        time_ratio=(1.73, 1.94, 2.47, 1.73, 2.12, 2.65, 1.73, 2.16, 3.13),
    ),
    *_series("door", ("1.0m",), "VFH+", (100,), makespan_ratio=(8.2,)),
    *_series("door", ("1.0m",), "ORCA", (70,), makespan_ratio=(3.4,)),
    *_series("door", ("1.0m",), "one-way platoons", makespan_ratio=(1.45,)),
    *_series("corridor", ("0.8m",), "ORCA", (80,), makespan_ratio=(6.8,)),
    *_series("corridor", ("0.8m",), "every other", (0,)),
    *_series("corridor", ("0.8m",), "one-way platoons", makespan_ratio=(1.7,)),
    *_series("traps", ("circle", "u", "wall", "canyon"), "map + replanning", (100,) * 4),
    *_series("traps", ("circle", "u", "wall", "canyon"), "VFH+", (100, 25, 100, 0)),
    *_series(
        "traps",
        ("circle", "u", "wall", "canyon"),
        "full map",
        makespan_ratio=(1.12, 1.23, 1.37, 4.56),
    ),
    *_series(
        "paper-fields",
        ("12", "25", "40"),
        "first prototype",
        (100, 100, 92),
        path_ratio=(None, 1.079, 1.18),
    ),
    *_series("paper-u", ("u",), "first prototype", (100,), path_ratio=(1.81,)),
    *_series("paper-walls", ("wall",), "first prototype", (100,), path_ratio=(1.64,)),
    *_series("barn", _BARN, "VFH+", (94.7, 58), score=(0.452, 0.266)),
    *_series("barn", _BARN, "map + replanning", (100, 99), score=(0.4998, 0.491)),
    *_series("barn", _BARN[:1], "DWA", (77.7,), score=(0.388,)),
    *_series("barn", _BARN[:1], "ORCA", (42.7,), score=(0.206,)),
    *_series("barn", _BARN[:1], "textbook APF", (14.0,), score=(0.069,)),
    *_series("barn", _BARN[:1], "first prototype", (26,), score=(0.1147,)),
)

# (family, size) -> share of runs in which all arrive, of `navigator`; in all of them no contact
EXPECTED: dict[tuple[str, str], float] = {
    ("pairs", "lanes"): 1.0,
    ("pairs", "star"): 1.0,
    **{("traps", size): 1.0 for size in ("circle", "u", "wall", "canyon")},
    **{("paper-fields", size): 1.0 for size in ("12", "25", "40")},
    ("paper-u", "u"): 1.0,
    ("paper-walls", "wall"): 1.0,
    ("barn", "0.215m"): 0.99,
    ("barn", "0.33m"): 0.95,
}
