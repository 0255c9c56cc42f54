"""Recordings of ROS 2 made data sets: pairs by their time stamps, cameras, and boxes of detectors."""

import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from recon.errors import RescoreError
from recon.files import atomic_path
from rescore.data.frames import DataSet, frame_names
from rescore.data.pictures import picture_size
from rescore.files import remove
from rescore.formats import coco
from rescore.formats.bags.heard import Heard, cameras, listen, values_of
from rescore.formats.bags.messages import picture_file
from rescore.formats.bags.pairs import MAX_NS_APART, BagPairs
from rescore.formats.bags.reader import Bag, opened
from rescore.formats.bags.topics import Topics, Wanted, chosen_topics
from rescore.formats.calibration_files import Calibration, refuse_other_size, size_of
from rescore.formats.calibrations.raw_pair import RawPair
from rescore.formats.calibrations.rectify import SIDES, rectified, refuse_pictures
from rescore.formats.folders import Layout, Pictures, data_set
from rescore.formats.labels import ClassMap
from rescore.formats.parts.manifest import refuse_data_set
from rescore.formats.time_pairs import nearest_pairs
from rescore.locks import locked
from rescore.speech import counted

DETECTIONS = "detections.json"
"""Name of the file of boxes that a recording's detector found."""


def import_bag(path: Path, wanted: Wanted, classes: ClassMap, out: Path, *, rectify: bool) -> DataSet:
    """The data set of a recording, with its pictures, and its boxes as detections, written to a folder.

    Args:
        path: File or folder of the recording.
        wanted: Topics to read.
        classes: The class of the detections to keep, and its other names.
        out: Folder to write to.
        rectify: Whether to rectify the pictures by the recorded calibration.

    Raises:
        RescoreError: the recording cannot be read, has no such pair, or one that is not rectified though
            ``rectify`` is not asked for.
    """
    take = _rectified if rectify else _as_recorded
    there = out.exists()
    try:
        return take(path, wanted, classes, out)
    except BaseException:
        if not there:
            with suppress(OSError):
                out.rmdir()
        raise


def _as_recorded(path: Path, wanted: Wanted, classes: ClassMap, out: Path) -> DataSet:
    with locked(out):
        _refuse_data(out)
        with _whole(out):
            found = unpacked(path, wanted, classes, out)
            if found.detections is None:
                return found.data
            table = found.detections.table
            coco.write_detections(out / DETECTIONS, "detections", table, found.data)
    told = f"{path}: wrote {len(table)} detections to {out / DETECTIONS}"
    return replace(found.data, notes=(*found.data.notes, told))


def _rectified(path: Path, wanted: Wanted, classes: ClassMap, out: Path) -> DataSet:
    _refuse_data(out)
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".as-taken-", dir=out) as folder:
        found = unpacked(path, wanted, classes, Path(folder), as_taken=True)
        if found.raw is None:
            raise RescoreError(
                f"{path}: expected camera_info of both cameras to rectify by, got none; import the pictures "
                "without --rectify"
            )
        boxes = 0 if found.detections is None else len(found.detections.table)
        told = (f"{path}: left out {counted(boxes, 'detection')} made on pictures as taken",) if boxes else ()
        data = replace(found.data, root=out, notes=(*found.data.notes, *told))
        return rectified(data, found.raw, path, out)


def _refuse_data(out: Path) -> None:
    """Raises RescoreError where a folder holds a data set already."""
    refuse_pictures(out)
    refuse_data_set(out, DETECTIONS)


@contextmanager
def _whole(out: Path) -> Iterator[None]:
    """Inside, pictures are written to a folder; none is left there if that fails."""
    try:
        yield
    except BaseException:
        for side in SIDES:
            remove(out / side)
        raise


@dataclass(frozen=True, eq=False)
class Unpacked:
    """What a recording holds, with its pictures in a folder."""

    data: DataSet
    """Without boxes: those of a recording are a detector's."""
    detections: coco.DetectionFile | None
    """None where the recording has no such topic."""
    raw: RawPair | None
    """The cameras as they stand; None where the recording does not say."""


def unpacked(
    path: Path,
    wanted: Wanted,
    classes: ClassMap,
    out: Path,
    *,
    as_taken: bool = False,
    most: int | None = None,
) -> Unpacked:
    """A recording with its pictures written to ``left`` and ``right`` of a folder.

    Pictures pair by the stamps of their headers, at most ``MAX_SECONDS_APART`` apart, and are named by the
    left one in seconds. What is left out is counted in the notes.

    Args:
        path: File or folder of the recording.
        wanted: Topics to read.
        classes: The class of the detections to keep, and its other names.
        out: Folder to write to.
        as_taken: Whether pictures that are not rectified are wanted.
        most: Pairs to write, evenly spread; all if None.

    Raises:
        RescoreError: the recording cannot be read, has no pair, or one that is rectified or not against what
            is asked for.
    """
    with opened(path) as bag:
        topics = chosen_topics(path, bag.types, wanted)
        heard = listen(bag, topics, classes)
        calibration, raw = cameras(path, topics, heard, as_taken=as_taken)
        pairs = BagPairs.of(path, topics, heard)
        chosen = pairs.spread(most)
        written = _written(bag, topics, chosen, out)
    if as_taken:
        values = values_of(path, topics, heard)
        refuse_other_size(path, size_of(path, values), picture_size(written[0][0]))
    told = [*topics.notes, *heard.notes(path), *pairs.notes]
    if len(chosen) < len(pairs.names):
        told.append(f"{path}: {len(chosen)} of {len(pairs.names)} pairs are read, evenly spread")
    if len(written) < len(chosen):
        told.append(f"{path}: left out {len(chosen) - len(written)} pairs with a damaged picture")
    data = _data_set(path, out, written, calibration, classes, told)
    if topics.detections is None:
        return Unpacked(data, None, raw)
    detections, more = _detections(path, data, pairs, heard, classes)
    return Unpacked(replace(data, notes=(*data.notes, *more)), detections, raw)


def _data_set(
    path: Path,
    out: Path,
    written: Sequence[tuple[Path, Path]],
    calibration: Calibration | None,
    classes: ClassMap,
    notes: Sequence[str],
) -> DataSet:
    pictures = [
        Pictures(left.stem, left, right, None, calibration, path if calibration else None)
        for left, right in written
    ]
    split = dict.fromkeys([p.stem for p in pictures], "test")
    return data_set(Layout(out, pictures), classes, split, [[] for _ in pictures], notes)


def _written(
    bag: Bag, topics: Topics, names: Mapping[tuple[int, int], str], out: Path
) -> list[tuple[Path, Path]]:
    """Left and right pictures of the named pairs, which are written.

    Pairs with a damaged picture are left out.

    Raises:
        RescoreError: the pixels are of a kind that is not read, or all pictures are damaged.
    """
    wanted = {(topics.left, a): (SIDES[0], name) for (a, _), name in names.items()}
    wanted |= {(topics.right, b): (SIDES[1], name) for (_, b), name in names.items()}
    found: dict[tuple[str, str], Path] = {}
    for message in bag.messages((topics.left, topics.right)):
        place = wanted.get((message.topic, message.number))
        file = place and picture_file(f"{bag.path}: {message.topic}", message.read())
        if place and file:
            path = out / place[0] / f"{place[1]}{file[0]}"
            with atomic_path(path) as beside:
                beside.write_bytes(file[1])
            found[place] = path
    for side, name in list(found):
        if not all((s, name) in found for s in SIDES):
            found.pop((side, name)).unlink()
    if not found:
        raise RescoreError(f"{bag.path}: expected pictures, got damaged ones alone; record it again")
    left, right = SIDES
    return [(found[left, name], found[right, name]) for name in names.values() if (left, name) in found]


def _detections(
    path: Path, data: DataSet, pairs: BagPairs, heard: Heard, classes: ClassMap
) -> tuple[coco.DetectionFile, tuple[str, ...]]:
    """The boxes of the class on the frames, and what to say of the others."""
    ids = {name: image_id for image_id, name in frame_names(data).items()}
    names = list(pairs.left_ns)
    found = nearest_pairs(list(pairs.left_ns.values()), heard.box_ns, MAX_NS_APART)
    rows = [(ids[names[i]], row) for i, j in found.items() if names[i] in ids for row in heard.boxes[j]]
    strangers = len(heard.boxes) - len(found)
    told = (f"{path}: left out {strangers} messages of detections of no pair",) if strangers else ()
    counts = Counter(row.name for _, row in rows)
    kept = []
    for image_id, row in rows:
        if classes.takes(row.name) and row.score is not None:
            x0, y0, x1, y1 = row.xyxy_px
            kept.append(coco.Detection(image_id=image_id, bbox=(x0, y0, x1 - x0, y1 - y0), score=row.score))
    return coco.detection_file(path, [kept], data, None, classes), (*told, *classes.notes(path, counts))
