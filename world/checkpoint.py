"""All that a world must know to go on where another one was killed.

    Checkpoint --encode--> bytes beside the recording --decode--> Checkpoint

A checkpoint is the moment of one tick between its faults and its frames. What adds up over a run is
not in it: that is made again from the recording, which is whole up to the tick before.
"""

from __future__ import annotations

import msgspec

from swarm import errors
from swarm.faults import Fault
from swarm.messages import Event, Goal
from world.roster import Member
from world.simulation import WorldState

FILE_NAME = "checkpoint.msgpack"
KILLS_NAME = "kills.txt"  # a line for each fault that has killed a world of the run
HANDLING_NAME = "handling.json"
BYTES_MAX = 256 << 20


class Handling(msgspec.Struct, frozen=True):
    """How people have set a run going; kept when they change it, whatever the tick."""

    rate: float  # x real time
    paused: bool = False  # now, or after the ticks of a step
    selected: str = ""  # robot whose surroundings the picture shows; "": of the leader


class Order(msgspec.Struct, frozen=True, array_like=True):
    """A new goal on its way to a robot."""

    goal: Goal
    sent_tick: int = -1  # of the first frame that had it; -1: none yet


class Checkpoint(msgspec.Struct, frozen=True, kw_only=True):
    """Between the faults and the frames of `state.tick`."""

    run: str
    state: WorldState
    members: dict[str, Member]
    faults: tuple[Fault, ...]  # the scenario's, then those that came while it ran
    struck: tuple[int, ...]  # numbers of those that are done, or at work
    events: tuple[Event, ...]  # of this tick, not recorded yet
    commands_total: int
    wall_time_s: float
    goals: dict[str, Order] = {}


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(Checkpoint)


def encode(checkpoint: Checkpoint) -> bytes:
    """Its bytes."""
    return _encoder.encode(checkpoint)


def decode(data: bytes, where: str) -> Checkpoint:
    """Checkpoint of bytes; raises RecordingError when they are none."""
    try:
        return _decoder.decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise errors.RecordingError(f"{where}: expected a checkpoint, got: {error}") from error
