"""The pictures in real viewers: of a swarm that runs, and of one that is over."""

from __future__ import annotations

import contextlib
import functools
import http.server
import io
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dashboards import live, stage
from swarm import runs, scenario
from swarm.run import library

CHROMIUM = shutil.which("chromium")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
Image = pytest.importorskip("PIL.Image", reason="pillow is not installed")

NAME = "two-obstacles"
FAULT = "mute:robot3@0.8+1.6"  # early, so that its marks are soon there
RATE = "0.2"  # software rendering lags by half a minute on a busy machine
VIEW = {"width": 1200, "height": 800}
DEADLINE_S = 250.0
FLAGS = [
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
LANE_BRIGHTNESS = 0.79  # Rerun draws the colours of time lines darker
# Where the layout has what, as shares of the page: left, top, right, bottom.
SCENE = (0.01, 0.07, 0.63, 0.62)
WORDS = (0.01, 0.67, 0.63, 0.95)
PLOTS = (0.66, 0.07, 0.99, 0.68)
EVENTS = (0.66, 0.72, 0.99, 0.95)

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.timeout(600),
]
Picture = np.ndarray[Any, np.dtype[np.uint8]]
Part = tuple[float, float, float, float]


class Run:
    """A swarm as a person starts it, with the address that it prints."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._log = folder.with_suffix(".log")
        command = [sys.executable, "-m", "swarm.run.start", "run", NAME, "--view", "web"]
        command += ["--rate", RATE, "--fault", FAULT, "--out", str(folder)]
        with self._log.open("wb") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=out)
        wait_until(lambda: self._found() is not None)
        self.address = str(self._found())

    def _found(self) -> str | None:
        found = re.search(r"http://127\.0\.0\.1:\S+", self._log.read_text())
        return None if found is None else found[0]

    def end(self) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(DEADLINE_S)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    started = Run(tmp_path_factory.mktemp("viewer") / "run")
    try:
        yield started
    finally:
        if started.process.poll() is None:
            started.end()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, headless=True, args=FLAGS)
        yield found
        found.close()


def wait_until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {DEADLINE_S} s"
        time.sleep(0.1)


def open_page(browser: Any, address: str) -> tuple[Any, Any]:
    """A page that can reach this machine only, and the frame in it that has the viewer."""
    page = browser.new_page(viewport=VIEW)

    def route(request: Any) -> None:
        local = request.request.url.startswith(f"http://{live.HOST}:")
        request.continue_() if local else request.abort()

    page.route("**/*", route)
    page.goto(f"{address}&renderer=webgl&theme=dark")
    frames: list[Any] = []

    def is_loaded() -> bool:
        page.wait_for_timeout(100.0)
        with contextlib.suppress(playwright.Error):  # it is just being loaded
            frames[:] = [one for one in page.frames if one.evaluate("() => !!window._handle")]
        return bool(frames)

    wait_until(is_loaded)
    return page, frames[0]


def shoot(page: Any) -> Picture:
    data = page.screenshot(timeout=1000.0 * DEADLINE_S)
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def keep(picture: Picture, folder: Path) -> None:
    """The newest picture, for whoever has to find out what was wrong with it."""
    Image.fromarray(picture).save(folder / "seen.png")


def part(picture: Picture, where: Part) -> Picture:
    height, width, _ = picture.shape
    left, top, right, bottom = where
    return picture[int(top * height) : int(bottom * height), int(left * width) : int(right * width)]


def pixels(picture: Picture, rgba: int, tolerance: int = 4) -> int:
    """How many have a colour."""
    colour = [rgba >> shift & 0xFF for shift in (24, 16, 8)]
    return int((np.abs(picture.astype(int) - colour) <= tolerance).all(axis=2).sum())


def changed(one: Picture, other: Picture, where: Part) -> int:
    """Pixels of a part that are not the same."""
    apart = np.abs(part(one, where).astype(int) - part(other, where))
    return int((apart > 24).any(axis=2).sum())


def is_whole(picture: Picture) -> bool:
    """Scene with every robot's way, lanes of leader and followers, curves, and lines of events."""
    _, where, data = library.read_scenario(NAME)
    plan = scenario.decode(data, where)
    scene, words = part(picture, SCENE), part(picture, WORDS)
    plots, events = part(picture, PLOTS), part(picture, EVENTS)
    background = int.from_bytes(bytes([*stage.BACKGROUND, 0xFF]), "big")
    lanes = [stage.STATE_COLOURS[mode] for mode in ("GO", "FORM")]
    lanes = stage.dimmed(np.array(lanes, np.uint32), LANE_BRIGHTNESS).tolist()
    ways = stage.dimmed(stage.colours(plan), stage.TRAILS[-1].brightness).tolist()
    return (
        pixels(scene, background) > 0.3 * scene.shape[0] * scene.shape[1]
        and min(pixels(scene, way) for way in ways) > 20
        and min(pixels(scene, colour) for colour in (stage.OBSTACLE_EDGE, stage.LEADER)) > 20
        and min(pixels(words, lane, 8) for lane in lanes) > 200
        and pixels(plots, stage.LARGEST, 24) > 20
        and int((events.max(axis=2) > 160).sum()) > 100
    )


def test_browser_shows_a_running_swarm_move(run: Run, browser: Any, tmp_path: Path) -> None:
    page, frame = open_page(browser, run.address)
    shots: list[Picture] = []

    def is_seen() -> bool:
        shots.append(shoot(page))
        keep(shots[-1], tmp_path)
        return is_whole(shots[-1])

    wait_until(is_seen)
    first = shots[-1]

    def has_moved() -> bool:
        shots.append(shoot(page))
        keep(shots[-1], tmp_path)
        return (
            is_whole(shots[-1])
            and min(changed(first, shots[-1], where) for where in (SCENE, PLOTS, WORDS)) > 100
        )

    wait_until(has_moved)
    assert run.process.poll() is None  # all that was seen while it ran
    assert not frame.evaluate("() => window._handle.has_panicked()")
    page.close()


def test_browser_shows_a_run_that_is_over(run: Run, browser: Any, tmp_path: Path) -> None:
    """Its file alone, served by any server; after the test above, so there is something in it."""
    if run.process.poll() is None:
        run.end()
    files = functools.partial(Files, directory=str(run.folder))
    with http.server.ThreadingHTTPServer((live.HOST, 0), files) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://{live.HOST}:{server.server_address[1]}/{runs.RRD}"
        web_port = free_port()
        viewer = subprocess.Popen(
            live.web_command(web_port, url), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            wait_until(lambda: is_open(web_port))
            page, frame = open_page(browser, live.web_address(web_port, url))

            def is_seen() -> bool:
                picture = shoot(page)
                keep(picture, tmp_path)
                return is_whole(picture)

            wait_until(is_seen)
            assert not frame.evaluate("() => window._handle.has_panicked()")
            page.close()
        finally:
            viewer.kill()
            viewer.wait()
            server.shutdown()


class Files(http.server.SimpleHTTPRequestHandler):
    """A folder that pages of other servers may read."""

    def end_headers(self) -> None:
        self.send_header("Access-Control-Allow-Origin", "*")
        super().end_headers()

    def log_message(self, *_: object) -> None:
        """Silent."""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((live.HOST, 0))
        port: int = probe.getsockname()[1]
        return port


def is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((live.HOST, port)) == 0
