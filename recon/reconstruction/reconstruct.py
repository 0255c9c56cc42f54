"""Reconstruction of candidates (section 4): outline, parts, ground line, planes, predicted depth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from recon.arrays import BoolArray, FloatArray, IntArray, UInt8Array
from recon.camera import GroundedCamera, PinholeCamera, cross
from recon.class_model import ClassModel
from recon.depth_map import DepthMap
from recon.errors import Failure, Reason, RescoreError
from recon.outlines import fill_polygon
from recon.reconstruction.canonical_window import GridToImage, canonical_windows, grid_to_image, zero_level
from recon.reconstruction.ground_line import GroundLineConfig, ground_line
from recon.reconstruction.part_labels import PartLabels
from recon.reconstruction.part_registration import (
    CanonicalGrid,
    PreparedView,
    RegisteredParts,
    RegistrationConfig,
    prepare_view,
    register_parts,
)
from recon.reconstruction.place_parts import PlacingConfig, feet, place_instance
from recon.reconstruction.segment import SegmentConfig, colour_evidence, edge_indicator, evolve


@dataclass(frozen=True)
class ReconstructConfig:
    """Settings of all stages."""

    min_inside: float = 0.5
    """Smallest share of the box that must lie inside the image."""
    max_aspect_change: float = 1.8
    """A box whose width to height differs by more than this factor from that of the labelled outline shows
    the object from elsewhere, or something else: stretched to such a box, any outline would seem to fit."""
    min_outline_iou: float = 0.4
    """Smallest intersection over union of the outline with the one it started from."""
    box_bottom_is_ground: bool = False
    """Whether boxes are drawn tightly: then the contacts go down to the lower edge of the box, which an
    outline that has lost a foot does not reach. The boxes of a detector are too coarse for that."""
    segment: SegmentConfig = field(default_factory=SegmentConfig)
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    ground_line: GroundLineConfig = field(default_factory=GroundLineConfig)
    placing: PlacingConfig = field(default_factory=PlacingConfig)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """The 3D instance of one candidate, and how it came about."""

    outline_px: FloatArray
    """Outline after the evolution, shape (m, 2), pixel centres of the image."""
    initial_outline_px: FloatArray
    """The labelled outline of the view bin scaled to the box, where the evolution started, shape (k, 2)."""
    x0_px: int
    """Image column of the first column of part_labels and depth."""
    y0_px: int
    """Image row of the first row of part_labels and depth."""
    part_labels: UInt8Array
    """Registered parts, shape (h, w): 0 for none."""
    part_planes: dict[int, FloatArray]
    """Plane (a, b, c, d) of each placed part by label, camera frame, metres; in the order of placing."""
    unplaced_parts: dict[int, str]
    """Why each part of the image without a plane has none, by label."""
    depth: DepthMap
    """Predicted z-depth in the window of the part labels; NaN outside placed parts."""
    ground_line_px: FloatArray
    """Left and right end of the ground line, shape (2, 2)."""
    cam_from_object: FloatArray
    """Rotation (3, 3) of the view bin at this place of the image."""
    registration_cost: float
    """Mean chi-squared cost of the outline match, in [0, 1]."""
    placed_share: float
    """Share of the labelled pixels that have a depth, in [0, 1]."""
    part_regions: tuple[tuple[int, FloatArray], ...] = ()
    """Label and outline (m, 2) of each region of the labelled image where registration puts it, pixel
    centres; point i is where point i of ``PreparedView.region_points`` comes to lie. Evidence files leave it
    out."""
    ground_points_m: dict[int, FloatArray] = field(default_factory=dict)
    """Ground contact (3,) of each part that stands on a ground line by label, camera frame. Evidence files
    leave it out."""


@dataclass(frozen=True, eq=False)
class RegisteredOutline:
    """An outline in a box, and the parts of a view registered to it, canonical coordinates."""

    outline: FloatArray
    """Shape (m, 2)."""
    parts: RegisteredParts


def reconstruct(
    rgb: UInt8Array,
    xyxy_px: FloatArray,
    view_bin: int | IntArray,
    model: ClassModel,
    seen_from: GroundedCamera,
    config: ReconstructConfig | None = None,
    known: Mapping[int, RegisteredOutline] | None = None,
) -> tuple[Reconstruction | Failure, ...]:
    """The 3D instance in each box, or why there is none; one result a box, in order.

    Args:
        rgb: the picture, shape (h, w, 3).
        xyxy_px: boxes, shape (n, 4), pixel edges.
        view_bin: the bin that each box is seen from, shape (n,), or that of all.
        model: the class model.
        seen_from: the camera M and the ground plane Q_g.
        config: settings; None for the defaults.
        known: outlines that are found and registered already, by their places among the boxes.

    Raises:
        RescoreError: the model has no labelled view of a bin, or the picture and the camera differ in size.
    """
    config, camera = config or ReconstructConfig(), seen_from.camera
    if rgb.shape != (camera.height_px, camera.width_px, 3):
        raise RescoreError(
            f"picture: expected {camera.width_px} x {camera.height_px} pixels as the camera says, "
            f"got shape {rgb.shape}; calibrate for this picture size"
        )
    boxes = np.asarray(xyxy_px, float).reshape(-1, 4)
    bins = np.broadcast_to(view_bin, len(boxes)).tolist()
    prepared = {b: prepare_view(model, b, config.registration) for b in {*np.ravel(view_bin).tolist()}}
    views = [prepared[b] for b in bins]
    results: list[Reconstruction | Failure | None] = [
        check_box(box, view.grid, (rgb.shape[1], rgb.shape[0]), config)
        for box, view in zip(boxes, views, strict=True)
    ]
    registered: dict[int, RegisteredOutline | Failure] = dict(known or {})
    todo = [i for i, result in enumerate(results) if result is None and i not in registered]
    outlines = segment(rgb, boxes[todo], [views[i] for i in todo], config)
    for i, outline in zip(todo, outlines, strict=True):
        registered[i] = register(outline, views[i], config.registration)
    for i in (i for i, result in enumerate(results) if result is None):
        found = registered[i]
        results[i] = (
            found
            if isinstance(found, Failure)
            else _instance(
                _shown(found, grid_to_image(views[i].grid, boxes[i]), views[i]),
                view_rotation(views[i], boxes[i], seen_from),
                seen_from,
                config,
            )
        )
    return tuple(r for r in results if r is not None)


def reconstruct_outline(
    ring_px: FloatArray,
    view_bin: int,
    model: ClassModel,
    seen_from: GroundedCamera,
    config: ReconstructConfig,
    turns_rad: Sequence[float] = (0.0,),
) -> tuple[Reconstruction | Failure, ...]:
    """The 3D instances of an outline that is already known, such as one from colour segmentation.

    One for each way in which the object may be turned about the vertical from the middle of its view bin.

    Args:
        ring_px: the closed outline, shape (m, 2), centres of its border pixels.
        view_bin: the bin that it is taken to be seen from.
        model: the class model.
        seen_from: the camera M and the ground plane Q_g.
        config: settings.
        turns_rad: azimuth of the camera seen from the object, less that of the bin.
    """
    view = prepare_view(model, view_bin, config.registration)
    box = np.concatenate([ring_px.min(axis=0), ring_px.max(axis=0) + 1.0])
    picture_px = (seen_from.camera.width_px, seen_from.camera.height_px)
    failure = check_box(box, view.grid, picture_px, config)
    if failure is not None:
        return (failure,) * len(turns_rad)
    to_image = grid_to_image(view.grid, box)
    found = register((ring_px - to_image.shift) / to_image.scale, view, config.registration)
    if isinstance(found, Failure):
        return (found,) * len(turns_rad)
    shown = _shown(found, to_image, view)
    level = view_rotation(view, box, seen_from)
    return tuple(_instance(shown, level @ _about_z(-turn), seen_from, config) for turn in turns_rad)


def segment(
    rgb: UInt8Array, xyxy_px: FloatArray, views: Sequence[PreparedView], config: ReconstructConfig
) -> tuple[FloatArray | Failure, ...]:
    """The closed outline (m, 2) of the object in each box, canonical coordinates; or that there is none.

    Boxes (n, 4) have a view each; those on grids of one size evolve together.
    """
    together: dict[CanonicalGrid, list[int]] = {}
    for i, view in enumerate(views):
        together.setdefault(view.grid, []).append(i)
    found: dict[int, FloatArray | Failure] = {}
    for grid, rows in together.items():
        windows = canonical_windows(rgb, xyxy_px[rows], grid)
        start = np.stack([views[i].phi for i in rows])
        region = colour_evidence(windows, start) if config.segment.region_weight else None
        phi = evolve(start, edge_indicator(windows, config.segment), config.segment, region)
        for i, after, before in zip(rows, phi, start, strict=True):
            found[i] = zero_level(after, before, config.min_outline_iou)
    return tuple(found[i] for i in range(len(views)))


@dataclass(frozen=True, eq=False)
class _RegisteredView:
    """A labelled view deformed to an outline in the picture."""

    view: PreparedView
    cost: float
    """Mean chi-squared cost of the match, in [0, 1]."""
    to_image: GridToImage
    outline_px: FloatArray
    """The outline, shape (m, 2)."""
    points_px: FloatArray
    """Outlines of all regions, shape (p, 2)."""

    @property
    def box_bottom_px(self) -> float:
        """Image row of the lower edge of the box, pixel centres."""
        grid = self.view.grid
        return float(self.to_image(np.array([0.0, grid.margin_px + grid.box_height_px - 0.5]))[1])


def register(
    outline: FloatArray | Failure, view: PreparedView, config: RegistrationConfig
) -> RegisteredOutline | Failure:
    """An outline (m, 2) in canonical coordinates with the parts of a view; why not where there is none."""
    if isinstance(outline, Failure):
        return outline
    parts = register_parts(outline, view, config)
    return parts if isinstance(parts, Failure) else RegisteredOutline(outline, parts)


def _shown(found: RegisteredOutline, to_image: GridToImage, view: PreparedView) -> _RegisteredView:
    outline_px, points_px = to_image(found.outline), to_image(found.parts.points)
    return _RegisteredView(view, found.parts.cost, to_image, outline_px, points_px)


def _instance(
    shown: _RegisteredView,
    cam_from_object: FloatArray,
    seen_from: GroundedCamera,
    config: ReconstructConfig,
) -> Reconstruction | Failure:
    """The reconstruction from registered parts on: ground line found, planes placed."""
    model, camera = shown.view.model, seen_from.camera
    parts = _part_labels(shown, camera)
    feet_cam = {label: cam_from_object @ foot for label, foot in feet(model).items()}
    bottom_px = shown.box_bottom_px if config.box_bottom_is_ground else None
    line = ground_line(parts, feet_cam, seen_from, config.ground_line, bottom_px)
    if isinstance(line, Failure):
        return line
    placed = place_instance(parts, line, cam_from_object, model, camera, config.placing)
    if placed.placed_share < config.placing.min_placed:
        why = "; ".join(f"{model.part_names[k - 1]}: {text}" for k, text in placed.unplaced.items())
        return Failure(
            Reason.PARTS_NOT_PLACED,
            f"at least {config.placing.min_placed:.0%} of the object placed expected, "
            f"got {placed.placed_share:.0%} ({why or 'depth limits'})",
        )
    return Reconstruction(
        outline_px=shown.outline_px,
        initial_outline_px=shown.to_image(shown.view.outline),
        x0_px=parts.x0_px,
        y0_px=parts.y0_px,
        part_labels=parts.labels,
        part_planes=placed.planes,
        unplaced_parts=placed.unplaced,
        depth=DepthMap(parts.x0_px, parts.y0_px, placed.depth),
        ground_line_px=line.line_px,
        cam_from_object=cam_from_object,
        registration_cost=shown.cost,
        placed_share=placed.placed_share,
        part_regions=tuple((label, shown.points_px[rows]) for label, rows in shown.view.rings),
        ground_points_m=line.points_m,
    )


def view_rotation(view: PreparedView, box_px: FloatArray, seen_from: GroundedCamera) -> FloatArray:
    """Rotation (3, 3) from the object frame to the camera frame for an object in a box.

    T_alpha says how the object is turned towards the ray on which it is seen. Under perspective that ray is
    not the optical axis, so the view frame is turned about the vertical onto the ray through the middle of
    the box; and the vertical is that of the ground plane, which replaces the elevation of the labelled views.
    """
    forward = seen_from.level_direction((box_px[:2] + box_px[2:]) / 2 - 0.5)
    down = -seen_from.ground.up
    cam_from_view = np.stack([cross(down, forward), down, forward], axis=1)
    return np.asarray(cam_from_view @ view.model.bins.level_view_from_object(view.view_bin))


def _about_z(angle_rad: float) -> FloatArray:
    """Rotation (3, 3) about the vertical of the object."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def check_box(
    box_px: FloatArray, grid: CanonicalGrid, picture_px: tuple[int, int], config: ReconstructConfig
) -> Failure | None:
    """Why nothing of this grid's aspect can be looked for in a box (4,) of a picture; None where it can.

    ``picture_px`` is the width and height of the picture.
    """
    return check_extent(box_px, picture_px, config.min_inside) or check_aspect(box_px, grid, config)


def check_aspect(box_px: FloatArray, grid: CanonicalGrid, config: ReconstructConfig) -> Failure | None:
    """Why nothing of this grid's aspect can be looked for in a box (4,); None where it can."""
    x0, y0, x1, y1 = box_px.tolist()
    aspect, expected = (x1 - x0) / (y1 - y0), grid.box_width_px / grid.box_height_px
    if max(aspect / expected, expected / aspect) > config.max_aspect_change:
        return Failure(
            Reason.REGISTRATION_FAILED,
            f"a box {expected:.2f} times as wide as high expected for this view, got {aspect:.2f}",
        )
    return None


def check_extent(box_px: FloatArray, picture_px: tuple[int, int], min_inside: float) -> Failure | None:
    """Why a box (4,) is too small, or too far outside a picture of a width and height; None where it is not.

    ``min_inside`` is the smallest share of it that must lie in the picture.
    """
    x0, y0, x1, y1 = box_px.tolist()
    if not (np.isfinite(box_px).all() and x1 - x0 >= 4 and y1 - y0 >= 4):
        return Failure(
            Reason.BOX_OUTSIDE_IMAGE,
            f"a box of at least 4 x 4 pixels expected, got {np.round(box_px, 1).tolist()}",
        )
    width, height = (
        min(max(high, 0), most) - min(max(low, 0), most)
        for low, high, most in ((x0, x1, picture_px[0]), (y0, y1, picture_px[1]))
    )
    inside = width * height / ((x1 - x0) * (y1 - y0))
    if inside < min_inside:
        return Failure(
            Reason.BOX_OUTSIDE_IMAGE,
            f"at least {min_inside:.0%} of the box inside the image expected, got {inside:.0%}",
        )
    return None


def _part_labels(shown: _RegisteredView, camera: PinholeCamera) -> PartLabels:
    """Labels of the pixels inside the outline, in the outline's window."""
    outline_px, size = shown.outline_px, np.array([camera.width_px, camera.height_px])
    low = np.clip(np.floor(outline_px.min(axis=0)), 0, size - 1).astype(int)
    high = np.clip(np.ceil(outline_px.max(axis=0)) + 1, low + 1, size).astype(int)
    width, height = (high - low).tolist()
    labels = np.zeros((height, width), np.uint8)
    points = np.rint((shown.points_px - low) * 16).astype(np.int32)
    for label, rows in shown.view.rings:
        cv2.fillPoly(labels, [points[rows]], label, shift=4)
    inside = fill_polygon(outline_px - low, height, width)
    return PartLabels(int(low[0]), int(low[1]), fill_gaps(labels, inside))


def fill_gaps(labels: UInt8Array, inside: BoolArray) -> UInt8Array:
    """Labels inside the outline; pixels that no region covers get the nearest region's label."""
    own = np.where(inside, labels, np.uint8(0))
    known = own > 0
    gap = inside & ~known
    if not gap.any() or not known.any():
        return own
    _, nearest = cv2.distanceTransformWithLabels(
        (~known).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    # OpenCV numbers the known pixels from 1 on in their order
    own[gap] = own[known][nearest[gap] - 1]
    return own
