"""The command line: every verb of `swarm`, its flags, and what its exit code means.

    running     run, scenarios, validate           options   what verbs share
    live        status, stop, kill, restart, fault
    watch       top, logs
    steer       pause, resume, step, rate, goal, select
    recordings  verify, replay, diff, why
    results     report, export
    hand        world, robot, version
    measure     bench, reproduce
    breaking    chaos
    own         doctor, view, new

0  it worked      1  the run failed, or a threshold was broken
2  a flag, a name or a file is wrong      130  interrupted
"""

from __future__ import annotations

import inspect
import io
import os
import sys
from collections.abc import Callable

import typer

from swarm import errors
from swarm.run import front
from swarm.run.cli import (
    breaking,
    hand,
    live,
    measure,
    own,
    recordings,
    results,
    running,
    steer,
    watch,
)

app = typer.Typer(
    name="swarm",
    help=(
        "Robot swarms as real processes: run them, watch them, break them, replay them.\n\n"
        "Start with:  swarm run two-obstacles"
    ),
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 ok, 1 run failed or threshold broken, 2 usage, 130 interrupted.",
)

VERBS: dict[str, Callable[..., None]] = {  # in the order of `swarm --help`
    "scenarios": running.list_scenarios,
    "validate": running.validate,
    "run": running.run,
    "status": live.status,
    "top": watch.top,
    "logs": watch.logs,
    "stop": live.stop,
    "pause": steer.pause,
    "resume": steer.resume,
    "step": steer.step,
    "rate": steer.rate,
    "goal": steer.goal,
    "select": steer.select,
    "kill": live.kill,
    "restart": live.restart,
    "fault": live.fault,
    "verify": recordings.verify,
    "replay": recordings.replay_,
    "diff": recordings.diff,
    "why": recordings.why_,
    "report": results.report,
    "export": results.export_,
    "world": hand.world_,
    "robot": hand.robot_,
    "bench": measure.bench,
    "reproduce": measure.reproduce,
    "chaos": breaking.chaos,
    "view": own.view,
    "new": own.new,
    "doctor": own.doctor,
    "version": hand.version,
}


def flowed(text: str) -> str:
    """A docstring as help: paragraphs as wide as the terminal, examples line by line."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(
        one if one.startswith("Example") else " ".join(one.split()) for one in paragraphs
    )


for name, verb in VERBS.items():
    app.command(name, help=flowed(verb.__doc__ or ""))(verb)


def main() -> None:
    """Run the verb of the command line and exit with its code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # None when it was closed
            stream.reconfigure(errors="backslashreplace")
    code = 0
    try:
        app()
    except errors.SwarmError as error:
        front.say(f"swarm: {error}")
        code = error.exit_code
    except KeyboardInterrupt:
        code = 130
    except BrokenPipeError:  # `swarm ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    except OSError as error:  # /dev/full as standard output, a name that is too long
        front.say(f"swarm: {error.filename or 'standard output'}: {error.strerror}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        code = 1
    raise SystemExit(code)
