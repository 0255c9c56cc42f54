"""Pose and bounding box of an object on a known ground plane from its outline (section 5.1).

Three ways: by the report's construction, by a joint fit of pose and shape, and by one upright plane.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from recon.camera import GroundPlane, PinholeCamera
from recon.class_model import ClassModel
from recon.class_to_instance import InstanceTransform, fit_instance_transform
from recon.errors import RescoreError
from recon.joint_fit import FittedInstance, JointFitConfig, joint_fits
from recon.outcome import Failure, Reason
from recon.outline_edges import OutlineEdgeConfig, OutlinePoints, points_on_edges
from recon.outlines import canonical_ring, fill_polygon, largest_outline
from recon.reconstruct import ReconstructConfig, Reconstruction, reconstruct_outline
from recon.shape_space import ShapeSpace
from recon.standing_box import StandingBox, angle_between, cam_from_ground
from recon.view_bins import ViewBins

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_RING_POINTS = 24
"""Points on each part outline that the class model and the instance are compared by."""


@dataclass(frozen=True)
class FitConfig:
    """Settings of localisation by the joint fit."""

    view_bins: int = 12
    """Directions that the fit starts from."""
    outline_points: int = 160
    """Points on the outline."""
    max_cost: float = 600.0
    """A larger cost is a failure: the class does not explain the outline. That of cars is about 25."""
    max_deviation: float = 12.0
    """A larger length of the shape coefficients is a failure: no object of the class looks like this. Where
    k of them are standard normal, it is about the root of k."""
    edges: OutlineEdgeConfig = field(default_factory=OutlineEdgeConfig)
    fit: JointFitConfig = field(default_factory=JointFitConfig)


@dataclass(frozen=True, eq=False)
class UprightSurface:
    """One vertical surface, as in pop-ups of Hoiem et al.; it has no depth, so no box and no front."""

    centroid_m: FloatArray
    """Mean of its points in the ground frame, shape (3,)."""
    yaw_rad: float
    """Direction of its ground line, in [0, pi)."""


def single_plane(mask: Mask, camera: PinholeCamera, ground: GroundPlane) -> UprightSurface | Failure:
    """The vertical surface through the ground line of the whole region of a mask (h, w).

    The ground line is fitted to the lowest pixel of each column.
    """
    columns = np.nonzero(mask.any(axis=0))[0]
    if len(columns) < 2:
        return Failure(Reason.NO_OUTLINE, f"a region of two columns or more expected, got {len(columns)}")
    lowest = mask.shape[0] - 1 - np.argmax(mask[::-1, columns], axis=0) + 0.5
    slope, offset = np.polyfit(columns.astype(float), lowest, 1)
    ends = columns[[0, -1]].astype(float)
    line_m = ground.intersect(camera.rays(np.stack([ends, slope * ends + offset], axis=1)))
    if not np.isfinite(line_m).all():
        return Failure(
            Reason.ABOVE_HORIZON, "a ground line below the horizon expected, got one that crosses it"
        )
    along = line_m[1] - line_m[0]
    normal = np.cross(along, ground.up)
    v, u = np.nonzero(mask)
    rays = camera.rays(np.stack([u, v], axis=1).astype(float))
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (line_m[0] @ normal) / (rays @ normal)
    seen = depth > 0
    if not seen.any():
        return Failure(
            Reason.PARTS_NOT_PLACED, "a surface in front of the camera expected, it is seen edge-on"
        )
    pose = cam_from_ground(ground)
    centroid = (depth[seen, None] * rays[seen]).mean(axis=0)
    direction = along @ pose[:3, :3]
    yaw = float(np.arctan2(direction[1], direction[0])) % np.pi
    return UprightSurface((centroid - pose[:3, 3]) @ pose[:3, :3], yaw)


@dataclass(frozen=True, eq=False)
class PartsLocalization:
    """What the report's construction says of one outline."""

    box: StandingBox
    view_bin: int
    reconstruction: Reconstruction
    transform: InstanceTransform
    """From the class model to the instance in the ground frame."""
    cost: float
    """Registration cost plus what the projected instance and the outline do not share (1 - IoU)."""


def localize_by_parts(
    ring_px: FloatArray,
    model: ClassModel,
    camera: PinholeCamera,
    ground: GroundPlane,
    config: ReconstructConfig,
) -> PartsLocalization | Failure:
    """The report's construction from every view bin; the bin of least cost.

    Parts are registered to the outline and placed from the ground line up (section 4.3); the transform from
    the class model to the placed parts places the others (section 4.4), and all together give the box.
    """
    tried = [_from_bin(ring_px, view.view_bin, model, camera, ground, config) for view in model.views]
    found = [t for t in tried if isinstance(t, PartsLocalization)]
    if found:
        return min(found, key=lambda t: t.cost)
    failures = [t for t in tried if isinstance(t, Failure)]
    return failures[0]


def _from_bin(
    ring_px: FloatArray,
    view_bin: int,
    model: ClassModel,
    camera: PinholeCamera,
    ground: GroundPlane,
    config: ReconstructConfig,
) -> PartsLocalization | Failure:
    built = reconstruct_outline(ring_px, view_bin, model, camera, ground, config)
    if isinstance(built, Failure):
        return built
    pose = cam_from_ground(ground)
    nose = pose[:3, :3].T @ built.cam_from_object[:, 0]
    yaw = float(np.arctan2(nose[1], nose[0]))
    model_points, instance_points = _correspondences(built, model, camera, pose)
    try:
        transform = fit_instance_transform(model_points, instance_points, yaw)
    except RescoreError as error:
        return Failure(Reason.PARTS_NOT_PLACED, str(error))
    box = _box(transform, model)
    iou = _projection_iou(transform, model, ring_px, camera, pose)
    return PartsLocalization(box, view_bin, built, transform, built.registration_cost + 1 - iou)


def _correspondences(
    built: Reconstruction, model: ClassModel, camera: PinholeCamera, pose: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) of the class model's parts, and where the placed parts have them, ground frame."""
    of_model, of_instance = [], []
    for label, plane in built.part_planes.items():
        ring = largest_outline(built.part_labels == label)
        if ring is None or len(ring) < 8:
            continue
        rays = camera.rays(ring + np.array([built.x0_px, built.y0_px]))
        points = rays * (-plane[3] / (rays @ plane[:3]))[:, None]
        own = canonical_ring(points @ built.cam_from_object, model.part(label).plane[:3], _RING_POINTS)
        in_cam = own @ built.cam_from_object.T
        of_instance.append((in_cam - pose[:3, 3]) @ pose[:3, :3])
        part = model.part(label)
        of_model.append(canonical_ring(part.outline, part.plane[:3], _RING_POINTS))
    if not of_model:
        return np.zeros((0, 3)), np.zeros((0, 3))
    return np.concatenate(of_model), np.concatenate(of_instance)


def _box(transform: InstanceTransform, model: ClassModel) -> StandingBox:
    """The box around all parts of the class model, moved onto the instance; it stands on the ground."""
    points = np.concatenate([p.outline for p in model.parts])
    low, high = points.min(axis=0), points.max(axis=0)
    size = (high - low) * transform.scale
    middle = transform((low + high) / 2)
    return StandingBox(middle[:2], transform.yaw_rad, np.append(size[:2], max(middle[2] + size[2] / 2, 1e-3)))


def _projection_iou(
    transform: InstanceTransform,
    model: ClassModel,
    ring_px: FloatArray,
    camera: PinholeCamera,
    pose: FloatArray,
) -> float:
    """Intersection over union of the outline's region and the projected parts, in [0, 1]."""
    low = np.floor(ring_px.min(axis=0)) - 20
    width, height = (np.ceil(ring_px.max(axis=0)) + 21 - low).astype(int)
    region = fill_polygon(ring_px - low, height, width)
    parts = np.zeros_like(region)
    for part in model.parts:
        cam = transform(part.outline) @ pose[:3, :3].T + pose[:3, 3]
        if (cam[:, 2] > 0).all():
            parts |= fill_polygon(camera.project(cam) - low, height, width)
    return float((region & parts).sum() / (region | parts).sum())


@dataclass(frozen=True, eq=False)
class FitLocalization:
    """What the joint fit says of one outline."""

    box: StandingBox
    fit: FittedInstance
    outline: OutlinePoints
    """The points that were fitted."""
    runner_up: FittedInstance | None
    """The best fit of another direction of the nose; None where all starts led to one."""


def localize_by_fit(
    light: NDArray[np.float32],
    background: NDArray[np.float32],
    ring_px: FloatArray,
    space: ShapeSpace,
    camera: PinholeCamera,
    ground: GroundPlane,
    config: FitConfig,
) -> FitLocalization | Failure:
    """The joint fit of pose and shape, started from the middle of every view bin; the least cost wins.

    Args:
        light: linear light of the picture, shape (h, w, 3).
        background: the same of the empty scene.
        ring_px: outline from the segmentation, shape (m, 2), centres of its border pixels.
        space: the shape space of the class.
        camera: M.
        ground: Q_g.
        config: settings.
    """
    if not np.isfinite(ground.intersect(camera.rays(ring_px))).all():
        return Failure(Reason.ABOVE_HORIZON, "an outline below the horizon expected, got points above it")
    outline = points_on_edges(light, background, ring_px, config.outline_points, config.edges)
    fits = joint_fits(outline, space, camera, ground, ViewBins(config.view_bins), config.fit)
    best = fits[0]
    deviation = float(np.linalg.norm(best.coefficients))
    if best.cost > config.max_cost or deviation > config.max_deviation:
        return Failure(
            Reason.REGISTRATION_FAILED,
            f"a cost of at most {config.max_cost:g} and a deviation from the mean shape of at most "
            f"{config.max_deviation:g} expected, got {best.cost:.0f} and {deviation:.1f}",
        )
    others = [f for f in fits[1:] if angle_between(f.yaw_rad, best.yaw_rad) > np.deg2rad(15)]
    return FitLocalization(
        best.box(space, config.fit.model_scale), best, outline, others[0] if others else None
    )
