"""What does not change while the robots move: scene, colours, sizes, names; logged once.

Rerun's 2-D views have y downwards, so the root of the scene mirrors y (labels would come out
mirrored with it, so nothing in the scene has any).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
import numpy.typing as npt
import rerun as rr

from dashboards import states
from swarm import geometry, movers, palette
from swarm.geometry import Floats
from swarm.scenario import Obstacle, Scenario

RING = np.array([geometry.unit(angle) for angle in np.linspace(0.0, geometry.TAU, 49)])


class Trail(msgspec.Struct, frozen=True):
    """One piece of the way that a robot leaves behind it: the older, the darker."""

    path: str
    stride_ticks: int  # one line for so many ticks
    last_s: float  # how far back it reaches
    brightness: float  # of the robot's colour


TRAILS = (
    Trail("world/trails/old", 12, 30.0, 0.3),
    Trail("world/trails/recent", 4, 10.0, 0.5),
    Trail("world/trails/now", 1, 3.0, 0.8),
)

Colours = npt.NDArray[np.uint32]  # RGBA
Shades = Colours | Sequence[int]
Static = Sequence[rr.AsComponents]

STATE_ROBOTS_MAX = 10  # names, and time lines of single robots, one entity each; beyond it none
FORCE_TERMS = ("attractive", "repulsive", "rotating", "robots")
FORCES = (*FORCE_TERMS, "resultant")
GAINS = ("P along", "I along", "D along", "P across", "I across", "D across")
TERMS_MAX = 10  # of leadership, that have the leader's own colour on the time line

BACKGROUND = (20, 23, 28)
OBSTACLE = 0x3E4859FF
OBSTACLE_EDGE = 0x8A97ADFF
MOVER = 0x7388A8FF
SCAN = 0xFFF3C4FF
CELL_FREE = 0x1F3A3AFF
CELL_OBSTACLE = 0xF08C3AFF
CELL_ROBOT = 0x4FA3F7FF
CELL_TARGET = 0x4ADE80FF
SENSOR_RANGE = 0x3A4656FF
CIRCLE = 0x6D5A9EFF
LINK = 0x34506FFF
LINK_ONE_WAY = 0x9A6A1CFF
YIELDS = 0xFF5CA8FF
HEADING = 0x0B0D10FF  # upon the light body
STOPPED = 0xFF4D4DFF
OVER = 0x4ADE80FF
LEADER = int.from_bytes(bytes([*palette.LEADER, 0xFF]), "big")
LARGEST = 0xCBD5E0FF
BETWEEN_ROBOTS = 0xC084FCFF
FORCE_COLOURS = (0x4ADE80FF, 0xF87171FF, 0xFACC15FF, 0xC084FCFF, 0xFFFFFFFF)  # as in FORCES
GAIN_COLOURS = (0x63B3EDFF, 0x4FD1C5FF, 0xB794F4FF, 0x2B6CB0FF, 0x2C7A7BFF, 0x6B46C1FF)
ORDER = {  # of drawing, where Rerun's own (20 for lines, 30 for points) is not right
    "world/msam/cells": 2.0,
    "world/links": 3.0,
    "world/msam/circles": 4.0,
    "world/trails/old": 5.0,
    "world/trails/recent": 6.0,
    "world/trails/now": 7.0,
    "world/goals": 8.0,
    "world/movers": 25.0,
    "world/slots": 26.0,
    "world/forces/terms": 51.0,
    "world/forces/resultant": 52.0,
    "world/yields": 53.0,
    "world/stopped": 55.0,
}
ABOVE = 50.0  # noses, upon the bodies
STATE_COLOURS: Mapping[str, int] = {
    "GO": 0x4299E1FF,
    "FORM": 0x48BB78FF,
    "AVOID": 0xECC94BFF,
    "ROUND": 0xED8936FF,
    "HOLD": 0xA0AEC0FF,
    "ARRIVED": 0x38B2ACFF,
    "FAILED": 0xE53E3EFF,
    states.SILENT: 0x4A5568FF,
    states.COLLIDED: 0xE53E3EFF,
    states.DEAD: 0x9B2C2CFF,
    "killed": 0x9B2C2CFF,
    "lost": 0x9B2C2CFF,
    "missing": 0x9B2C2CFF,
    "hung": 0x7B341EFF,
    "restarting": 0x6B46C1FF,
}
MORE_COLOURS: Mapping[str, int] = {  # half of it is mixed into that of the mode
    states.YIELDS: YIELDS,
    "motor fault": 0xFF2E88FF,
    "sensor fault": 0xB14CFFFF,
    "slow": 0x8B5A2BFF,
    "link fault": 0x2B3A8CFF,
    "garbage": 0x808000FF,
}


def statics(scenario: Scenario, obstacles: Sequence[Obstacle]) -> dict[str, Static]:
    """Static content by entity path."""
    return {
        **_scene(scenario, obstacles),
        **_curves(scenario),
        **_time_lines(scenario),
        "info": [rr.TextDocument(_info(scenario), media_type="text/markdown")],
    }


def _scene(scenario: Scenario, obstacles: Sequence[Obstacle]) -> dict[str, Static]:
    own = colours(scenario)
    radii_m = [robot.body_radius_m for robot in scenario.robots]
    names = [robot.name for robot in scenario.robots]
    named = len(names) <= STATE_ROBOTS_MAX
    return {
        "world": [rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0]))],
        "world/obstacles": [*_discs(obstacles), *_outlines(obstacles)],
        **_moving(obstacles),
        "world/goals": _goals(scenario, own),
        "world/links": [_lines("world/links", 0.012)],
        "world/msam/cells": [_lines("world/msam/cells")],
        "world/msam/circles": [_lines("world/msam/circles", 0.015)],
        **{
            trail.path: [_lines(trail.path, 0.03, dimmed(own, trail.brightness))]
            for trail in TRAILS
        },
        "world/scan": [rr.Points2D.from_fields(colors=[SCAN], radii=[0.03])],
        "world/slots": [
            rr.Points2D.from_fields(colors=dimmed(own, 0.8), radii=[0.06]),
            _lines("world/slots", 0.02, dimmed(own, 0.8)),
        ],
        "world/bodies": [
            rr.Points2D.from_fields(
                colors=own, radii=radii_m, labels=names if named else None, show_labels=named
            ),
            rr.Arrows2D.from_fields(colors=[HEADING], radii=[0.04], draw_order=ABOVE),
        ],
        "world/leaders": [_lines("world/leaders", 0.03, [LEADER])],
        "world/forces/terms": [_arrows("world/forces/terms", 0.02)],
        "world/forces/resultant": [_arrows("world/forces/resultant", 0.03)],
        "world/yields": [_arrows("world/yields", 0.035, [YIELDS])],
        "world/stopped": [_lines("world/stopped", 0.05, [STOPPED])],
    }


def _curves(scenario: Scenario) -> dict[str, Static]:
    names = [robot.name for robot in scenario.robots]
    own = colours(scenario)
    thin, thick = 1.5, 3.0
    result: dict[str, Static] = {
        "plots/formation_error": [
            rr.SeriesLines(
                colors=np.append(own, np.uint32(LARGEST)),
                names=[*names, "largest"],
                widths=[*[thin] * len(names), thick],
            )
        ],
        **{
            f"plots/{name}": [rr.SeriesLines(colors=own, names=names, widths=[thin] * len(names))]
            for name in ("tracking_distance", "tracking_bearing", "force_angle", "speed")
        },
        "plots/gains": [_series(GAINS, GAIN_COLOURS)],
        "plots/clearance": [
            _series(("to obstacles", "between robots"), (OBSTACLE_EDGE, BETWEEN_ROBOTS))
        ],
        "plots/tick_cost": [_series(("wall", "CPU of the world"), (OBSTACLE_EDGE, CELL_OBSTACLE))],
        "plots/faults": [
            rr.SeriesPoints(
                colors=np.array([STOPPED, OVER], np.uint32),
                names=["trouble", "over"],
                markers=["cross", "circle"],
                marker_sizes=[5.0, 4.0],
            )
        ],
    }
    if len(names) > STATE_ROBOTS_MAX:
        result["plots/modes"] = [
            _series(
                (*states.MODES, "waiting", "stopped"),
                (*(STATE_COLOURS[mode] for mode in states.MODES), YIELDS, STOPPED),
            )
        ]
    return result


def _time_lines(scenario: Scenario) -> dict[str, Static]:
    names = [robot.name for robot in scenario.robots]
    result: dict[str, Static] = {}
    if len(names) <= STATE_ROBOTS_MAX:
        for name in names:
            result[f"robots/{name}"] = [_words(state_colours())]
        if scenario.formation is not None:
            own = dimmed(colours(scenario), 0.7)
            known = {"nobody": STATE_COLOURS["HOLD"]}
            for name, colour in zip(names, own.tolist(), strict=True):
                known |= {f"{name} (term {term})": colour for term in range(TERMS_MAX)}
            result["swarm/leader"] = [_words(known)]
    return result


def _lines(
    path: str, radius_m: float | None = None, colours: Shades | None = None
) -> rr.AsComponents:
    return rr.LineStrips2D.from_fields(
        radii=None if radius_m is None else [radius_m],
        colors=None if colours is None else np.asarray(colours, np.uint32),
        draw_order=ORDER.get(path),
    )


def _arrows(path: str, radius_m: float, colours: Shades | None = None) -> rr.AsComponents:
    return rr.Arrows2D.from_fields(
        radii=[radius_m],
        colors=None if colours is None else np.asarray(colours, np.uint32),
        draw_order=ORDER.get(path),
    )


def _series(names: Sequence[str], shades: Sequence[int]) -> rr.AsComponents:
    return rr.SeriesLines(
        names=names, colors=np.array(shades, np.uint32), widths=[1.5] * len(names)
    )


def _words(known: Mapping[str, int]) -> rr.AsComponents:
    return rr.StateConfiguration(
        values=list(known), colors=np.array(list(known.values()), np.uint32)
    )


def colours(scenario: Scenario) -> Colours:
    """(robots,) RGBA; see swarm.palette."""
    formation = scenario.formation
    leader = None if formation is None else scenario.row(formation.leader)
    return _rgba(np.array(palette.colours(len(scenario.robots), leader), dtype=np.float64))


def state_colours() -> dict[str, int]:
    """Colour of everything that a time line shows."""
    result = dict(STATE_COLOURS)
    modes = (*states.MODES, states.SILENT)
    for more, colour in MORE_COLOURS.items():
        own = np.array([STATE_COLOURS[mode] for mode in modes], np.uint32)
        mixed = _rgba(0.5 * _rgb(own) + 0.5 * _rgb(np.array([colour], np.uint32)))
        words = (states.joined(mode, more) for mode in modes)
        result |= zip(words, mixed.tolist(), strict=True)
    return result


def dimmed(rgba: Colours, share: float) -> Colours:
    """The same hues, darker."""
    return _rgba(share * _rgb(rgba))


def _rgb(rgba: Colours) -> Floats:
    """(colours, 3)"""
    return np.stack([(rgba >> shift) & 0xFF for shift in (24, 16, 8)], axis=1).astype(np.float64)


def _rgba(rgb: Floats) -> Colours:
    parts = np.rint(rgb).astype(np.uint32) << np.array([24, 16, 8], np.uint32)
    result: Colours = np.bitwise_or.reduce(parts, axis=1) | np.uint32(0xFF)
    return result


def bounds(
    scenario: Scenario, obstacles: Sequence[Obstacle], margin_m: float = 0.7
) -> tuple[float, float, float, float]:
    """(x_min, y_min, x_max, y_max) of all that is known beforehand, with a margin."""
    points = [robot.start[:2] for robot in scenario.robots]
    for robot in scenario.robots:
        points += [*robot.via, *([] if robot.goal is None else [robot.goal])]
    for obstacle in obstacles:
        if obstacle.circle is not None:
            x, y, radius_m = obstacle.circle
            for corner_x, corner_y in ((x, y), *(obstacle.path or ())):
                points += [
                    (corner_x - radius_m, corner_y - radius_m),
                    (corner_x + radius_m, corner_y + radius_m),
                ]
        else:
            points += obstacle.polygon or ()
    x_min, y_min = (min(point[axis] for point in points) - margin_m for axis in (0, 1))
    x_max, y_max = (max(point[axis] for point in points) + margin_m for axis in (0, 1))
    return x_min, y_min, x_max, y_max


def _discs(obstacles: Sequence[Obstacle]) -> Static:
    circles = [
        obstacle.circle
        for obstacle in obstacles
        if obstacle.circle is not None and obstacle.path is None
    ]
    if not circles:
        return ()
    table = np.array(circles)
    return [rr.Points2D(table[:, :2], radii=table[:, 2], colors=[OBSTACLE])]


def _outlines(obstacles: Sequence[Obstacle]) -> Static:
    strips = []
    for obstacle in obstacles:
        if obstacle.path is not None:
            continue
        if obstacle.circle is not None:
            x, y, radius_m = obstacle.circle
            strips.append(np.array([x, y]) + radius_m * RING)
        else:
            corners = obstacle.polygon or ()
            strips.append(np.array([*corners, *corners[:1]]))
    if not strips:
        return ()
    return [rr.LineStrips2D(strips, radii=[0.03], colors=[OBSTACLE_EDGE])]


def _moving(obstacles: Sequence[Obstacle]) -> dict[str, Static]:
    """Discs of those that move, all in one entity, and the ways that they go; none without."""
    found = movers.moving(obstacles)
    if not found:
        return {}
    path = "world/movers"
    ways = [np.array(mover.corners) for mover in found]
    return {
        path: [
            rr.Points2D.from_fields(
                colors=[MOVER], radii=movers.radii_m(found), draw_order=ORDER[path]
            ),
            rr.LineStrips2D(ways, radii=[0.01], colors=[OBSTACLE], draw_order=1.0),
        ]
    }


def _goals(scenario: Scenario, own: Colours) -> Static:
    """A ring of the tolerance's size around each goal, and a smaller one at each way-point."""
    rings, ring_colours = [], []
    for robot, colour in zip(scenario.robots, own, strict=True):
        for point in robot.via:
            rings.append(np.array(point) + 0.1 * RING)
            ring_colours.append(colour)
        if robot.goal is not None:
            for radius_m in (robot.goal_tolerance_m, 3.0 * robot.goal_tolerance_m):
                rings.append(np.array(robot.goal) + radius_m * RING)
                ring_colours.append(colour)
    if not rings:
        return ()
    return [rr.LineStrips2D(rings, radii=[0.025], colors=np.array(ring_colours, np.uint32))]


LEGEND = """
| seen | means |
|---|---|
| disc on a thin line | an obstacle that moves, and its way |
| disc, nose, trail | a robot in its own colour, and its way in the last 30 s |
| gold ring | leads; map, scan and circles are the first leader's |
| rays, cells | its map: free, occupied (orange), a robot it hears (blue), where it goes (green) |
| pale dots | what its lidar hits |
| violet circles | virtual circles fitted to its map; the largest, grey ring is its lidar's range |
| dot and line | a follower's slot, and its error |
| double ring | a goal |
| arrows | attractive (green), repulsive (red), rotating (yellow), robots (violet), sum (white) |
| thin lines | hear each other; orange: one way only |
| pink arrow | waits for whom it points to |
| red cross | dead, or has touched something |
| crosses in plots | something goes wrong; circles: it is over |

Links are those of the leading robot alone when there are more than 20; time lines of single robots
are shown for up to 10.
"""


def _info(scenario: Scenario) -> str:
    formation = scenario.formation
    rows = [
        ("seed", scenario.seed),
        ("robots", len(scenario.robots)),
        ("tick", f"{scenario.dt_s} s"),
        ("leader at the start", "none" if formation is None else formation.leader),
        ("clock", scenario.clock.mode),
    ]
    table = "\n".join(f"| {name} | {value} |" for name, value in rows)
    return f"# {scenario.title}\n\n| | |\n|---|---|\n{table}\n{LEGEND}"
