"""A client of Foxglove's WebSocket, of the standard library alone: HOST PORT.

Subscribes to every channel; prints a JSON line with topics and schemas, one when it has
subscribed, and one for each message: topic, stamp, size.
"""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
import sys
from typing import BinaryIO

TEXT, BINARY, PING = 1, 2, 9


def connect(host: str, port: int) -> tuple[socket.socket, BinaryIO]:
    connection = socket.create_connection((host, port))
    key = base64.b64encode(os.urandom(16)).decode()
    lines = [
        "GET / HTTP/1.1",
        f"Host: {host}:{port}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        f"Sec-WebSocket-Key: {key}",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Protocol: foxglove.sdk.v1",
    ]
    connection.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
    stream = connection.makefile("rb")
    while stream.readline().strip():
        pass
    return connection, stream


def receive(stream: BinaryIO) -> tuple[int, bytes]:
    """One frame; the server sends none in parts."""
    first, size = stream.read(2)
    if size == 126:
        (size,) = struct.unpack(">H", stream.read(2))
    elif size == 127:
        (size,) = struct.unpack(">Q", stream.read(8))
    return first & 0x0F, stream.read(size)


def send(connection: socket.socket, text: str) -> None:
    """One text frame, masked by zeros."""
    data = text.encode()
    head = struct.pack(">BBH", 0x80 | TEXT, 0x80 | 126, len(data))
    connection.sendall(head + bytes(4) + data)


def main(host: str, port: int) -> None:
    connection, stream = connect(host, port)
    topics: dict[int, str] = {}
    while True:
        kind, data = receive(stream)
        if kind == TEXT:
            message = json.loads(data)
            if message["op"] == "advertise":
                channels = message["channels"]
                print(
                    json.dumps(
                        [[c["topic"] for c in channels], [c["schemaName"] for c in channels]]
                    ),
                    flush=True,
                )
                topics = {channel["id"]: channel["topic"] for channel in channels}
                wanted = [{"id": number, "channelId": number} for number in topics]
                send(connection, json.dumps({"op": "subscribe", "subscriptions": wanted}))
                print(json.dumps(["subscribed"]), flush=True)
        elif kind == BINARY and data[0] == 1:
            number, stamp_ns = struct.unpack_from("<IQ", data, 1)
            print(json.dumps([topics[number], stamp_ns, len(data) - 13]), flush=True)


main(sys.argv[1], int(sys.argv[2]))
