"""Topics of a recording: the pair, its calibration and the detections."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from recon.errors import RescoreError

PICTURES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA = "sensor_msgs/msg/CameraInfo"
DETECTIONS = "vision_msgs/msg/Detection2DArray"
_DEPTH = "/compressedDepth"
"""End of the topics that ROS advertises beside those of any pictures, for depth alone."""
_RECTIFIED = re.compile(r"(?<![a-z])rect", re.IGNORECASE)
"""What the name of a topic of rectified pictures holds."""


@dataclass(frozen=True)
class Wanted:
    """Topics as a person names them; None for those that are to be found."""

    left: str | None = None
    right: str | None = None
    detections: str | None = None


@dataclass(frozen=True)
class Topics:
    """The topics of a recording that are read."""

    left: str
    right: str
    left_info: str | None
    """Topic of the left camera's calibration; None where there is none."""
    right_info: str | None
    detections: str | None
    """None where there are none."""
    notes: tuple[str, ...] = ()
    """What the user is to see."""

    @property
    def all(self) -> list[str]:
        """Every topic that is read."""
        return [
            t
            for t in (self.left, self.right, self.left_info, self.right_info, self.detections)
            if t is not None
        ]

    @property
    def say_rectified(self) -> bool:
        """Whether the names say that the pictures are rectified, as ROS has it."""
        return all(_RECTIFIED.search(t) for t in (self.left, self.right))


def chosen_topics(path: Path, types: Mapping[str, str], wanted: Wanted) -> Topics:
    """The topics to read.

    Args:
        path: The recording, for errors.
        types: Type of message of each topic.
        wanted: What a person names.

    Raises:
        RescoreError: a named topic is not there or of another type, or there is not exactly one pair.
    """
    pictures = sorted(t for t, kind in types.items() if kind in PICTURES and not t.endswith(_DEPTH))
    left, right = _pair(path, pictures, wanted)
    info = [_info(topic, types) for topic in (left, right)]
    if info[0] == info[1]:
        # one calibration above both is that of neither
        info = [None, None]
    detections, notes = _detections(path, types, wanted.detections)
    return Topics(left, right, info[0], info[1], detections, notes)


def _pair(path: Path, pictures: Collection[str], wanted: Wanted) -> tuple[str, str]:
    left, right = (
        None if name is None else _named(path, option, name, pictures, "pictures")
        for option, name in (("--left", wanted.left), ("--right", wanted.right))
    )
    if left is not None and right is not None:
        pairs = [(left, right)] if left != right else []
    else:
        every = sorted((a, b) for a in pictures for b in _other_side(a) if b in pictures)
        pairs = [p for p in every if left in (None, p[0]) and right in (None, p[1])]
    if len(pairs) != 1:
        told = [f"{a} and {b}" for a, b in pairs] or pictures
        raise RescoreError(
            f"{path}: expected one pair of topics of left and right pictures, found {len(pairs)}; name them "
            f"by --left and --right: {'; '.join(told) or 'no topic has pictures'}"
        )
    return pairs[0]


def _named(path: Path, option: str, name: str, there: Collection[str], what: str) -> str:
    topic = f"/{name.lstrip('/')}"
    if topic not in there:
        raise RescoreError(
            f"{path}: {option}: expected a topic of {what} ({', '.join(there) or 'there is none'}), got "
            f"{name!r}; name one of these"
        )
    return topic


def _other_side(topic: str) -> list[str]:
    """The names that differ in one "left" alone, which is "right" in them."""
    places = re.finditer("left", topic, re.IGNORECASE)
    words = {"left": "right", "Left": "Right", "LEFT": "RIGHT"}
    return [topic[: m.start()] + words[m[0]] + topic[m.end() :] for m in places if m[0] in words]


def _info(topic: str, types: Mapping[str, str]) -> str | None:
    """The calibration nearest above a topic of pictures."""
    parts = topic.split("/")
    names = ("/".join([*parts[:n], "camera_info"]) for n in range(len(parts), 0, -1))
    return next((name for name in names if types.get(name) == CAMERA), None)


def _detections(
    path: Path, types: Mapping[str, str], wanted: str | None
) -> tuple[str | None, tuple[str, ...]]:
    there = sorted(t for t, kind in types.items() if kind == DETECTIONS)
    if wanted is not None:
        return _named(path, "--detections", wanted, there, DETECTIONS), ()
    if len(there) > 1:
        return None, (f"{path}: left out detections of {', '.join(there)}; name one by --detections",)
    return (there[0] if there else None), ()
