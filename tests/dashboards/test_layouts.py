"""The layout files are what the code would write, and name what the recordings hold."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

from rerun.chunk import RrdReader

from dashboards import foxglove, layouts, stage
from swarm.scenario import Obstacle, Scenario

ID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
RENEW = "renew it by: python -m dashboards.layouts"


def contents(path: Path) -> list[str]:
    """What a blueprint shows, without the ids that are drawn anew each time."""
    (entry,) = RrdReader(path).blueprints()
    found = []
    for chunk in RrdReader(path).stream(store=entry).to_chunks():
        rows = chunk.to_record_batch()
        for name in rows.schema.names:
            if name.split(":")[0] in ("ViewBlueprint", "ViewContents", "ContainerBlueprint"):
                found.append(ID.sub("ID", f"{name} {rows[name].to_pylist()}"))
    return sorted(found)


def test_layout_of_rerun_is_that_of_the_code(tmp_path: Path) -> None:
    layouts.write(tmp_path / "foxglove.json", tmp_path / "swarm.rbl")
    expected = contents(tmp_path / "swarm.rbl")
    assert any("Formation error" in line for line in expected)
    assert contents(layouts.RERUN) == expected, RENEW


def test_layout_of_foxglove_is_that_of_the_code() -> None:
    assert layouts.FOXGLOVE.read_bytes() == layouts.foxglove_layout(), RENEW


MOVING = Obstacle(circle=(3.0, 2.0, 0.25), path=((5.0, 2.0),), speed_mps=1.0)


def test_layout_of_foxglove_shows_channels_that_there_are(
    made_scenario: Callable[[int], Scenario],
) -> None:
    layout = json.loads(layouts.foxglove_layout())
    panels = layout["configById"]
    assert {layout["layout"]["first"], layout["layout"]["second"]} == set(panels)
    topics = {one.topic for one in foxglove.channels(made_scenario(2), (MOVING,))}
    shown = {*panels[layouts.SCENE]["topics"], panels[layouts.EVENTS]["topicToRender"]}
    assert shown == topics - {"/tf"}  # transforms are always shown
    colour = "#" + bytes(stage.BACKGROUND).hex()
    assert panels[layouts.SCENE]["scene"]["backgroundColor"] == colour
