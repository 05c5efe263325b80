"""The floor of the barrier: the same processes and payloads over Zenoh, and nothing else.

    world (router) --frame of the real length--> robot --command of the real length--> world

No decoding, no thinking, no bus. The configuration is the best one measured for this exchange and
is written here a second time on purpose: a floor that shared the product's configuration would
sink with it.
"""

from __future__ import annotations

import json
import os
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec
import zenoh

from swarm import lifetime
from swarm.run import child
from swarm.run.bench import processes
from swarm.run.bench.processes import Window

# one worker thread does everything; only for leaves, it deadlocks a node that forwards
LEAF_RUNTIME = (
    "(rx:(handover:app),tx:(handover:app),acc:(handover:app),net:(handover:app),"
    "app:(worker_threads:1))"
)
QUEUE_MAX = 4096  # messages; at the bound the BLOCK sender waits


class Barrier(msgspec.Struct, frozen=True):
    """What every process of it knows."""

    endpoint: str
    folder: Path  # for logs
    bench_pid: int
    frame_bytes: tuple[int, ...]  # per robot
    command_bytes: tuple[int, ...]


def measure(
    frame_bytes: tuple[int, ...], command_bytes: tuple[int, ...], window_s: float
) -> Window:
    """One window of a barrier with the payloads of a real one."""
    with processes.Children() as children:
        barrier = Barrier(
            endpoint=f"tcp/127.0.0.1:{child.free_port()}",
            folder=children.folder,
            bench_pid=os.getpid(),
            frame_bytes=frame_bytes,
            command_bytes=command_bytes,
        )
        children.start("world", world, barrier, window_s, children.child_end)
        for row in range(len(frame_bytes)):
            children.start(f"robot{row + 1}", robot, barrier, row)
        return children.windows()[0]


def world(barrier: Barrier, window_s: float, end: Connection) -> None:
    """Tick until the window has passed."""
    _adopt("world", barrier)
    config = _config("router")
    config.insert_json5("listen/endpoints", json.dumps([barrier.endpoint]))
    with zenoh.open(config) as session:
        commands = session.declare_subscriber(
            "bare/command/*", zenoh.handlers.FifoChannel(QUEUE_MAX)
        )
        tokens = session.liveliness().declare_subscriber(
            "bare/alive/*", zenoh.handlers.FifoChannel(QUEUE_MAX), history=True
        )
        frames = [
            (_publisher(session, f"bare/frame/{row}"), bytes(size))
            for row, size in enumerate(barrier.frame_bytes)
        ]
        alive: set[str] = set()  # one that comes while we ask who is there is told of twice
        while len(alive) < len(frames):
            alive.add(str(tokens.recv().key_expr))
        meter = processes.Meter(end, windows=1, window_s=window_s, settle_s=0.0)
        tick = 0
        while not meter.look(tick):
            for publisher, payload in frames:
                publisher.put(payload)
            for _ in frames:
                commands.recv().payload.to_bytes()
            tick += 1


def robot(barrier: Barrier, row: int) -> None:
    """Answer every frame until ended."""
    _adopt(f"robot{row + 1}", barrier)
    os.environ["ZENOH_RUNTIME"] = LEAF_RUNTIME  # read by zenoh at its first use
    config = _config("client")
    config.insert_json5("connect/endpoints", json.dumps([barrier.endpoint]))
    config.insert_json5("connect/timeout_ms", "20000")
    config.insert_json5(
        "connect/retry",
        json.dumps({"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5}),
    )
    with zenoh.open(config) as session:
        commands = _publisher(session, f"bare/command/{row}")
        payload = bytes(barrier.command_bytes[row])
        frames = session.declare_subscriber(
            f"bare/frame/{row}", zenoh.handlers.FifoChannel(QUEUE_MAX)
        )
        token = session.liveliness().declare_token(f"bare/alive/{row}")
        while token is not None:  # it lives as long as it is referenced
            frames.recv().payload.to_bytes()
            commands.put(payload)


def _adopt(name: str, barrier: Barrier) -> None:
    log = barrier.folder / f"{name}.log"
    lifetime.adopt(name, log, lifetime.Stop(), barrier.bench_pid)


def _config(mode: str) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": 500,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
