"""A live run among strangers: garbage on every topic and query changes nothing but a count."""

from __future__ import annotations

import json
import socket
import threading
from pathlib import Path

import pytest
import zenoh

from swarm import messages, recording, runs
from swarm.run import library
from tests.run import processes
from tests.swarm.test_bus import GARBAGE

DURATION_S = "8"


def card_in(folder: Path) -> runs.Card | None:
    cards = [card for card in runs.running() if Path(card.folder).parent == folder]
    return cards[0] if cards else None


def stranger(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def test_garbage_on_every_topic_and_query_changes_nothing_but_a_count(folder: Path) -> None:
    line = ("two-obstacles", "--duration", DURATION_S, "--json", "-q")
    alone = processes.swarm(folder, "run", *line, "--bus", "memory", "--out", "alone")
    run = processes.start(folder, "run", *line, "--rate", "4", "--out", "among")
    processes.until(lambda: card_in(folder), 30.0, "the run")
    card = card_in(folder)
    assert card is not None
    with stranger(card.endpoint) as session:
        keys = [
            messages.key(topic, card.run, name)
            for topic in messages.TOPICS.values()
            for name in ("leader", "robot3", "nobody")
        ]
        keys.append(f"swarm/{card.run}/robot/robot3/no-such-topic")
        publishers = [session.declare_publisher(key) for key in dict.fromkeys(keys)]
        while run.poll() is None:
            for payload in GARBAGE.values():
                for publisher in publishers:
                    publisher.put(payload)
                for query in messages.QUERIES.values():
                    for reply in session.get(
                        messages.key(query, card.run), payload=payload, timeout=1.0
                    ):
                        if reply.ok is not None:
                            assert not messages.decode_reply(reply.ok.payload.to_bytes()).ok
            threading.Event().wait(0.05)  # pace of the flood, not a synchronisation
    printed, said = run.communicate()
    assert json.loads(printed)["state_hash"] == json.loads(alone.stdout)["state_hash"], said
    kinds = {
        event.text.split(":")[0]
        for record in recording.read(folder / "among").ticks
        for event in record.events
        if event.kind == "message-rejected"
    }
    assert "command" in kinds
    log = (folder / "among" / runs.LOGS / "robot3.log").read_text()
    assert "ignored" in log
    assert "frame" in log


@pytest.mark.parametrize("flag", ["--foxglove", "--view"])
def test_live_picture_is_served_on_loopback_and_ends_with_the_run(folder: Path, flag: str) -> None:
    value = ["web"] if flag == "--view" else []
    run = processes.start(folder, "run", "empty", "--rate", "1", "--out", "out", flag, *value)
    assert run.stderr is not None
    address = ""
    for line in run.stderr:
        if "watch in" in line:
            address = line.split("://")[1]
            break
    host, port = address.split("/")[0].strip().split(":")
    assert host == "127.0.0.1"
    request = "GET / HTTP/1.1\r\nHost: x\r\n"
    if flag == "--foxglove":
        request += (
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n"
        )
    answers: list[bytes] = []

    def answered() -> bool:
        try:
            with socket.create_connection((host, int(port)), timeout=5.0) as client:
                client.sendall(f"{request}\r\n".encode())
                answers.append(client.recv(200))
        except OSError:
            return False
        return True

    processes.until(answered, 20.0, "an answer")
    version, code = answers[-1].split()[:2]
    assert version.startswith(b"HTTP/1.")
    assert code == (b"101" if flag == "--foxglove" else b"200")
    run.terminate()
    run.communicate(timeout=10.0)
    processes.until(lambda: not processes.belonging(folder), 5.0, "all end")


def test_scenarios_are_found_by_name() -> None:
    assert {
        "two-obstacles",
        "three-obstacles",
        "single-robot",
        "head-on-pairs",
        "random-field",
        "empty",
    } <= set(library.built_in())
