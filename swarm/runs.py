"""Runs on disk: a folder for each, and where a running one can be found.

runs/<UTC time>-<scenario>/    run.mcap run.rrd scenario.toml summary.json run.json logs/
<runtime folder>/<run>.json    the same run.json, while it runs, for status, stop, ...
"""

from __future__ import annotations

import contextlib
import os
import secrets
import tempfile
import time
from pathlib import Path

import msgspec
import psutil

from swarm import errors, playback

MCAP = "run.mcap"
RRD = "run.rrd"
SCENARIO = "scenario.toml"
SUMMARY = "summary.json"
LOGS = "logs"
CARD = "run.json"


class Card(msgspec.Struct, frozen=True):
    """How to reach a running swarm."""

    run: str
    scenario: str
    pid: int
    started_s: float  # creation time of the process, so that a pid used again is recognised
    endpoint: str
    folder: str
    tls: str = ""  # folder of certificates, empty when the bus is not encrypted


def new_folder(out: Path | None, scenario: str) -> Path:
    """Make the folder of a run; its name is the run's id.

    Raises UsageError when it cannot be written or holds a run already.
    """
    if out is not None:
        if not str(out).strip("."):
            raise errors.UsageError("--out: expected a folder of the run's own, got this one")
        folder = out.absolute()
        if _holds_run(folder):
            raise errors.UsageError(
                f"--out {out}: expected a folder without a run in it, got one with {MCAP}; "
                "choose another or remove it"
            )
        return _make(folder, exist_ok=True)
    stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    base = Path("runs").absolute() / f"{stamp}-{scenario}"
    for number in range(1, 1000):
        folder = base if number == 1 else base.with_name(f"{base.name}-{number}")
        with contextlib.suppress(FileExistsError):
            return _make(folder, exist_ok=False)
    raise errors.UsageError(f"{base}: expected a free name for a run, got 999 taken ones")


def _holds_run(folder: Path) -> bool:
    try:
        return playback.next_segment(folder / MCAP) > 0 or (folder / SUMMARY).exists()
    except OSError as error:  # a name that is too long
        raise errors.UsageError(f"--out {folder}: {error.strerror}") from error


def _make(folder: Path, *, exist_ok: bool) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=exist_ok)
        (folder / LOGS).mkdir(exist_ok=True)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(13, "Permission denied")
    except FileExistsError:
        if exist_ok or not folder.is_dir():
            raise errors.UsageError(f"{folder}: expected a folder, got a file") from None
        raise
    except OSError as error:
        raise errors.UsageError(
            f"{folder}: expected a folder that can be written, got: {error.strerror}; "
            "choose another with --out"
        ) from error
    return folder


def new_run_id(folder: Path) -> str:
    """Id for the run in a folder: its name, as far as a key may carry it, and some letters more.

    Two runs in folders of the same name, or on the same router, never share an id.
    """
    kept = "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in folder.name)
    name = kept.encode("ascii", "replace").decode().replace("?", "-").lstrip("-_") or "run"
    return f"{name[:80]}-{secrets.token_hex(2)}"


def hold_room(path: Path, size_bytes: int) -> None:
    """Take room on the disk for a file that is to be written even if the disk is full by then."""
    with contextlib.suppress(OSError):
        descriptor = os.open(_room(path), os.O_WRONLY | os.O_CREAT, 0o644)
        try:
            os.posix_fallocate(descriptor, 0, size_bytes)
        finally:
            os.close(descriptor)


def _room(path: Path) -> Path:
    return path.with_name(f"{path.name}.room")


def write_whole(path: Path, data: bytes) -> str | None:
    """Write a file whole or not at all; what went wrong, None when nothing did."""
    part = path.with_name(f"{path.name}.part")
    with contextlib.suppress(OSError):
        _room(path).unlink(missing_ok=True)
    try:
        part.write_bytes(data)
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        return f"{path}: {error.strerror}"
    return None


def recording(run: Path) -> Path:
    """MCAP of a RUN given as folder or file; raises UsageError when there is none."""
    try:
        path = run / MCAP if run.is_dir() else run
        there = any(one.is_file() for one in playback.segment_paths(path))
    except OSError as error:
        raise errors.UsageError(f"{run}: {error.strerror}") from error
    if not there:
        raise errors.UsageError(
            f"{run}: expected a run's folder or its recording, got "
            f"{'a folder without ' + MCAP if run.is_dir() else 'nothing there'}"
        )
    return path


# --- finding what runs --------------------------------------------------------------------------


def runtime_folder() -> Path:
    """The user's folder for cards of running swarms."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    if base and os.access(base, os.W_OK):
        return Path(base) / "msam-swarm"
    return Path(tempfile.gettempdir()) / f"msam-swarm-{os.getuid()}"


@contextlib.contextmanager
def posted(card: Card, folder: Path | None):  # type: ignore[no-untyped-def]
    """Post a card while the body runs."""
    data = msgspec.json.format(msgspec.json.encode(card))
    places = [runtime_folder() / f"{card.run}.json"]
    if folder is not None:
        places.append(folder / CARD)
    with contextlib.suppress(OSError):  # a run that cannot be found by others is still a run
        places[0].parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        for place in places:
            place.write_bytes(data)
    try:
        yield
    finally:
        for place in places:
            with contextlib.suppress(OSError):
                place.unlink(missing_ok=True)


def card_of(
    run: str, scenario: str, endpoint: str, folder: Path | None, tls: Path | None = None
) -> Card:
    """Card of this process."""
    started_s = psutil.Process().create_time()
    certificates = str(tls.absolute()) if tls is not None else ""
    return Card(run, scenario, os.getpid(), started_s, endpoint, str(folder or ""), certificates)


def running() -> list[Card]:
    """Cards of the swarms that run now, oldest first; stale ones are removed."""
    cards = []
    for path in sorted(runtime_folder().glob("*.json")):
        try:
            card = msgspec.json.decode(path.read_bytes(), type=Card)
        except (OSError, msgspec.DecodeError):
            continue
        if is_alive(card):
            cards.append(card)
        else:
            with contextlib.suppress(OSError):
                path.unlink()
    return sorted(cards, key=lambda card: card.started_s)


def is_alive(card: Card) -> bool:
    """Whether the process that posted a card still runs."""
    try:
        process = psutil.Process(card.pid)
        same = abs(process.create_time() - card.started_s) < 0.5
        return same and process.status() != psutil.STATUS_ZOMBIE
    except psutil.Error:
        return False
