"""The cars of a rendered frame that are whole and in sight: their pixels, true disparity and pose."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, TypeAdapter

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray
from recon.boxes import paired_overlap
from recon.camera import GroundPlane
from recon.errors import RescoreError
from recon.stereo.sgbm import read_disparity
from rescore.data.frames import FrameRecord, Truth
from rescore.data.rendered_kinds import read_instances
from rescore.formats.checked_json import read_checked

WHOLE = 0.9
"""A car is in sight if at least this share of it is seen, and whole if no part lies outside the picture."""
FARTHEST_M = 60.0
_SAME_BOX = 0.7
"""Overlap of an annotated box with the box around an instance that is taken for it."""
_WINDOW = 5
"""Pixels across the matcher's window: nearer than half of it to the edge of a car, it mixes two surfaces."""


@dataclass(frozen=True, eq=False)
class ShownCar:
    """One annotated car."""

    annotation_id: int
    xyxy_px: FloatArray
    """The annotated box, shape (4,), pixel edges."""
    seen: BoolArray
    """Mask of its pixels, shape (h, w)."""
    cam_from_object: FloatArray
    """True pose (4, 4) with the origin on the ground below the middle, metres; upright on the true ground."""
    size_m: FloatArray
    """True length, width and height without mirrors, shape (3,)."""
    azimuth_deg: float
    """Side from which it is seen, 0 its front, in [0, 360)."""

    @property
    def distance_m(self) -> float:
        """Distance of its middle from the camera."""
        return float(np.linalg.norm(self.cam_from_object[:3, 3]))

    @property
    def inner(self) -> BoolArray:
        """Mask of its pixels but those at an edge, where the matcher's window shows more than the car."""
        kernel = np.ones((_WINDOW, _WINDOW), np.uint8)
        eroded = cv2.erode(self.seen.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        return np.asarray(eroded > 0)


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """What is known of a rendered frame beyond its annotations."""

    disparity_px: Float32Array
    """True disparity, shape (h, w)."""
    ground: GroundPlane


class _Ground(BaseModel):
    model_config = ConfigDict(frozen=True)
    height_m: float
    pitch_rad: float
    roll_rad: float


class _Image(BaseModel):
    model_config = ConfigDict(frozen=True)
    id: int
    truth_disparity_file_name: str | None = None
    ground_truth: _Ground | None = None
    rig: str = ""


class _File(BaseModel):
    model_config = ConfigDict(frozen=True)
    images: tuple[_Image, ...]


@dataclass(frozen=True, eq=False)
class RenderedTruth:
    """What the file of a rendered data set says of its images beside what every data set does."""

    root: Path
    images: Mapping[int, _Image]

    @staticmethod
    def of(root: Path) -> "RenderedTruth":
        """The truth of a data set.

        Raises:
            RescoreError: no such data set.
        """
        file = read_checked(root / "annotations.json", TypeAdapter(_File), "a data set")
        return RenderedTruth(root, {image.id: image for image in file.images})

    def rig(self, image_id: int) -> str:
        """Name of the stereo head of an image."""
        return self.images[image_id].rig

    def of_frame(self, record: FrameRecord) -> FrameTruth:
        """The truth of one frame.

        Raises:
            RescoreError: the data set was not rendered along streets, or a picture of it is missing.
        """
        image = self.images[record.image_id]
        if image.truth_disparity_file_name is None or image.ground_truth is None:
            raise RescoreError(
                f"{self.root}: expected true disparity and ground of image {record.image_id}, got none; "
                "use a data set that `rescore synth --preset streets` rendered"
            )
        path = self.root / image.truth_disparity_file_name
        disparity = read_disparity(path, record.width_px, record.height_px)
        return FrameTruth(disparity, GroundPlane(**dict(image.ground_truth)))


def shown_cars(record: FrameRecord, truth: Truth, ground: GroundPlane) -> Iterator[ShownCar]:
    """The annotated cars of a frame that are whole, in sight and nearer than ``FARTHEST_M``.

    Raises:
        RescoreError: the data set has no pictures of instances or no 3D boxes.
    """
    instances = read_instances(record)
    if instances is None or truth.boxes3d is None or truth.azimuth_deg is None or truth.truncated is None:
        if len(truth.xyxy_px):
            raise RescoreError(
                f"image {record.image_id}: expected instances, 3D boxes and sides of its cars, got none; use "
                "a data set that `rescore synth --preset streets` rendered"
            )
        return
    whole = ~truth.ignore & (truth.visibility >= WHOLE) & (truth.truncated <= 0) & truth.boxes3d.known
    numbers = np.array([i for i, kind in record.instance_kinds.items() if kind == "car"], np.int64)
    around = np.array([_box_around(instances == number) for number in numbers]).reshape(-1, 4)
    for i in np.flatnonzero(whole):
        overlap = paired_overlap(around, truth.xyxy_px[i])[0] if len(around) else np.zeros(1)
        if overlap.max() < _SAME_BOX:
            continue
        size = truth.boxes3d.size_m[i]
        pose = _pose(
            truth.boxes3d.centre_cam_m[i], float(truth.boxes3d.rotation_y_rad[i]), size[2], ground.up
        )
        car = ShownCar(
            int(truth.annotation_id[i]),
            truth.xyxy_px[i],
            np.asarray(instances == numbers[overlap.argmax()]),
            pose,
            size,
            float(truth.azimuth_deg[i]),
        )
        if car.distance_m < FARTHEST_M:
            yield car


def _box_around(seen: BoolArray) -> FloatArray:
    columns, rows = np.flatnonzero(seen.any(axis=0)), np.flatnonzero(seen.any(axis=1))
    if not len(columns):
        return np.zeros(4)
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)


def _pose(centre_m: FloatArray, rotation_y_rad: float, height_m: float, up: FloatArray) -> FloatArray:
    """The pose (4, 4) of a car that stands upright on the ground."""
    nose = np.array([np.cos(rotation_y_rad), 0.0, -np.sin(rotation_y_rad)])
    nose = nose - (nose @ up) * up
    nose = nose / np.linalg.norm(nose)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([nose, np.cross(up, nose), up], axis=1)
    pose[:3, 3] = centre_m - up * height_m / 2
    return pose


def sampled(where: BoolArray, most: int) -> IntArray:
    """Rows and columns (n, 2) of at most so many of the pixels of a mask, evenly taken."""
    at = np.argwhere(where)
    return np.asarray(at[np.unique(np.linspace(0, len(at) - 1, min(most, len(at))).astype(int))])
