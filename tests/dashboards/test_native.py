"""Rerun's own viewer, without a window: it opens the picture, scrubs it, no view complains."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from rerun.experimental import ViewerClient

from dashboards import live
from swarm.messages import TickRecord
from swarm.scenario import Scenario

MakeTicks = Callable[..., tuple[TickRecord, ...]]
MakeScenario = Callable[[int], Scenario]

START_S = 30.0
COUNT = 60
DRIVERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")

pytestmark = [
    pytest.mark.skipif(
        not any(any(Path(folder).glob("*.json")) for folder in DRIVERS),
        reason="no Vulkan driver is installed (mesa-vulkan-drivers has one that needs no card)",
    ),
    pytest.mark.filterwarnings("ignore"),  # experimental, says the client
]


@pytest.fixture(scope="module")
def viewer() -> Iterator[ViewerClient]:
    with socket.socket() as probe:
        probe.bind((live.HOST, 0))
        port = probe.getsockname()[1]
    command = [str(live.viewer_binary()), "--headless", "--bind", live.HOST, "--port", str(port)]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield connect(port)
    finally:
        process.kill()
        process.wait()


def connect(port: int) -> ViewerClient:
    end_s = time.monotonic() + START_S
    while True:
        try:
            return ViewerClient.connect(live.uri(port))
        except ConnectionError:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.1)


@pytest.mark.parametrize("robots", [1, 6, 30])
def test_every_view_can_show_what_there_is(
    viewer: ViewerClient,
    made_ticks: MakeTicks,
    made_scenario: MakeScenario,
    tmp_path: Path,
    robots: int,
) -> None:
    """Sent tick by tick, in which many a batch has nothing for some of its entities."""
    scenario, path = made_scenario(robots), tmp_path / "run.rrd"
    clock = iter(range(10_000))
    picture = live.Live(
        scenario, scenario.obstacles, f"run-{robots}", path, None, now=lambda: float(next(clock))
    )
    for record in made_ticks(robots, COUNT):
        dead = robots > 1 and record.tick in range(20, 30)
        first = msgspec.structs.replace(record.robots[0], alive=not dead)
        picture.observe(msgspec.structs.replace(record, robots=(first, *record.robots[1:])))
    picture.close()
    viewer.open(str(path))
    pictures = []
    for time_s in (0.8, 2.0, 4.4):
        viewer.set_time("sim_time", duration=time_s, play_state="paused")
        pictures.append(viewer.take_screenshot())
    assert len(set(pictures)) == len(pictures)
    views = viewer.get_state().views
    assert {"Scene", "Clearance [m]", "Events"} <= {view.name for view in views}
    assert {view.name: view.reports for view in views if view.reports} == {}
