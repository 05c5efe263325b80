"""The .rrd read back, what stays closed to the outside, and what happens when a disk fails."""

from __future__ import annotations

import re
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import psutil
import pytest
from rerun.chunk import RrdReader

from dashboards import doorway, live
from swarm.messages import Event, TickRecord
from swarm.scenario import Scenario

MakeTicks = Callable[..., tuple[TickRecord, ...]]
MakeScenario = Callable[[int], Scenario]

ROBOTS = 6
COUNT = 220  # two batches and a bit


def record_run(
    scenario: Scenario, ticks: tuple[TickRecord, ...], path: Path | None, port: int | None = None
) -> live.Live:
    viewer = live.Live(scenario, scenario.obstacles, "run-1", path, port, now=lambda: 0.0)
    for record in ticks:
        viewer.observe(record)
    viewer.close()
    return viewer


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((live.HOST, 0))
        port: int = probe.getsockname()[1]
        return port


def connect_again_and_again(port: int, *, for_s: float) -> None:
    end_s = time.monotonic() + for_s
    while time.monotonic() < end_s:
        socket.create_connection((live.HOST, port), timeout=for_s).close()


def test_file_is_complete_and_holds_every_tick(
    made_ticks: MakeTicks, made_scenario: MakeScenario, tmp_path: Path
) -> None:
    ticks, path = made_ticks(ROBOTS, COUNT), tmp_path / "run.rrd"
    assert record_run(made_scenario(ROBOTS), ticks, path).failure is None
    checked = subprocess.run(
        [live.viewer_binary(), "rrd", "verify", path], capture_output=True, timeout=60, check=False
    )
    assert checked.returncode == 0, checked.stderr
    positions: dict[int, np.ndarray] = {}
    times_s: dict[int, float] = {}
    for chunk in RrdReader(path).stream().filter(content="/world/bodies").to_chunks():
        rows = chunk.to_record_batch()
        if "tick" not in rows.schema.names:
            continue  # colours and sizes, which are static
        found = np.asarray(rows["Points2D:positions"].values.flatten()).reshape(-1, ROBOTS, 2)
        for tick, time_ns, row in zip(
            rows["tick"].to_pylist(), rows["sim_time"].cast("int64").to_pylist(), found, strict=True
        ):
            positions[tick], times_s[tick] = row, time_ns * 1e-9
    assert sorted(positions) == list(range(COUNT))
    for record in ticks:
        expected = [(robot.pose.x_m, robot.pose.y_m) for robot in record.robots]
        assert np.allclose(positions[record.tick], expected, atol=1e-5)
        assert times_s[record.tick] == pytest.approx(record.stamp_ns * 1e-9, abs=1e-6)


def test_file_brings_its_own_layout(
    made_ticks: MakeTicks, made_scenario: MakeScenario, tmp_path: Path
) -> None:
    path = tmp_path / "run.rrd"
    record_run(made_scenario(2), made_ticks(2, 5), path)
    reader = RrdReader(path)
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1


def test_a_world_that_goes_on_shows_the_run_from_its_beginning(
    made_ticks: MakeTicks, made_scenario: MakeScenario, tmp_path: Path
) -> None:
    """And knows faults that began before: robot2's link is bad from tick 2, the world died at 6."""
    scenario, ticks, path = made_scenario(2), list(made_ticks(2, 12)), tmp_path / "run.1.rrd"
    fault = Event(2, 0, "fault", "robot2", fault="loss", number=0)
    ticks[2] = msgspec.structs.replace(ticks[2], events=(fault,))
    viewer = live.Live(scenario, (), "run-1", path, None, now=lambda: 0.0)
    for record in ticks[:6]:
        viewer.has(record)
    for record in ticks[6:]:
        viewer.observe(record)
    viewer.close()
    seen: dict[str, list[int]] = {}
    words: list[str] = []
    for chunk in RrdReader(path).stream().to_chunks():
        rows = chunk.to_record_batch()
        if "tick" in rows.schema.names:
            seen.setdefault(chunk.entity_path, []).extend(rows["tick"].to_pylist())
        if chunk.entity_path == "/robots/robot2" and "tick" in rows.schema.names:
            words += [word for row in rows["StateChange:state"].to_pylist() for word in row]
    assert sorted(seen["/world/bodies"]) == list(range(12))
    assert words[-1].endswith(", link fault")
    assert sorted(seen["/events"])[0] == 0


@pytest.mark.parametrize(("served", "grown"), [(True, [1, 2, 3, 4, 5]), (False, [1, 2, 4])])
def test_ticks_are_shown_at_once_when_somebody_may_watch(
    made_ticks: MakeTicks,
    made_scenario: MakeScenario,
    tmp_path: Path,
    served: bool,
    grown: list[int],
) -> None:
    """One tick a second; a file alone may lag by two. At first comes what does not change."""
    scenario, path = made_scenario(2), tmp_path / "run.rrd"
    clock = iter(range(100))
    port = free_port() if served else None
    viewer = live.Live(scenario, (), "run-1", path, port, now=lambda: float(next(clock)))
    sizes = [path.stat().st_size]
    for record in made_ticks(2, 5):
        viewer.observe(record)
        sizes.append(path.stat().st_size)
    viewer.close()
    assert [second for second in range(1, 6) if sizes[second] > sizes[second - 1]] == grown


def test_nothing_is_opened_when_nothing_is_asked_for(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    assert record_run(made_scenario(2), made_ticks(2, 5), None).failure is None


def test_run_goes_on_when_the_folder_is_not_there(
    made_ticks: MakeTicks, made_scenario: MakeScenario, tmp_path: Path
) -> None:
    viewer = record_run(made_scenario(2), made_ticks(2, 5), tmp_path / "none" / "run.rrd")
    assert viewer.failure is not None
    assert "No such file" in viewer.failure


def test_run_goes_on_when_the_disk_is_full(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    viewer = record_run(made_scenario(2), made_ticks(2, 120), Path("/dev/full"))
    assert viewer.failure is not None
    assert "No space left on device" in viewer.failure


def test_server_listens_on_loopback_only_and_is_gone_after_close(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, port = made_scenario(2), free_port()
    viewer = live.Live(scenario, (), "run-1", None, port, now=lambda: 0.0)
    viewer.observe(made_ticks(2, 1)[0])
    with socket.create_connection((live.HOST, port), timeout=10.0):
        listening = {
            connection.laddr.ip
            for connection in psutil.Process().net_connections("tcp")
            if connection.status == psutil.CONN_LISTEN and connection.laddr.port == port
        }
    assert listening == {live.HOST}
    viewer.close()
    assert viewer.failure is None
    viewer.close()  # again, to no effect
    with pytest.raises(ConnectionRefusedError):
        connect_again_and_again(port, for_s=10.0)


def test_failure_names_a_port_that_is_taken(
    made_ticks: MakeTicks, made_scenario: MakeScenario, tmp_path: Path
) -> None:
    with socket.socket() as taken:
        taken.bind((live.HOST, 0))
        taken.listen()
        path = tmp_path / "run.rrd"
        viewer = record_run(made_scenario(2), made_ticks(2, 5), path, taken.getsockname()[1])
    assert viewer.failure is not None
    assert len(RrdReader(path).recordings()) == 1  # the file does not mind


def test_viewer_is_the_binary_itself() -> None:
    version = subprocess.run(
        [live.viewer_binary(), "--version"], capture_output=True, timeout=60, check=True, text=True
    )
    assert "0.41" in version.stdout


@pytest.mark.parametrize(
    "command", [live.native_command(9999, live.uri(9876)), live.web_command(9090, live.uri(9876))]
)
def test_viewers_are_started_on_loopback(command: list[str]) -> None:
    assert command[0] == str(live.viewer_binary())
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == "rerun+http://127.0.0.1:9876/proxy"


def test_web_address_carries_the_address_of_the_run() -> None:
    assert live.web_address(9090, live.uri(9876)) == (
        "http://127.0.0.1:9090/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A9876%2Fproxy"
        "&hide_welcome_screen"
    )


def test_doorway_serves_one_page_on_loopback_until_it_is_closed() -> None:
    door = doorway.Doorway()
    address = door.address(9090, 9876)
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?viewer=9090&world=9876", address)
    with urllib.request.urlopen(address, timeout=10.0) as answer:
        page = answer.read().decode()
    assert "rerun+http://" in page
    assert re.findall(r"https?://(?!127\.0\.0\.1:|\$\{world\})", page) == []  # works offline
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(address.replace("/?", "/secret?"), timeout=10.0)
    door.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(address, timeout=10.0)


def test_a_file_that_cannot_be_compacted_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    live.compact(path)  # there is none, as when the disk was full from the beginning
    path.write_bytes(b"no recording at all")
    live.compact(path)
    assert path.read_bytes() == b"no recording at all"
    assert list(tmp_path.iterdir()) == [path]
