"""A scenario: every tunable of a run with its unit and bound, decoded strictly from TOML.

    bytes --decode--> Scenario --setup(name)--> RobotSetup     what one robot may know
                          \\--> world.scene, world.simulation   what is so

`decode` is pure; reading files is the business of shells. Unknown keys, missing keys and values
out of range raise ScenarioError with the file, the path, what was expected and what was found.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from math import pi
from typing import Annotated, Any, Literal, TypeVar, cast

import msgspec
from msgspec import Meta

from swarm import errors, geometry, shapes
from swarm import faults as faults_
from swarm.faults import Fault
from swarm.messages import Name, Slot

Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
NotNegative = Annotated[float, Meta(ge=0.0, le=1e6)]
Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6)]
Point = tuple[Coordinate, Coordinate]
Probability = Annotated[float, Meta(ge=0.0, le=1.0)]

ROBOTS_MAX = 500
DEVIATES_MAX = 3.0  # sigma at which noise is cut; one normal draw in 370 lies beyond
CONTROLLERS = ("navigator", "paper")  # built in
# Tunables that are gone, with the values that they had where nobody changed them: recordings of
# before and files written out in full have them all.
RETIRED: dict[str, dict[str, float]] = {
    "field": {"attraction_m_max": 15.0},
    "steering": {
        "gap_margin_m": 0.12,
        "gap_margin_follower_m": 0.10,
        "gap_look_m": 2.0,
        "gap_memory_weight": 0.7,
        "stall_progress_m": 0.15,
        "stall_s": 4.0,
        "round_distance_m": 0.65,
        "round_leave_m": 0.3,
        "round_s_max": 150.0,
    },
}
RESERVED_NAMES = frozenset(("world", "supervisor", "router", "run"))  # other processes' names

T = TypeVar("T")


class _Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Anything people write: immutable, by keyword, without unknown keys."""


class RobotParameters(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Body, limits and mind of a robot; `[robot]` gives defaults, a `[[robots]]` row its own."""

    body_radius_m: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.22  # circumscribes the wheels
    half_track_m: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.17  # b of eq. 2
    wheel_radius_m: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.12
    speed_mps_max: Annotated[float, Meta(gt=0.0, le=20.0)] = 1.0  # also of each wheel rim
    speed_mps_reverse_max: Annotated[float, Meta(ge=0.0, le=20.0)] = 0.4
    cruise_speed_mps: Annotated[float, Meta(gt=0.0, le=20.0)] = 0.6  # of a formation's leader
    turn_rate_radps_max: Annotated[float, Meta(gt=0.0, le=50.0)] = 2.5
    acceleration_mps2_max: Annotated[float, Meta(gt=0.0, le=100.0)] = 4.0
    turn_acceleration_radps2_max: Annotated[float, Meta(gt=0.0, le=500.0)] = 12.0
    goal_tolerance_m: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.1
    via_tolerance_m: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.5
    # one of CONTROLLERS, or a file's name in agents/controllers
    controller: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,63}\Z")] = "navigator"
    # kinematic: the wheels are ideal; dynamic: torques, masses and friction, eq. 8 to 16
    motion: Literal["kinematic", "dynamic"] = "kinematic"
    mass_kg: Annotated[float, Meta(ge=0.01, le=1e4)] = 12.0
    inertia_kgm2: Annotated[float, Meta(ge=1e-6, le=1e4)] = 0.28  # I_c, about the centre of mass
    mass_offset_m: Annotated[float, Meta(ge=-10.0, le=10.0)] = 0.05  # a, ahead of the axle
    wheel_torque_nm_max: Annotated[float, Meta(gt=0.0, le=1e4)] = 3.0  # of each wheel
    velocity_gain_1ps: Annotated[float, Meta(gt=0.0, le=100.0)] = 40.0  # wheel loop; 1 / its lag
    # F_d and tau_d of eq. 16, which the wheel loop does not know: constant parts (1 % of the
    # weight; half of it at the wheels' 0.17 m), and parts that grow with the speed
    rolling_friction_n: Annotated[float, Meta(ge=0.0, le=1e4)] = 1.2
    rolling_damping_nspm: Annotated[float, Meta(ge=0.0, le=1e4)] = 1.0
    turning_friction_nm: Annotated[float, Meta(ge=0.0, le=1e4)] = 0.1
    turning_damping_nms: Annotated[float, Meta(ge=0.0, le=1e4)] = 0.05

    def __post_init__(self) -> None:
        if self.controller == "extended":
            raise ValueError(
                "expected controller 'navigator', which has taken its place, or 'paper', got "
                "'extended'"
            )


class Robot(RobotParameters, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One `[[robots]]` row; its number is the id of eq. 65."""

    name: Name
    start: tuple[Coordinate, Coordinate, Coordinate]  # x_m, y_m, yaw_rad
    goal: Point | None = None
    via: tuple[Point, ...] = ()


class Line(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """robot1..robotN along y, instead of `[[robots]]`; `--robots N` sets the count."""

    count: Annotated[int, Meta(ge=1, le=ROBOTS_MAX)]
    spacing_m: Positive = 1.5
    goal: Point | None = None  # of robot1, for a formation that it leads


class Obstacle(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A circle (x_m, y_m, radius_m) or a simple polygon (corners in order): exactly one of them.

    A circle with a path moves: from its centre through the corners of the path and back the same
    way, again and again, or round when the path ends at that centre. Nothing stops it, it passes
    through other obstacles, and only lidars see it.
    """

    circle: tuple[Coordinate, Coordinate, Positive] | None = None
    polygon: Annotated[tuple[Point, ...], Meta(min_length=3, max_length=200)] | None = None
    path: Annotated[tuple[Point, ...], Meta(min_length=1, max_length=200)] | None = None
    speed_mps: Annotated[float, Meta(gt=0.0, le=20.0)] | None = None  # along the path

    def __post_init__(self) -> None:
        if (self.circle is None) == (self.polygon is None):
            raise ValueError("expected either circle or polygon, got both or none")
        if (self.path is None) != (self.speed_mps is None):
            raise ValueError("expected path and speed_mps together, got one of them")
        if self.path is None:
            return
        if self.circle is None:
            raise ValueError("expected a circle with path, got a polygon")
        corners = (self.circle[:2], *self.path)
        if any(one == other for one, other in zip(corners, self.path, strict=False)):
            raise ValueError(
                "expected a path whose corners follow the circle's centre and differ from the "
                "one before, got the same twice"
            )


class RandomObstacles(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Circles drawn from the scenario's seed by rejection sampling."""

    count: Annotated[int, Meta(ge=0, le=1000)]
    radius_m: tuple[Positive, Positive] = (0.4, 1.0)
    gap_m_min: NotNegative = 0.6  # between surfaces
    area: tuple[
        Coordinate, Coordinate, Coordinate, Coordinate
    ]  # x_min, y_min, x_max, y_max of centres
    keep_clear_m: NotNegative = 1.0  # between a surface and any start, goal or way-point

    def __post_init__(self) -> None:
        if self.radius_m[0] > self.radius_m[1]:
            raise ValueError(f"expected radius_m as [smallest, largest], got {self.radius_m}")
        if self.area[0] >= self.area[2] or self.area[1] >= self.area[3]:
            raise ValueError(f"expected area as [x_min, y_min, x_max, y_max], got {self.area}")


class Place(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A slot as people write it: eq. 39's distance from the leader and bearing behind it."""

    distance_m: Annotated[float, Meta(gt=0.0, le=1e6)]
    bearing_rad: Annotated[float, Meta(ge=-pi, le=pi)]  # 0: straight behind, > 0: to its right


class Formation(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Leader and followers, section 3.2. Followers are the robots without a goal.

    Their slots, in row order: those given, or those of a shape; else where they start.
    """

    leader: Name
    shape: shapes.Shape | None = None
    spacing_m: Positive = 1.5  # between neighbours of a shape
    slots: Annotated[tuple[Place, ...], Meta(max_length=ROBOTS_MAX)] = ()
    tolerance_m: Positive = 0.08  # a follower this near to its slot has arrived
    heading_gain_1ps: Positive = 0.5  # theta_F follows theta_l with this gain, rate-limited
    pacing_lag_m: NotNegative = 0.6  # the leader slows down when a follower lags by more
    pacing_range_m: Positive = 1.2
    pacing_factor_min: Probability = 0.15
    bearing_rate_radps: Positive = 1.2  # slew of alpha_now at a bearing switch
    bearing_step_rad: Annotated[float, Meta(gt=0.0, le=1.0)] = pi / 72.0
    corridor_margin_m: NotNegative = 0.30  # from body to obstacle in the bearing's corridor
    corridor_behind_m: NotNegative = 0.7
    corridor_ahead_m: NotNegative = 2.5
    avoid_ahead_m: NotNegative = 1.3  # FORM -> AVOID: a cell this near within +-109 degrees
    avoid_around_m: NotNegative = 0.7  # or anywhere this near
    reform_after_s: NotNegative = 0.5  # AVOID -> FORM after this long without a trigger

    def __post_init__(self) -> None:
        if self.shape is not None and self.slots:
            raise ValueError(f"expected either shape or slots, got '{self.shape}' and slots")


class Priority(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What robots do about each other, section 3.3.1."""

    strategy: Literal["priority", "mutual"] = "priority"
    yield_s_max: Positive = 6.0  # bounded waiting inside a formation
    wait_s_max: Positive = 30.0  # and outside, where one may have to wait for several
    yield_hold_s: NotNegative = 0.4
    yield_reach_m: Positive = 2.5
    yield_horizon_s: Positive = 3.0
    yield_margin_m: NotNegative = 0.35
    stale_s: Positive = 0.5  # a peer not heard for this long is an obstacle, nothing else


class Sensor(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The planar lidar."""

    beams: Annotated[int, Meta(ge=8, le=4096)] = 216  # over 360 degrees
    range_m: Annotated[float, Meta(gt=0.0, le=100.0)] = 5.0


class Radio(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Who hears whom."""

    range_m: Positive = 10.0


class Msam(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The motion situational awareness map, section 3.1."""

    sectors: Annotated[int, Meta(ge=8, le=720)] = 72  # n; must divide sensor.beams
    rings: Annotated[int, Meta(ge=5, le=10_000)] = 100  # m; ring width = sensor.range_m / rings
    link_distance_m: Positive = 0.8  # neighbouring cells nearer than this are one obstacle
    split_rad: Annotated[float, Meta(gt=0.05, lt=2.0)] = pi / 3.0  # wider arcs are split; < 120 deg
    peer_tolerance_m: NotNegative = 0.05
    peer_tolerance_per_missed_tick_m: NotNegative = 0.06


class Field(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The improved artificial potential field, sections 3.1 and 3.3; symbols as in the paper."""

    k_g: Positive = 5.0
    k_r: NotNegative = 30.0
    k_e: NotNegative = 0.01
    rho_m: Positive = 3.0  # reach of an obstacle's repulsion
    distance_m_min: Positive = 0.05  # f and q - r are clamped here
    attraction_follower_m: Positive = 8.0
    k_ij: NotNegative = 5.0
    safe_distance_m: Positive = 0.5  # r of eq. 36
    robot_reach_m: Positive = 1.0  # r_ij of eq. 36

    def __post_init__(self) -> None:
        if self.robot_reach_m <= self.safe_distance_m:
            raise ValueError(
                f"expected robot_reach_m > safe_distance_m ({self.safe_distance_m}), "
                f"got {self.robot_reach_m}"
            )


class Steering(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Heading controller."""

    heading_gain_1ps: Positive = 4.0  # k_omega
    approach_gain_1ps: Positive = 1.2  # v <= gain * distance to the goal


class Pid(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Adaptive PID tracking A2, section 3.2 as read in the documentation."""

    gamma: tuple[Positive, Positive, Positive] = (8.0, 5.0, 5.0)  # adaptation gains (Kp, Ki, Kd)
    gain_max: tuple[NotNegative, NotNegative, NotNegative] = (8.0, 5.0, 0.5)  # projection box
    k: Annotated[float, Meta(gt=1.0, le=100.0)] = 2.0  # K; the proof needs more than 1
    k_i: NotNegative = 0.5  # K_I
    leak: NotNegative = 0.05  # sigma
    normalisation: Positive = 0.05
    derivative_filter_s: Positive = 0.3
    integral_max: Positive = 1.0
    error_m_max: Positive = 1.0
    off_axle_m: Positive = 0.2  # L of eq. 42


class Guard(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Braking guards, always last."""

    deceleration_mps2: Positive = 1.0  # planned; less than the body can do
    strip_margin_m: NotNegative = 0.03
    stop_margin_m: NotNegative = 0.05
    peer_margin_m: NotNegative = 0.06
    peer_lateral_m: NotNegative = 0.25
    latency_s: NotNegative = 0.16  # two ticks


# Stages that a navigator can do without, to see what each is good for.
Stage = Literal[
    "memory",  # it knows what it sees now, and nothing else
    "way",  # straight to the target, whatever is in between
    "speed",  # as fast as it can, whatever is beside its way
    "movers",  # what moves is taken for standing where it is seen
    "roundabout",
    "gaps",  # no claims: who comes first goes first
    "cells",  # the direction of the way, as if there were no peers
    "forces",
    "dodge",
    "guard",  # nothing but its wheels limits what is asked for: bodies touch
]


class Navigator(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True, cache_hash=True):
    """The controller `navigator`: memory, way, forces, speed, guard."""

    cell_m: Annotated[float, Meta(ge=0.02, le=1.0)] = 0.1  # of the distance field, to the mm
    window_m: Annotated[float, Meta(ge=4.0, le=60.0)] = 22.0  # side of the square remembered
    # Speed by clearance c from the body's surface: all of it from comfort_m on, this share of it
    # in touch, and less still in a slit that is hardly wider than the body.
    comfort_m: Annotated[float, Meta(ge=0.02, le=5.0)] = 0.3
    crawl_share: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.25
    slit_share: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.15
    hard_m: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.01  # ways with less are the last resort
    look_m: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.4  # the sub-goal lies this far along
    look_s: NotNegative = 0.5  # the way, and further by so much driving
    chord_factor: Annotated[float, Meta(ge=1.0, le=10.0)] = 1.03  # cutting a corner may cost
    heading_gain_1ps: Positive = 5.0
    reach_m: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.45  # of repulsion, from the body's surface
    repulsion_m2: NotNegative = 0.01  # k_r of eq. 27
    repulsion_max: Probability = 0.1  # of the attraction, and only across it
    barrier_m: Annotated[float, Meta(gt=0.015, le=5.0)] = 0.08  # nearer, nothing pulls inwards
    guard_margin_m: NotNegative = 0.03
    give_up_s: Positive = 150.0  # without coming nearer to the goal; then FAILED
    without: tuple[Stage, ...] = ()

    def __post_init__(self) -> None:
        if self.window_m > 500.0 * self.cell_m:
            raise ValueError(
                f"expected navigator.window_m of at most 500 cells of cell_m ({self.cell_m}), "
                f"got {self.window_m}"
            )


class Clock(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How simulation time passes."""

    mode: Literal["lockstep", "realtime"] = "lockstep"
    rate: Annotated[float, Meta(ge=0.0, le=1000.0)] = 0.0  # x real time; 0: as fast as it goes
    command_ttl: Annotated[int, Meta(ge=1, le=1000)] = 3  # ticks; an older command brakes
    command_deadline_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 10.0  # wall; then hung
    start_timeout_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 15.0  # wall; then without it


class Disturbance(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors that strike every robot in every tick, and are no faults: nobody is excused by them.

    Robots know what is declared here, never what is drawn. Normal deviates are cut at 3 sigma, so
    that there is a bound to reckon with.
    """

    range_sigma_m: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0  # of each beam; a miss stays one
    # of the pose in the frame, in each coordinate and in yaw; the body is where it is
    position_sigma_m: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    yaw_sigma_rad: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    # and its position creeps away by this share of the way, wherever to, until something else
    # keeps it to the bound; a goal is then found so much beside where it is
    drift_m_per_m: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.0
    drift_m_max: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    # motors take a set-point so many ticks later; beacons are not late
    latency_ticks: Annotated[int, Meta(ge=0, le=4)] = 0
    # the body goes and turns (1 + e) times as fast as its wheels say, e this or minus this: one of
    # them for each robot, drawn once
    speed_error: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    # share of the beacons that each directed link loses
    loss_probability: Annotated[float, Meta(ge=0.0, le=0.9)] = 0.0
    # 0: each tick is drawn for itself; else 1 to so many are lost one after the other, evenly
    # drawn, and at least one arrives in between
    loss_ticks_max: Annotated[int, Meta(ge=0, le=100)] = 0

    def __post_init__(self) -> None:
        if (self.drift_m_per_m > 0.0) != (self.drift_m_max > 0.0):
            raise ValueError(
                "expected drift_m_per_m and drift_m_max, how fast and how far a pose creeps away, "
                f"both or neither, got {self.drift_m_per_m} and {self.drift_m_max}"
            )
        most = self.loss_ticks_mean / (self.loss_ticks_mean + 1.0)
        if self.loss_ticks_max and self.loss_probability > most:
            raise ValueError(
                f"expected loss_probability <= {most:.4g} with bursts of up to "
                f"{self.loss_ticks_max} ticks, got {self.loss_probability}"
            )

    @property
    def loss_ticks_mean(self) -> float:
        """Length of a burst, in the mean."""
        return (self.loss_ticks_max + 1) / 2.0

    @property
    def range_error_m_max(self) -> float:
        """No range is further off."""
        return DEVIATES_MAX * self.range_sigma_m

    @property
    def position_error_m_max(self) -> float:
        """No position is further off, whichever way."""
        return DEVIATES_MAX * self.position_sigma_m + self.drift_m_max

    @property
    def yaw_error_rad_max(self) -> float:
        """No yaw is further off."""
        return DEVIATES_MAX * self.yaw_sigma_rad


class Recording(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is written, and how soon it is safe."""

    mcap: bool = True
    rerun: bool = True
    flush_ticks: Annotated[int, Meta(ge=1, le=10_000)] = 12
    flush_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.5  # wall


class Restart(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is done about processes that end or hang before the run does.

    `on-failure`: started again when it was killed, crashed or hung. `always`: also when it ended
    by itself. All times of robots are simulated, those of the world are of the wall.
    """

    robot: Literal["never", "on-failure", "always"] = "never"
    world: Literal["never", "on-failure", "always"] = "on-failure"
    restart_max: Annotated[int, Meta(ge=0, le=10_000)] = 5  # of one process within the window
    restart_window_s: Positive = 60.0
    restart_delay_s: NotNegative = 0.5  # before the first; doubles with every one in the window
    hang_timeout_s: Positive = 2.0  # without a sign of life it is taken for hung, and killed


class Expect(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a run must reach: summary paths joined by `_`.

    `min_*`, `arrived` and `blocked` are lower bounds, `outcome` is equal, all others are upper
    bounds.
    `mirror_pairs` names the robots whose paths should mirror each other in the x axis.
    """

    outcome: Literal["succeeded", "collided", "timeout", "failed"] | None = None
    arrived: int | None = None
    blocked: int | None = None  # how many outcomes of per_robot
    collisions: int | None = None
    makespan_s: float | None = None
    path_ratio_mean: float | None = None
    min_clearance_obstacle_m: float | None = None
    min_clearance_robot_m: float | None = None
    formation_error_m_max: float | None = None
    formation_error_m_final: float | None = None
    formation_settling_s: float | None = None
    formation_symmetry_m: float | None = None
    priority_waiting_s_max: float | None = None
    mirror_pairs: tuple[tuple[Name, Name], ...] = ()


class Shared(_Part, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The parts every robot knows as well as the world."""

    priority: Priority = Priority()
    sensor: Sensor = Sensor()
    radio: Radio = Radio()
    msam: Msam = Msam()
    field: Field = Field()
    steering: Steering = Steering()
    pid: Pid = Pid()
    guard: Guard = Guard()
    navigator: Navigator = Navigator()
    clock: Clock = Clock()
    disturbance: Disturbance = Disturbance()

    def __post_init__(self) -> None:
        if self.sensor.beams % self.msam.sectors:
            raise ValueError(
                f"expected msam.sectors that divide sensor.beams ({self.sensor.beams}), "
                f"got {self.msam.sectors}"
            )


class Scenario(Shared, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One TOML file, checked."""

    title: Annotated[str, Meta(min_length=1, max_length=200)]
    seed: Annotated[int, Meta(ge=0, le=2**53)]
    dt_s: Annotated[float, Meta(ge=0.001, le=0.1)]
    duration_s: Annotated[float, Meta(gt=0.0, le=1e6)]
    robot: RobotParameters = RobotParameters()
    robots: Annotated[tuple[Robot, ...], Meta(min_length=1, max_length=ROBOTS_MAX)]
    obstacles: Annotated[tuple[Obstacle, ...], Meta(max_length=10_000)] = ()
    random_obstacles: RandomObstacles | None = None
    formation: Formation | None = None
    recording: Recording = Recording()
    restart: Restart = Restart()
    faults: Annotated[tuple[Fault, ...], Meta(max_length=10_000)] = ()
    expect: Expect = Expect()

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [robot.name for robot in self.robots]
        reserved = sorted(set(names) & RESERVED_NAMES)
        if reserved:
            raise ValueError(
                f"expected robots' names other than {', '.join(sorted(RESERVED_NAMES))}, "
                f"got '{reserved[0]}'"
            )
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise ValueError(f"expected every robot to have its own name, got {repeated} twice")
        if self.formation is not None and self.formation.leader not in names:
            raise ValueError(
                f"expected formation.leader to be one of {names}, got '{self.formation.leader}'"
            )
        for name in (name for pair in self.expect.mirror_pairs for name in pair):
            if name not in names:
                raise ValueError(f"expected expect.mirror_pairs to be one of {names}, got '{name}'")
        for i, fault in enumerate(self.faults):
            problem = faults_.problem_of(fault, names)
            if problem is not None:
                raise ValueError(f"faults[{i}].target: {problem}")
            ticks = fault.at_s / self.dt_s
            if abs(ticks - round(ticks)) > 1e-6:
                raise ValueError(
                    f"expected faults[{i}].at_s as a multiple of dt_s ({self.dt_s}), "
                    f"got {fault.at_s}; the nearest is {round(ticks) * self.dt_s:.6g}"
                )
        for i, one in enumerate(self.robots):
            for other in self.robots[:i]:
                gap_m = geometry.length(
                    one.start[0] - other.start[0], one.start[1] - other.start[1]
                )
                if gap_m <= one.body_radius_m + other.body_radius_m:
                    raise ValueError(
                        f"expected robots that do not touch at the start, got '{other.name}' and "
                        f"'{one.name}' {gap_m:.3f} m apart"
                    )
        if self.formation is not None and (self.formation.shape or self.formation.slots):
            self._check_slots(self.formation)

    def _check_slots(self, formation: Formation) -> None:
        """Slots for all, none on another's body, all within earshot of the leader."""
        followers = [row for row in range(len(self.robots)) if self._follows(row)]
        if formation.slots and len(formation.slots) < len(followers):
            raise ValueError(
                f"expected formation.slots for {len(followers)} followers, "
                f"got {len(formation.slots)}"
            )
        places: list[tuple[Robot, float, float]] = []
        for row, slot in enumerate(self.slots()):
            x_m = y_m = 0.0
            if slot is not None:
                ahead, left = geometry.unit(slot.bearing_rad)
                x_m, y_m = -slot.distance_m * ahead, -slot.distance_m * left
                if slot.distance_m > self.radio.range_m:
                    raise ValueError(
                        f"expected the slot of '{self.robots[row].name}' within radio.range_m "
                        f"({self.radio.range_m:g}) of its leader, got {slot.distance_m:.3f} m; "
                        "make the formation smaller or the range larger"
                    )
            elif self.robots[row].name != formation.leader:
                continue
            robot = self.robots[row]
            for other, other_x_m, other_y_m in places:
                gap_m = geometry.length(x_m - other_x_m, y_m - other_y_m)
                if gap_m <= robot.body_radius_m + other.body_radius_m:
                    raise ValueError(
                        f"expected slots that do not touch, got those of '{other.name}' and "
                        f"'{robot.name}' {gap_m:.3f} m apart"
                    )
            places.append((robot, x_m, y_m))

    def tick_of(self, at_s: float) -> int:
        """Tick of a simulation time."""
        return round(at_s / self.dt_s)

    def stamp_ns(self, tick: int) -> int:
        """Simulation time of a tick."""
        return round(tick * self.dt_s * 1e9)

    def row(self, name: str) -> int:
        """Number of a robot's row, its id in eq. 65; KeyError when there is none."""
        for number, robot in enumerate(self.robots):
            if robot.name == name:
                return number
        raise KeyError(name)

    def slots(self) -> list[Slot | None]:
        """Nominal slot of every row (eq. 39); None for who does not follow.

        Where neither shape nor slots are given, exactly as the start poses have them.
        """
        formation = self.formation
        result: list[Slot | None] = [None] * len(self.robots)
        if formation is None:
            return result
        followers = [row for row in range(len(self.robots)) if self._follows(row)]
        leader = self.robots[self.row(formation.leader)].start
        shaped: tuple[Slot, ...] = ()
        if formation.shape is not None:
            shaped = shapes.slots(formation.shape, len(followers), formation.spacing_m)
        for number, row in enumerate(followers):
            if shaped:
                result[row] = shaped[number]
            elif formation.slots:
                place = formation.slots[number]
                result[row] = Slot(place.distance_m, geometry.wrap_angle(place.bearing_rad))
            else:
                x_m, y_m, _ = self.robots[row].start
                result[row] = shapes.slot_at(x_m - leader[0], y_m - leader[1], leader[2])
        return result

    def slot(self, row: int) -> Slot | None:
        """Nominal slot of one row."""
        return self.slots()[row]

    def _follows(self, row: int) -> bool:
        robot = self.robots[row]
        return (
            self.formation is not None
            and robot.name != self.formation.leader
            and robot.goal is None
        )

    def setup(self, name: str) -> RobotSetup:
        """What one robot may know: its own row and what all share, never its peers' rows."""
        row = self.row(name)
        every = self.slots()
        formation = self.formation
        if formation is not None and formation.slots:
            formation = msgspec.structs.replace(formation, slots=())  # its peers' rows are theirs
        return RobotSetup(
            row=row,
            robot=self.robots[row],
            dt_s=self.dt_s,
            leads=formation is not None and formation.leader == name,
            slot=every[row],
            places=tuple(
                sorted(
                    (slot for slot in every if slot is not None),
                    key=lambda slot: (slot.distance_m, slot.bearing_rad),
                )
            ),
            formation=formation,
            slot_distance_m_max=max([slot.distance_m for slot in every if slot], default=0.0),
            **{field: getattr(self, field) for field in Shared.__struct_fields__},
        )


class RobotSetup(Shared, frozen=True, kw_only=True, forbid_unknown_fields=True, cache_hash=True):
    """One robot's part of a scenario: the world's reply to its scenario query."""

    row: int
    robot: Robot
    dt_s: float
    leads: bool  # at the start, as far as nobody was elected since
    slot: Slot | None  # at the start
    places: tuple[Slot, ...]  # all slots of the formation; their order tells nothing
    formation: Formation | None
    slot_distance_m_max: float  # d_max of the formation, for the heading's rate limit


# --- decoding -----------------------------------------------------------------------------------


def decode(
    data: bytes,
    where: str,
    *,
    settings: Sequence[str] = (),
    faults: Sequence[str] = (),
    robots: int | None = None,
    seed: int | None = None,
    duration_s: float | None = None,
) -> Scenario:
    """Scenario from TOML bytes and what the command line changed in it.

    Args:
        data: the file's content; `where` names it in errors.
        settings: `PATH=VALUE` of `--set`, VALUE in TOML (bare words are strings).
        faults: `kind:target@start_s[,key=value]` of `--fault`, added to `[[faults]]`.
        robots: how many of the rows, or of the `[line]`, to keep.
    Raises:
        ScenarioError: file, path, expected and got.
    """
    try:
        raw = tomllib.loads(data.decode())
    except UnicodeDecodeError as error:
        raise errors.ScenarioError(
            f"{where}: expected UTF-8 text, got byte 0x{data[error.start]:02x} at {error.start}"
        ) from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise errors.ScenarioError(f"{where}: expected TOML, got: {error}") from error
    for name, retired in RETIRED.items():
        if isinstance(table := raw.get(name), dict):
            raw[name] = {key: value for key, value in table.items() if retired.get(key) != value}
    for setting in settings:
        _set(raw, setting)
    if seed is not None:
        raw["seed"] = seed
    if duration_s is not None:
        raw["duration_s"] = duration_s
    if faults:
        raw["faults"] = [*_rows(raw, "faults", where), *(faults_.table(spec) for spec in faults)]
    defaults = raw.get("robot", {})
    _convert(defaults, RobotParameters, where, "robot")
    if "line" in raw:
        raw = _with_line(raw, robots, where)
    elif robots is not None:
        rows = _rows(raw, "robots", where)
        if not 1 <= robots <= len(rows):
            raise errors.ScenarioError(
                f"{where}: expected --robots between 1 and {len(rows)} (the rows of [[robots]]), "
                f"got {robots}"
            )
        raw["robots"] = rows[:robots]
        _expect_only(raw, robots)
    if isinstance(raw.get("robots"), list):
        raw["robots"] = [
            {**defaults, **row} if isinstance(row, dict) else row for row in raw["robots"]
        ]
    return _convert(raw, Scenario, where)


def fault(spec: str, *, at_s: float, names: Sequence[str]) -> Fault:
    """Fault of one text, for a swarm that runs; raises ScenarioError.

    Args:
        at_s: when it begins if the text does not say.
        names: robots of the swarm.
    """
    table = faults_.table(spec, at_s=at_s, where="fault")
    found: Fault = _convert(table, cast("type[Fault]", Fault), f"fault {spec}")
    if (problem := faults_.problem_of(found, names)) is not None:
        raise errors.ScenarioError(f"fault: {spec}: {problem}")
    return found


def to_builtins(scenario: Scenario) -> dict[str, Any]:
    """Plain tables and values, without what is None: decodes to the same scenario again."""
    result = _without_none(msgspec.to_builtins(scenario))
    assert isinstance(result, dict)
    return result


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, (list, tuple)):
        return [_without_none(item) for item in value]
    return value


def _rows(raw: Mapping[str, Any], key: str, where: str) -> list[Any]:
    rows = raw.get(key, [])
    if not isinstance(rows, list):
        raise errors.ScenarioError(f"{where}: {key}: expected rows [[{key}]], got {rows!r}")
    return rows


def _expect_only(raw: dict[str, Any], robots: int) -> None:
    """Expect no more than the robots that are left can do."""
    expect = raw.get("expect")
    if not isinstance(expect, dict):
        return
    names = [row.get("name") for row in raw["robots"] if isinstance(row, dict)]
    if isinstance(expect.get("arrived"), int):
        expect["arrived"] = min(expect["arrived"], robots)
    if isinstance(expect.get("mirror_pairs"), list):
        expect["mirror_pairs"] = [
            pair
            for pair in expect["mirror_pairs"]
            if not isinstance(pair, list) or all(name in names for name in pair)
        ]


def _with_line(raw: Mapping[str, Any], robots: int | None, where: str) -> dict[str, Any]:
    table = dict(raw["line"]) if isinstance(raw["line"], dict) else raw["line"]
    if robots is not None and isinstance(table, dict):
        table["count"] = robots
    line = _convert(table, Line, where, "line")
    if "robots" in raw:
        raise errors.ScenarioError(
            f"{where}: robots: expected either [line] or [[robots]], got both"
        )
    rest = {key: value for key, value in raw.items() if key != "line"}
    rest["robots"] = [
        {
            "name": f"robot{i + 1}",
            "start": [0.0, (i - (line.count - 1) / 2.0) * line.spacing_m, 0.0],
        }
        for i in range(line.count)
    ]
    if line.goal is not None:
        rest["robots"][0]["goal"] = list(line.goal)
    return rest


def _set(raw: dict[str, Any], setting: str) -> None:
    path, sign, text = setting.partition("=")
    keys = path.strip().split(".")
    if not sign or not all(keys) or "\n" in setting:
        raise errors.ScenarioError(
            f"--set {setting}: expected PATH=VALUE such as field.k_e=1.0, got '{setting}'"
        )
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    table: Any = raw
    for depth, name in enumerate(keys[:-1]):
        table = table[int(name)] if _is_row(table, name) else _table(table, name)
        if not isinstance(table, (dict, list)):
            raise errors.ScenarioError(
                f"--set {setting}: expected a table at '{'.'.join(keys[: depth + 1])}', "
                f"got {table!r}"
            )
    if _is_row(table, keys[-1]):
        table[int(keys[-1])] = value
    elif isinstance(table, dict):
        table[keys[-1]] = value
    else:
        raise errors.ScenarioError(
            f"--set {setting}: expected a row number from 0 to {len(table) - 1}, got '{keys[-1]}'"
        )


def _is_row(table: Any, name: str) -> bool:
    return (
        isinstance(table, list) and name.isascii() and name.isdecimal() and int(name) < len(table)
    )


def _table(table: Any, name: str) -> Any:
    return table.setdefault(name, {}) if isinstance(table, dict) else None


_FAULT = re.compile(r"^faults\[([0-9]+)\]\Z")
_KIND = re.compile(r"^(faults\[[0-9]+\]\.)?kind\Z")
_PATH = re.compile(r"^(?P<text>.*?)(?: - at `(?P<path>[^`]*)`)?$", re.DOTALL)


def _convert(raw: Any, type_: type[T], where: str, inside: str = "") -> T:
    try:
        return msgspec.convert(raw, type_)
    except msgspec.ValidationError as error:
        match = _PATH.match(str(error))
        assert match is not None
        text, path = match["text"], (match["path"] or "$").removeprefix("$").lstrip(".")
        found = _found(raw, path)
        full = ".".join(part for part in (inside, path) if part) or "the whole file"
        text, known = _expected(text[0].lower() + text[1:], type_, path, raw)
        got = "" if ", got" in text or found is None else f", got {found}"
        word = text.rsplit(", got ", 1)[-1] if ", got" in text else found or ""
        hint = errors.did_you_mean(word.strip("'"), known)
        raise errors.ScenarioError(f"{where}: {full}: {text}{got}{hint}") from error


def _expected(text: str, type_: Any, path: str, raw: Any) -> tuple[str, list[str]]:
    """Text of msgspec's, with the known keys or values where it does not name them; and those."""
    known: list[str] = []
    if "unknown field" in text:
        name, known = text.split("`")[1], _known(type_, path, raw)
        text = f"expected one of the keys {', '.join(known)}, got '{name}'"
    elif "invalid enum value" in text:
        known = _known(type_, path, raw)
        text = f"expected one of {', '.join(known)}"
    elif _KIND.search(path) and "invalid value" in text:
        known = list(faults_.KINDS)
        text = f"expected one of {', '.join(known)}"
    elif "missing required field" in text:
        text = f"expected the key '{text.split('`')[1]}', got none"
    return text, known


def _known(type_: Any, path: str, raw: Any) -> list[str]:
    """Keys of the table, or values of the choice, that a path of a type leads to."""
    if fault := _FAULT.match(path):
        kind = raw["faults"][int(fault[1])]["kind"]
        return ["kind", *faults_.KINDS[kind].__struct_fields__]
    info: Any = msgspec.inspect.type_info(type_)
    for step in [*re.findall(r"[^.\[\]]+", path), ""]:
        if isinstance(info, msgspec.inspect.UnionType):
            info = next(one for one in info.types if not isinstance(one, msgspec.inspect.NoneType))
        if not step:
            break
        if isinstance(info, msgspec.inspect.StructType):
            info = next(field.type for field in info.fields if field.encode_name == step)
        elif isinstance(info, msgspec.inspect.TupleType):
            info = info.item_types[int(step)]
        else:
            info = info.item_type
    if isinstance(info, msgspec.inspect.StructType):
        return [field.encode_name for field in info.fields]
    return [str(value) for value in info.values]


def _found(raw: Any, path: str) -> str | None:
    value = raw
    for step in re.findall(r"[^.\[\]]+", path):
        try:
            value = value[int(step)] if isinstance(value, list) else value[step]
        except (KeyError, IndexError, TypeError, ValueError):
            return None
    return None if isinstance(value, (dict, list)) and len(str(value)) > 60 else repr(value)
