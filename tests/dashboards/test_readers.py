"""A recording in the hands of others: MCAP's own JavaScript library, and Rerun's importer."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from dashboards import foxglove, live
from swarm import recording
from swarm.messages import TickRecord
from swarm.scenario import Scenario

MakeTicks = Callable[..., tuple[TickRecord, ...]]
MakeScenario = Callable[[int], Scenario]

ROBOTS = 6
COUNT = 60
CHECK = Path(__file__).with_name("check.mjs")
PACKAGES = ("@mcap/core@2.2.2", "@mcap/support@1.1.0", "@mcap/nodejs@1.0.2")
INSTALL_S = 90.0
CHECK_S = 60.0


@pytest.fixture(scope="module")
def recorded(
    made_ticks: MakeTicks, made_scenario: MakeScenario, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A recording with every channel; what is in it: see the test of the channels."""
    scenario, folder = made_scenario(ROBOTS), tmp_path_factory.mktemp("recorded")
    channels = foxglove.channels(scenario, scenario.obstacles)
    with recording.Writer(folder, b"title", {"seed": "7"}, channels) as writer:
        for record in made_ticks(ROBOTS, COUNT):
            writer.write(record)
    return folder / "run.mcap"


@pytest.fixture(scope="module")
def modules(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the library; skips where it cannot be had."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("node and npm are not installed")
    folder = tmp_path_factory.mktemp("modules")
    command = ["npm", "install", "--no-audit", "--no-fund", "--silent", "--prefix", str(folder)]
    try:
        found = subprocess.run(
            [*command, *PACKAGES], capture_output=True, timeout=INSTALL_S, check=False, text=True
        )
    except subprocess.TimeoutExpired:
        pytest.skip(f"npm did not answer within {INSTALL_S} s")
    if found.returncode:
        pytest.skip(f"npm cannot get @mcap/core: {found.stderr.strip()[:200]}")
    return folder


def check(modules: Path, path: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["node", str(CHECK), str(modules), str(path)],
        capture_output=True,
        timeout=CHECK_S,
        check=False,
        text=True,
    )


def test_the_library_of_mcap_finds_every_message_whole(modules: Path, recorded: Path) -> None:
    answer = check(modules, recorded)
    assert answer.returncode == 0, answer.stderr
    found: dict[str, Any] = json.loads(answer.stdout)
    expected = {"tick": COUNT, "/tf": COUNT, "/poses": COUNT, "/bodies": COUNT}
    expected |= {"/scans": COUNT // 3, "/obstacles": 3, "/log": 1}
    assert found["topics"] == found["counted"] == expected
    assert found["messages"] == found["statistics"] == found["streamed"] == sum(expected.values())
    assert found["sorted"]
    assert found["done"]
    assert found["left"] == 0
    assert found["attachments"] == ["scenario.toml"]
    assert set(found["metadata"]) == {"run", "recording"}
    for topic, (name, encoding, size) in found["schemas"].items():
        own = topic == "tick"
        assert name.startswith("swarm.messages." if own else "foxglove.")
        assert encoding == ("text" if own else "protobuf")
        assert size > 100


def test_the_library_of_mcap_sees_a_flipped_bit(
    modules: Path, recorded: Path, tmp_path: Path
) -> None:
    data = bytearray(recorded.read_bytes())
    data[data.index(b"\x03\x00\x00\x00lz4") + 500] ^= 4  # in the first of its chunks
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    answer = check(modules, damaged)
    assert answer.returncode != 0


def test_rerun_imports_bodies_scans_obstacles_transforms_and_log(
    recorded: Path, tmp_path: Path, made_ticks: MakeTicks
) -> None:
    path = tmp_path / "imported.rrd"
    command = [live.viewer_binary(), "mcap", "convert", recorded, "-o", path]
    answer = subprocess.run(command, capture_output=True, timeout=CHECK_S, check=False)
    assert answer.returncode == 0, answer.stderr
    counts = {
        "/bodies": ("Points3D:positions", COUNT),
        "/scans": ("Points3D:positions", COUNT // 3),
        "/obstacles": ("Points3D:positions", 3),
        "/poses": ("InstancePoses3D:translations", COUNT),
        "/tf": ("Transform3D:translation", COUNT * ROBOTS),
        "/log": ("TextLog:text", 1),
    }
    for topic, (component, count) in counts.items():
        found = [
            row
            for chunk in RrdReader(path).stream().filter(content=topic).to_chunks()
            for name in chunk.to_record_batch().schema.names
            if name == component
            for row in chunk.to_record_batch()[name].to_pylist()
        ]
        assert len(found) == count, topic
        if topic == "/poses":
            first = [(one.pose.x_m, one.pose.y_m, 0.0) for one in made_ticks(ROBOTS, 1)[0].robots]
            assert np.allclose(found[0], first, atol=1e-5)
