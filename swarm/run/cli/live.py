"""Verbs that speak to a swarm that runs now."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Literal

import msgspec
import typer

from swarm import errors, messages, runs, zenoh_bus
from swarm.run import front
from swarm.run.cli import options

STOP_TIMEOUT_S = 10.0
ASK_TIMEOUT_S = 2.0


def pick(run_id: str | None) -> runs.Card:
    cards = runs.running()
    exact = [card for card in cards if card.run == run_id]
    matching = exact or [card for card in cards if card.run.startswith(run_id or "")]
    if len(matching) == 1:
        return matching[0]
    known = ", ".join(card.run for card in cards) or "none"
    if not matching:
        wanted = f"the run '{run_id}'" if run_id else "a running swarm"
        raise errors.SwarmError(f"expected {wanted}, got: {known}")
    raise errors.UsageError(f"expected --run with one of the swarms that run: {known}")


def ask(card: runs.Card, action: Literal["status", "stop"]) -> messages.Status:
    with_bus = zenoh_bus.open_client(
        card.run,
        card.endpoint,
        name="supervisor",
        tls=Path(card.tls) if card.tls else None,
        connect_timeout_s=ASK_TIMEOUT_S,
    )
    try:
        reply = with_bus.ask(messages.CONTROL, messages.ControlRequest(action), ASK_TIMEOUT_S)
        return msgspec.msgpack.decode(reply.body, type=messages.Status)
    except msgspec.DecodeError as error:
        raise errors.BusError(f"{card.run}: expected a status, got: {error}") from error
    finally:
        with_bus.close()


def status(run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Show the swarms that run now. Exit code 1 when there is none.

    Example:  swarm status --json
    """
    cards = runs.running() if run_id is None else [pick(run_id)]
    if not cards and not as_json:
        raise errors.SwarmError("expected a running swarm, got none")
    rows = []
    for card in cards:
        try:
            rows.append((card, ask(card, "status")))
        except errors.SwarmError as error:
            front.say(f"swarm: {card.run}: {error}")
    if as_json:
        options.print_json({"runs": [{"card": card, "status": answer} for card, answer in rows]})
    else:
        for card, answer in rows:
            print(f"{card.run}  pid {card.pid}  {card.endpoint}  {card.folder}")
            front.show_status(answer)
    if not rows:
        raise typer.Exit(1)


def stop(run_id: options.RunId = None, as_json: options.Json = False) -> None:
    """Stop a running swarm; its recording is completed.

    Example:  swarm stop --run 20260101T120000Z-two-obstacles
    """
    card = pick(run_id)
    ask(card, "stop")
    deadline_s = time.monotonic() + STOP_TIMEOUT_S
    while runs.is_alive(card):
        if time.monotonic() >= deadline_s:
            raise errors.SwarmError(
                f"{card.run}: expected it to end within {STOP_TIMEOUT_S:g} s, "
                f"got pid {card.pid} that still runs; end it with kill {card.pid}"
            )
        time.sleep(0.05)
    if as_json:
        options.print_json({"run": card.run, "stopped": True})
    else:
        print(f"{card.run}: stopped")
