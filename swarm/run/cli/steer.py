"""Verbs that hold a running swarm, let it go on, set its pace, its goal and its picture."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated

import msgspec
import typer
from typer import Argument

from swarm import errors, runs
from swarm.bus import Bus
from swarm.messages import CONTROL, ControlRequest, Status
from swarm.run import front
from swarm.run.cli import complete, live, options

LOOK_S = 0.05
PAUSE_S = 10.0  # the tick at hand may wait for a robot, or take long at a small rate


def pause(run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Pause a running swarm between two ticks: nothing moves, nothing is lost, robots wait.

    Example:  swarm pause
    """
    _steer(run_id, ControlRequest("pause"), as_json, lambda told: told.state == "paused", PAUSE_S)


def resume(run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Let a paused swarm go on.

    Example:  swarm resume
    """
    _steer(run_id, ControlRequest("resume"), as_json, lambda told: told.state != "paused", PAUSE_S)


def step(
    count: Annotated[int, Argument(metavar="[N]", min=1, max=10**9, help="Ticks.")] = 1,
    run_id: options.RunId = None,
    as_json: options.Json = False,
) -> None:
    """Let a swarm go on for some ticks, then pause; waits until it has.

    Example:  swarm step

    Example:  swarm step 125
    """
    _steer(run_id, ControlRequest("step", count=count), as_json, None, None)


def rate(
    factor: Annotated[
        float, Argument(metavar="FACTOR", min=0.0, max=1000.0, help="x real time; 0: no limit.")
    ],
    run_id: options.RunId = None,
    as_json: options.Json = False,
) -> None:
    """Change the pace of a running swarm. In real time 0 is 1.

    Example:  swarm rate 0.25
    """
    request = ControlRequest("rate", rate=factor)
    _steer(run_id, request, as_json, lambda told: told.rate == factor, PAUSE_S)


def goal(
    name: Annotated[
        str,
        Argument(
            metavar="NAME",
            help="A robot's name, or `leader`: whoever leads.",
            autocompletion=complete.robots,
        ),
    ],
    x_m: Annotated[float, Argument(metavar="X", min=-1e6, max=1e6, help="m, in the world.")],
    y_m: Annotated[float, Argument(metavar="Y", min=-1e6, max=1e6, help="m, in the world.")],
    run_id: options.RunId = None,
    as_json: options.Json = False,
) -> None:
    """Send a robot, or a formation by its leader, somewhere else from now on.

    Way-points that were still ahead are forgotten. Write `--` before negative numbers.

    Example:  swarm goal leader 12 3

    Example:  swarm goal -- robot2 -4.5 0
    """
    _order(run_id, ControlRequest("goal", robot=name, goal=(x_m, y_m)), as_json)


def select(
    name: Annotated[
        str,
        Argument(
            metavar="NAME",
            help="A robot's name, or `leader`: whoever leads.",
            autocompletion=complete.robots,
        ),
    ],
    run_id: options.RunId = None,
    as_json: options.Json = False,
) -> None:
    """Choose the robot whose scan, map and virtual circles the live picture shows.

    Example:  swarm select robot3
    """
    _order(run_id, ControlRequest("select", robot=name), as_json)


def _order(run_id: str | None, request: ControlRequest, as_json: bool) -> None:
    """Ask for something that is done with the next tick."""
    card = live.pick(run_id)
    reply = live.ask(card, request)
    if not reply.ok:
        raise errors.UsageError(f"{card.run}: {reply.text}")
    if as_json:
        options.print_json({"run": card.run, "done": reply.text})
    else:
        print(f"{card.run}: {reply.text}")


def _steer(
    run_id: str | None,
    request: ControlRequest,
    as_json: bool,
    done: Callable[[Status], bool] | None,
    timeout_s: float | None,
) -> None:
    """Ask for something and wait until it is so, or the run is over.

    Args:
        done: None: until it has paused after all the ticks of a step.
    """
    card = live.pick(run_id)
    bus = live.connect(card)
    try:
        before = _ask(card, bus, ControlRequest("status"))
        if done is None:
            wanted = before.tick + request.count

            def done(told: Status) -> bool:
                return told.state == "paused" and told.tick >= wanted

        _ask(card, bus, request)
        deadline_s = time.monotonic() + (timeout_s or float("inf"))
        while True:
            told = _ask(card, bus, ControlRequest("status"))
            if done(told) or told.state == "ended":
                break
            if time.monotonic() > deadline_s:
                front.say(f"swarm: {card.run}: not yet; it will be so after the tick at hand")
                raise typer.Exit(1)
            time.sleep(LOOK_S)
    finally:
        bus.close()
    if told.state == "ended" and not done(told):
        raise errors.SwarmError(f"{card.run}: expected it to {request.action}, got: it is over")
    if as_json:
        options.print_json({"run": card.run, "status": told})
    else:
        pace = f", {told.rate:g} x real time" if told.rate else ""
        print(f"{card.run}: {told.state} at {told.stamp_ns / 1e9:.2f} s, tick {told.tick}{pace}")


def _ask(card: runs.Card, bus: Bus, request: ControlRequest) -> Status:
    reply = bus.ask(CONTROL, request, live.ASK_TIMEOUT_S)
    if not reply.ok:
        raise errors.SwarmError(f"{card.run}: {reply.text}")
    try:
        return msgspec.msgpack.decode(reply.body, type=Status)
    except msgspec.DecodeError as error:
        raise errors.BusError(f"{card.run}: expected a status, got: {error}") from error
