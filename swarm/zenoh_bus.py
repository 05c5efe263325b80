"""The bus between processes: the only module that imports zenoh.

    open_router(run, endpoint)      the world: Zenoh router inside, bound where it is told
    open_client(run, endpoint)      robots, supervisor, command line

Data is pulled from one FIFO channel by the thread that calls `receive` (callbacks cost 8 times as
much a message); what must interrupt that wait (a deadline, a token that came or went, `wake`) is
a put of our own to a key of the same channel, which never leaves the session. Frames and commands
are BLOCK (DROP loses 41 % of a burst), express stays off, shared memory is off because it passes
by the size limit, and a stalled peer can hold a sender for at most 1 s.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import zenoh

from swarm import errors, messages
from swarm.bus import Delivery, Handler
from swarm.messages import Query, Reply, Topic

# one worker thread does everything; only for leaves, it deadlocks a node that forwards
LEAF_RUNTIME = (
    "(rx:(handover:app),tx:(handover:app),acc:(handover:app),net:(handover:app),"
    "app:(worker_threads:1))"
)
LEASE_MS = 500  # a silent link is given up after this; 100 gives false alarms under load
QUEUE_MAX = 4096  # messages; at the bound a BLOCK sender waits, so nothing is lost
CONNECT_TIMEOUT_S = 20.0
TOKEN_TIMEOUT_S = 0.5
DEADLINE_RESOLUTION_S = 0.2  # how late a deadline of `receive` may be noticed
MESSAGE_BYTES_MAX = max(topic.size_max for topic in messages.TOPICS.values()) + 4096


def open_router(run: str, endpoint: str, *, tls: Path | None = None) -> ZenohBus:
    """Bus of the world, listening on `endpoint`.

    Raises BusError when the port is taken, UsageError when endpoint and `tls` do not fit.
    """
    config = _config("router", "listen", endpoint, tls, "world")
    return ZenohBus(run, _open(config, f"listen on {endpoint}"))


def open_client(
    run: str,
    endpoint: str,
    *,
    name: str,
    tls: Path | None = None,
    leaf: bool = False,
    connect_timeout_s: float = CONNECT_TIMEOUT_S,
) -> ZenohBus:
    """Bus of everyone else; waits for the router up to `connect_timeout_s`, else BusError.

    Raises UsageError when endpoint and `tls` do not fit.
    """
    if leaf:
        os.environ["ZENOH_RUNTIME"] = LEAF_RUNTIME  # read by zenoh at its first use
    config = _config("client", "connect", endpoint, tls, name)
    config.insert_json5("connect/timeout_ms", str(round(connect_timeout_s * 1000)))
    config.insert_json5(
        "connect/retry",
        json.dumps({"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5}),
    )
    return ZenohBus(run, _open(config, f"reach the router at {endpoint}"))


def _config(mode: str, end: str, endpoint: str, tls: Path | None, name: str) -> zenoh.Config:
    if endpoint.startswith("tls/") != (tls is not None):  # never in clear what was to be encrypted
        raise errors.UsageError(
            f"expected an endpoint tls/HOST:PORT with --tls and only with it, got '{endpoint}' "
            f"{'without' if tls is None else 'with'} it"
        )
    config = zenoh.Config()
    try:
        config.insert_json5(f"{end}/endpoints", json.dumps([endpoint]))
    except zenoh.ZError as error:
        raise errors.UsageError(
            f"expected an endpoint such as tcp/127.0.0.1:7447, got '{endpoint}'"
        ) from error
    for key, value in {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # a router waits 0.5 s otherwise, for nobody
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/rx/max_message_size": MESSAGE_BYTES_MAX,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
    }.items():
        config.insert_json5(key, json.dumps(value))
    if tls is not None:
        paths = {
            f"{end}_certificate": tls / f"{name}.pem",
            f"{end}_private_key": tls / f"{name}.key",
            "root_ca_certificate": tls / "ca.pem",
        }
        for path in paths.values():
            if not os.access(path, os.R_OK):  # zenoh would only say that nobody answers
                raise errors.UsageError(f"--tls: expected a file that can be read, got {path}")
        files = {key: str(path) for key, path in paths.items()}
        config.insert_json5("transport/link/tls", json.dumps({**files, "enable_mtls": True}))
    return config


def _open(config: zenoh.Config, purpose: str) -> zenoh.Session:
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise errors.BusError(f"expected to {purpose}, got: {_first_line(error)}") from error


def _first_line(error: BaseException) -> str:
    """Zenoh's own words without the paths of its source files."""
    return str(error).splitlines()[0].split(" at /")[0] or type(error).__name__


class ZenohBus:
    """A Bus over one Zenoh session, for one receiving thread."""

    def __init__(self, run: str, session: zenoh.Session) -> None:
        self.run = run
        self._session = session
        self._publishers: dict[tuple[str, str], zenoh.Publisher] = {}
        self._channels: list[_Channel] = []
        self._kept: list[Any] = []  # tokens and queryables live as long as they are referenced
        self._rejected: dict[str, int] = {}
        self._closed = False
        self._waker = _Waker(self)
        self._alive: frozenset[tuple[str, str]] = frozenset()
        self._kept.append(
            session.liveliness().declare_subscriber(
                messages.alive_key(run), self._on_liveliness, history=True
            )
        )

    # --- data ---

    def publish(self, topic: Topic, message: msgspec.Struct, robot: str = "") -> None:
        """Encode and put."""
        self.publish_raw(topic, messages.encode(message), robot)

    def publish_raw(self, topic: Topic, payload: bytes, robot: str = "") -> None:
        """Put; declares the publisher at the first use."""
        publisher = self._publishers.get((topic.name, robot))
        if publisher is None:
            publisher = self._publishers[(topic.name, robot)] = self._session.declare_publisher(
                messages.key(topic, self.run, robot),
                congestion_control=zenoh.CongestionControl.BLOCK
                if topic.delivery == "block"
                else zenoh.CongestionControl.DROP,
            )
        try:
            publisher.put(payload)
        except zenoh.ZError as error:
            raise errors.BusError(f"the bus is closed: {_first_line(error)}") from error

    def subscribe(self, topic: Topic, robot: str = "*", *, newest: bool = False) -> None:
        """Receive a topic through a channel of its own."""
        key = messages.key(topic, self.run, robot)
        fifo = self._session.declare_subscriber(key, zenoh.handlers.FifoChannel(QUEUE_MAX))
        self._channels.append(_Channel(topic, robot, newest, fifo))
        if len(self._channels) == 1:
            self._waker.start(key.replace("*", "~"))

    def receive(self, timeout_s: float) -> Delivery | None:
        """Next message of any subscribed topic; blocks on the first one subscribed."""
        while True:
            found = self._take() or (self._wait(timeout_s) if timeout_s > 0.0 else None)
            if found is None:
                return None
            channel, sample = found
            if self._waker.is_mine(sample):
                return None
            if channel.newest:
                sample = self._newest(channel, sample)
            payload = sample.payload.to_bytes()
            try:
                message = messages.decode(channel.topic, payload)
                self._require_own_key(channel, message, sample)
                return Delivery(channel.topic, message)
            except errors.MessageError as error:
                self._reject(str(error))

    def _take(self) -> tuple[_Channel, zenoh.Sample] | None:
        try:
            for channel in self._channels:
                if (sample := channel.fifo.try_recv()) is not None:
                    return channel, sample
        except zenoh.ZError as error:
            raise errors.BusError(f"the bus is closed: {_first_line(error)}") from error
        return None

    def _wait(self, timeout_s: float) -> tuple[_Channel, zenoh.Sample] | None:
        if not self._channels:
            self._waker.wait(timeout_s)
            return None
        self._waker.arm(timeout_s)
        try:
            return self._channels[0], self._channels[0].fifo.recv()
        except zenoh.ZError as error:
            raise errors.BusError(f"the bus is closed: {_first_line(error)}") from error
        finally:
            self._waker.disarm()

    def _newest(self, channel: _Channel, sample: zenoh.Sample) -> zenoh.Sample:
        # not a ring channel: in a ring our own wake-up would push the newest frame out
        while (later := channel.fifo.try_recv()) is not None:
            if not self._waker.is_mine(later):
                sample = later
        return sample

    def _require_own_key(self, channel: _Channel, message: Any, sample: zenoh.Sample) -> None:
        """Raise MessageError when a message names another robot than its key does."""
        topic = channel.topic
        if "{robot}" not in topic.key:
            return
        if channel.robot != "*":  # zenoh delivers this key alone
            if message.robot != channel.robot:
                raise errors.MessageError(f"{topic.name}: foreign: named '{message.robot}'")
            return
        key = messages.key(topic, self.run, message.robot)
        if str(sample.key_expr) != key:
            raise errors.MessageError(f"{topic.name}: foreign: named '{message.robot}'")

    def _reject(self, reason: str) -> None:
        if len(self._rejected) < 100 or reason in self._rejected:
            self._rejected[reason] = self._rejected.get(reason, 0) + 1
        else:
            self._rejected["others"] = self._rejected.get("others", 0) + 1

    def wake(self) -> None:
        """Let `receive` return None."""
        self._waker.wake()

    # --- who is alive ---

    def announce(self, role: str, name: str) -> None:
        """Declare a token after everything else: who sees it can already be reached."""
        self._kept.append(
            self._session.liveliness().declare_token(messages.alive_key(self.run, role, name))
        )

    def alive(self) -> frozenset[tuple[str, str]]:
        """Tokens at this moment; empty while the router is out of reach."""
        return self._alive

    def _on_liveliness(self, sample: zenoh.Sample) -> None:
        who = messages.parse_alive_key(str(sample.key_expr))
        if who is None:
            return
        if sample.kind == zenoh.SampleKind.PUT or self._is_declared(str(sample.key_expr)):
            self._alive = self._alive | {who}
        else:
            self._alive = self._alive - {who}
        self.wake()

    def _is_declared(self, key: str) -> bool:
        """Ask for a token that is said to be gone: after a reconnection its owner's new one may
        have been announced before the loss of the old one.
        """
        try:
            replies = self._session.liveliness().get(key, timeout=TOKEN_TIMEOUT_S)
            return any(reply.ok is not None for reply in replies)
        except zenoh.ZError:
            return False

    # --- queries ---

    def serve(self, query: Query, handler: Handler) -> None:
        """Answer on a thread of zenoh's; a request that does not decode is told why."""

        def answer(request: zenoh.Query) -> None:
            with request:
                try:
                    payload = request.payload.to_bytes() if request.payload is not None else b""
                    reply = handler(messages.decode(query, payload))
                except errors.MessageError as error:
                    self._reject(str(error))
                    reply = Reply(False, str(error))
                request.reply(messages.key(query, self.run), messages.encode(reply))

        key = messages.key(query, self.run)
        self._kept.append(self._session.declare_queryable(key, answer, complete=True))

    def ask(self, query: Query, request: msgspec.Struct, timeout_s: float) -> Reply:
        """Ask until somebody answers; raises BusError when nobody does in time."""
        deadline_s = time.monotonic() + timeout_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            try:
                replies = self._session.get(
                    messages.key(query, self.run),
                    payload=messages.encode(request),
                    timeout=max(left_s, 0.01),
                )
            except zenoh.ZError as error:
                raise errors.BusError(f"the bus is closed: {_first_line(error)}") from error
            for reply in replies:
                if reply.ok is not None:
                    return messages.decode_reply(reply.ok.payload.to_bytes())
            time.sleep(min(0.02, max(left_s, 0.0)))  # not declared yet: an empty answer is at once
        raise errors.BusError(
            f"query {query.name}: expected the {query.answered_by} to answer within "
            f"{timeout_s:g} s, got nothing"
        )

    def rejected(self) -> dict[str, int]:
        """Messages counted and ignored so far, by reason."""
        return dict(self._rejected)

    def close(self) -> None:
        """Close the session; a `receive` blocked in another thread raises BusError."""
        if not self._closed:
            self._closed = True
            self._waker.stop()
            self._session.close()  # type: ignore[no-untyped-call]


class _Channel(NamedTuple):
    topic: Topic
    robot: str  # * for all
    newest: bool
    fifo: Any  # zenoh.Subscriber with a FIFO channel


class _Waker:
    """Ends a blocking recv: the deadline's thread, or anyone, puts an empty message to us."""

    def __init__(self, bus: ZenohBus) -> None:
        self._bus = bus
        self._nonce = secrets.token_bytes(16)  # what others put on the key is not taken for ours
        self._publisher: zenoh.Publisher | None = None
        self._deadline_s: float | None = None
        self._stopped = threading.Event()
        self._woken = threading.Event()  # for a bus that subscribes to nothing

    def start(self, key: str) -> None:
        self._publisher = self._bus._session.declare_publisher(
            key, allowed_destination=zenoh.Locality.SESSION_LOCAL
        )
        threading.Thread(target=self._watch, name="deadline", daemon=True).start()

    def arm(self, timeout_s: float) -> None:
        self._deadline_s = time.monotonic() + timeout_s

    def disarm(self) -> None:
        self._deadline_s = None

    def wait(self, timeout_s: float) -> None:
        self._woken.wait(timeout_s)
        self._woken.clear()

    def wake(self) -> None:
        self._woken.set()
        if self._publisher is not None and not self._stopped.is_set():
            with contextlib.suppress(zenoh.ZError):  # closed meanwhile: recv has ended by itself
                self._publisher.put(b"", attachment=self._nonce)

    def is_mine(self, sample: zenoh.Sample) -> bool:
        return sample.attachment is not None and sample.attachment.to_bytes() == self._nonce

    def stop(self) -> None:
        self._stopped.set()

    def _watch(self) -> None:
        while not self._stopped.wait(DEADLINE_RESOLUTION_S):
            deadline_s = self._deadline_s
            if deadline_s is not None and time.monotonic() >= deadline_s:
                self._deadline_s = None
                self.wake()
