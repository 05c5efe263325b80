"""Every robot again: recorded frames through `robot.step`, compared with the recorded commands.

    TickRecord --frames, beacons--> SensorFrame --robot.step--> Command == the recorded one?
               --robot-started----> begin again from robot.init

A robot's step is pure, so on the same machine and lock file every command comes out equal to the
bit. The world's truth of each tick, joined with the commands computed anew, gives a state hash of
its own, which must be that of the run.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Sequence
from math import ceil
from pathlib import Path
from typing import Any

import msgspec

from agents import robot
from swarm import compare, errors, metrics, recording, scenario
from swarm.messages import Beacon, Command, SensorFrame, TickRecord
from swarm.scenario import RobotSetup, Scenario
from world import simulation

# A command may be 5 s late by a fault, a beacon in it another 5 s, and a hung robot 2 s behind.
HISTORY_S = 12.0
HISTORY_TICKS_MIN = 64
UNHEARD_MAX = 4  # of so many answers that nobody heard every choice is tried


class Difference(msgspec.Struct, frozen=True):
    """The first place where a replayed robot did something else."""

    tick: int  # of the frame
    robot: str
    field: str
    recorded: str
    replayed: str


class Replay(msgspec.Struct, frozen=True):
    """What a replay found."""

    ok: bool
    ticks: int
    commands: int
    restarts: int  # robots that began again
    unheard: int  # answers that the robots must have given, though the world got none
    state_hash: str | None  # of the replayed commands; None in real time or for one robot only
    recorded_hash: str | None
    difference: Difference | None
    cut: bool  # the recording ends in the middle
    missing: str | None  # where it has a hole; nothing behind it can be replayed


class _Life(msgspec.Struct):
    """One robot from one start to the next."""

    state: robot.State
    frames: dict[int, SensorFrame] = {}  # not yet answered, by tick, rising


class _Player(msgspec.Struct):
    """One robot being replayed; a slow one may still be heard from its life before."""

    setup: RobotSetup
    lives: dict[int, _Life]  # by incarnation, rising


class _HoleError(Exception):
    """The recording does not hold what is needed to go on; says what."""


def replay(path: Path, only: str | None = None) -> Replay:
    """Replay a recording, or one robot of it.

    Raises RecordingError when it cannot be read, UsageError when `only` is not in it.
    """
    source = recording.read(path)
    plan = scenario.decode(source.scenario_toml, f"{path}: {recording.SCENARIO_NAME}")
    names = [row.name for row in plan.robots]
    if only is not None and only not in names:
        raise errors.UsageError(f"--robot: expected one of {', '.join(names)}, got '{only}'")
    players = {
        name: _Player(plan.setup(name), {0: _Life(robot.init(plan.setup(name)), {})})
        for name in names
        if only in (None, name)
    }
    hashed = only is None and plan.clock.mode == "lockstep"
    recorded, replayed = metrics.begin(plan), metrics.begin(plan)
    history = history_ticks(plan)
    beacons = Beacons(len(names), history)
    ticks = commands = restarts = unheard = 0
    difference: Difference | None = None
    missing: str | None = None
    for record in source.ticks:
        try:
            _check(plan, record, ticks)
            restarts += _begin_again(players, record)
            for frame in frames_of(plan, record, beacons):
                if frame.robot in players:
                    _keep(players[frame.robot], frame, history)
            answers: list[tuple[Command, Command]] = []
            for command in record.commands:
                if command.robot in players:
                    answer, more = _answer(players[command.robot], command)
                    answers.append((command, answer))
                    unheard += more
        except _HoleError as hole:
            missing = f"tick {record.tick}: {hole}: replayed up to there"
            break
        beacons.hear(record, names)
        commands += len(answers)
        if difference is None:
            difference = next(filter(None, (_difference(*pair) for pair in answers)), None)
        ticks += 1
        if hashed:
            metrics.observe(recorded, record)
            metrics.observe(replayed, _with_answers(record, names, answers))
    hashes = [score.hash.hexdigest() if hashed else None for score in (recorded, replayed)]
    return Replay(
        ok=difference is None and hashes[0] == hashes[1] and ticks > 0 and missing is None,
        ticks=ticks,
        commands=commands,
        restarts=restarts,
        unheard=unheard,
        state_hash=hashes[1],
        recorded_hash=hashes[0],
        difference=difference,
        cut=source.cut,
        missing=missing,
    )


def _check(plan: Scenario, record: TickRecord, expected: int) -> None:
    """Raise _HoleError when a tick is missing, or cannot be of this scenario."""
    if record.tick != expected:
        raise _HoleError(f"expected tick {expected}, got {record.tick}")
    if problem := misfit(plan, record):
        raise _HoleError(problem)


def misfit(plan: Scenario, record: TickRecord) -> str:
    """Why a record cannot be of a scenario, as "expected ..., got ..."; empty when it can."""
    rows = len(plan.robots)
    names = {one.name for one in plan.robots}
    if len(record.robots) != rows:
        return f"expected {rows} robots, got {len(record.robots)}"
    for frame in record.frames:
        if not 0 <= frame.row < rows or frame.ranges.shape != (plan.sensor.beams,):
            beams = plan.sensor.beams
            return (
                f"expected frames of {rows} robots with {beams} beams, "
                f"got row {frame.row} with {frame.ranges.shape}"
            )
    for command in record.commands:
        if command.robot not in names:
            return f"expected commands of this scenario's robots, got one of '{command.robot}'"
    return ""


# --- what a robot got ---------------------------------------------------------------------------


def history_ticks(plan: Scenario) -> int:
    """How long a frame may go unanswered and a beacon unheard."""
    return max(HISTORY_TICKS_MIN, ceil(HISTORY_S / plan.dt_s))


class Beacons:
    """What was said lately, by (row of the speaker, tick of the beacon)."""

    def __init__(self, rows: int, history_ticks: int) -> None:
        self._history_ticks = history_ticks
        # By row: tick of the beacon -> when it was heard first, and the beacon.
        self._said: list[dict[int, tuple[int, Beacon]]] = [{} for _ in range(rows)]

    def __getitem__(self, key: tuple[int, int]) -> Beacon:
        return self._said[key[0]][key[1]][1]

    def hear(self, record: TickRecord, names: Sequence[str]) -> None:
        """Remember a tick's beacons; forget old ones, but not the newest two of anybody."""
        rows = {name: row for row, name in enumerate(names)}
        for command in record.commands:
            said = self._said[rows[command.robot]]
            said[command.beacon.tick] = (record.tick, command.beacon)
            while len(said) > 2:
                oldest = next(iter(said))
                if said[oldest][0] >= record.tick - self._history_ticks:
                    break
                del said[oldest]


def frames_of(plan: Scenario, record: TickRecord, beacons: Beacons) -> Iterator[SensorFrame]:
    """Frames of a tick as they were sent, beacons and all; without those nobody could decode."""
    for frame in record.frames:
        pairs = [(row, tick) for row, tick in frame.heard.numpy().tolist()]
        try:
            heard = {pair: beacons[pair] for pair in pairs}
        except LookupError as error:
            raise _HoleError(
                f"expected a beacon that was recorded before, got (row, tick) {error} of none"
            ) from error
        try:
            yield simulation.frame_of(plan, frame, record.tick, record.stamp_ns, heard)
        except ValueError:  # no robot could decode it either
            continue


def _begin_again(players: dict[str, _Player], record: TickRecord) -> int:
    """New lives for robots that were started again in this tick; how many."""
    begun = 0
    for event in record.events:
        if event.kind == "robot-started" and event.incarnation > 0 and event.robot in players:
            player = players[event.robot]
            state = robot.init(player.setup, event.incarnation)
            *_, newest = player.lives
            player.lives = {newest: player.lives[newest], event.incarnation: _Life(state, {})}
            begun += 1
    return begun


def _keep(player: _Player, frame: SensorFrame, history: int) -> None:
    *_, life = player.lives.values()
    life.frames[frame.tick] = frame
    if len(life.frames) > history:
        del life.frames[next(iter(life.frames))]


# --- what it made of it -------------------------------------------------------------------------


def _answer(player: _Player, command: Command) -> tuple[Command, int]:
    """The robot's command to the frame that the recorded one names, and how many went unheard.

    An answer may be lost between robot and world, as when one of them was stopped or killed just
    then. The robot has gone on from it all the same, so when the command does not come out it is
    tried with the frames in between, which nobody is known to have answered.
    """
    life = player.lives.get(command.beacon.incarnation)
    if life is None:
        raise _HoleError(
            f"expected that {command.robot} had been started as incarnation "
            f"{command.beacon.incarnation}, got no such event"
        )
    frame = life.frames.get(command.tick)
    if frame is None:
        raise _HoleError(f"expected frame {command.tick}, which {command.robot} answered, got none")
    between = [kept for tick, kept in life.frames.items() if tick < command.tick]
    first: tuple[robot.State, Command] | None = None
    found: tuple[robot.State, Command] | None = None
    unheard = 0
    for taken in _choices(between):
        state = life.state
        for kept in taken:
            state, _ = robot.step(player.setup, state, kept)
        found = robot.step(player.setup, state, frame)
        first = first or found
        if _equal(found[1], command):
            unheard = len(taken)
            break
    else:
        found = first
    assert found is not None
    life.state, answer = found
    for tick in [tick for tick in life.frames if tick <= command.tick]:
        del life.frames[tick]
    return answer, unheard


def _choices(frames: list[SensorFrame]) -> Iterator[Sequence[SensorFrame]]:
    """Which of the frames a robot may have answered: none, all, then the rest."""
    yield ()
    if frames:
        yield frames
    if len(frames) <= UNHEARD_MAX:
        for count in range(len(frames) - 1, 0, -1):
            yield from itertools.combinations(frames, count)


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(Command)


def _equal(one: Command, other: Command) -> bool:
    return _encoder.encode(one) == _encoder.encode(other) or not any(_differing(one, other))


def _differing(replayed: Command, recorded: Command) -> Iterator[compare.Difference]:
    """Differences after both have been through the same wire form."""
    with contextlib.suppress(msgspec.DecodeError):  # then it is none, and is shown as it is
        replayed = _decoder.decode(_encoder.encode(replayed))
    yield from compare.differences(recorded, replayed, "command")


def _difference(recorded: Command, replayed: Command) -> Difference | None:
    if _encoder.encode(recorded) == _encoder.encode(replayed):
        return None
    for found in _differing(replayed, recorded):
        return Difference(
            recorded.tick, recorded.robot, found.field, _text(found.one), _text(found.other)
        )
    return None


def _text(value: Any) -> str:
    return repr(value)[:200]


def _with_answers(
    record: TickRecord, names: list[str], answers: Sequence[tuple[Command, Command]]
) -> TickRecord:
    """The record as it would be with the replayed commands, where the recorded are in force."""
    robots = list(record.robots)
    for recorded, replayed in answers:
        row = names.index(recorded.robot)
        truth = robots[row]
        if truth.beacon is not None and truth.beacon == recorded.beacon:
            robots[row] = truth = msgspec.structs.replace(truth, beacon=replayed.beacon)
        if truth.applied == recorded.set_point:
            robots[row] = msgspec.structs.replace(truth, applied=replayed.set_point)
    commands = tuple(replayed for _, replayed in answers)
    return msgspec.structs.replace(record, robots=tuple(robots), commands=commands)
