"""Any bytes on any topic or query: a message, or a MessageError that says why not."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest

from swarm import errors, messages
from swarm.messages import TickRecord
from tests.fuzz import mutations
from tests.fuzz.campaign import Campaign

CASES = 20_000  # of a part
ROWS = [*messages.TOPICS.values(), *messages.QUERIES.values()]
# Beginnings of lists in lists, tables in tables, and of far more than follows.
OPENINGS = (
    b"\x91",
    b"\x81\xa0",
    b"\xdc\xff\xff",
    b"\xdd\xff\xff\xff\xff",
    b"\xc6\x7f\xff\xff\xff",
)
REPLY = messages.Query("reply", "", messages.Reply, "world")


@pytest.fixture(scope="module")
def good(made_ticks: Callable[..., tuple[TickRecord, ...]]) -> dict[str, list[bytes]]:
    """Payloads that are well, by topic or query."""
    record = made_ticks(3, 12, beams=24)[11]
    beacons = tuple(one.beacon for one in record.robots if one.beacon is not None)
    frames = [
        messages.SensorFrame(
            f"robot{one.row + 1}", record.tick, record.stamp_ns, one.pose, one.twist, one.wheels,
            one.contact, one.ranges, beacons[: one.row],
        )
        for one in record.frames
    ]  # fmt: skip
    status = messages.Status(
        "run", "made up", 11, record.stamp_ns, "lockstep", "running", 60.0, 12.5,
        (messages.RobotStatus("robot1", "running", "GO", "robot1", False, 0, None),),
    )  # fmt: skip
    every: dict[str, list[msgspec.Struct]] = {
        "frame": list(frames),
        "command": list(record.commands),
        "event": [
            messages.Event(3, 4, "fault", "robot1", "kill", fault="kill", number=2),
            messages.Event(3, 4, "start"),
        ],
        "status": [status],
        "scenario": [messages.ScenarioRequest("robot1")],
        "control": [
            messages.ControlRequest("fault", "kill:robot1"),
            messages.ControlRequest("stop"),
        ],
        "process": [messages.ProcessRequest("robot1", "start", 2)],
        "reply": [messages.Reply(True, "yes", b"\x80")],
    }
    return {name: [messages.encode(one) for one in rows] for name, rows in every.items()}


def arrays(tree: Any) -> Iterator[messages.Array]:
    """Every array in a message."""
    if isinstance(tree, messages.Array):
        yield tree
    elif isinstance(tree, msgspec.Struct):
        for name in tree.__struct_fields__:
            yield from arrays(getattr(tree, name))
    elif isinstance(tree, tuple):
        for one in tree:
            yield from arrays(one)


def decode(row: messages.Topic | messages.Query, payload: bytes) -> Any:
    return messages.decode_reply(payload) if row.name == "reply" else messages.decode(row, payload)


def payload_of(draw: random.Random, good: dict[str, list[bytes]], name: str) -> bytes:
    choice = draw.randrange(10)
    if choice == 0:
        return draw.randbytes(draw.choice((0, 1, 5, 100, 5000)))
    if choice == 1:  # of another topic
        return draw.choice(good[draw.choice(list(good))])
    if choice == 2:
        kinds = (
            b"\x91",
            b"\x81\xa0",
            b"\xdc\xff\xff",
            b"\xdd\xff\xff\xff\xff",
            b"\xc6\x7f\xff\xff\xff",
        )
        return draw.choice(kinds) * draw.choice((1, 1000, 200_000))
    payload = draw.choice(good[name])
    if choice < 7:
        return mutations.altered_message(draw, payload)
    return mutations.damaged(draw, payload, draw.choice(good[draw.choice(list(good))]))


def test_every_topic_and_query_has_a_good_payload(good: dict[str, list[bytes]]) -> None:
    for row in (*ROWS, REPLY):
        for payload in good[row.name]:
            assert isinstance(decode(row, payload), row.type)


def test_payloads_are_refused_with_a_reason_or_are_messages(
    campaign: Campaign, good: dict[str, list[bytes]]
) -> None:
    draw = campaign.draw
    accepted = 0
    for number in range(CASES):
        row = draw.choice((*ROWS, REPLY))
        payload = payload_of(draw, good, row.name)
        with campaign.case(number, row.name, payload):
            message, refusal = attempt(row, payload)
            if message is None:
                assert refusal.startswith(f"{row.name}: ")
                assert len(refusal) > len(row.name) + 10
                continue
            accepted += 1
            # What was taken for a message can be used and sent on.
            for array in arrays(message):
                assert array.numpy().size * array.numpy().itemsize == len(array.data)
            sent = messages.encode(message)
            assert messages.encode(decode(row, sent)) == sent
    assert accepted > CASES // 200  # or the damage is so coarse that nothing is tested


def attempt(row: messages.Topic | messages.Query, payload: bytes) -> tuple[Any, str]:
    """(message, "") or (None, why not)."""
    try:
        return decode(row, payload), ""
    except errors.MessageError as error:
        return None, str(error)
