"""What a recording says besides pixels: times, cameras and boxes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from recon.errors import RescoreError
from rescore.formats.bags.messages import camera_values, rows_of, stamp_ns
from rescore.formats.bags.reader import Bag
from rescore.formats.bags.topics import Topics
from rescore.formats.calibration_files import Calibration, calibration_of
from rescore.formats.calibrations.numbers import Values
from rescore.formats.calibrations.raw_pair import RawPair
from rescore.formats.labels import ClassMap, LabelRow


@dataclass(eq=False)
class Heard:
    """What the first reading of a recording keeps: all but pixels."""

    stamps: dict[str, list[int]]
    """Nanoseconds of each picture, by topic."""
    first: dict[str, Any] = field(default_factory=dict)
    """The first message of each topic of cameras."""
    boxes: list[list[LabelRow]] = field(default_factory=list)
    """Boxes of each message of detections."""
    box_ns: list[int] = field(default_factory=list)
    """Nanoseconds of each of these messages."""
    boxes_gone: int = 0
    unstamped: int = 0
    changed: int = 0
    """Messages of cameras that say another calibration than the first of their topic."""

    def notes(self, path: Path) -> tuple[str, ...]:
        """What the user is to see."""
        lines = []
        if self.unstamped:
            lines.append(
                f"{path}: {self.unstamped} messages without a time stamp have that of their recording"
            )
        if self.changed:
            lines.append(
                f"{path}: {self.changed} messages of camera_info differ from the first, which is used"
            )
        if self.boxes_gone:
            lines.append(f"{path}: left out {self.boxes_gone} detections without a size or a score")
        return tuple(lines)


def listen(bag: Bag, topics: Topics, classes: ClassMap) -> Heard:
    """What the messages of a recording say besides pixels.

    Raises:
        RescoreError: the recording is damaged.
    """
    found = Heard({topics.left: [], topics.right: []})
    for message in bag.messages(topics.all):
        read = message.read()
        stamp = stamp_ns(read)
        found.unstamped += stamp == 0
        time_ns = stamp or message.logged_ns
        if message.topic in (topics.left_info, topics.right_info):
            first = found.first.setdefault(message.topic, read)
            found.changed += not _same_camera(first, read)
        elif message.topic == topics.detections:
            rows, gone = rows_of(read, classes)
            found.boxes.append(rows)
            found.box_ns.append(time_ns)
            found.boxes_gone += gone
        else:
            found.stamps[message.topic].append(time_ns)
    return found


def _same_camera(first: Any, second: Any) -> bool:
    return all(np.array_equal(getattr(first, k), getattr(second, k)) for k in ("k", "d", "r", "p", "width"))


def values_of(path: Path, topics: Topics, heard: Heard) -> Values:
    """The two cameras; empty where the recording lacks one."""
    infos = [heard.first.get(t) for t in (topics.left_info, topics.right_info) if t is not None]
    return camera_values(path, *infos) if len(infos) == 2 and None not in infos else {}


def cameras(
    path: Path, topics: Topics, heard: Heard, *, as_taken: bool
) -> tuple[Calibration | None, RawPair | None]:
    """The rectified camera, or the cameras as they stand where pictures as taken are wanted.

    Raises:
        RescoreError: the pictures are rectified, and are to be as taken, or the other way round.
    """
    values = values_of(path, topics, heard)
    if not values:
        return None, None
    if as_taken:
        if topics.say_rectified:
            raise RescoreError(
                f"{path}: expected topics of pictures as taken to rectify, got "
                f"{topics.left}; leave --rectify out"
            )
        return None, RawPair.of(path, values)
    if topics.say_rectified:
        values = {k: v for k, v in values.items() if k in ("P1", "P2", "width", "height")}
    raw = RawPair.of(path, values)
    if raw is not None and raw.doubt:
        raise RescoreError(
            f"{path}: expected rectified pictures, got {topics.left} with {raw.doubt}; rectify by "
            f"`rescore import {path} --left {topics.left} --right {topics.right} --rectify --out NEW`, "
            "or name topics with image_rect"
        )
    return calibration_of(path, values), raw
