"""The live server of Foxglove: what a client gets, and one that has stopped holds up nobody."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from dashboards import bridge, foxglove, live
from swarm.messages import TickRecord
from swarm.scenario import Scenario

MakeTicks = Callable[..., tuple[TickRecord, ...]]
MakeScenario = Callable[[int], Scenario]

ROBOTS = 100
COUNT = 60
DEADLINE_S = 60.0
FLOOD_BYTES = 40_000_000  # far more than the buffers of a connection hold
CLIENT = Path(__file__).with_name("foxglove_client.py")


@pytest.fixture
def served(made_scenario: MakeScenario) -> Iterator[tuple[bridge.Bridge, int]]:
    with socket.socket() as probe:
        probe.bind((live.HOST, 0))
        port = probe.getsockname()[1]
    scenario = made_scenario(ROBOTS)
    server = bridge.Bridge("run-1", foxglove.channels(scenario, scenario.obstacles), port)
    yield server, port
    server.close()


@pytest.fixture
def client(served: tuple[bridge.Bridge, int]) -> Iterator[subprocess.Popen[str]]:
    """A process that subscribes to everything and prints a line for each message."""
    command = [sys.executable, str(CLIENT), live.HOST, str(served[1])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def line(client: subprocess.Popen[str]) -> list[object]:
    assert client.stdout is not None
    found: list[object] = json.loads(client.stdout.readline())
    return found


def test_client_gets_every_channel_with_its_schema(
    served: tuple[bridge.Bridge, int], client: subprocess.Popen[str], made_ticks: MakeTicks
) -> None:
    server, _ = served
    advertised, schemas = line(client)
    assert set(advertised) == {"/tf", "/poses", "/bodies", "/scans", "/obstacles", "/log"}  # type: ignore[call-overload]
    assert {str(name).split(".")[0] for name in schemas} == {"foxglove"}  # type: ignore[attr-defined]
    assert line(client) == ["subscribed"]
    got = set()
    for record in made_ticks(ROBOTS, COUNT):
        server.observe(record)
    while got != set(advertised):  # type: ignore[call-overload]
        topic, stamp_ns, _ = line(client)
        got.add(topic)
        assert stamp_ns in {record.stamp_ns for record in made_ticks(ROBOTS, COUNT)}


def test_client_that_has_stopped_holds_up_nobody_and_fills_no_memory(
    served: tuple[bridge.Bridge, int],
    client: subprocess.Popen[str],
    made_ticks: MakeTicks,
    made_scenario: MakeScenario,
) -> None:
    server, _ = served
    line(client)
    assert line(client) == ["subscribed"]
    ticks = made_ticks(ROBOTS, COUNT)
    size = sum(
        len(channel.encode(record) or b"")
        for channel in foxglove.channels(made_scenario(ROBOTS), ())
        for record in ticks
    )
    client.send_signal(signal.SIGSTOP)
    before = psutil.Process().memory_info().rss
    end_s = time.monotonic() + DEADLINE_S
    for _ in range(FLOOD_BYTES // size + 1):
        for record in ticks:
            server.observe(record)
            assert time.monotonic() < end_s, "expected the server to drop, it waits"
    assert psutil.Process().memory_info().rss - before < FLOOD_BYTES
    client.send_signal(signal.SIGCONT)
    assert line(client)[0] in {"/tf", "/poses", "/bodies", "/scans", "/obstacles", "/log"}


def test_server_listens_on_loopback_only(served: tuple[bridge.Bridge, int]) -> None:
    _, port = served
    listening = {
        connection.laddr.ip
        for connection in psutil.Process().net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN and connection.laddr.port == port
    }
    assert listening == {live.HOST}
