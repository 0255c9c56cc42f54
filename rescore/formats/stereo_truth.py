"""Stereo pairs with true disparity: KITTI stereo 2015, and folders of Middlebury scenes."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from recon.arrays import BoolArray, Float32Array, IntArray, UInt8Array
from recon.camera import StereoCamera
from recon.errors import RescoreError
from recon.stereo.sgbm import PNG_SCALE
from rescore.data.depth_files import SUFFIXES, MeasuredFile, Quantity, read_measured
from rescore.data.pictures import PICTURES, decode_picture, file_named, picture_size, pictures_in, read_rgb
from rescore.formats.calibration_files import read_calibration

KITTI_TRUTH = "disp_occ_0"
"""Folder of KITTI's true disparities of all pixels; ``disp_noc_0`` holds those seen in both pictures."""
SCENE_TRUTH = ("disp0GT", "disp0")
"""Names of the true disparities of a Middlebury scene, best first."""


@dataclass(frozen=True, eq=False)
class TruePair:
    """A rectified pair with the true disparity of its left picture."""

    name: str
    left_rgb: UInt8Array
    """Shape (h, w, 3), like the right one."""
    right_rgb: UInt8Array
    """Shape (h, w, 3), like the left one."""
    truth_px: Float32Array
    """Shape (h, w); NaN where it is not known."""
    seen_twice: BoolArray
    """Shape (h, w): whether a pixel is seen in the right picture too, of those with truth."""
    foreground: BoolArray | None
    """Shape (h, w): KITTI's moving cars; None where the set does not tell foreground from background."""
    camera: StereoCamera | None


@dataclass(frozen=True)
class TrueScene:
    """Files of one stereo pair with true disparity."""

    name: str
    left: Path
    right: Path
    truth: Path
    seen_twice: Path | None
    """KITTI's true disparity of the pixels seen in both pictures, or Middlebury's mask, 255 where both see a
    pixel."""
    objects: Path | None
    """KITTI's map of moving cars, above 0 where one is."""
    calibration: Path | None

    def load(self) -> TruePair:
        """The pair, read.

        Raises:
            RescoreError: a file is missing, damaged or of another size.
        """
        width, height = picture_size(self.left)
        truth = _disparity(self.truth, width, height)
        camera = None
        if self.calibration is not None:
            calibration = read_calibration(self.calibration)
            camera = calibration.camera(self.calibration, width, height)
        return TruePair(
            name=self.name,
            left_rgb=read_rgb(self.left, width, height),
            right_rgb=read_rgb(self.right, width, height),
            truth_px=truth,
            seen_twice=self._seen_twice(truth),
            foreground=None if self.objects is None else _map(self.objects, truth.shape) > 0,
            camera=camera,
        )

    def _seen_twice(self, truth_px: Float32Array) -> BoolArray:
        height, width = truth_px.shape
        if self.seen_twice is None:
            return seen_in_right(truth_px)
        if self.seen_twice.parent.name == "disp_noc_0":
            return ~np.isnan(_disparity(self.seen_twice, width, height))
        return np.asarray((_map(self.seen_twice, truth_px.shape) == 255) & ~np.isnan(truth_px), bool)


@dataclass(frozen=True)
class TrueScenes:
    """The pairs with truth of a folder, in the order of their names."""

    kitti: bool
    """Whether the scenes are of KITTI stereo 2015; else they are Middlebury scenes."""
    scenes: tuple[TrueScene, ...]


def find_true_scenes(root: Path) -> TrueScenes | None:
    """The pairs with true disparity of a folder; None where it holds none.

    KITTI stereo 2015 is the folder ``training`` of its download with ``image_2, image_3, disp_occ_0,
    disp_noc_0, obj_map`` and, if there, ``calib_cam_to_cam``. A Middlebury scene is a folder with
    ``im0, im1``, ``disp0GT`` or ``disp0`` (PFM, NPY, or 16-bit PNG of 256 x pixels), and, if there,
    ``mask0nocc.png``.

    Raises:
        RescoreError: a file of a pair is missing.
    """
    if (root / KITTI_TRUTH).is_dir():
        return TrueScenes(True, tuple(_kitti(root, truth) for truth in pictures_in(root / KITTI_TRUTH)))
    folders = [root, *sorted(p for p in root.iterdir() if p.is_dir())] if root.is_dir() else []
    scenes = tuple(scene for folder in folders if (scene := _middlebury(folder)) is not None)
    return TrueScenes(False, scenes) if scenes else None


def _kitti(root: Path, truth: Path) -> TrueScene:
    """The files of one KITTI frame, named as its truth is."""
    needed = [root / folder / truth.name for folder in ("image_2", "image_3", "disp_noc_0", "obj_map")]
    for path in needed:
        if not path.is_file():
            raise RescoreError(
                f"{path}: expected a file of KITTI stereo 2015 to go with {truth}, found none; unpack the "
                "whole of data_scene_flow.zip"
            )
    left, right, seen_twice, objects = needed
    # frames are named 000000_10, their calibrations 000000
    calibration = root / "calib_cam_to_cam" / f"{truth.stem.partition('_')[0]}.txt"
    return TrueScene(
        truth.stem, left, right, truth, seen_twice, objects, calibration if calibration.is_file() else None
    )


def _middlebury(folder: Path) -> TrueScene | None:
    """The files of a Middlebury scene, None where it is none or has no truth."""
    left, right = (_first(folder, (stem,), PICTURES) for stem in ("im0", "im1"))
    truth = _first(folder, SCENE_TRUTH, SUFFIXES)
    if left is None or right is None or truth is None:
        return None
    mask = folder / "mask0nocc.png"
    return TrueScene(folder.name, left, right, truth, mask if mask.is_file() else None, None, None)


def _first(folder: Path, stems: tuple[str, ...], suffixes: tuple[str, ...]) -> Path | None:
    return next((p for stem in stems if (p := file_named(folder, stem, suffixes))), None)


def _disparity(path: Path, width: int, height: int) -> Float32Array:
    factor = PNG_SCALE if path.suffix.lower() == ".png" else 1.0
    return read_measured(MeasuredFile(path, Quantity.DISPARITY, factor), width, height)


def _map(path: Path, shape: tuple[int, ...]) -> IntArray:
    """A grey picture of numbers, shape (h, w)."""
    value = decode_picture(path, cv2.IMREAD_UNCHANGED)
    if value is None or value.shape != shape:
        got = "no whole picture" if value is None else f"an array of shape {value.shape}"
        raise RescoreError(
            f"{path}: expected a grey picture of {shape[1]} x {shape[0]} pixels, got {got}; take the file of "
            "the download again"
        )
    return np.asarray(value, np.int64)


def seen_in_right(truth_px: Float32Array) -> BoolArray:
    """Whether each pixel (h, w) with truth is seen in the right picture, by the truth alone.

    A pixel is hidden where its column in the right picture lies outside, or where another pixel with a
    disparity larger by more than one falls on that column. What has no truth hides nothing, so that this
    takes a few hidden pixels for seen.
    """
    height, width = truth_px.shape
    row, column = np.nonzero(~np.isnan(truth_px))
    disparity = truth_px[row, column]
    place = column - disparity
    nearest = np.zeros((height, width), np.float32)
    # surfaces that slope away leave gaps of a column in the right picture unless they fill two
    for target in (np.floor(place).astype(int), np.ceil(place).astype(int)):
        inside = (target >= 0) & (target < width)
        np.maximum.at(nearest, (row[inside], target[inside]), disparity[inside])
    target = np.rint(place).astype(int)
    seen = np.zeros((height, width), bool)
    inside = (target >= 0) & (target < width)
    row, column, target = row[inside], column[inside], target[inside]
    seen[row, column] = nearest[row, target] <= truth_px[row, column] + 1
    return seen
