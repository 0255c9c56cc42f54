"""Recordings of ROS 2, written with rosbags, for tests to read and to break."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rescore.formats.bags.reader import VISION_MESSAGES
from tests.rescore import own_data as own

STORE = get_typestore(Stores.ROS2_JAZZY)
for name, text in VISION_MESSAGES.items():
    STORE.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))
TYPES = STORE.types
LEFT, RIGHT = "/cam/left/image_rect", "/cam/right/image_rect"
START_NS = 1_700_000_000 * 10**9
STORAGES = [StoragePlugin.SQLITE3, StoragePlugin.MCAP]


def made(name: str, **values: Any) -> Any:
    package, _, short = name.partition("/")
    return TYPES[f"{package}/msg/{short}"](**values)


def header(ns: int) -> Any:
    stamp = made("builtin_interfaces/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    return made("std_msgs/Header", stamp=stamp, frame_id="cam")


def raw(ns: int, pixels: NDArray[np.uint8], encoding: str, padding: int = 0) -> Any:
    """A message of raw pixels (h, w) or (h, w, c), with some bytes behind each row."""
    height, width = pixels.shape[:2]
    rows = np.pad(pixels.reshape(height, -1), ((0, 0), (0, padding)), constant_values=99)
    return made(
        "sensor_msgs/Image",
        header=header(ns),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=rows.shape[1],
        data=rows.ravel(),
    )


def packed(ns: int, content: bytes, form: str) -> Any:
    data = np.frombuffer(content, np.uint8)
    return made("sensor_msgs/CompressedImage", header=header(ns), format=form, data=data)


def info(
    k: NDArray[Any],
    p: NDArray[Any],
    *,
    d: Sequence[float] = (),
    r: NDArray[Any] | None = None,
    size: tuple[int, int] = (own.WIDTH, own.HEIGHT),
) -> Any:
    roi = made("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return made(
        "sensor_msgs/CameraInfo",
        header=header(START_NS),
        height=size[1],
        width=size[0],
        distortion_model="plumb_bob",
        d=np.array(d, float),
        k=np.asarray(k, float).ravel(),
        r=(np.eye(3) if r is None else r).ravel(),
        p=np.asarray(p, float).ravel(),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


K = np.array([[own.FX, 0, 48], [0, own.FX, 32], [0, 0, 1]])


def infos(**options: Any) -> dict[str, list[Any]]:
    """Both messages of camera_info of the pairs of ``own_data``."""
    found = {}
    for side, shift in (("left", 0.0), ("right", -own.FX * own.BASELINE_M)):
        p = np.column_stack([K, [shift, 0, 0]])
        found[f"/cam/{side}/camera_info"] = [info(K, p, **options)]
    return found


def boxes(ns: int, found: Sequence[tuple[str, float, tuple[float, ...]]], turned_rad: float = 0.0) -> Any:
    """A message of detections: class, score and x, y of the middle, width and height of each."""
    pose = made(
        "geometry_msgs/PoseWithCovariance",
        pose=made(
            "geometry_msgs/Pose",
            position=made("geometry_msgs/Point", x=0.0, y=0.0, z=0.0),
            orientation=made("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        ),
        covariance=np.zeros(36),
    )
    rows = []
    for name, score, (x, y, width, height) in found:
        middle = made("vision_msgs/Point2D", x=x, y=y)
        centre = made("vision_msgs/Pose2D", position=middle, theta=turned_rad)
        told = [("person", 0.01), (name, score)]
        results = [
            made(
                "vision_msgs/ObjectHypothesisWithPose",
                hypothesis=made("vision_msgs/ObjectHypothesis", class_id=c, score=s),
                pose=pose,
            )
            for c, s in told
        ]
        box = made("vision_msgs/BoundingBox2D", center=centre, size_x=width, size_y=height)
        rows.append(made("vision_msgs/Detection2D", header=header(ns), results=results, bbox=box, id=""))
    return made("vision_msgs/Detection2DArray", header=header(ns), detections=rows)


def pictures(times_ms: Sequence[float], right_ms: Sequence[float], **options: Any) -> dict[str, list[Any]]:
    """Raw grey pairs of ``own_data``, number i of seed i, at times of left and right."""
    found: dict[str, list[Any]] = {}
    for side, (topic, times) in enumerate(((LEFT, times_ms), (RIGHT, right_ms))):
        found[topic] = [
            raw(START_NS + round(ms * 10**6), own.pair(i)[side], "mono8") for i, ms in enumerate(times)
        ]
    return found


def write_bag(path: Path, topics: Mapping[str, Sequence[Any]], storage: StoragePlugin = STORAGES[0]) -> Path:
    """A recording: a folder with metadata.yaml and the file of messages, each logged 1 s after its stamp."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        rows = []
        for topic, messages in topics.items():
            kind = messages[0].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for m in messages:
                ns = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
                rows.append((ns + 10**9, connection, STORE.serialize_cdr(m, kind)))
        for ns, connection, data in sorted(rows, key=lambda row: row[0]):
            writer.write(connection, ns, data)
    return path
