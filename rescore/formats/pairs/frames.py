"""The frames of plain folders: pictures with their partners, measured files and calibrations."""

import filecmp
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from recon.errors import RescoreError
from recon.stereo.sgbm import PNG_SCALE
from recon.stores import remote
from rescore.data.depth_files import SUFFIXES, TUM_DEPTH_FACTOR, MeasuredFile, Quantity, has_whole_numbers
from rescore.data.pictures import PICTURES, file_named, files_in, picture_size
from rescore.formats.calibration_files import Calibration
from rescore.formats.calibrations.in_folder import FolderCalibration, calibration_in, calibrations_of_frames
from rescore.formats.folders import Pictures
from rescore.formats.pairs.names import Side, paired
from rescore.formats.pairs.places import MEASURED, Place, folders_in

MOST_NOTES = 5
"""Notes on the calibrations of scenes, and on places, that the user is to see."""
Frames = tuple[list[Pictures], tuple[str, ...]]
"""Frames, and what to say of what was left out or taken."""


def frames_of_places(root: Path, places: Sequence[Place], top: Path) -> Frames:
    """The frames of the folders of pictures under a folder.

    Args:
        root: The folder.
        places: Its folders of pictures.
        top: The folder above up to which a calibration is looked for.

    Raises:
        RescoreError: something is missing, damaged, or does not fit the rest.
    """
    whole = [place for place in places if place.right or place.measured]
    if not whole:
        raise RescoreError(
            f"{places[0].left}: expected a folder of its name for right pictures or measured files too, "
            "found none; fetch them"
        )
    read = [_of_place(root, place, top) for place in whole]
    notes = list(dict.fromkeys(note for _, own in read for note in own))[:MOST_NOTES]
    if len(whole) < len(places):
        gone = next(place.left for place in places if place not in whole)
        notes.append(
            f"{gone}: left out {len(places) - len(whole)} of {len(places)} such folders, which have no right "
            "pictures"
        )
    found = [(place, pictures) for place, (own, _) in zip(whole, read, strict=True) for pictures in own]
    counts = Counter(pictures.stem for _, pictures in found)
    if len(counts) < len(found):
        found = [(a, replace(b, stem="-".join((*a.sub, b.stem)))) for a, b in found]
    return [pictures for _, pictures in found], tuple(notes)


def paired_pictures(
    partner: Path, left: Path, lefts: Sequence[Path], others: Sequence[Path], side: Side
) -> tuple[list[tuple[Path, Path]], tuple[str, ...]]:
    """Left pictures with their partners, and what to say of those without.

    Raises:
        RescoreError: none has one, a file belongs to two others, or both folders hold the same pictures.
    """
    pairs = paired(lefts, others, side)
    alone = len(lefts) - len(pairs)
    if not pairs:
        raise RescoreError(
            f"{partner}: expected files of the names in {left.name}, as {lefts[0].stem!r}, got "
            f"{others[0].stem!r}; rename them"
        )
    # of the first pair alone: pictures without packing are all of one size, and reading them takes long
    if side is Side.RIGHT and filecmp.cmp(*pairs[0], shallow=False):
        raise RescoreError(
            f"{pairs[0][1]}: expected the right picture of {pairs[0][0]}, got the same picture; give each "
            "camera's pictures in a folder of their own"
        )
    who = f"{alone} of {len(lefts)} left pictures without a partner"
    told = f"{partner}: left out {who}; image ids count the rest"
    return pairs, (told,) if alone else ()


def _of_place(root: Path, place: Place, top: Path) -> Frames:
    """The frames of one folder of left pictures. Measured files go before right pictures."""
    lefts = place.lefts()
    size = picture_size(lefts[0])
    of_each = calibrations_of_frames(root, place.sub, lefts, size)
    found = next(iter(of_each.values()), None) or calibration_in(root, place.left, place.right, size, top=top)
    if place.measured is not None:
        return _with_measured(root, place, place.measured, lefts, found, of_each)
    assert place.right is not None
    pairs, notes = paired_pictures(place.right, place.left, lefts, place.rights(), Side.RIGHT)
    pictures = []
    for left, right in pairs:
        own = _own(left, found, of_each)
        pictures.append(Pictures(left.stem, left, right, None, own.calibration, own.path))
    return pictures, (*notes, *found.notes)


def _own(
    left: Path, found: FolderCalibration, of_each: Mapping[Path, FolderCalibration]
) -> FolderCalibration:
    """The calibration of a picture: its own where frames have their own, else that of the folder."""
    return of_each.get(left, FolderCalibration()) if of_each else found


def _with_measured(
    root: Path,
    place: Place,
    measured: Path,
    lefts: Sequence[Path],
    found: FolderCalibration,
    of_each: Mapping[Path, FolderCalibration],
) -> Frames:
    """The frames of left pictures and measured files."""
    files = files_in(measured, SUFFIXES, "files")
    pairs, notes = paired_pictures(measured, place.left, lefts, files, Side.LEFT)
    unused = [n for n, _ in MEASURED if (root / n).is_dir() and root / n not in (measured, *measured.parents)]
    if unused:
        notes = (*notes, f"{measured}: taken in place of {', '.join(unused)}")
    if place.right is not None:
        told = f"{measured}: taken in place of matching {place.left.name} with {place.right.name}"
        notes = (*notes, told)
    if place.quantity is Quantity.DEPTH and found.calibration is None:
        raise RescoreError(
            f"{root}: expected a calibration to use depth in metres, found none; add calib.yaml with "
            f"cameraMatrix{'; ' * bool(found.notes)}{found.notes[0] if found.notes else ''}"
        )
    factors = [_factor_of(path, place, found) for _, path in pairs]
    if place.quantity is Quantity.DEPTH and found.depth_factor is None and found.usual_factor in factors:
        notes = (
            *notes,
            f"{found.path}: states no depth_factor, so {found.usual_factor:g} is taken for one metre, as "
            f"{found.form} documents; add depth_factor where it is another",
        )
    pictures = []
    for (left, path), factor in zip(pairs, factors, strict=True):
        own = _own(left, found, of_each)
        calibration = own.calibration and _with_zero(own.calibration, place, own.disparity_zero / factor)
        file = MeasuredFile(path, place.quantity, factor)
        pictures.append(Pictures(left.stem, left, None, file, calibration, own.path))
    return pictures, (*notes, *found.notes)


def _with_zero(calibration: Calibration, place: Place, zero_px: float) -> Calibration:
    """The calibration for files of disparity that have a value where nothing is nearer than infinity."""
    if place.quantity is Quantity.DEPTH or not zero_px:
        return calibration
    return replace(calibration, disparity_offset_px=calibration.disparity_offset_px - zero_px)


def _factor_of(path: Path, place: Place, found: FolderCalibration) -> float:
    """Value of a file for one pixel or metre: as the calibration says, else what the form has.

    Raises:
        RescoreError: whole numbers of depth whose factor nothing tells.
    """
    whole = has_whole_numbers(path)
    if place.quantity is Quantity.DISPARITY:
        return found.disparity_factor or (PNG_SCALE if path.suffix.lower() == ".png" else 1.0)
    if found.depth_factor:
        return found.depth_factor
    if not whole:
        return 1.0
    root = place.left.parent
    if place.left.name == "rgb" and (root / "rgb.txt").is_file() and (root / "depth.txt").is_file():
        return TUM_DEPTH_FACTOR
    if found.usual_factor:
        return found.usual_factor
    raise RescoreError(
        f"{path.parent}: expected to be told the value of one metre, found nothing; add the line "
        "'depth_factor: 5000' (TUM), 1000 (millimetres) or 256 (KITTI) to the calibration (in JSON "
        '"depth_factor": 1000)'
    )


def scenes_in(root: Path) -> Iterator[Path]:
    """Folders with im0 and im1 (or disp0): the folder itself, else those in it."""
    if _has_im0(root):
        yield root
        return
    inside = sorted(p for p in root.iterdir() if p.is_dir()) if remote(root) else folders_in(root)
    yield from (p for p in inside if _has_im0(p))


def _has_im0(folder: Path) -> bool:
    if remote(folder) is not None:
        return file_named(folder, "im0", PICTURES) is not None
    # a folder of very many files need not be listed
    return any(os.path.isfile(folder / f"im0{end}") for e in PICTURES for end in (e, e.upper()))


def frames_of_scenes(root: Path, top: Path) -> Frames:
    """The frames of folders of scenes, as ``frames_of_places`` gives them."""
    scenes = [_scene(folder, top) for folder in scenes_in(root)]
    # a line a kind of note, not a line a scene
    notes = dict.fromkeys(note for _, own in scenes for note in own)
    return [pictures for pictures, _ in scenes], tuple(notes)[:MOST_NOTES]


def _scene(folder: Path, top: Path) -> tuple[Pictures, tuple[str, ...]]:
    left, right = (file_named(folder, stem, PICTURES) for stem in ("im0", "im1"))
    assert left is not None
    found = calibration_in(folder, folder, None, picture_size(left), top=top)
    measured = None
    if right is None:
        file = file_named(folder, "disp0", SUFFIXES)
        if file is None:
            raise RescoreError(f"{folder}: expected im1 or disp0 beside {left.name}, found neither; add one")
        place = Place(folder, None, folder, Quantity.DISPARITY)
        measured = MeasuredFile(file, Quantity.DISPARITY, _factor_of(file, place, found))
    return Pictures(folder.name, left, right, measured, found.calibration, found.path), found.notes
