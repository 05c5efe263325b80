"""Every verb: help with examples that parse, nonsense that is refused, words that complete."""

from __future__ import annotations

import functools
import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
import typer

from swarm import errors, runs, scenario
from swarm.run import cli
from swarm.run.cli import complete
from tests.run import processes

Here = Callable[[str], subprocess.CompletedProcess[str]]
NONSENSE = "no-such-thing! " * 9  # more than any verb takes, but for those that take any number
FAILED = {"logs"}  # none of its arguments is wrong: there is nothing to show


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    """The command line within this process."""
    return functools.partial(processes.here, monkeypatch, capsys, folder)


def examples(verb: str) -> list[str]:
    """Lines of a verb's help that begin with `swarm`."""
    text = cli.VERBS[verb].__doc__ or ""
    return [match.strip() for match in re.findall(r"(?:Example:|^)\s+(swarm .*)$", text, re.M)]


@pytest.mark.parametrize("verb", cli.VERBS)
def test_help_teaches_every_verb_by_an_example_that_parses(here: Here, verb: str) -> None:
    done = here(f"{verb} --help")
    assert done.returncode == 0
    assert "Usage" in done.stdout
    lines = examples(verb)
    assert lines
    command: Any = typer.main.get_command(cli.app)
    for line in lines:
        assert line in re.sub(r"\s+", " ", done.stdout)
        name, *words = shlex.split(line)[1:]
        assert name == verb
        command.commands[verb].make_context(verb, words)  # raises what is wrong with it


@pytest.mark.parametrize("verb", cli.VERBS)
def test_nonsense_is_refused_by_every_verb(here: Here, folder: Path, verb: str) -> None:
    for line in (f"{verb} --no-such-flag", f"{verb} {NONSENSE}"):
        done = here(line)
        refused = 1 if verb in FAILED and "flag" not in line else 2
        assert done.returncode == refused, (line, done.stderr)
        assert "Traceback" not in done.stderr
        assert done.stderr + done.stdout
    assert list(folder.iterdir()) == []


NEEDING_A_SWARM = (
    *("status", "top", "stop", "kill x", "restart x", "fault x"),
    *("pause", "resume", "step", "rate 2", "goal x 1 2", "select x"),
)


@pytest.mark.parametrize("verb", NEEDING_A_SWARM)
def test_verbs_about_a_running_swarm_fail_when_there_is_none(here: Here, verb: str) -> None:
    done = here(verb)
    assert done.returncode == 1
    assert "expected a running swarm, got" in done.stderr


@pytest.mark.parametrize(
    ("line", "near"),
    [
        ("rnu", "Did you mean 'run'?"),
        ("doctro", "Did you mean 'doctor'?"),
        ("run empyt", "did you mean 'empty'?"),
        ("run two-obstacles --sed 3", "--seed"),
        ("run two-obstacles --set fild.k_e=1", "did you mean 'field'?"),
        ("run two-obstacles --set field.k_ee=1", "did you mean 'k_e'?"),
        ("run two-obstacles --set robot.controller=navigatr", "did you mean 'navigator'?"),
        ("run two-obstacles --set robots.0.gaol=[1.0,2.0]", "did you mean 'goal'?"),
        ("run two-obstacles --fault kil:robot1@8", "did you mean 'kill'?"),
        ("bench barier", "did you mean 'barrier'?"),
        ("reproduce figg13", "did you mean 'fig13'?"),
    ],
)
def test_the_word_that_was_meant_is_named(here: Here, line: str, near: str) -> None:
    done = here(line)
    assert done.returncode == 2
    assert near in re.sub(r"[│\s]+", " ", done.stderr + done.stdout)


def test_nothing_is_suggested_where_nothing_is_near() -> None:
    assert errors.did_you_mean("qqq", ["run", "status"]) == ""
    with pytest.raises(errors.ScenarioError) as caught:
        scenario.decode(b"title = 'a'\nzzzzzz = 1\n", "a.toml")
    assert "did you mean" not in str(caught.value)


def test_shell_is_offered_scenarios_runs_and_robots(
    here: Here, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    (folder / "two.toml").write_text("")
    (folder / "more").mkdir()
    (folder / "more" / "deep.toml").write_text("")
    assert complete.scenarios("two") == ["two-obstacles", "two.toml"]
    assert complete.scenarios("more/") == ["more/deep.toml"]
    run = folder / "runs" / "20260101T000000Z-empty"
    run.mkdir(parents=True)
    (run / runs.SCENARIO).write_text('[[robots]]\nname = "ann"\n[[robots]]\nname = "bob"\n')
    assert complete.finished("runs/2026") == [f"runs/{run.name}"]
    assert complete.robots("") == complete.run_ids("") == []
    card = runs.card_of("one-1a2b", "empty", "tcp/127.0.0.1:1", run)
    runs.runtime_folder().mkdir(parents=True)
    (runs.runtime_folder() / "one.json").write_bytes(msgspec.json.encode(card))
    assert complete.robots("") == ["ann", "bob"]
    assert complete.robots("b") == ["bob"]
    assert complete.run_ids("o") == ["one-1a2b"]
    assert complete.logs("w") == ["world"]


def test_completion_is_wired_into_the_shell(folder: Path) -> None:
    done = subprocess.run(
        processes.SWARM,
        cwd=folder,
        env={
            "PATH": "/usr/bin:/bin",
            "_SWARM_COMPLETE": "complete_bash",
            "_TYPER_COMPLETE_ARGS": "swarm run two-",
            "COMP_WORDS": "swarm run two-",
            "COMP_CWORD": "2",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert "two-obstacles" in done.stdout, done.stderr
