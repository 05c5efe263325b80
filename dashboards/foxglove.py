"""Extra channels that Foxglove and Rerun draw by themselves when they open the MCAP.

    TickRecord --one message per kind--> /tf, /poses, /bodies, /scans, /obstacles, /movers, /log

Schemas and encoders are Foxglove's own. Poses and transforms are hundreds of small objects per tick
for a large swarm (4 and 6 us per robot), so those two are encoded once and afterwards only the
numbers in the bytes are replaced, and a cloud is its stamp, what never changes, and its points:
the same bytes as Foxglove's for a tenth of the time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil

import foxglove.messages as fm
import numpy as np
import numpy.typing as npt

from dashboards import plots, snapshot, stage
from swarm import geometry, messages, movers
from swarm.geometry import Floats, Vec2
from swarm.messages import TickRecord
from swarm.movers import Mover
from swarm.recording import Channel
from swarm.scenario import Obstacle, Scenario

FRAME = "world"
OBSTACLES_TICKS = 25  # they stand still; a viewer that jumps into the run finds them soon
OUTLINE_STEP_M = 0.1  # between points of an obstacle's outline
BODY_POINTS = (16, 8)  # of a body's rim in a small and in a large swarm
NOSE_POINTS = (5, 2)  # from its centre to the rim
RISE_M = 0.05  # bodies above scans above obstacles, when seen from above

Bytes = npt.NDArray[np.uint8]
Cloud = npt.NDArray[np.float32]  # (..., 4): x_m, y_m, z_m, colour's bytes

_POINT_BYTES = 16  # x, y, z as float32, then red, green, blue, alpha
_NUMBER = fm.PackedElementFieldNumericType
_FIELDS = [
    *(
        fm.PackedElementField(name=name, offset=4 * place, type=_NUMBER.Float32)
        for place, name in enumerate(("x", "y", "z"))
    ),
    *(
        fm.PackedElementField(name=name, offset=12 + place, type=_NUMBER.Uint8)
        for place, name in enumerate(("red", "green", "blue", "alpha"))
    ),
]
_LEVELS = {
    "INFO": fm.LogLevel.Info,
    "WARN": fm.LogLevel.Warning,
    "ERROR": fm.LogLevel.Error,
}


def channels(scenario: Scenario, obstacles: tuple[Obstacle, ...]) -> tuple[Channel, ...]:
    """Channels for `recording.Writer`; each gives at most one message per tick."""
    names = [robot.name for robot in scenario.robots]
    transforms = _Template(
        lambda numbers, stamp: fm.FrameTransforms(
            transforms=[
                fm.FrameTransform(
                    timestamp=stamp,
                    parent_frame_id=FRAME,
                    child_frame_id=name,
                    translation=fm.Vector3(x=x, y=y),
                    rotation=fm.Quaternion(z=z, w=w),
                )
                for name, (x, y, z, w) in zip(names, numbers, strict=True)
            ]
        ).encode()
    )
    poses = _Template(
        lambda numbers, stamp: fm.PosesInFrame(
            timestamp=stamp,
            frame_id=FRAME,
            poses=[
                fm.Pose(position=fm.Vector3(x=x, y=y), orientation=fm.Quaternion(z=z, w=w))
                for x, y, z, w in numbers
            ],
        ).encode()
    )
    bodies = _bodies(scenario)
    still = _outlines(obstacles)
    stride = snapshot.scan_ticks(len(names))

    def scans(record: TickRecord) -> bytes | None:
        if record.tick % stride:
            return None
        return _cloud(record, _points(snapshot.scan(record), stage.SCAN, RISE_M))

    def standing(record: TickRecord) -> bytes | None:
        return _cloud(record, still) if record.tick % OBSTACLES_TICKS == 0 and len(still) else None

    found = (
        _channel("/tf", fm.FrameTransforms, lambda r: transforms.encode(r)),
        _channel("/poses", fm.PosesInFrame, lambda r: poses.encode(r)),
        _channel("/bodies", fm.PointCloud, lambda r: _cloud(r, bodies(snapshot.motion(r)))),
        _channel("/scans", fm.PointCloud, scans),
        _channel("/obstacles", fm.PointCloud, standing),
        _channel("/log", fm.Log, lambda r: _log(r) if r.events else None),
    )
    some = movers.moving(obstacles)
    if not some:
        return found

    def passing(record: TickRecord) -> bytes:
        return _cloud(record, _rims(some, record.tick * scenario.dt_s))

    return (*found, _channel("/movers", fm.PointCloud, passing))


def _channel(
    topic: str,
    message: type[fm.FrameTransforms | fm.PosesInFrame | fm.PointCloud | fm.Log],
    encode: Callable[[TickRecord], bytes | None],
) -> Channel:
    schema = message.get_schema()
    return Channel(topic, schema.name, schema.encoding, schema.data, "protobuf", encode)


# --- poses ----------------------------------------------------------------------------------------


class _Template:
    """A message whose bytes stay where they are while its numbers change.

    Encoded once by Foxglove with marks for numbers, which are then looked up in the bytes. The
    stamp is a varint: for each of the few lengths that it can have there is a template.
    """

    def __init__(self, encode: Callable[[Floats, fm.Timestamp], bytes]) -> None:
        self._encode = encode
        self._known: dict[int, tuple[Bytes, npt.NDArray[np.intp], npt.NDArray[np.intp]]] = {}

    def encode(self, record: TickRecord) -> bytes:
        """Bytes of the message for the poses and the stamp of a record."""
        stamp = _stamp_bytes(record.stamp_ns)
        numbers = snapshot.placements(record)
        if len(stamp) not in self._known:
            self._known[len(stamp)] = self._learn(numbers.shape, record.stamp_ns, stamp)
        template, stamps_at, numbers_at = self._known[len(stamp)]
        result = template.copy()
        result[stamps_at] = np.frombuffer(stamp, np.uint8)
        result[numbers_at] = numbers.view(np.uint8).reshape(-1, 8)
        return result.tobytes()

    def _learn(
        self, shape: tuple[int, ...], stamp_ns: int, stamp: bytes
    ) -> tuple[Bytes, npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        marks = np.random.Generator(np.random.Philox(1)).random(shape)
        data = self._encode(marks, _timestamp(stamp_ns))
        number_places: list[int] = []
        place = 0
        for mark in marks.ravel():  # in the order of the message
            place = data.index(mark.tobytes(), place)
            number_places.append(place)
        stamp_places: list[int] = []
        framed = bytes([0x0A, len(stamp)]) + stamp  # field 1 of its message
        found = data.find(framed)
        while found >= 0 and stamp:
            stamp_places.append(found + 2)
            found = data.find(framed, found + len(framed))
        return (
            np.frombuffer(data, np.uint8),
            np.add.outer(np.array(stamp_places, np.intp), np.arange(len(stamp))),
            np.add.outer(np.array(number_places, np.intp), np.arange(8)),
        )


def _timestamp(stamp_ns: int) -> fm.Timestamp:
    return fm.Timestamp(sec=stamp_ns // 1_000_000_000, nsec=stamp_ns % 1_000_000_000)


def _stamp_bytes(stamp_ns: int) -> bytes:
    """google.protobuf.Timestamp: seconds = 1, nanos = 2, each left out when zero."""
    seconds, nanos = divmod(stamp_ns, 1_000_000_000)
    return (b"\x08" + _varint(seconds) if seconds else b"") + (
        b"\x10" + _varint(nanos) if nanos else b""
    )


def _varint(number: int) -> bytes:
    result = bytearray()
    while number > 0x7F:
        result.append(number & 0x7F | 0x80)
        number >>= 7
    result.append(number)
    return bytes(result)


# --- clouds ---------------------------------------------------------------------------------------


def _bodies(scenario: Scenario) -> Callable[[Floats], Cloud]:
    """Rim and nose of every robot as points in its colour, (robots * points, 4)."""
    large = len(scenario.robots) > snapshot.DETAIL_ROBOTS
    rim = _ring(BODY_POINTS[large])
    nose = np.linspace((0.0, 0.0), (1.0, 0.0), NOSE_POINTS[large])
    radii_m = np.array([robot.body_radius_m for robot in scenario.robots])
    ahead, left = np.moveaxis(radii_m[:, None, None] * np.concatenate([rim, nose]), 2, 0)
    template = np.empty((*ahead.shape, 4), "<f4")
    template[:, :, 2] = 2.0 * RISE_M
    template[:, :, 3] = _as_number(stage.colours(scenario))[:, None]
    stopped_colour = _as_number(np.array([stage.STOPPED], np.uint32))

    def draw(motion: Floats) -> Cloud:
        yaw_rad = motion[:, snapshot.YAW, None]
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        points = template.copy()
        points[:, :, 0] = motion[:, snapshot.X, None] + cos * ahead - sin * left
        points[:, :, 1] = motion[:, snapshot.Y, None] + sin * ahead + cos * left
        stopped = (motion[:, snapshot.ALIVE] == 0.0) | (motion[:, snapshot.CONTACT] != 0.0)
        points[stopped, :, 3] = stopped_colour
        return points

    return draw


def _outlines(obstacles: Sequence[Obstacle]) -> Cloud:
    pieces: list[Floats] = [np.empty((0, 2))]
    for obstacle in obstacles:
        if obstacle.path is not None:
            continue
        if obstacle.circle is not None:
            x, y, radius_m = obstacle.circle
            pieces.append(_rim((x, y), radius_m))
        else:
            corners = np.array(obstacle.polygon)
            for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                length_m = geometry.length(*(end - start))
                along = np.linspace(0.0, 1.0, max(2, ceil(length_m / OUTLINE_STEP_M)))
                pieces.append(start + along[:, None] * (end - start))
    return _points(np.concatenate(pieces), stage.OBSTACLE_EDGE, 0.0)


def _rims(some: Sequence[Mover], time_s: float) -> Cloud:
    """Those that move, where they are then."""
    rims = [_rim(movers.place(mover, time_s), mover.radius_m) for mover in some]
    return _points(np.concatenate(rims), stage.OBSTACLE_EDGE, 0.0)


def _rim(centre: Vec2, radius_m: float) -> Floats:
    count = max(8, ceil(geometry.TAU * radius_m / OUTLINE_STEP_M))
    return np.array(centre) + radius_m * _ring(count)


def _ring(count: int) -> Floats:
    """(count, 2) unit vectors."""
    return np.array([geometry.unit(angle_rad) for angle_rad in geometry.sector_centres(count)])


def _points(positions: Floats, colour: int, height_m: float) -> Cloud:
    points = np.empty((len(positions), 4), "<f4")
    points[:, :2] = positions
    points[:, 2] = height_m
    points[:, 3] = _as_number(np.array([colour], np.uint32))
    return points


def _as_number(colours: stage.Colours) -> Cloud:
    """(colours,) the bytes red, green, blue, alpha taken for a float32; only ever copied."""
    return colours.astype(">u4").view("<f4")


_CLOUD = fm.PointCloud(
    frame_id=FRAME,
    pose=fm.Pose(position=fm.Vector3(), orientation=fm.Quaternion(w=1.0)),
    point_stride=_POINT_BYTES,
    fields=_FIELDS,
).encode()


def _cloud(record: TickRecord, points: Cloud) -> bytes:
    """A PointCloud: stamp (field 1), what never changes, data (field 6), as Foxglove has them."""
    stamp, data = _stamp_bytes(record.stamp_ns), points.tobytes()
    head = bytes([0x0A, len(stamp)]) + stamp + _CLOUD
    return head + b"\x32" + _varint(len(data)) + data if data else head


# --- events ---------------------------------------------------------------------------------------


def _log(record: TickRecord) -> bytes:
    """All events of a tick in one message, at the level of the worst."""
    levels = [messages.level_of(event.kind).upper() for event in record.events]
    worst = max(levels, key=list(_LEVELS).index)
    return fm.Log(
        timestamp=_timestamp(record.stamp_ns),
        level=_LEVELS[worst],
        message="\n".join(map(plots.event_text, record.events)),
        name="swarm",
    ).encode()
