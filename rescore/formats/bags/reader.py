"""A recording of ROS 2 read message by message."""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.errors import RescoreError
from recon.reading import reading

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys.store import Typestore

SUFFIXES = (".mcap", ".db3")
"""Ends of the names of files of messages."""
_ROS1 = ".bag"
_WHAT = "a recording of ROS 2"
_ADVICE = "record it again, or mend it by `ros2 bag reindex`"
VISION_MESSAGES = {
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "Point2D": "float64 x\nfloat64 y",
    "Pose2D": "Point2D position\nfloat64 theta",
    "BoundingBox2D": "Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "Detection2D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\n"
    "string id",
    "Detection2DArray": "std_msgs/Header header\nDetection2D[] detections",
}
"""Fields of vision_msgs 4, for recordings that hold no definitions, as those of ROS 2 Humble."""


@dataclass(frozen=True)
class Message:
    """One message of a recording."""

    topic: str
    number: int
    """Messages of its topic before it."""
    logged_ns: int
    """When it was recorded."""
    read: Callable[[], Any]
    """Gives its fields as ROS names them.

    Raises:
        RescoreError: it is not of the type of its topic.
    """


class Bag:
    """An open recording."""

    def __init__(self, path: Path, reader: "AnyReader") -> None:
        self.path, self._reader = path, reader

    @property
    def types(self) -> dict[str, str]:
        """Type of message of each topic, as ``sensor_msgs/msg/Image``."""
        return {c.topic: c.msgtype for c in self._reader.connections}

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """The messages of some topics in the order of their recording; there must be one topic at least.

        Raises:
            RescoreError: the recording is damaged.
        """
        wanted = [c for c in self._reader.connections if c.topic in topics]
        heard = dict.fromkeys(topics, 0)
        with reading(self.path, _WHAT, _ADVICE):
            for connection, logged_ns, data in self._reader.messages(wanted):
                number = heard[connection.topic]
                heard[connection.topic] += 1
                yield Message(connection.topic, number, logged_ns, partial(self._fields, connection, data))

    def _fields(self, connection: Any, data: bytes) -> Any:
        advice = "check which version of ROS wrote it"
        with reading(f"{self.path}: {connection.topic}", f"messages of {connection.msgtype}", advice):
            return self._reader.deserialize(data, connection.msgtype)


def is_bag(path: Path) -> bool:
    """Whether a path is that of a recording: a file by its name, a folder by what is in it."""
    if path.is_dir():
        inside = list(path.iterdir())
        # a folder of pictures may have a recording beside them
        described = (path / "metadata.yaml").is_file() or not any(p.is_dir() for p in inside)
        return described and any(_plain_suffix(p) in SUFFIXES for p in inside if p.is_file())
    return path.suffix.lower() in (*SUFFIXES, _ROS1) and path.is_file()


def _plain_suffix(path: Path) -> str:
    # rosbag2 compresses whole files so
    name = path.with_suffix("") if path.suffix == ".zstd" else path
    return name.suffix.lower()


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """An open recording, from a file or a folder.

    Raises:
        RescoreError: rosbags is not installed, or it cannot read the recording.
    """
    if path.suffix.lower() == _ROS1:
        raise RescoreError(
            f"{path}: expected {_WHAT}, got one of ROS 1; convert it by "
            f"`rosbags-convert --src {path.name} --dst NEW`"
        )
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an optional package
    except ImportError as error:
        raise RescoreError(
            f"{path}: expected the package rosbags, which reads recordings of ROS, found none; run "
            "`make setup`, or `pip install rosbags`"
        ) from error
    source = _source(path)
    with reading(path, _WHAT, _ADVICE):
        reader = AnyReader([source], default_typestore=_humble())
        reader.open()
    try:
        yield Bag(path, reader)
    finally:
        reader.close()


def _source(path: Path) -> Path:
    """What rosbags is to open: the folder of a recording, or its only file where nothing describes it."""
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return path
    files = sorted(p for p in path.iterdir() if p.is_file() and p.suffix.lower() in SUFFIXES)
    if len(files) != 1:
        raise RescoreError(
            f"{path}: expected metadata.yaml or one file of messages, got {len(files)} such files; "
            "run `ros2 bag reindex`"
        )
    return files[0]


def _humble() -> "Typestore":
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - optional

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in VISION_MESSAGES.items():
        store.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    return store
