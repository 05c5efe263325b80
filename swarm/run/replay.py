"""Every robot again: recorded frames through `robot.step`, compared with the recorded commands.

A robot's step is pure, so on the same machine and lock file every command comes out equal to the
bit. The world's truth of each tick, joined with the commands computed anew, gives a state hash of
its own, which must be that of the run.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from agents import robot
from swarm import errors, metrics, recording, scenario
from swarm.messages import Beacon, Command, SensorFrame, TickRecord
from swarm.scenario import RobotSetup, Scenario
from world import simulation

FRAMES_KEPT = 1000  # ticks; in real time a command names an older frame, never one so old


class Difference(msgspec.Struct, frozen=True):
    """The first place where a replayed robot did something else."""

    tick: int
    robot: str
    field: str
    recorded: str
    replayed: str


class Replay(msgspec.Struct, frozen=True):
    """What a replay found."""

    ok: bool
    ticks: int
    commands: int
    state_hash: str | None  # of the replayed commands; None in real time or for one robot only
    recorded_hash: str | None
    difference: Difference | None
    cut: bool  # the recording ends in the middle
    missing: str | None  # where it has a hole; nothing behind it can be replayed


class _Player(msgspec.Struct):
    """One robot being replayed."""

    setup: RobotSetup
    state: robot.State
    frames: dict[int, SensorFrame] = {}


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
        name: _Player(plan.setup(name), robot.init(plan.setup(name)), {})
        for name in names
        if only in (None, name)
    }
    recorded, replayed = metrics.begin(plan), metrics.begin(plan)
    ticks = commands = 0
    difference = None
    missing = None
    for record, frames in _with_frames(plan, source.ticks):
        if record.tick != ticks:
            missing = f"expected tick {ticks}, got {record.tick}: replayed up to the hole"
            break
        for frame in frames:
            if frame.robot in players:
                player = players[frame.robot]
                player.frames[frame.tick] = frame
                player.frames.pop(frame.tick - FRAMES_KEPT, None)
        answers: dict[str, tuple[Command, Command]] = {}
        for command in record.commands:
            if command.robot in players:
                answer = _answer(players[command.robot], command)
                answers[command.robot] = command, answer
                commands += 1
                if difference is None and answer != command:
                    difference = _difference(record.tick, command, answer)
        ticks += 1
        if only is None and plan.clock.mode == "lockstep":
            metrics.observe(recorded, record)
            metrics.observe(replayed, _with_answers(record, names, answers))
    hashes: list[str | None] = [None, None]
    if only is None and plan.clock.mode == "lockstep":
        hashes = [score.hash.hexdigest() for score in (recorded, replayed)]
    return Replay(
        ok=difference is None and hashes[0] == hashes[1] and ticks > 0 and missing is None,
        ticks=ticks,
        commands=commands,
        state_hash=hashes[1],
        recorded_hash=hashes[0],
        difference=difference,
        cut=source.cut,
        missing=missing,
    )


def _with_frames(
    plan: Scenario, ticks: Iterator[TickRecord]
) -> Iterator[tuple[TickRecord, list[SensorFrame]]]:
    """Each tick with its frames as they were sent, beacons and all."""
    beacons: dict[tuple[int, int], Beacon] = {}
    rows = {row.name: number for number, row in enumerate(plan.robots)}
    for expected, record in enumerate(ticks):
        if record.tick != expected:  # what was heard in it may have been said in what is missing
            yield record, []
            return
        try:
            frames = [
                simulation.frame_of(plan, frame, record.tick, record.stamp_ns, beacons)
                for frame in record.frames
            ]
        except KeyError as error:
            raise errors.RecordingError(
                f"tick {record.tick}: expected beacons that were recorded before, "
                f"got one of (row, tick) {error} that was not"
            ) from error
        for command in record.commands:
            beacons[(rows[command.robot], command.beacon.tick)] = command.beacon
        yield record, frames


def _answer(player: _Player, command: Command) -> Command:
    """The robot's command to the frame that the recorded one names."""
    frame = player.frames.get(command.tick)
    if frame is None:
        raise errors.RecordingError(
            f"tick {command.tick}: expected the frame that {command.robot} answered, got none"
        )
    player.state, answer = robot.step(player.setup, player.state, frame)
    return answer


def _with_answers(
    record: TickRecord, names: list[str], answers: dict[str, tuple[Command, Command]]
) -> TickRecord:
    """The record with what was answered anew wherever the recorded command had its way.

    A command that came too late, or from a robot that was dead by then, had not.
    """
    robots = list(record.robots)
    for name, (command, answer) in answers.items():
        row = names.index(name)
        truth = robots[row]
        robots[row] = msgspec.structs.replace(
            truth,
            applied=answer.set_point if truth.applied == command.set_point else truth.applied,
            beacon=answer.beacon if truth.beacon == command.beacon else truth.beacon,
        )
    commands = tuple(answer for _, answer in answers.values())
    return msgspec.structs.replace(record, robots=tuple(robots), commands=commands)


def _difference(tick: int, recorded: Command, replayed: Command) -> Difference:
    field, one, other = _first_difference("command", recorded, replayed)
    return Difference(tick, recorded.robot, field, repr(one)[:200], repr(other)[:200])


def _first_difference(path: str, one: Any, other: Any) -> tuple[str, Any, Any]:
    if isinstance(one, msgspec.Struct) and type(one) is type(other):
        for name in one.__struct_fields__:
            if getattr(one, name) != getattr(other, name):
                return _first_difference(f"{path}.{name}", getattr(one, name), getattr(other, name))
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        for number, (left, right) in enumerate(zip(one, other, strict=True)):
            if left != right:
                return _first_difference(f"{path}[{number}]", left, right)
    return path, one, other
