"""What does not change while the robots move: scene, colours, sizes, names; logged once.

Rerun's 2-D views have y downwards, so the root of the scene mirrors y (labels would come out
mirrored with it, so nothing in the scene has any).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from dashboards import states
from swarm import geometry, palette
from swarm.geometry import Floats
from swarm.scenario import Obstacle, Scenario

RING = np.array([geometry.unit(angle) for angle in np.linspace(0.0, geometry.TAU, 49)])

Colours = npt.NDArray[np.uint32]  # RGBA
Static = Sequence[rr.AsComponents]

STATE_ROBOTS_MAX = 12  # time lines of single robots, one entity each; beyond it there are none
FORCES = ("attractive", "repulsive", "rotating", "robots", "resultant")

BACKGROUND = (20, 23, 28)
OBSTACLE = 0x4A5568FF
OBSTACLE_EDGE = 0x8A97ADFF
SCAN = 0xE8B26AFF
HEADING = 0x0B0D10FF  # upon the light body
STOPPED = 0xFF4D4DFF
LARGEST = 0x4A5568FF
BETWEEN_ROBOTS = 0xC084FCFF
FORCE_COLOURS = (0x4ADE80FF, 0xF87171FF, 0xFACC15FF, 0xC084FCFF, 0xFFFFFFFF)  # as in FORCES
TRAIL_SHARE = 0.7  # of a robot's brightness
ABOVE = 50.0  # drawing order; Rerun's own for points is 30
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
TROUBLE_COLOURS: Mapping[str, int] = {  # half of it is mixed into that of the mode
    "motor fault": 0xFF2E88FF,
    "sensor fault": 0xB14CFFFF,
    "slow": 0x8B5A2BFF,
    "link fault": 0x2B3A8CFF,
    "garbage": 0x808000FF,
}


def statics(scenario: Scenario, obstacles: Sequence[Obstacle]) -> dict[str, Static]:
    """Static content by entity path."""
    names = [robot.name for robot in scenario.robots]
    own = colours(scenario)
    trails = dimmed(own, TRAIL_SHARE)
    radii_m = [robot.body_radius_m for robot in scenario.robots]
    result: dict[str, Static] = {
        "world": [rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0]))],
        "world/obstacles": _discs(obstacles),
        "world/walls": _outlines(obstacles),
        "world/goals": _goals(scenario, own),
        "world/slots": [rr.Points2D.from_fields(colors=dimmed(own, 0.8), radii=[0.06])],
        "world/trails": [rr.LineStrips2D.from_fields(colors=trails, radii=[0.03])],
        "world/scan": [rr.Points2D.from_fields(colors=[SCAN], radii=[0.03])],
        "world/bodies": [rr.Points2D.from_fields(colors=own, radii=radii_m)],
        "world/headings": [
            rr.Arrows2D.from_fields(colors=[HEADING], radii=[0.04], draw_order=ABOVE)
        ],
        "world/stopped": [
            rr.LineStrips2D.from_fields(colors=[STOPPED], radii=[0.04], draw_order=ABOVE)
        ],
        "plots/formation_error": [rr.SeriesLines(colors=own, names=names)],
        "plots/formation_error_max": [
            rr.SeriesLines(colors=[LARGEST], names=["largest"], widths=[4.0])
        ],
        "plots/clearance": [
            rr.SeriesLines(
                colors=np.array([OBSTACLE_EDGE, BETWEEN_ROBOTS], np.uint32),
                names=["to obstacles", "between robots"],
            )
        ],
        "plots/speed": [rr.SeriesLines(colors=own, names=names)],
        "info": [rr.TextDocument(_info(scenario), media_type="text/markdown")],
    }
    for name, colour in zip(FORCES, FORCE_COLOURS, strict=True):
        result[f"world/forces/{name}"] = [
            rr.Arrows2D.from_fields(colors=[colour], radii=[0.02], draw_order=ABOVE)
        ]
    if len(names) <= STATE_ROBOTS_MAX:
        known = state_colours()
        for name in names:
            result[f"robots/{name}"] = [
                rr.StateConfiguration(
                    values=list(known), colors=np.array(list(known.values()), np.uint32)
                )
            ]
    return result


def colours(scenario: Scenario) -> Colours:
    """(robots,) RGBA; see swarm.palette."""
    formation = scenario.formation
    leader = None if formation is None else scenario.row(formation.leader)
    return _rgba(np.array(palette.colours(len(scenario.robots), leader), dtype=np.float64))


def state_colours() -> dict[str, int]:
    """Colour of everything that a time line shows."""
    result = dict(STATE_COLOURS)
    modes = (*states.MODES, states.SILENT)
    for trouble, colour in TROUBLE_COLOURS.items():
        own = np.array([STATE_COLOURS[mode] for mode in modes], np.uint32)
        mixed = _rgba(0.5 * _rgb(own) + 0.5 * _rgb(np.array([colour], np.uint32)))
        words = (states.with_trouble(mode, trouble) for mode in modes)
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
            points += [(x - radius_m, y - radius_m), (x + radius_m, y + radius_m)]
        else:
            points += obstacle.polygon or ()
    x_min, y_min = (min(point[axis] for point in points) - margin_m for axis in (0, 1))
    x_max, y_max = (max(point[axis] for point in points) + margin_m for axis in (0, 1))
    return x_min, y_min, x_max, y_max


def _discs(obstacles: Sequence[Obstacle]) -> Static:
    circles = [obstacle.circle for obstacle in obstacles if obstacle.circle is not None]
    if not circles:
        return ()
    table = np.array(circles)
    return [rr.Points2D(table[:, :2], radii=table[:, 2], colors=[OBSTACLE])]


def _outlines(obstacles: Sequence[Obstacle]) -> Static:
    strips = []
    for obstacle in obstacles:
        if obstacle.circle is not None:
            x, y, radius_m = obstacle.circle
            strips.append(np.array([x, y]) + radius_m * RING)
        else:
            corners = obstacle.polygon or ()
            strips.append(np.array([*corners, *corners[:1]]))
    if not strips:
        return ()
    return [rr.LineStrips2D(strips, radii=[0.03], colors=[OBSTACLE_EDGE])]


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
    return f"# {scenario.title}\n\n| | |\n|---|---|\n{table}\n"
