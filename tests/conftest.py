"""Shared by all tests: deterministic hypothesis, a Zenoh port of one's own, made-up ticks."""

from __future__ import annotations

import functools
import math
import socket
from collections.abc import Callable

import hypothesis
import numpy as np
import pytest

from swarm import geometry, messages
from swarm.messages import TickRecord

hypothesis.settings.register_profile("swarm", derandomize=True, deadline=None, max_examples=60)
hypothesis.settings.load_profile("swarm")


@pytest.fixture
def endpoint() -> str:
    """A loopback endpoint whose port was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture(scope="session")
def made_ticks() -> Callable[..., tuple[TickRecord, ...]]:
    """Factory of a run that never was: `made_ticks(robots, count, beams=216)`, robots on a ring."""
    return functools.cache(_made_ticks)


def _made_ticks(robots: int, count: int, beams: int = 216) -> tuple[TickRecord, ...]:
    return tuple(_made_tick(tick, robots, beams) for tick in range(count))


def _made_tick(tick: int, robots: int, beams: int) -> TickRecord:
    """Each robot goes round its ring place, leads or follows, and sees one arc that wanders."""
    stamp_ns = tick * 80_000_000
    rows, frames, commands = [], [], []
    leadership = messages.Leadership(1, (0, 0, 0, 0), "robot1")
    for row in range(robots):
        angle_rad = 0.02 * tick + math.tau * row / robots
        ring_m = 3.0 + 0.15 * robots
        pose = geometry.Pose(
            ring_m * math.cos(angle_rad),
            ring_m * math.sin(angle_rad),
            geometry.wrap_angle(angle_rad + math.pi / 2.0),
        )
        twist = geometry.Twist(0.5 + 0.001 * row, 0.02)
        ranges_m = np.full(beams, np.inf, np.float32)
        seen = (np.arange(beams // 7) + 3 * tick + 7 * row) % beams
        ranges_m[seen] = 2.5 + 0.5 * np.sin(0.1 * np.arange(len(seen)) + 0.05 * tick)
        beacon = messages.Beacon(
            name=f"robot{row + 1}",
            tick=tick,
            incarnation=0,
            pose=pose,
            twist=twist,
            body_radius_m=0.22,
            speed_mps_max=1.0,
            mode="AVOID" if (tick // 20 + row) % 3 == 0 else "FORM",
            arrived=False,
            priority=(1, row, 0, 0),
            slot=messages.Slot(1.0, 0.3 * row) if row else None,
            bearing_now_rad=0.3 * row,
            leadership=leadership,
            goal=None if row else (18.0, 0.0),
            formation_heading_rad=0.0 if row else pose.yaw_rad,
        )
        heard = [(peer, tick - 1) for peer in range(robots) if tick and peer != row][:20]
        rows.append(messages.RobotRecord(True, False, pose, twist, twist, beacon, 2.0))
        frames.append(
            messages.FrameRecord(
                row,
                pose,
                twist,
                messages.Wheels(0.5, 0.51),
                False,
                messages.array(ranges_m),
                messages.array(np.array(heard, np.int32).reshape(-1, 2)),
            )
        )
        trace = messages.Trace(
            sectors=messages.array(ranges_m.reshape(-1, 3).min(axis=1)),
            arcs=(messages.Arc(angle_rad, 2.0, 0.3, 0.7),),
            forces=messages.Forces((1.0, 0.5), (0.2, 0.1), (0.0, 0.1), (0.0, 0.0), (1.2, 0.7)),
            waypoint=(pose.x_m + 1.0, pose.y_m),
        )
        if tick:
            commands.append(messages.Command(beacon.name, tick, stamp_ns, twist, beacon, trace))
    events = (
        (messages.Event(tick, stamp_ns, "fault", "robot1", "kill", fault="kill", number=0),)
        if tick == 10
        else ()
    )
    return TickRecord(tick, stamp_ns, tuple(rows), tuple(frames), tuple(commands), events)


def pytest_addoption(parser: pytest.Parser) -> None:
    """How long the random campaigns are; `make test-kills`, `-fuzz`, `-soak` run the full ones."""
    parser.addoption("--kills", type=int, default=2, help="random kills of each kind (full: 20)")
    parser.addoption("--fuzz", type=int, default=1, help="parts of the fuzzing (full: 50)")
    parser.addoption(
        "--crowds",
        type=int,
        default=60,
        help="crowds a property looks at (full: 50,000)",
    )
    parser.addoption("--soak", type=int, default=3, help="kill-and-restart cycles (full: 1000)")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test a kill, so that each can be repeated by its name."""
    if "kill" in metafunc.fixturenames:
        metafunc.parametrize("kill", range(metafunc.config.getoption("--kills")))
