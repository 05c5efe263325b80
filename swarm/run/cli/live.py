"""Verbs that speak to a swarm that runs now."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
import psutil
import typer
from typer import Argument

from swarm import errors, runs, scenario, zenoh_bus
from swarm.messages import CONTROL, ControlRequest, Reply, Status
from swarm.run import census, front, processes
from swarm.run.cli import complete, options

WORLD = "world"
STOP_TIMEOUT_S = 10.0
ASK_TIMEOUT_S = 2.0
KILL_TIMEOUT_S = 5.0

Name = Annotated[
    str, Argument(metavar="NAME", help="A robot's name.", autocompletion=complete.robots)
]
Victim = Annotated[
    str,
    Argument(metavar="NAME", help="A robot's name, or `world`.", autocompletion=complete.robots),
]
Spec = Annotated[str, Argument(metavar="SPEC", help="kind:target[@start_s][+for_s][,key=value]")]


def pick(run_id: str | None) -> runs.Card:
    """Card of the swarm that is meant."""
    cards = runs.running()
    exact = [card for card in cards if card.run == run_id]
    matching = exact or [card for card in cards if card.run.startswith(run_id or "")]
    if len(matching) == 1:
        return matching[0]
    names = ", ".join(card.run for card in cards) or "none"
    if not matching:
        wanted = f"the run '{run_id}'" if run_id else "a running swarm"
        raise errors.SwarmError(f"expected {wanted}, got: {names}")
    raise errors.UsageError(f"expected --run with one of the swarms that run: {names}")


def connect(card: runs.Card) -> zenoh_bus.ZenohBus:
    """The bus of a running swarm; raises BusError."""
    return zenoh_bus.open_client(
        card.run,
        card.endpoint,
        name="supervisor",
        tls=Path(card.tls) if card.tls else None,
        connect_timeout_s=ASK_TIMEOUT_S,
    )


def ask(card: runs.Card, request: ControlRequest) -> Reply:
    """What the world says; raises BusError that tells what holds it up when it says nothing."""
    try:
        bus = connect(card)
        try:
            return bus.ask(CONTROL, request, ASK_TIMEOUT_S)
        finally:
            bus.close()
    except errors.BusError as error:
        raise errors.BusError(
            f"{card.run}: expected the world to answer within {ASK_TIMEOUT_S:g} s, got nothing: "
            f"{processes.what_blocks(card)}"
        ) from error


def status_of(card: runs.Card) -> Status:
    """The world's own account of the run."""
    reply = ask(card, ControlRequest("status"))
    try:
        return msgspec.msgpack.decode(reply.body, type=Status)
    except msgspec.DecodeError as error:
        raise errors.BusError(f"{card.run}: expected a status, got: {error}") from error


def status(run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Show the swarms that run now. Exit code 1 when none of them answers, or there is none.

    `--json` has for each its card, the world's own account (null, with a problem, when it does not
    answer), and a row for every process, as in `swarm top`.

    Example:  swarm status --json
    """
    cards = runs.running() if run_id is None else [pick(run_id)]
    if not cards and not as_json:
        raise errors.SwarmError("expected a running swarm, got none")
    found = []
    for card in cards:
        answer, problem = None, None
        try:
            answer = status_of(card)
        except errors.SwarmError as error:
            problem = str(error)
            front.say(f"swarm: {problem}")
        people = census.Census(card).take(answer) if as_json else []
        found.append({"card": card, "status": answer, "processes": people, "problem": problem})
        if answer is not None and not as_json:
            print(f"{card.run}  pid {card.pid}  {card.endpoint}  {card.folder}")
            front.show_status(answer)
    if as_json:
        options.print_json({"runs": found})
    if all(row["status"] is None for row in found):
        raise typer.Exit(1)


def stop(run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Stop a running swarm; its recording is completed.

    Example:  swarm stop --run 20260101T120000Z-two-obstacles
    """
    card = pick(run_id)
    everyone = processes.of(card)
    try:
        ask(card, ControlRequest("stop"))
    except errors.SwarmError as error:  # its supervisor ends it, whatever the world does
        front.say(f"swarm: {error}")
        with contextlib.suppress(ProcessLookupError):
            os.kill(card.pid, signal.SIGTERM)
    if left := processes.wait_gone(everyone, STOP_TIMEOUT_S):
        raise errors.SwarmError(
            f"{card.run}: expected it to end within {STOP_TIMEOUT_S:g} s, "
            f"got: {'; '.join(row.text() for row in left)}"
        )
    if as_json:
        options.print_json({"run": card.run, "stopped": True})
    else:
        print(f"{card.run}: stopped")


def kill(name: Victim, run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Kill a process of a running swarm (SIGKILL); its restart policy decides what follows.

    Example:  swarm kill robot3

    Example:  swarm kill world
    """
    card = pick(run_id)
    if name == WORLD:
        _answer(card, _kill_world(card), as_json)
    else:
        _strike(card, f"kill:{known(card, name, more=(WORLD,))}", as_json)


def restart(name: Name, run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Kill a robot of a running swarm, and start it again a simulated second later.

    Example:  swarm restart robot3
    """
    card = pick(run_id)
    _strike(card, f"restart:{known(card, name)}", as_json)


def fault(spec: Spec, run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Let something go wrong in a running swarm: now, or at a simulated time still to come.

    Example:  swarm fault hang:robot2+3

    Example:  swarm fault loss:all@20+5,probability=0.3
    """
    card = pick(run_id)
    names = [row.name for row in status_of(card).robots]
    scenario.fault(spec, at_s=0.0, names=names)  # raises what is wrong with it
    _strike(card, spec, as_json)


def known(card: runs.Card, name: str, more: Sequence[str] = ()) -> str:
    """The name, if the run has such a robot; raises UsageError."""
    names = [*(row.name for row in status_of(card).robots), *more]
    if name in names:
        return name
    hint = errors.did_you_mean(name, names)
    raise errors.UsageError(f"expected one of {', '.join(names)}, got '{name}'{hint}")


def _strike(card: runs.Card, spec: str, as_json: bool) -> None:
    reply = ask(card, ControlRequest("fault", spec))
    if not reply.ok:
        raise errors.SwarmError(f"{card.run}: {reply.text}")
    _answer(card, reply.text, as_json)


def _kill_world(card: runs.Card) -> str:
    """Kill the world by its process's number: it may be stopped, or answer nobody."""
    everyone = processes.of(card)
    worlds = [row for row in processes.rows(everyone) if row.name == WORLD]
    if not worlds:
        raise errors.SwarmError(
            f"{card.run}: expected a world, got none: {processes.what_blocks(card)}"
        )
    pid = worlds[0].pid
    with contextlib.suppress(psutil.NoSuchProcess):
        next(one for one in everyone if one.pid == pid).kill()
    if left := processes.wait_gone([one for one in everyone if one.pid == pid], KILL_TIMEOUT_S):
        raise errors.SwarmError(
            f"{card.run}: expected it to die within {KILL_TIMEOUT_S:g} s, got: {left[0].text()}"
        )
    return f"killed the world, pid {pid}"


def _answer(card: runs.Card, text: str, as_json: bool) -> None:
    if as_json:
        options.print_json({"run": card.run, "done": text})
    else:
        print(f"{card.run}: {text}")
