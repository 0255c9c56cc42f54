"""Reads one picture with its camera and ground, and makes the 3D instance in a box of the picture."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.camera import DEFAULT_GROUND, GroundedCamera, GroundPlane, PinholeCamera, default_camera
from recon.class_model import ClassModel
from recon.errors import Failure, RescoreError
from recon.localization.shape_fit import Agreement, FittedShape, shape_in_box
from recon.outlines import fill_polygon, largest_outline
from recon.reconstruction.border_evidence import EdgeWindow, EdgeWindowConfig
from recon.reconstruction.instance import NEAR_M, Instance3D, InstancePart, build_instance
from recon.reconstruction.matte import matte
from recon.reconstruction.part_registration import RegistrationConfig
from recon.reconstruction.reconstruct import (
    ReconstructConfig,
    Reconstruction,
    reconstruct,
    reconstruct_outline,
)
from recon.reconstruction.segment import SegmentConfig
from rescore.data.pictures import decode_picture, turned_by_exif
from rescore.formats.calibration_files import calibration_of, notes_of
from rescore.formats.calibrations.values import calibration_values
from rescore.speech import say

_SOLID_CONFIG = ReconstructConfig(
    box_bottom_is_ground=True,
    segment=SegmentConfig(steps=40, region_weight=0.3),
    registration=RegistrationConfig(box_area_px=12288.0),
)
_THIN_CONFIG = ReconstructConfig(
    box_bottom_is_ground=True,
    segment=SegmentConfig(steps=100, length_weight=1.0, region_weight=0.5),
    registration=RegistrationConfig(box_area_px=24576.0),
)
_THIN = 0.08
"""Width of a thin limb, in roots of the box area."""
_JOINED = 0.04
"""Pieces of a matte this near to each other, in roots of its area, have one outline."""
_ASTRAY = 0.04
"""An outline whose sides are farther than this from the drawn box, as shares of its extent, has lost a limb;
a foot that is missing moves the whole object away."""


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture with the camera and the ground that it is seen with."""

    rgb: UInt8Array
    """Shape (h, w, 3)."""
    seen_from: GroundedCamera


@dataclass(frozen=True, eq=False)
class FoundObject:
    """The object in one box."""

    picture: Reconstruction
    """What the picture gave: outline, parts, ground line, planes."""
    instance: Instance3D
    """The whole object in 3D."""
    matte: Float32Array
    """How much of each pixel of the picture is the object, shape (h, w), in [0, 1]."""
    shape: FittedShape | None = None
    """The closed shape; None where the class model knows none, or none fits."""
    occluded: BoolArray | None = None
    """Pixels (h, w) where something else hides the object; None for none."""
    agreement: Agreement | None = None
    """How well the closed shape goes with picture and box; None without one."""
    closed_failure: Failure | None = None
    """Why no closed shape fits, where the class model knows closed shapes."""
    borders: float | None = None
    """Correlation in [-1, 1] of the picture's edges in the box with the borders of the closed shape and of
    its parts; None without one, and for shapes of thin limbs."""


def read_photo(path: Path) -> UInt8Array:
    """The picture (h, w, 3) of a file.

    Raises:
        RescoreError: no such file, no picture, or one that EXIF asks viewers to turn, so that nobody knows of
            which pixels boxes are.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a picture, found no file; check the path")
    if told := turned_by_exif(path):
        raise RescoreError(
            f"{path}: expected a picture that is stored upright, got one{told}; turn its pixels"
        )
    bgr = decode_picture(path, cv2.IMREAD_COLOR)
    if bgr is None:
        raise RescoreError(
            f"{path}: expected a whole picture that OpenCV reads, could not decode it; mend it"
        )
    return np.ascontiguousarray(bgr[..., ::-1], np.uint8)


def parse_numbers(option: str, text: str, names: str) -> FloatArray:
    """Finite numbers of an option as many as there are comma-separated names.

    Raises:
        RescoreError: another count, or something that is no number.
    """
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.zeros(0)
    if len(values) != len(names.split(",")) or not np.isfinite(values).all():
        raise RescoreError(f"{option}: expected numbers {names}, got {text!r}; write them with commas")
    return values


def parse_box(text: str, width_px: int, height_px: int) -> FloatArray:
    """Edges x0, y0, x1, y1 of a box "x,y,w,h" that meets a picture of a size.

    Raises:
        RescoreError: not a box, or outside the picture.
    """
    x, y, w, h = parse_numbers("--box", text, "x,y,w,h")
    if not (w > 0 and h > 0):
        raise RescoreError(f"--box: expected a positive width and height, got {text!r}; mend it")
    if x >= width_px or y >= height_px or x + w <= 0 or y + h <= 0:
        raise RescoreError(
            f"--box: expected a box inside the picture of {width_px} x {height_px} pixels, got {text!r}; "
            "mend it"
        )
    return np.array([x, y, x + w, y + h])


def open_photo(
    path: Path, camera: str | None, calib: Path | None, height_m: float | None, pitch_deg: float | None
) -> Photo:
    """A picture with its camera and ground; what is not given is as in the report.

    Args:
        path: the picture.
        camera: "fx,fy,cx,cy" in pixels.
        calib: calibration file of any form that is read beside own pairs; of a pair the left camera is
            taken, and the ground where the file states it.
        height_m: height of the camera above the ground; goes before that of the file.
        pitch_deg: how far the camera looks down; goes before that of the file.
    """
    if camera is not None and calib is not None:
        raise RescoreError("camera: expected --camera or --calib, got both; leave one out")
    rgb = read_photo(path)
    height_px, width_px = rgb.shape[:2]
    lens, known = default_camera(width_px, height_px), None
    if camera is not None:
        fx, fy, cx, cy = parse_numbers("--camera", camera, "fx,fy,cx,cy").tolist()
        lens = PinholeCamera(fx, fy, cx, cy, width_px, height_px)
    elif calib is not None:
        lens, known = _read_calib(calib, width_px, height_px)
    ground = known or DEFAULT_GROUND
    height = ground.height_m if height_m is None else height_m
    pitch = ground.pitch_rad if pitch_deg is None else float(np.deg2rad(pitch_deg))
    return Photo(rgb, GroundedCamera(lens, GroundPlane(height, pitch, ground.roll_rad)))


def _read_calib(path: Path, width_px: int, height_px: int) -> tuple[PinholeCamera, GroundPlane | None]:
    """The left camera of a calibration file, and the ground that it states; says what is not undone."""
    values = calibration_values(path, size_px=(width_px, height_px))
    for note in notes_of(path, values):
        say(note)
    calibration = calibration_of(path, values)
    return calibration.depth_camera(path, width_px, height_px).left, calibration.ground


def load_class(path: Path | None, class_name: str) -> ClassModel:
    """The class model of a file, which must be of a class; without a file that which comes with the package.

    Raises:
        RescoreError: no such file, not a class model, a model of another class, or none with the package.
    """
    if path is None:
        from rescore.library.bundles import default_bundle  # noqa: PLC0415 (readers take long to import)

        return default_bundle(class_name).class_model
    model = ClassModel.load(path)
    if model.class_name != class_name:
        raise RescoreError(
            f"{path}: expected a model of class {class_name!r}, got one of {model.class_name!r}; "
            "mend --class or give another --model"
        )
    return model


def fine_config(model: ClassModel, view_bin: int) -> ReconstructConfig:
    """Settings for one picture: a finer grid than thousands of candidates can have, and colours beside edges.

    Thin objects get a still finer grid, more weight on colours and more steps: along a limb there are edges
    on both sides, and the outline would lose it. An object is thin where an opening takes more than a
    twentieth of its labelled image, as it does with the legs of a chair.
    """
    mask = (model.view(view_bin).labels > 0).astype(np.uint8)
    rows, cols = np.nonzero(mask)
    side = float(np.sqrt((np.ptp(rows) + 1) * (np.ptp(cols) + 1)))
    width = max(3, round(_THIN * side))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    padded = cv2.copyMakeBorder(mask, width, width, width, width, cv2.BORDER_CONSTANT)
    kept = int(np.count_nonzero(cv2.morphologyEx(padded, cv2.MORPH_OPEN, disc)))
    return _THIN_CONFIG if kept < 0.95 * len(rows) else _SOLID_CONFIG


def find_object(
    photo: Photo,
    xyxy_px: FloatArray,
    view_bin: int,
    model: ClassModel,
    occluded: BoolArray | None = None,
) -> FoundObject | Failure:
    """The object in a box (4,) in 3D, or why there is none.

    Args:
        photo: the picture.
        xyxy_px: the box, drawn tightly.
        view_bin: where the object is seen from.
        model: the class model.
        occluded: pixels (h, w) where something else hides the object (see ``build_instance``).
    """
    config, rgb, seen_from = fine_config(model, view_bin), photo.rgb, photo.seen_from
    (found,) = reconstruct(rgb, xyxy_px[None], view_bin, model, seen_from, config)
    if isinstance(found, Failure):
        return found
    inside = fill_polygon(found.outline_px, *rgb.shape[:2])
    share = inside.astype(np.float32)
    # a solid object without a shape keeps its outline: by colours alone it would lose its tyres
    if config is _THIN_CONFIG and (model.shape_space is None or model.shape_space.is_thin):
        share = matte(rgb, inside, xyxy_px)
        found = _along_matte(found, share, xyxy_px, view_bin, model, seen_from)
    instance = build_instance(found, view_bin, model, seen_from, config.registration, occluded=occluded)
    if isinstance(instance, Failure):
        return instance
    if model.shape_space is None:
        return FoundObject(found, instance, share, None, occluded)
    expected = found.initial_outline_px
    solid = shape_in_box(
        rgb, share > 0.5, xyxy_px, instance, model.shape_space, seen_from, occluded, expected
    )
    if isinstance(solid, Failure):
        return FoundObject(found, instance, share, None, occluded, closed_failure=solid)
    whole = _as_shape(instance, solid.shape, model)
    borders = None if model.shape_space.is_thin else shape_borders(photo, xyxy_px, solid.shape, whole)
    return FoundObject(found, whole, solid.matte, solid.shape, occluded, solid.agreement, borders=borders)


def _as_shape(instance: Instance3D, shape: FittedShape, model: ClassModel) -> Instance3D:
    """The instance with the place, the size and the parts of its closed shape."""
    turn = shape.cam_from_object
    seen = {p.label for p in instance.parts if p.seen}
    parts = []
    for label, outline in zip(shape.space.part_labels, shape.parts_m, strict=True):
        points = outline @ turn[:3, :3].T + turn[:3, 3]
        middle = points.mean(axis=0)
        normal = np.linalg.svd(points - middle)[2][2]
        flat = points - np.outer((points - middle) @ normal, normal)
        plane = np.append(normal, -normal @ middle)
        parts.append(InstancePart(label, model.part_names[label - 1], plane, flat, label in seen))
    ordered = tuple(sorted(parts, key=lambda p: p.label))
    return replace(instance, parts=ordered, cam_from_object=turn, size_m=shape.size_m)


def shape_borders(photo: Photo, xyxy_px: FloatArray, shape: FittedShape, instance: Instance3D) -> float:
    """Correlation in [-1, 1] of the edges in a box (4,) with the borders of a shape and of its visible parts.

    Colours find something in any box and a shape is fitted to it; the borders of windows, wheels and lamps
    are where a car is.
    """
    camera = photo.seen_from.camera
    ring = largest_outline(shape.silhouette(camera, xyxy_px))
    if ring is None:
        return 0.0
    far = np.array([camera.width_px - 1.0, camera.height_px - 1.0])
    corners = np.clip(xyxy_px.reshape(2, 2) - 0.5, 0, far)
    borders = [ring]
    for part in instance.parts:
        normal, middle = part.plane[:3], part.outline_m.mean(axis=0)
        outward = normal * np.sign(normal @ (middle - instance.centroid_m))
        if outward @ middle < 0 and (part.outline_m[:, 2] > NEAR_M).all():
            borders.append(camera.project(part.outline_m))
    return float(EdgeWindow(photo.rgb, corners, EdgeWindowConfig()).agreement([borders])[0])


def _along_matte(
    found: Reconstruction,
    share: Float32Array,
    xyxy_px: FloatArray,
    view_bin: int,
    model: ClassModel,
    seen_from: GroundedCamera,
) -> Reconstruction:
    """The reconstruction of a thin object along its matte (h, w); the first one where that loses much."""
    across = max(3, round(_JOINED * float(np.sqrt((share > 0.5).sum()))))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, across))
    ring = largest_outline(cv2.morphologyEx((share > 0.5).astype(np.uint8), cv2.MORPH_CLOSE, disc) > 0)
    if ring is None or len(ring) < 8:
        return found
    sides = np.concatenate([ring.min(axis=0), ring.max(axis=0) + 1]) - xyxy_px
    if (np.abs(sides.reshape(2, 2)) > _ASTRAY * (xyxy_px[2:] - xyxy_px[:2])).any():
        return found
    (again,) = reconstruct_outline(ring, view_bin, model, seen_from, _THIN_CONFIG)
    return found if isinstance(again, Failure) else again


def instance_json(instance: Instance3D, doubt: str | None) -> dict[str, Any]:
    """Everything of an instance for a JSON file: metres, radians, the camera frame unless a name says so.

    Args:
        instance: the instance.
        doubt: why it is not to be believed; None where nothing speaks against it.
    """
    moved = instance.class_to_instance
    return {
        "format": "instance-3d 1",
        "frame": "camera: x right, y down, z forward, metres",
        "class_name": instance.class_name,
        "view_bin": instance.view_bin,
        "cam_from_object": instance.cam_from_object.tolist(),
        "size_m": instance.size_m.tolist(),
        "centroid_m": instance.centroid_m.tolist(),
        "distance_m": instance.distance_m,
        "yaw_rad": instance.yaw_rad,
        "azimuth_rad": instance.azimuth_rad,
        "box_corners_m": instance.corners_m.tolist(),
        "parts": [
            {
                "label": p.label,
                "name": p.name,
                "seen": p.seen,
                "plane": p.plane.tolist(),
                "outline_m": p.outline_m.tolist(),
            }
            for p in instance.parts
        ],
        "unplaced": instance.unplaced,
        "class_to_instance": {
            "rotation": moved.rotation.tolist(),
            "scale_m": moved.scale.tolist(),
            "shift_m": moved.shift_m.tolist(),
            "residual_m": moved.residual_m,
            "part_residual_m": {str(k): v for k, v in moved.part_residual_m.items()},
        },
        "quality": {
            "registration_cost": instance.quality.registration_cost,
            "placed_share": instance.quality.placed_share,
            "transform_residual_m": instance.quality.transform_residual_m,
            "doubt": doubt,
        },
    }
