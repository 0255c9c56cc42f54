"""Is a data set whole, and do its numbers agree with its pictures?"""

import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from recon.errors import RescoreError
from rescore.data.frames import SPLITS, DataSet, FrameRecord, none_counts
from rescore.data.pictures import picture_size, turned_by_exif
from rescore.data.splits import Splits
from rescore.doctor.findings import Finding, Level
from rescore.doctor.pairs import examine_pairs
from rescore.files import digest_of
from rescore.formats.bags.reader import is_bag
from rescore.formats.bags.topics import Wanted
from rescore.formats.bags.unpack import unpacked
from rescore.formats.calibration_files import doubts
from rescore.formats.labels import ClassMap
from rescore.formats.open import read_dataset
from rescore.speech import counted


def examine_dataset(
    path: Path, class_name: str, max_frames: int, wanted: Wanted | None = None
) -> list[Finding]:
    """Findings on a data set: files, calibrations, boxes and splits of all frames, the pixels of some.

    Pixels are those of ``max_frames`` frames. Of a recording of ROS that many pairs of the topics ``wanted``
    are examined, and no others.
    """
    if not is_bag(path):
        return _examine(path, lambda: read_dataset(path, class_name), max_frames)
    with tempfile.TemporaryDirectory() as folder:
        classes, out, topics = ClassMap(class_name), Path(folder), wanted or Wanted()
        return _examine(path, lambda: unpacked(path, topics, classes, out, most=max_frames).data, max_frames)


def _examine(path: Path, read: Callable[[], DataSet], max_frames: int) -> list[Finding]:
    try:
        data = read()
    except RescoreError as error:
        return [Finding(Level.ERROR, "data set", str(error))]
    except OSError as error:
        return [Finding(Level.ERROR, str(error.filename or path), error.strerror or "cannot be read")]
    cars = data.n_cars
    counts = Counter(f.split for f in data.frames)
    said = ", ".join(f"{counts[s]} {s}" for s in SPLITS if counts[s])
    found = [
        Finding(
            Level.OK,
            str(path),
            f"{counted(len(data.frames), 'frame')} ({said}), {counted(cars, 'box')} of {data.category!r}",
        )
    ]
    if not data.frames:
        return [*found, Finding(Level.ERROR, str(path), "no frames", "add some")]
    calibration = _calibration(data)
    # the reader says the same of the calibration, frame by frame it is said here
    told = [n for n in data.notes if not any(f.what in n for f in calibration)]
    found += [Finding(Level.WARNING, "reader", note) for note in told]
    if not cars:
        found.append(_no_cars(data, str(path)))
    broken = _files(data.frames)
    advice = "boxes, depth and calibration must be of the stored pixels"
    turned = _grouped(Level.WARNING, advice, data.frames, _turned)
    found += broken + turned + calibration + _boxes(data) + _splits(data)
    whole = [f for f in data.frames if not _files([f])] if broken else list(data.frames)
    chosen = np.unique(np.linspace(0, len(whole) - 1, min(max_frames, len(whole))).astype(int))
    return found + examine_pairs(data, [whole[i] for i in chosen])


def _no_cars(data: DataSet, where: str) -> Finding:
    if data.n_ignored:
        return Finding(Level.WARNING, where, none_counts(data.n_ignored), "unmark those that are to count")
    return Finding(Level.WARNING, where, f"no boxes of {data.category!r}", "check --class")


def _grouped(
    level: Level, advice: str, frames: Sequence[FrameRecord], problem: Callable[[FrameRecord], str | None]
) -> list[Finding]:
    """One finding for a kind of problem: the first frame that has it, and how many frames have it."""
    places = [(f, text) for f in frames if (text := problem(f))]
    if not places:
        return []
    first, text = places[0]
    more = f" ({len(places)} of {len(frames)} frames have such)" if len(places) > 1 else ""
    return [Finding(level, f"image {first.image_id}", f"{text}{more}", advice)]


def _files(frames: Sequence[FrameRecord]) -> list[Finding]:
    return [
        *_grouped(Level.ERROR, "add it or mend its name", frames, _missing),
        *_grouped(Level.ERROR, "mend the sizes in the data set or the picture", frames, _wrong_size),
        *_grouped(Level.ERROR, "add a right picture or measured depth", frames, _no_depth),
    ]


def _missing(frame: FrameRecord) -> str | None:
    measured = frame.measurement.path if frame.measurement else None
    paths = [p for p in (frame.left_path, frame.right_path, measured) if p is not None]
    return next((f"no file {p}" for p in paths if not p.is_file()), None)


def _wrong_size(frame: FrameRecord) -> str | None:
    """Error text for the first picture that is there but not of the stated size, read from its head; else
    None."""
    for path in (frame.left_path, frame.right_path):
        if path is None or not path.is_file():
            continue
        try:
            width, height = picture_size(path)
        except RescoreError as error:
            return str(error)
        if (width, height) != (frame.width_px, frame.height_px):
            said = f"{frame.width_px} x {frame.height_px}"
            return f"{path} has {width} x {height} pixels{turned_by_exif(path)}, the data set says {said}"
    return None


def _turned(frame: FrameRecord) -> str | None:
    paths = [p for p in (frame.left_path, frame.right_path) if p is not None and p.is_file()]
    return next((f"{p} is used{told}" for p in paths if (told := turned_by_exif(p))), None)


def _no_depth(frame: FrameRecord) -> str | None:
    return None if frame.right_path or frame.measurement else "neither right picture nor measured depth"


def _calibration(data: DataSet) -> list[Finding]:
    found = []
    texts: dict[str, list[FrameRecord]] = {}
    serious: dict[str, bool] = {}
    for frame in data.frames:
        for doubt in doubts(frame.camera) if frame.camera else ():
            texts.setdefault(doubt.text, []).append(frame)
            serious[doubt.text] = doubt.serious
    for text, frames in texts.items():
        level = Level.ERROR if serious[text] else Level.WARNING
        where = f"image {frames[0].image_id}"
        found.append(
            Finding(level, where + (f" and {len(frames) - 1} more" if len(frames) > 1 else ""), text)
        )
    return found


def _boxes(data: DataSet) -> list[Finding]:
    def outside(frame: FrameRecord) -> str | None:
        boxes = data.truth[frame.image_id].xyxy_px
        gone = (boxes[:, :2] >= (frame.width_px, frame.height_px)).any(1) | (boxes[:, 2:] <= 0).any(1)
        return (
            f"{counted(int(gone.sum()), 'box')} outside the picture, as {boxes[gone][0].tolist()}"
            if gone.any()
            else None
        )

    def over(frame: FrameRecord) -> str | None:
        boxes = data.truth[frame.image_id].xyxy_px
        # a pixel beyond comes of rounding
        far = (boxes[:, :2] < -1).any(1) | (boxes[:, 2:] > (frame.width_px + 1, frame.height_px + 1)).any(1)
        return (
            f"{counted(int(far.sum()), 'box')} beyond the edge of the picture, as {boxes[far][0].tolist()}"
            if far.any()
            else None
        )

    def twice(frame: FrameRecord) -> str | None:
        boxes = [tuple(b) for b in data.truth[frame.image_id].xyxy_px.tolist()]
        same = [b for b, n in Counter(boxes).items() if n > 1]
        return f"box {list(same[0])} is there more than once" if same else None

    return [
        *_grouped(Level.ERROR, "mend bbox: left, top, width, height in pixels", data.frames, outside),
        *_grouped(
            Level.WARNING, "they are used as they are; clip them if that is not meant", data.frames, over
        ),
        *_grouped(Level.WARNING, "remove the copies", data.frames, twice),
    ]


def _splits(data: DataSet) -> list[Finding]:
    """Pictures in more than one split: by name, and by what is in the files."""
    try:
        Splits.of(data)
    except RescoreError as error:
        return [Finding(Level.ERROR, "splits", str(error))]
    if len({f.split for f in data.frames}) < 2:
        return []
    seen: dict[str, FrameRecord] = {}
    for frame in data.frames:
        digest = digest_of(frame.left_path)
        other = seen.setdefault(digest, frame) if digest else frame
        if other.split != frame.split:
            return [
                Finding(
                    Level.ERROR,
                    f"image {frame.image_id}",
                    f"in split {frame.split}, the same picture as image {other.image_id} in {other.split}",
                    "keep one of them",
                )
            ]
    return []
