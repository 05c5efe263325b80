"""What a file of ours looks like to MCAP: its profile, compression and channels.

The only module that imports mcap; salvage reads without it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import IO

import msgspec
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from swarm import messages
from swarm.messages import TickRecord
from swarm.source import PROFILE, TICK_TOPIC

__all__ = ["Channel", "McapWriter", "register", "register_tick", "schema_text", "start"]

# Ticks of runs with 6 / 100 robots and 216 beams, 12 / 201 kB: lz4 makes 3.3 / 53 kB of them, zstd
# 2.7 / 36 kB in 3 / 2 times the time (51 / 730 us against 16 / 350). Time is what a tick lacks.
COMPRESSION = CompressionType.LZ4
TICK_SCHEMA_NAME = "swarm.messages.TickRecord"


class Channel(msgspec.Struct, frozen=True):
    """One more stream for viewers, derived from each tick; None is nothing at this tick."""

    topic: str
    schema_name: str
    schema_encoding: str
    schema_data: bytes
    message_encoding: str
    encode: Callable[[TickRecord], bytes | None]


def start(file: IO[bytes]) -> McapWriter:
    """A file of ours, its header written."""
    writer = McapWriter(file, compression=COMPRESSION, enable_data_crcs=True)
    writer.start(profile=PROFILE)
    return writer


def register_tick(writer: McapWriter) -> int:
    """Id of the tick channel, which comes first."""
    schema = writer.register_schema(TICK_SCHEMA_NAME, "text", schema_text().encode())
    return writer.register_channel(TICK_TOPIC, "msgpack", schema)


def register(writer: McapWriter, channel: Channel) -> int:
    """Id of a viewer's channel."""
    schema = writer.register_schema(
        channel.schema_name, channel.schema_encoding, channel.schema_data
    )
    return writer.register_channel(channel.topic, channel.message_encoding, schema)


def schema_text() -> str:
    """How to read a tick without this program: every struct is a msgpack array of these fields."""
    lines: list[str] = []
    names = ["TickRecord"]
    for name in names:  # grows while it is read
        struct = getattr(messages, name)
        fields = [f"{field}: {struct.__annotations__[field]}" for field in struct.__struct_fields__]
        lines.append(f"{name} = [{', '.join(fields)}]")
        for found in re.findall(r"\b[A-Z]\w+", lines[-1]):
            kind = getattr(messages, found, None)
            if isinstance(kind, type) and issubclass(kind, msgspec.Struct) and found not in names:
                names.append(found)
    return "\n".join(lines)
