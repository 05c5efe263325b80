"""One contract for every Bus, then what only a network can do to it."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator

import pytest
import zenoh

from swarm import errors, messages, zenoh_bus
from swarm.bus import Bus, Delivery, Hub, MemoryBus
from swarm.geometry import STILL, Pose
from swarm.messages import COMMAND, EVENT, Beacon, Command, Event, Reply, Trace

Pair = tuple[Bus, Bus]
RUN = "test-run"


def command(robot: str, tick: int) -> Command:
    beacon = Beacon(robot, tick, 0, Pose(0.0, 0.0, 0.0), STILL, 0.2, 1.0, "GO", False, (1, 0, 0, 1))
    return Command(robot, tick, 0, STILL, beacon, Trace(messages.Array("<f4", (0,), b"")))


@pytest.fixture(params=["memory", "zenoh"])
def pair(request: pytest.FixtureRequest, endpoint: str) -> Iterator[Pair]:
    """The world's bus and a robot's bus."""
    if request.param == "memory":
        hub = Hub()
        world, robot = MemoryBus(hub, RUN), MemoryBus(hub, RUN)
        yield world, robot
    else:
        router = zenoh_bus.open_router(RUN, endpoint)
        client = zenoh_bus.open_client(RUN, endpoint, name="robot1")
        yield router, client
        client.close()
        router.close()


def until(condition: Callable[[], object], bus: Bus) -> None:
    """Wait for a condition, at most 10 s."""
    deadline_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline_s, "condition did not come true within 10 s"
        bus.receive(0.05)


def collect(bus: Bus, count: int) -> list[Delivery]:
    """Take so many deliveries, within 10 s."""
    deliveries: list[Delivery] = []
    deadline_s = time.monotonic() + 10.0
    while len(deliveries) < count and time.monotonic() < deadline_s:
        if (delivery := bus.receive(0.5)) is not None:
            deliveries.append(delivery)
    return deliveries


def test_bus_delivers_in_order_to_the_wildcard_subscriber(pair: Pair) -> None:
    world, robot = pair
    world.subscribe(COMMAND)
    robot.announce("robot", "robot1")
    until(lambda: ("robot", "robot1") in world.alive(), world)
    sent = [command("robot1", tick) for tick in range(50)]
    for one in sent:
        robot.publish(COMMAND, one, one.robot)
    received = collect(world, len(sent))
    assert [one.message for one in received] == sent
    assert all(one.topic is COMMAND for one in received)


def test_bus_receives_only_what_it_subscribed_to(pair: Pair) -> None:
    world, robot = pair
    world.subscribe(COMMAND, "robot2")
    robot.announce("robot", "robot1")
    until(lambda: world.alive(), world)
    robot.publish(COMMAND, command("robot1", 1), "robot1")
    robot.publish(EVENT, Event(0, 0, "end"))
    robot.publish(COMMAND, command("robot2", 2), "robot2")
    assert [one.message.robot for one in collect(world, 1)] == ["robot2"]
    assert world.receive(0.0) is None


def test_bus_answers_queries_and_says_when_nobody_does(pair: Pair) -> None:
    world, robot = pair
    with pytest.raises(errors.BusError, match="control"):
        robot.ask(messages.CONTROL, messages.ControlRequest("status"), 0.2)
    world.serve(messages.CONTROL, lambda request: Reply(True, request.action))
    reply = robot.ask(messages.CONTROL, messages.ControlRequest("stop"), 5.0)
    assert reply == Reply(True, "stop")


def test_bus_shows_who_is_alive_and_who_left(pair: Pair) -> None:
    world, robot = pair
    world.subscribe(COMMAND)
    robot.announce("robot", "robot1")
    robot.announce("supervisor", "host")
    until(lambda: len(world.alive()) == 2, world)
    assert world.alive() == {("robot", "robot1"), ("supervisor", "host")}
    robot.close()
    until(lambda: not world.alive(), world)


def test_bus_wakes_and_refuses_after_close(pair: Pair) -> None:
    world, _ = pair
    world.subscribe(COMMAND)
    world.wake()
    assert world.receive(5.0) is None
    world.close()
    with pytest.raises(errors.BusError):
        world.receive(0.5)


def test_receive_keeps_only_the_newest_when_asked(pair: Pair) -> None:
    world, robot = pair
    world.subscribe(COMMAND, "robot1", newest=True)
    robot.announce("robot", "robot1")
    until(lambda: world.alive(), world)
    for tick in range(20):
        robot.publish(COMMAND, command("robot1", tick), "robot1")
    robot.announce("robot", "done")  # after the data on the same session: nearly all has arrived
    until(lambda: ("robot", "done") in world.alive(), robot)
    ticks: list[int] = []
    while not ticks or ticks[-1] < 19:
        ticks += [one.message.tick for one in collect(world, 1)]
    assert ticks == sorted(ticks)
    assert len(ticks) < 10  # one by one it would be 20
    assert world.receive(0.0) is None


GARBAGE = {
    "empty": b"",
    "truncated": messages.encode(command("robot1", 1))[:-7],
    "trailing": messages.encode(command("robot1", 1)) + b"\x00",
    "not msgpack": b"\xc1" * 40,
    "wrong type": messages.encode(Event(1, 1, "end")),
    "huge": b"\xc6" + (60_000).to_bytes(4, "big") + bytes(60_000),
    "oversized": bytes(70_000),
    "deep": b"\x91" * 20_000,
    "not finite": messages.encode(command("robot1", 1)).replace(
        b"\xcb" + bytes(8), b"\xcb\x7f\xf8" + bytes(6), 1
    ),
    "foreign name": messages.encode(command("robot2", 1)),
    "bad name": messages.encode(command("robot1", 1)).replace(b"robot1", b"ROBOT1"),
    "negative tick": messages.encode(command("robot1", 1)).replace(b"robot1\x01", b"robot1\xff", 1),
}


def test_zenoh_bus_counts_and_ignores_garbage_from_strangers(endpoint: str) -> None:
    world = zenoh_bus.open_router(RUN, endpoint)
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    try:
        world.subscribe(COMMAND)
        with zenoh.open(config) as stranger:
            token = stranger.liveliness().declare_token(messages.alive_key(RUN, "robot", "robot1"))
            until(lambda: world.alive(), world)
            put = stranger.declare_publisher(
                messages.key(COMMAND, RUN, "robot1"),
                congestion_control=zenoh.CongestionControl.BLOCK,
            ).put
            for payload in GARBAGE.values():
                put(payload)
            good = command("robot1", 7)
            put(messages.encode(good))
            deliveries = collect(world, 1)
            token.undeclare()
        assert [one.message for one in deliveries] == [good]
        assert sum(world.rejected().values()) == len(GARBAGE), world.rejected()
    finally:
        world.close()


def test_zenoh_bus_names_the_port_that_is_taken(endpoint: str) -> None:
    world = zenoh_bus.open_router(RUN, endpoint)
    try:
        with pytest.raises(errors.BusError, match=r"listen on .* in use"):
            zenoh_bus.open_router(RUN, endpoint)
    finally:
        world.close()


def test_zenoh_bus_says_that_no_router_answers(endpoint: str) -> None:
    with pytest.raises(errors.BusError, match="reach the router"):
        zenoh_bus.open_client(RUN, endpoint, name="robot1", connect_timeout_s=0.3)


def test_zenoh_receive_returns_at_its_deadline_and_on_wake_from_a_thread(endpoint: str) -> None:
    world = zenoh_bus.open_router(RUN, endpoint)
    try:
        world.subscribe(COMMAND)
        started_s = time.monotonic()
        assert world.receive(0.3) is None
        assert time.monotonic() - started_s >= 0.3
        threading.Timer(0.05, world.wake).start()
        assert world.receive(60.0) is None
    finally:
        world.close()
