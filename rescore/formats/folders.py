"""Data sets as folders of pictures: from pictures, calibrations and boxes to frames and truth."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from recon.camera import StereoCamera
from recon.errors import RescoreError
from rescore.data.depth_files import MeasuredFile, Quantity
from rescore.data.frames import SPLITS, DataSet, FrameRecord
from rescore.data.pictures import picture_size
from rescore.formats.calibration_files import Calibration, doubts
from rescore.formats.labels import ClassMap, LabelRow, image_ids, read_lines, truth_of


@dataclass(frozen=True)
class Pictures:
    """What a folder has of one frame."""

    stem: str
    """Name of the frame without suffix, by which files of boxes and splits know it."""
    left: Path
    right: Path | None
    measured: MeasuredFile | None
    calibration: Calibration | None
    calibration_path: Path | None
    """Path of the calibration file, named in errors."""

    def camera(self, width_px: int, height_px: int) -> StereoCamera | None:
        """The camera for pictures of a size, None where there is no calibration."""
        if self.calibration is None or self.calibration_path is None:
            return None
        measures_depth = self.measured is not None and self.measured.quantity is Quantity.DEPTH
        return self.calibration.camera(
            self.calibration_path, width_px, height_px, measures_depth=measures_depth
        )


@dataclass(frozen=True)
class Layout:
    """The frames of a folder, in the order of their names."""

    root: Path
    pictures: Sequence[Pictures]


def data_set(
    layout: Layout,
    classes: ClassMap,
    split: Mapping[str, str],
    rows: Sequence[Sequence[LabelRow]],
    notes: Sequence[str],
) -> DataSet:
    """Frames and truth of a layout; frames that ``split`` does not name are left out.

    Args:
        layout: The pictures.
        classes: For the name of the class.
        split: Split by the name of the frame.
        rows: The boxes of every frame of the layout.
        notes: What the reader has to say.
    """
    frames, truth, first_id = [], {}, 1
    ids = image_ids([p.stem for p in layout.pictures])
    for image_id, pictures, own in zip(ids, layout.pictures, rows, strict=True):
        if pictures.stem not in split:
            continue
        frames.append(_frame(image_id, pictures, split[pictures.stem]))
        truth[image_id] = truth_of(own, first_id)
        first_id += len(own)
    return DataSet(
        layout.root,
        1,
        classes.target,
        tuple(frames),
        truth,
        (*notes, *calibration_notes(frames, layout.root)),
    )


def _frame(image_id: int, pictures: Pictures, split: str) -> FrameRecord:
    width, height = picture_size(pictures.left)
    return FrameRecord(
        image_id=image_id,
        left_path=pictures.left,
        right_path=pictures.right,
        disparity_path=None,
        split=split,
        width_px=width,
        height_px=height,
        camera=pictures.camera(width, height),
        ground=None,
        measured=pictures.measured,
        disparity_offset_px=pictures.calibration.disparity_offset_px if pictures.calibration else 0.0,
    )


def calibration_notes(frames: Sequence[FrameRecord], where: Path) -> tuple[str, ...]:
    """What is unlikely about the calibrations of frames, each kind once with the number of its frames."""
    found: Counter[str] = Counter(d.text for f in frames if f.camera for d in doubts(f.camera))
    without = sum(f.camera is None for f in frames)
    if without:
        found["no calibration, so depth is known but for scale; add one"] = without
    return tuple(f"{where}: {n} of {len(frames)} frames: {text}" for text, n in found.items())


def splits_of(root: Path, stems: Sequence[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Split of each frame by its stem, from ImageSets/<split>.txt, and notes for the user.

    ``val.txt`` is the split validation. All frames are in split "test" where there are no such files.

    Raises:
        RescoreError: a file names an unknown frame, or two name the same.
    """
    names = {"val": "validation"} | {s: s for s in SPLITS}
    files = {root / "ImageSets" / f"{name}.txt": split for name, split in names.items()}
    found = {path: split for path, split in files.items() if path.is_file()}
    if not found:
        return dict.fromkeys(stems, "test"), ()
    known = set(stems)
    split_of: dict[str, str] = {}
    for path, split in found.items():
        for where, words in read_lines(path):
            if words[0] not in known:
                raise RescoreError(f"{where}: expected the name of a picture, got {words[0]!r}; remove it")
            if split_of.setdefault(words[0], split) != split:
                raise RescoreError(
                    f"{where}: {words[0]!r} is in split {split_of[words[0]]} and in {split}; give it to one"
                )
    rest = len(known) - len(split_of)
    return split_of, (f"{root / 'ImageSets'}: left out {rest} frames of no split",) if rest else ()
