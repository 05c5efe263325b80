"""Layout files for viewers, beside this module: `python -m dashboards.layouts` writes them anew.

foxglove.json   for Foxglove, of the MCAP or of a live run
swarm.rbl       for Rerun; every .rrd brings its own, which also knows the size of its scene
"""

from __future__ import annotations

from pathlib import Path

import msgspec

from dashboards import blueprint, stage
from dashboards.foxglove import FRAME
from dashboards.live import APPLICATION

HERE = Path(__file__).parent
FOXGLOVE = HERE / "foxglove.json"
RERUN = HERE / "swarm.rbl"
POINT_PIXELS = {"/bodies": 4.0, "/scans": 2.0, "/obstacles": 3.0, "/movers": 3.0}
SCENE, EVENTS = "3D!scene", "RosOut!events"  # kind of panel, and a name of its own


def foxglove_layout() -> bytes:
    """Scene from above, x to the right, with all that the channels draw; below it the log."""
    clouds = {
        topic: {"visible": True, "colorMode": "rgba-fields", "pointSize": size}
        for topic, size in POINT_PIXELS.items()
    }
    scene = {
        "fixedFrame": FRAME,
        "followMode": "follow-none",
        "cameraState": {
            "perspective": False,
            "distance": 24.0,
            "phi": 0.0,
            "thetaOffset": 0.0,
            "target": [0.0, 0.0, 0.0],
            "targetOffset": [8.0, 0.0, 0.0],
        },
        "scene": {
            "backgroundColor": "#{:02x}{:02x}{:02x}".format(*stage.BACKGROUND),
            "transforms": {"showLabel": True, "labelSize": 0.3, "axisScale": 0.25},
        },
        "topics": {**clouds, "/poses": {"visible": False}},  # the same as the transforms
    }
    layout = {
        "configById": {SCENE: scene, EVENTS: {"topicToRender": "/log", "minLogLevel": 1}},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "column",
            "first": SCENE,
            "second": EVENTS,
            "splitPercentage": 75,
        },
    }
    return msgspec.json.format(msgspec.json.encode(layout)) + b"\n"


def write(foxglove: Path, rerun: Path) -> None:
    """Both files."""
    foxglove.write_bytes(foxglove_layout())
    blueprint.layout(formation=True, lanes=True, bounds=None).save(APPLICATION, str(rerun))


if __name__ == "__main__":
    write(FOXGLOVE, RERUN)
