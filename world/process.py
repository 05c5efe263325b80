"""The world as a process: router inside, recording and viewer inline, one conducted run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec

from swarm import errors, lifetime, log, messages, metrics, recording, runs, scenario, zenoh_bus
from swarm.bus import Bus
from swarm.messages import Status, TickRecord
from world import checkpoint, conductor

# Room that is kept for the summary: one robot takes 400 bytes of it, events of a long run the rest.
SUMMARY_BYTES = 65_536
SUMMARY_BYTES_PER_ROBOT = 1024
PORT_TAKEN = 75  # exit code, EX_TEMPFAIL: the supervisor tries another port


class Arguments(msgspec.Struct, frozen=True, kw_only=True):
    """What a world process needs to be told."""

    run: str
    name: str  # of the scenario
    scenario_toml: bytes  # resolved
    endpoint: str
    folder: Path
    external_router: bool = False
    tls: Path | None = None
    log: Path | None = None
    serve_port: int | None = None  # of the live Rerun server
    foxglove_port: int | None = None  # of the live Foxglove server
    segment: int = 0  # above 0: go on where a world was killed, in a recording of this number
    supervisor_pid: int | None = None


def main(arguments: Arguments) -> int:
    """Run one world; its summary lies in the folder afterwards."""
    stop = lifetime.Stop()
    lifetime.adopt("world", arguments.log, stop, arguments.supervisor_pid)
    try:
        bus = _open_bus(arguments)
    except errors.SwarmError as error:
        log.say("world", str(error), level="error")
        return PORT_TAKEN if "in use" in str(error) else error.exit_code
    lifetime.heed_signals(stop)
    try:
        summary = record_run(
            bus,
            arguments.name,
            arguments.scenario_toml,
            arguments.folder,
            stop,
            bus_name="zenoh",
            segment=arguments.segment,
            serve_port=arguments.serve_port,
            foxglove_port=arguments.foxglove_port,
            supervised=arguments.supervisor_pid is not None,
        )
    except errors.SwarmError as error:
        log.say("world", str(error), level="error")
        return error.exit_code
    finally:
        bus.close()
    log.say("world", f"{summary.outcome}: {stop.reason or 'ended'}")
    return 0


def _open_bus(arguments: Arguments) -> Bus:
    run, endpoint, tls = arguments.run, arguments.endpoint, arguments.tls
    if arguments.external_router:
        return zenoh_bus.open_client(run, endpoint, name="world", tls=tls)
    return zenoh_bus.open_router(run, endpoint, tls=tls)


def record_run(
    bus: Bus,
    name: str,
    scenario_toml: bytes,
    folder: Path,
    stop: lifetime.Stop,
    *,
    bus_name: str,
    segment: int = 0,
    serve_port: int | None = None,
    foxglove_port: int | None = None,
    supervised: bool = False,
    on_status: Callable[[Status], None] = lambda status: None,
) -> metrics.Summary:
    """Conduct a run, record it in `folder`, write its summary there and return it.

    A recording that fails never stops the run; the summary then says what was lost.
    Raises RecordingError when the recording cannot even be opened, or cannot be gone on with.

    Args:
        segment: above 0, go on from the checkpoint in `folder`, or from the beginning when the
            world was killed before it had made one.
    """
    plan = scenario.decode(scenario_toml, str(folder / runs.SCENARIO))
    room_bytes = SUMMARY_BYTES + SUMMARY_BYTES_PER_ROBOT * len(plan.robots)
    runs.hold_room(folder / runs.SUMMARY, room_bytes)
    from world.watchers import Watchers  # with Rerun, half a second that others need not wait

    watchers = Watchers(bus, plan, folder)
    kept = _kept(folder) if segment and plan.recording.mcap else None
    first_tick = 0 if kept is None else kept.state.tick
    watchers.open(scenario_toml, serve_port, foxglove_port, segment=segment, first_tick=first_tick)
    resumed = None
    if segment:
        score = metrics.begin(plan)
        for record in recording.ticks_before(folder / runs.MCAP, first_tick) if first_tick else ():
            metrics.observe(score, record)
            watchers.has(record)
        if score.tick != first_tick - 1:
            raise errors.RecordingError(
                f"{folder}: expected a recording that is whole up to tick {first_tick}, "
                f"got one up to {score.tick}; the run cannot go on"
            )
        resumed = conductor.Resumed(kept, score, _kills(folder), _handling(folder))
    observers = [watchers.observe]
    if bus_name != "memory":  # for the world's log, or for who started it by hand
        observers.append(_say_events)
    try:
        run = conductor.conduct(
            bus,
            plan,
            observers,
            stop,
            supervised=supervised,
            keeper=watchers,
            resumed=resumed,
            on_status=on_status,
        )
    finally:
        watchers.close()
    facts = metrics.Facts(
        scenario=name,
        run=bus.run,
        bus=bus_name,
        clock=plan.clock.mode,
        wall_time_s=run.wall_time_s,
        late_commands=run.late_commands,
        recording=watchers.kept(),
        restarts=run.restarts,
        world_restarts=segment,
    )
    summary = metrics.summary(run.score, facts)
    for name in (checkpoint.FILE_NAME, checkpoint.KILLS_NAME, checkpoint.HANDLING_NAME):
        (folder / name).unlink(missing_ok=True)
    text = msgspec.json.format(msgspec.json.encode(summary))
    if (problem := runs.write_whole(folder / runs.SUMMARY, text)) is not None:
        log.say("world", problem, level="error")
    return summary


def _kept(folder: Path) -> checkpoint.Checkpoint | None:
    """Newest checkpoint of the run in a folder, None when there is none."""
    path = folder / checkpoint.FILE_NAME
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise errors.RecordingError(f"{path}: {error.strerror}") from error
    return checkpoint.decode(data, str(path))


def _kills(folder: Path) -> frozenset[str]:
    """Faults that have killed a world of the run in a folder."""
    try:
        text = (folder / checkpoint.KILLS_NAME).read_text(errors="replace")
    except OSError:
        return frozenset()
    return frozenset(text.splitlines())


def _handling(folder: Path) -> checkpoint.Handling | None:
    """How people had set the run in a folder going, None when nobody did."""
    path = folder / checkpoint.HANDLING_NAME
    try:
        return msgspec.json.decode(path.read_bytes(), type=checkpoint.Handling)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError) as error:
        log.say("world", f"{path}: {error}; goes on as the scenario says", level="warn")
        return None


def _say_events(record: TickRecord) -> None:
    for event in record.events:
        who = f" {event.robot}" if event.robot else ""
        text = f"{event.kind}{who}: {event.text}"
        log.say("world", text, level=messages.level_of(event.kind), tick=event.tick)
