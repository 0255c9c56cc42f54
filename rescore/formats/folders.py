"""Data sets as folders of pictures: from pictures, calibrations and boxes to frames and truth."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from recon.camera import DepthCamera, StereoCamera
from recon.errors import RescoreError
from rescore.data.depth_files import MeasuredFile, Quantity
from rescore.data.frames import SPLITS, DataSet, FrameRecord
from rescore.data.pictures import by_stem, picture_size
from rescore.formats.calibration_files import Calibration, doubts
from rescore.formats.labels import ClassMap, LabelRow, image_ids, refuse_other_truth, text_lines, truth_of
from rescore.speech import counted

NAME_FILES = ("classes.txt", "obj.names", "data.yaml", "dataset.yaml", "data.yml")
"""Where YOLO keeps the names of its class numbers."""


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

    def camera(self, width_px: int, height_px: int) -> StereoCamera | DepthCamera | None:
        """The camera for pictures of a size, None where there is no calibration."""
        if self.calibration is None or self.calibration_path is None:
            return None
        if self.measured is not None and self.measured.quantity is Quantity.DEPTH:
            return self.calibration.depth_camera(self.calibration_path, width_px, height_px)
        return self.calibration.camera(self.calibration_path, width_px, height_px)


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
    refuse_other_truth(layout.root, frames, truth)
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
        ground=pictures.calibration.ground if pictures.calibration else None,
        measured=pictures.measured,
        disparity_offset_px=pictures.calibration.disparity_offset_px if pictures.calibration else 0.0,
        name="" if pictures.stem == pictures.left.stem else pictures.stem,
    )


def calibration_notes(frames: Sequence[FrameRecord], where: Path) -> tuple[str, ...]:
    """What is unlikely about the calibrations of frames, each kind once with the number of its frames."""
    found: Counter[str] = Counter(d.text for f in frames if f.camera for d in doubts(f.camera))
    without = sum(f.camera is None for f in frames)
    if without:
        found["no calibration, so depth is known but for scale; add one"] = without
    return tuple(f"{where}: {n} of {len(frames)} frames: {text}" for text, n in found.items())


def splits_of(root: Path, stems: Sequence[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Split of each frame by its stem, from lists in ImageSets or VOC's ImageSets/Main, and notes.

    ``val.txt`` is the split validation; ``trainval.txt`` is the split train where neither of the two is
    there. All frames are in split "test" where there are no such files.

    Raises:
        RescoreError: a file names an unknown frame, or two name the same.
    """
    found = {
        path: split
        for folder in (root / "ImageSets", root / "ImageSets" / "Main")
        for path, split in _split_files(folder).items()
    }
    if not found:
        return dict.fromkeys(stems, "test"), ()
    known = set(stems)
    split_of: dict[str, str] = {}
    for path, split in found.items():
        for where, line in text_lines(path):
            stem = _named_in(line, known)
            if stem is None:
                raise RescoreError(f"{where}: expected the name of a picture, got {line[:60]!r}; remove it")
            if split_of.setdefault(stem, split) != split:
                raise RescoreError(
                    f"{where}: {stem!r} is in split {split_of[stem]} and in {split}; give it to one"
                )
    rest = len(known) - len(split_of)
    return split_of, (f"{root / 'ImageSets'}: left out {counted(rest, 'frame')} of no split",) if rest else ()


def _split_files(folder: Path) -> dict[Path, str]:
    names = {"val": "validation"} | {s: s for s in SPLITS}
    found = {p: split for name, split in names.items() if (p := folder / f"{name}.txt").is_file()}
    both = folder / "trainval.txt"
    if both.is_file() and not {"train", "validation"} & set(found.values()):
        found[both] = "train"
    return found


def _named_in(line: str, known: Collection[str]) -> str | None:
    """The frame that a line names: by its whole text, which may have blanks, or before VOC's 1 or -1.

    It may have the end of the picture's name.
    """
    for name in (line, line.split(maxsplit=1)[0]):
        for stem in (name, PurePath(name).stem):
            if stem in known:
                return stem
    return None


def box_files_in(folder: Path, suffix: str) -> list[Path]:
    """The files of boxes of a folder in the order of their names.

    Hidden files, YOLO's names, and what is no file, such as a pipe that nobody writes to, are none.
    """
    if not folder.is_dir():
        return []
    return sorted(
        p
        for p in folder.iterdir()
        if p.suffix.lower() == suffix
        and p.name not in NAME_FILES
        and not p.name.startswith(".")
        and p.is_file()
    )


def files_of_frames(folder: Path, suffix: str, layout: Layout) -> tuple[list[Path | None], tuple[str, ...]]:
    """The file of boxes of each frame, None where it has none, and what to say of those without.

    Raises:
        RescoreError: there are files, and none belongs to a frame.
    """
    there = box_files_in(folder, suffix)
    by_name = by_stem(there)
    paths = [by_name.get(p.stem) for p in layout.pictures]
    missing = paths.count(None)
    if there and missing == len(paths):
        raise RescoreError(
            f"{folder}: expected files of the names of the pictures, as {layout.pictures[0].stem}{suffix}, "
            f"got {there[0].name}; rename them"
        )
    strangers = len(by_name) - (len(paths) - missing)
    notes = []
    if missing:
        first = folder / f"{layout.pictures[paths.index(None)].stem}{suffix}"
        notes.append(f"{first}: {missing} of {len(paths)} frames have no label file and count as empty")
    if strangers:
        notes.append(f"{folder}: left out {strangers} files of boxes that belong to no picture")
    return paths, tuple(notes)
