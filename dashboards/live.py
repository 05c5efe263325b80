"""Watching a run as it happens: every tick goes to a file, to viewers that connect, or both.

    observe(record) -> up to a hundred of them --views--> columns -> run.rrd, gRPC server

The server is ours and viewers come to it: a client sink would stop the run when a viewer stalls.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import quote

import rerun as rr
import rerun_cli  # type: ignore[import-untyped]

from dashboards import batches, blueprint, stage, views
from swarm.messages import TickRecord
from swarm.scenario import Obstacle, Scenario

APPLICATION = "msam-swarm"
HOST = "127.0.0.1"
SERVER_MEMORY = "256MiB"  # beyond it the server forgets the oldest for viewers that come late
BATCH_TICKS = 100  # in one call per entity: some 10 x cheaper than a call per tick
BATCH_S = 0.2  # wall; a live picture is never older
FILE_BATCH_S = 2.0  # wall; of a file alone. Fewer pieces: 10 min of 100 robots open in 1 s, not 7
CHECK_S = 1.0  # wall; how soon a full disk is noticed
CLOSE_S = 5.0  # wall; for the last bytes
FREE_BYTES_MIN = 1 << 18  # on the disk; less is too little to begin with
COMPACT_BYTES_MAX = 1 << 28  # of a file; a larger one stays in many pieces, which opens slower
COMPACT_S = 30.0  # wall; for that


class Live:
    """Shows a run. Nothing that happens to file or viewers stops it: `failure` says what did."""

    def __init__(
        self,
        scenario: Scenario,
        obstacles: Sequence[Obstacle],
        run: str,
        rrd_path: Path | None,
        serve_port: int | None,
        now: Callable[[], float] = time.monotonic,
        cpu: Callable[[], float] = time.process_time,
    ) -> None:
        """Opens what it can; a port or a file of None is left out."""
        self.failure: str | None = None
        self.selected = ""  # robot whose scan, map and circles are drawn; "": of the leader
        self._path = rrd_path
        self._scenario = scenario
        self._now = now
        self._cpu = cpu
        self._shots: list[batches.Shot] = []
        self._before = batches.Before()
        self._seen_s, self._spent_s = now(), cpu()  # at the tick before
        self._batch_s = FILE_BATCH_S if serve_port is None else BATCH_S
        self._send_at_s = self._seen_s + self._batch_s
        self._check_at_s = self._seen_s + CHECK_S
        file = []
        if rrd_path is not None and not self._is_full(rrd_path):
            # A footer lists all pieces, and the list would stay in memory while the run lasts.
            file = [rr.FileSink(rrd_path, write_footer=False)]
        server: list[rr.GrpcServerSink] = []
        if serve_port is not None:
            server.append(rr.GrpcServerSink(HOST, serve_port, server_memory_limit=SERVER_MEMORY))
        self._stream: rr.RecordingStream | None = None
        if not file and not server:
            return
        stream = rr.RecordingStream(APPLICATION, recording_id=run)
        layout = blueprint.blueprint(scenario, obstacles)
        try:
            stream.set_sinks(*file, *server, default_blueprint=layout)
        except RuntimeError as error:
            self._fail(f"{rrd_path}: {error}")
            if not server:
                return
            stream.set_sinks(*server, default_blueprint=layout)
        self._stream = stream
        stream.send_recording_name(f"{scenario.title} ({run})")
        for path, archetypes in stage.statics(scenario, obstacles).items():
            for archetype in archetypes:
                stream.log(path, archetype, static=True)

    def has(self, record: TickRecord) -> None:
        """Takes a tick that an earlier world has shown: the picture is one of the whole run."""
        self._take(batches.shot(record), self._now())

    def observe(self, record: TickRecord) -> None:
        """Takes one tick; shows it with the next batch."""
        now_s, spent_s = self._now(), self._cpu()
        self._take(batches.shot(record, now_s - self._seen_s, spent_s - self._spent_s), now_s)
        self._seen_s, self._spent_s = now_s, spent_s

    def _take(self, shot: batches.Shot, now_s: float) -> None:
        if self._stream is None:
            return
        self._shots.append(shot)
        if len(self._shots) >= BATCH_TICKS or now_s >= self._send_at_s:
            self._send(self._stream)
            self._send_at_s = now_s + self._batch_s
        if now_s >= self._check_at_s:
            self._check(self._stream)
            self._check_at_s = now_s + CHECK_S

    def close(self) -> None:
        """Shows what is left and completes the file; may be called again."""
        if self._stream is None:
            return
        if self._shots:
            self._send(self._stream)
        self._check(self._stream)
        self._stream.disconnect()
        self._stream = None
        if self._path is not None:
            compact(self._path)

    def _send(self, stream: rr.RecordingStream) -> None:
        batch = batches.batch(self._scenario, self._shots, self._before, self.selected)
        for drawing in views.draw(batch):
            index = [
                rr.TimeColumn("tick", sequence=batch.ticks[drawing.rows]),
                rr.TimeColumn("sim_time", duration=batch.times_s[drawing.rows]),
            ]
            stream.send_columns(drawing.path, index, drawing.columns)
        self._before = batches.after(batch)
        self._shots = []

    def _check(self, stream: rr.RecordingStream) -> None:
        """Logging never fails, so a full disk is found by asking."""
        try:
            stream.flush(timeout_sec=CLOSE_S)
        except (RuntimeError, ValueError, TimeoutError) as error:
            self._fail(str(error))

    def _is_full(self, path: Path) -> bool:
        """Whether there is no room for the beginning of a file.

        Rerun may wait for ever when its writer dies of a full disk just while it opens the file;
        later it only says so.
        """
        try:
            free_bytes = shutil.disk_usage(path.parent).free
        except OSError as error:
            self._fail(f"{path}: {error.strerror}")
            return True
        if free_bytes < FREE_BYTES_MIN:
            self._fail(f"{path}: {free_bytes} bytes free, expected {FREE_BYTES_MIN}")
            return True
        return False

    def _fail(self, text: str) -> None:
        if self.failure is None:
            self.failure = f"Rerun: expected to write the picture of the run, got: {text}"


def compact(path: Path) -> None:
    """Puts the pieces of a file together, with a list of them at its end: it opens much faster.

    A file that is too large for it, or that it fails for, stays as it is, which viewers also read.
    """
    if not path.exists() or path.stat().st_size > COMPACT_BYTES_MAX:
        return
    whole = path.with_name(f".{path.name}.part")
    command = [str(viewer_binary()), "rrd", "optimize", str(path), "-o", str(whole)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=COMPACT_S, check=False)
        if done.returncode == 0:
            os.replace(whole, path)
    except (OSError, subprocess.TimeoutExpired):
        pass
    finally:
        whole.unlink(missing_ok=True)


# --- viewers --------------------------------------------------------------------------------------


def viewer_binary() -> Path:
    """The viewer itself: the `rerun` script would leave it behind when it is killed."""
    return Path(rerun_cli.__file__).parent / "rerun"


def uri(port: int) -> str:
    """Address of a live run for a Rerun viewer."""
    return f"rerun+http://{HOST}:{port}/proxy"


def native_command(port: int, uri: str) -> list[str]:
    """Command of a viewer in a window of its own, listening on loopback only.

    Where one listens already, it shows that one what there is at the address.
    """
    return [str(viewer_binary()), "--bind", HOST, "--port", str(port), uri]


def web_command(web_port: int, uri: str) -> list[str]:
    """Command of the server of the web viewer, on loopback only."""
    binary = str(viewer_binary())
    port = str(web_port)
    return [binary, "--bind", HOST, "--serve-web", "--web-viewer-port", port, "--port", "auto", uri]


def web_address(web_port: int, uri: str) -> str:
    """What to open in a browser."""
    return f"http://{HOST}:{web_port}/?url={quote(uri, safe='')}&hide_welcome_screen"
