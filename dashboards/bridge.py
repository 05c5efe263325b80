"""A live WebSocket for Foxglove: the channels of the recording, served on loopback.

The server keeps a bounded backlog for each client and drops the oldest, so a client that stalls
or dies never holds up the world.
"""

from __future__ import annotations

from collections.abc import Sequence

import foxglove

from dashboards.live import HOST
from swarm.messages import TickRecord
from swarm.recording import Channel

BACKLOG_MESSAGES = 256  # for each client; beyond it the oldest are dropped


class Bridge:
    """Serves a run to Foxglove clients on `port`; raises RuntimeError when it is taken."""

    def __init__(self, run: str, channels: Sequence[Channel], port: int) -> None:
        context = self._context = foxglove.Context()  # channels close with it
        self._server = foxglove.start_server(
            name=run,
            host=HOST,
            port=port,
            context=context,
            message_backlog_size=BACKLOG_MESSAGES,
        )
        self._channels = [
            (
                channel,
                foxglove.Channel(
                    channel.topic,
                    message_encoding=channel.message_encoding,
                    schema=foxglove.Schema(
                        name=channel.schema_name,
                        encoding=channel.schema_encoding,
                        data=channel.schema_data,
                    ),
                    context=context,
                ),
            )
            for channel in channels
        ]

    def observe(self, record: TickRecord) -> None:
        """Sends one tick to whoever listens."""
        for channel, outlet in self._channels:
            payload = channel.encode(record)
            if payload is not None:
                outlet.log(payload, log_time=record.stamp_ns)

    def close(self) -> None:
        """Ends all connections."""
        self._server.stop()


def address(port: int) -> str:
    """What to open in Foxglove."""
    return f"ws://{HOST}:{port}"
