"""The router configurations: they open, a swarm runs through them, and they hold their bounds."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from swarm import messages, zenoh_bus
from swarm.bus import Bus, Delivery
from swarm.geometry import STILL, Pose
from swarm.messages import COMMAND, FRAME, Beacon, Command, SensorFrame, Trace, Wheels
from tests.deploy import files
from tests.run import processes

RUN = "router-test"
ARRIVE_S = 10.0


def read(path: Path) -> dict[str, Any]:
    """Everything a configuration says, with Zenoh's defaults for the rest."""
    found: dict[str, Any] = json.loads(str(zenoh.Config.from_file(str(path))))
    return found


def command(robot: str, tick: int, padding: int = 0) -> Command:
    """A command of a chosen size: `padding` bytes more than the smallest."""
    beacon = Beacon(robot, tick, 0, Pose(0.0, 0.0, 0.0), STILL, 0.2, 1.0, "GO", False, (1, 0, 0, 1))
    sectors = messages.Array("<f4", (padding // 4,), bytes(padding // 4 * 4))
    return Command(robot, tick, 0, STILL, beacon, Trace(sectors))


def frame(robot: str, tick: int) -> SensorFrame:
    ranges = messages.array(np.full(8, np.inf, np.float32))
    pose = Pose(0.0, 0.0, 0.0)
    return SensorFrame(robot, tick, 0, pose, STILL, Wheels(0.0, 0.0), False, ranges)


def until(condition: Callable[[], object], bus: Bus) -> None:
    deadline_s = time.monotonic() + ARRIVE_S
    while not condition():
        assert time.monotonic() < deadline_s, f"not within {ARRIVE_S:g} s"
        bus.receive(0.05)


def next_of(bus: Bus) -> Delivery:
    """The next message; other things only wake the receiver."""
    deadline_s = time.monotonic() + ARRIVE_S
    while (delivery := bus.receive(0.5)) is None:
        assert time.monotonic() < deadline_s, f"nothing arrived within {ARRIVE_S:g} s"
    return delivery


# --- what the files say -------------------------------------------------------------------------


@pytest.mark.parametrize("path", [files.PLAIN, files.SECURE], ids=lambda path: path.stem)
def test_router_bounds_every_topic_and_query_as_the_table_does(path: Path) -> None:
    bounds = {
        (key, kind): rule["size_limit"]
        for rule in read(path)["low_pass_filter"]
        for key in rule["key_exprs"]
        for kind in rule["messages"]
    }
    wanted = {}
    for topic in messages.TOPICS.values():
        for kind in ("put", "delete"):
            wanted[messages.key(topic, "*"), kind] = topic.size_max
    for query in messages.QUERIES.values():
        wanted[messages.key(query, "*"), "query"] = query.size_max
    assert bounds == wanted


@pytest.mark.parametrize("path", [files.PLAIN, files.SECURE], ids=lambda path: path.stem)
def test_router_has_the_values_of_the_worlds_own(path: Path) -> None:
    config = read(path)
    link = config["transport"]["link"]
    assert config["mode"] == "router"
    assert link["tx"]["lease"] == zenoh_bus.LEASE_MS
    assert link["rx"]["max_message_size"] == zenoh_bus.MESSAGE_BYTES_MAX
    assert config["transport"]["shared_memory"]["enabled"] is False  # it passes by that bound
    assert config["scouting"]["multicast"]["enabled"] is False
    assert config["scouting"]["gossip"]["enabled"] is False


def test_secure_router_differs_from_the_plain_one_only_in_security() -> None:
    plain, secure = read(files.PLAIN), read(files.SECURE)
    for config in (plain, secure):
        del config["access_control"]
        del config["transport"]["link"]["tls"]
        for endpoint in config["listen"]["endpoints"]:
            assert endpoint.partition("/")[2] == "127.0.0.1:7447"
        del config["listen"]["endpoints"]
    assert plain == secure


@pytest.mark.parametrize("name", files.ROBOTS)
def test_secure_router_lets_a_robot_use_its_own_keys_only(name: str) -> None:
    table = read(files.SECURE)["access_control"]
    assert table["default_permission"] == "deny"
    [subject] = [one for one in table["subjects"] if one["cert_common_names"] == [name]]
    [policy] = [one for one in table["policies"] if one["subjects"] == [subject["id"]]]
    rules = {one["id"]: one for one in table["rules"]}
    speaks = {
        (kind, key)
        for rule in policy["rules"]
        for kind in rules[rule]["messages"]
        for key in rules[rule]["key_exprs"]
        if rules[rule]["flows"] == ["ingress"]
    }
    own = {
        messages.key(COMMAND, "*", name),
        messages.key(FRAME, "*", name),
        messages.alive_key("*", "robot", name),
    }
    assert speaks == {
        *((kind, key) for kind in ("put", "declare_subscriber", "liveliness_token") for key in own),
        ("query", messages.key(messages.SCENARIO, "*")),
        ("declare_liveliness_subscriber", messages.alive_key("*")),
        ("liveliness_query", messages.alive_key("*")),
    }


# --- what they do -------------------------------------------------------------------------------


def test_swarm_succeeds_through_the_plain_router(folder: Path, plain_router: str) -> None:
    done = processes.swarm(
        folder,
        *("run", "empty", "--robots", "2", "--duration", "1", "--router", plain_router),
        *("--json", "--quiet", *files.UNRECORDED),
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["outcome"] == "succeeded"
    assert summary["commands_total"] == 2 * (summary["ticks"] + 1)  # tick 0 has some, too


def test_swarm_succeeds_through_the_secure_router_with_an_injected_kill(
    folder: Path, secure_router: str, certificates: Path
) -> None:
    done = processes.swarm(
        folder,
        *("run", "empty", "--robots", "3", "--duration", "1", "--fault", "kill:robot2@0.4"),
        *("--router", secure_router, "--tls", str(certificates)),
        *("--json", "--quiet", *files.UNRECORDED),
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert [row["outcome"] for row in summary["per_robot"]] == ["arrived", "killed", "arrived"]


def test_plain_router_drops_what_is_too_large_and_keeps_the_link(plain_router: str) -> None:
    world = zenoh_bus.open_client(RUN, plain_router, name="world")
    robot = zenoh_bus.open_client(RUN, plain_router, name="robot1")
    try:
        world.subscribe(COMMAND)
        robot.announce("robot", "robot1")
        until(lambda: world.alive(), world)
        # one byte of the envelope more or less does not matter to these sizes
        robot.publish(COMMAND, command("robot1", 0, 60_000), "robot1")
        robot.publish(COMMAND, command("robot1", 1, 70_000), "robot1")
        for size in (300_000, 1_000_000):
            robot.publish_raw(COMMAND, bytes(size), "robot1")
        robot.publish(COMMAND, command("robot1", 4), "robot1")
        assert [next_of(world).message.tick for _ in range(2)] == [0, 4]
        assert world.rejected() == {}  # dropped on the way, not by the receiver
        assert world.alive() == {("robot", "robot1")}
    finally:
        robot.close()
        world.close()


def test_secure_router_lets_no_robot_speak_for_another(
    secure_router: str, certificates: Path
) -> None:
    world, robot1, robot2 = (
        zenoh_bus.open_client(RUN, secure_router, name=name, tls=certificates)
        for name in ("world", "robot1", "robot2")
    )
    try:
        world.subscribe(COMMAND)
        robot2.subscribe(FRAME, "robot2")
        robot2.announce("robot", "robot2")
        robot1.announce("world", "world")
        robot1.announce("robot", "robot3")
        robot1.announce("robot", "robot1")
        until(lambda: len(world.alive()) >= 2, world)
        assert world.alive() == {("robot", "robot1"), ("robot", "robot2")}
        robot1.publish(COMMAND, command("robot2", 1), "robot2")
        robot1.publish(FRAME, frame("robot2", 2), "robot2")
        # a session's messages keep their order: with this one, the forged ones have passed, too
        robot1.publish(COMMAND, command("robot1", 3), "robot1")
        assert next_of(world).message == command("robot1", 3)
        world.publish(FRAME, frame("robot2", 4), "robot2")
        assert next_of(robot2).message.tick == 4
    finally:
        for bus in (robot2, robot1, world):
            bus.close()
