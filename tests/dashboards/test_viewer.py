"""The live picture in a real browser: server, web viewer, layout and scene, end to end."""

from __future__ import annotations

import io
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from dashboards import live, stage
from swarm.messages import TickRecord
from swarm.scenario import Scenario

CHROMIUM = shutil.which("chromium")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
Image = pytest.importorskip("PIL.Image", reason="pillow is not installed")

ROBOTS = 4
VIEW = {"width": 1000, "height": 640}
DEADLINE_S = 180.0  # software rendering on a busy machine; 10 to 20 s on an idle one
SCENE_SHARE_MIN = 0.15  # of the picture
TRAIL_PIXELS_MIN = 40
FLAGS = [
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((live.HOST, 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.fixture
def address(
    made_ticks: Callable[..., tuple[TickRecord, ...]], made_scenario: Callable[[int], Scenario]
) -> Iterator[str]:
    """Page of a run that is being watched."""
    scenario, port, web_port = made_scenario(ROBOTS), free_port(), free_port()
    viewer = live.Live(scenario, scenario.obstacles, "run-1", None, port)
    for record in made_ticks(ROBOTS, 200):
        viewer.observe(record)
    uri = live.uri(port)
    server = subprocess.Popen(
        live.web_command(web_port, uri), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        wait_until(lambda: is_open(web_port))
        yield live.web_address(web_port, uri)
    finally:
        server.kill()
        server.wait()
        viewer.close()


def is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((live.HOST, port)) == 0


def wait_until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {DEADLINE_S} s"


def share(pixels: np.ndarray, colour: tuple[int, ...], tolerance: int = 3) -> float:
    """Part of the picture that has a colour."""
    return float((np.abs(pixels.astype(int) - colour) <= tolerance).all(axis=2).mean())


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_browser_shows_the_scene_with_every_robot(
    address: str, made_scenario: Callable[[int], Scenario]
) -> None:
    own = stage.dimmed(stage.colours(made_scenario(ROBOTS)), stage.TRAIL_SHARE)
    trails = [tuple(int(colour) >> shift & 0xFF for shift in (24, 16, 8)) for colour in own]
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, headless=True, args=FLAGS)
        page = browser.new_page(viewport=VIEW)

        def route(request: object) -> None:
            url = request.request.url  # type: ignore[attr-defined]
            if url.startswith(f"http://{live.HOST}:"):
                request.continue_()  # type: ignore[attr-defined]
            else:
                request.abort()  # type: ignore[attr-defined]

        page.route("**/*", route)
        page.goto(f"{address}&renderer=webgl&theme=dark")
        page.wait_for_function("() => !!window._handle", timeout=1000.0 * DEADLINE_S)
        seen: list[np.ndarray] = []

        def is_drawn() -> bool:
            picture = Image.open(io.BytesIO(page.screenshot(timeout=1000.0 * DEADLINE_S)))
            seen.append(np.asarray(picture.convert("RGB")))
            return share(seen[-1], stage.BACKGROUND) > SCENE_SHARE_MIN and all(
                share(seen[-1], colour) * seen[-1].shape[0] * seen[-1].shape[1] > TRAIL_PIXELS_MIN
                for colour in trails
            )

        wait_until(is_drawn)
        assert not page.evaluate("() => window._handle.has_panicked()")
        browser.close()
