"""Logs: records, crashes and what is neither, written and read back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from swarm import log
from swarm.log import Entry, Tail


def written(path: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Log of a process of its own that runs a few lines of Python as `robot1`."""
    begin = (
        "import os, sys\nfrom pathlib import Path\nfrom swarm import lifetime, log\n"
        f"lifetime.adopt('robot1', Path({str(path)!r}), lifetime.Stop(), None)\n"
    )
    return subprocess.run(
        [sys.executable, "-c", begin + code], capture_output=True, text=True, check=False
    )


def test_lines_are_records_in_the_log_and_text_for_people(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot1.log"
    done = written(path, "log.say('robot1', 'sees\\nnothing', level='warn', tick=7)")
    assert (done.stdout, done.stderr) == ("", "")
    (entry,) = Tail(path).read()
    assert entry == Entry(entry.time, "robot1", "warn", "sees\nnothing", 7)
    assert len(entry.time) == len("2026-01-01T00:00:00.000000Z")
    log.say("robot1", "sees nothing", tick=7)
    assert capsys.readouterr().err == "swarm-robot1: tick 7: sees nothing\n"


@pytest.mark.parametrize(
    "code",
    [
        "raise ValueError('no\\nwheels')",
        "import threading\nt = threading.Thread(target=lambda: int('x')); t.start(); t.join()",
        "try:\n    1 / 0\nexcept ZeroDivisionError as error:\n    log.crash(error)",
    ],
)
def test_crash_is_one_record_with_its_traceback(tmp_path: Path, code: str) -> None:
    path = tmp_path / "robot1.log"
    written(path, code)
    (entry,) = Tail(path).read()
    assert entry.level == "error"
    assert "Error: " in entry.text
    assert entry.traceback.startswith("Traceback (most recent call last)")
    assert log.last_words(path) == entry.text


def test_crash_of_native_code_stays_readable_and_is_the_last_word(tmp_path: Path) -> None:
    path = tmp_path / "robot1.log"
    written(path, "import faulthandler\nlog.say('robot1', 'well')\nfaulthandler._sigsegv()")
    entries = Tail(path).read(final=True)
    assert [entry.level for entry in entries][:2] == ["info", "raw"]
    assert {entry.time for entry in entries} == {entries[0].time}
    assert log.last_words(path) == "Fatal Python error: Segmentation fault"


def test_last_words_prefer_an_error_to_what_follows_it(tmp_path: Path) -> None:
    path = tmp_path / "robot1.log"
    path.write_bytes(b"old story\n")
    begins = path.stat().st_size
    written(path, "log.say('robot1', 'no router', level='error')\nlog.say('robot1', 'ends')")
    assert log.last_words(path, begins) == "no router"
    assert log.last_words(tmp_path / "missing.log") == ""
    assert log.last_words(path, path.stat().st_size) == ""


def test_tail_reads_what_is_new_and_waits_for_whole_lines(tmp_path: Path) -> None:
    path = tmp_path / "robot1.log"
    tail = Tail(path)
    assert tail.read() == []
    record = b'{"time":"2026-01-01T00:00:00.000000Z","process":"robot1","level":"info","text":"a"}'
    with path.open("ab", buffering=0) as file:
        file.write(record[:20])
        assert tail.read() == []
        file.write(record[20:] + b"\nthread panicked\n{half")
        assert [(entry.level, entry.text) for entry in tail.read()] == [
            ("info", "a"),
            ("raw", "thread panicked"),
        ]
    assert tail.read() == []
    (last,) = tail.read(final=True)
    assert (last.level, last.text, last.time) == ("raw", "{half", "2026-01-01T00:00:00.000000Z")


def test_text_before_the_first_record_has_the_time_of_that(tmp_path: Path) -> None:
    path = tmp_path / "world.log"
    path.write_text(
        'warning\n{"time":"2026-01-01T00:00:00.5Z","process":"world","level":"info","text":"a"}\n'
    )
    assert [entry.time for entry in Tail(path).read()] == ["2026-01-01T00:00:00.5Z"] * 2


def test_merging_orders_by_time_and_keeps_each_process_in_order() -> None:
    def entry(time: str, process: str, text: str) -> Entry:
        return Entry(time, process, "info", text)

    ours = [entry("1", "a", "one"), entry("2", "a", "two"), entry("2", "a", "three")]
    theirs = [entry("0", "b", "zero"), entry("2", "b", "four")]
    assert [one.text for one in log.merged([*ours, *theirs])] == [
        "zero", "one", "two", "three", "four",
    ]  # fmt: skip
