"""Where the parts are that the picture does not show (section 4.4): class model to reconstructed instance."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull

from recon.arrays import FloatArray
from recon.camera import GroundedCamera, PinholeCamera
from recon.class_model import ClassModel
from recon.errors import Failure, Reason
from recon.learning.primitives import lift
from recon.reconstruction.part_registration import PreparedView
from recon.reconstruction.place_parts import feet
from recon.reconstruction.reconstruct import Reconstruction


@dataclass(frozen=True)
class TransformConfig:
    """Settings of the transform from the class model to an instance."""

    min_parts: int = 2
    """Fewer placed parts are a failure."""
    own_scale_spread: float = 0.1
    """An axis along which the correspondences spread by this many units of the model (standard deviation)
    has a scale of its own in equal shares with the common one; with less spread the common one prevails."""
    max_stretch: float = 1.5
    """The scale of an axis differs from the common one by no more than this factor."""
    robust_rounds: int = 5
    """Rounds that weigh down the parts that do not fit."""
    ground_weight: float = 1.0
    """Weight of the ground contacts beside all parts together, on the vertical axis."""
    calibrated_ground: bool = False
    """Whether the camera and the ground plane are measured, as on a table: then the outline moves the object
    too, and all three scales; where they are a guess, it only sets the size."""
    outline_error: float = 0.02
    """Expected error of how far the outline reaches in each direction, as a share of its box's diagonal."""
    outline_directions: int = 24
    """Directions in the picture in which the outline is compared."""
    outline_outlier: float = 1.0
    """Errors of the outline beyond this many expected ones count little more: mirrors, aerials, wings."""
    class_stretch: float = 0.15
    """Expected spread of the logarithms of the three scales about their mean: members of a class differ."""
    parts_stretch: float = 0.3
    """Expected error of the logarithm of each scale that the parts give."""
    parts_shift: float = 0.3
    """Expected error of the place that the parts give, as a share of the model's length."""


@dataclass(frozen=True, eq=False)
class ClassToInstance:
    """The 3D transform of section 4.4: a rotation, a scale for each axis of the object, a translation."""

    rotation: FloatArray
    """Rotation from the object frame to the camera frame, shape (3, 3)."""
    scale: FloatArray
    """Metres of a unit of the model along x, y and z of the object, shape (3,)."""
    shift_m: FloatArray
    """Added in the object frame after scaling, shape (3,)."""
    residual_m: float
    """Root-mean-square distance of the correspondences of parts that fit, each part with equal weight."""
    part_residual_m: dict[int, float]
    """Root-mean-square distance of the correspondences of each placed part by label."""

    def __post_init__(self) -> None:
        if self.rotation.shape != (3, 3) or self.scale.shape != (3,) or self.shift_m.shape != (3,):
            raise ValueError(f"transform: {self.rotation.shape}, {self.scale.shape}, {self.shift_m.shape}")
        if not (self.scale > 0).all():
            raise ValueError(f"transform: scales must be positive, got {self.scale}")

    def in_object(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the class model in metres, still along the axes of the object."""
        return np.asarray(points * self.scale + self.shift_m)

    def points(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the class model in the camera frame, metres."""
        return np.asarray(self.in_object(points) @ self.rotation.T)

    def plane(self, plane: FloatArray) -> FloatArray:
        """A plane (4,) of the class model in the camera frame, metres; its normal has length 1."""
        normal = plane[:3] / self.scale
        d = plane[3] - normal @ self.shift_m
        return np.asarray(np.append(self.rotation @ normal, d) / np.linalg.norm(normal))


@dataclass(frozen=True, eq=False)
class PartCorrespondences:
    """Points of one part in the class model and in the instance."""

    model: FloatArray
    """Shape (m, 3), units of the model."""
    instance: FloatArray
    """Shape (m, 3), metres, along the axes of the object, its origin at the camera."""
    weight: float
    """How well the points are known: the square of the sine at which the part is seen."""


def class_to_instance(
    found: Reconstruction,
    view: PreparedView,
    seen_from: GroundedCamera,
    config: TransformConfig | None = None,
) -> ClassToInstance | Failure:
    """The transform that carries the class model onto the placed parts of an instance.

    The planes of the instance are those of the class model turned by T_alpha, so the rotation is known;
    scales and translation are fitted to points of the placed parts. A point of a region of the labelled image
    is lifted onto the part's plane in the class model, and where registration puts it in the picture it is
    lifted onto the part's plane in the instance.

    Args:
        found: the reconstruction.
        view: the model side of the bin that it is seen from (``prepare_view``).
        seen_from: the camera M and the ground plane Q_g.
        config: settings; None for the defaults.
    """
    config = config or TransformConfig()
    parts = part_correspondences(found, view, seen_from.camera)
    if len(parts) < config.min_parts:
        return Failure(
            Reason.PARTS_NOT_PLACED,
            f"at least {config.min_parts} placed parts of the class model expected to carry it over, "
            f"got {len(parts)}",
        )
    foot = feet(view.model)
    contacts = [k for k in found.ground_points_m if k in foot]
    heights = np.array([foot[k][2] for k in contacts])
    scale, shift, weights = _fit(parts, heights, -seen_from.ground.height_m, config)
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        return Failure(
            Reason.PARTS_NOT_PLACED,
            f"placed parts that fix a positive scale expected, got {np.round(scale, 3).tolist()} m a unit",
        )
    if config.calibrated_ground:
        scale, shift = _as_seen_on_ground(scale, shift, found, view, seen_from, config)
    else:
        scale, shift = _as_large_as_seen(scale, shift, found, view, seen_from.camera)
    residual = {
        k: float(np.sqrt(((p.model * scale + shift - p.instance) ** 2).sum(axis=1).mean()))
        for k, p in parts.items()
    }
    squares = np.array(list(residual.values())) ** 2
    total = float(np.sqrt(np.average(squares, weights=weights)))
    return ClassToInstance(found.cam_from_object, scale, shift, total, residual)


def _as_large_as_seen(
    scale: FloatArray,
    shift: FloatArray,
    found: Reconstruction,
    view: PreparedView,
    camera: PinholeCamera,
) -> tuple[FloatArray, FloatArray]:
    """Scale and shift with which the parts of the labelled image are as wide and as high as the outline.

    Outlines of the class model's parts come from several instances and reach farther than any one. The middle
    of the model and its lowest points keep their place. An outline that the picture cuts off says nothing.
    """
    outline, size = found.outline_px, np.array([camera.width_px, camera.height_px])
    labelled = {label for label, _ in view.rings}
    points = np.concatenate([p.outline for p in view.model.parts if p.label in labelled])
    seen = (points * scale + shift) @ found.cam_from_object.T
    if (outline < 1).any() or (outline > size - 2).any() or (seen[:, 2] <= 0).any():
        return scale, shift
    wide, high = np.ptp(outline, axis=0) / np.maximum(np.ptp(camera.project(seen), axis=0), 1e-9)
    factor = np.array([wide, wide, high])
    low, top = points.min(axis=0), points.max(axis=0)
    fixed = np.array([(low[0] + top[0]) / 2, (low[1] + top[1]) / 2, low[2]])
    return scale * factor, shift + (1 - factor) * scale * fixed


def _as_seen_on_ground(
    scale: FloatArray,
    shift: FloatArray,
    found: Reconstruction,
    view: PreparedView,
    seen_from: GroundedCamera,
    config: TransformConfig,
) -> tuple[FloatArray, FloatArray]:
    """Scale and shift with which the whole model stands on the ground and fills the box of the outline.

    Planes of single parts scatter, and an edge-on one says nothing of its place; the outline says how large
    the whole is, and the ground how far. So the box is fitted, near the parts and near the class model's
    proportions. An outline that the picture cuts off says nothing.
    """
    camera, height_m = seen_from.camera, seen_from.ground.height_m
    outline, size = found.outline_px, np.array([camera.width_px, camera.height_px])
    points = model_hull(view.model)
    low, high = points.min(axis=0), points.max(axis=0)
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    nearest = float(((points * scale + shift) @ found.cam_from_object.T)[:, 2].min())
    if (outline < 1).any() or (outline > size - 2).any() or nearest <= 0:
        return scale, shift
    directions = _directions(config.outline_directions)
    reach = (outline @ directions).max(axis=0)
    tolerance_px = config.outline_error * float(np.linalg.norm(np.ptp(outline, axis=0)))
    start = np.append(np.log(scale), (foot * scale + shift)[:2])
    reach_m = config.parts_shift * float(scale.mean())

    def moved(unknown: FloatArray) -> tuple[FloatArray, FloatArray]:
        new = np.exp(unknown[:3])
        return new, np.append(unknown[3:], -height_m) - new * foot

    def residual(unknown: FloatArray) -> FloatArray:
        new, by = moved(unknown)
        cam = (points * new + by) @ found.cam_from_object.T
        uv = camera.project(np.insert(cam[:, :2], 2, np.maximum(cam[:, 2], nearest / 10), axis=1))
        off = ((uv @ directions).max(axis=0) - reach) / tolerance_px
        away = unknown - start
        return np.concatenate(
            [
                _bounded(off, config.outline_outlier),
                (unknown[:3] - unknown[:3].mean()) / config.class_stretch,
                away[:3] / config.parts_stretch,
                away[3:] / reach_m,
            ]
        )

    return moved(least_squares(residual, start, max_nfev=15).x)


@lru_cache(maxsize=8)
def model_hull(model: ClassModel) -> FloatArray:
    """Corners (m, 3) of the convex hull of all part outlines."""
    points = np.concatenate([p.outline for p in model.parts])
    return np.asarray(points[ConvexHull(points).vertices])


@lru_cache(maxsize=8)
def _directions(count: int) -> FloatArray:
    """Unit vectors all around, shape (2, count)."""
    angle = np.arange(count) * (2 * np.pi / count)
    return np.stack([np.cos(angle), np.sin(angle)])


def _bounded(error: FloatArray, limit: float) -> FloatArray:
    """Errors whose square grows with its logarithm beyond a limit."""
    return np.asarray(np.sign(error) * limit * np.sqrt(np.log1p((error / limit) ** 2)))


def part_correspondences(
    found: Reconstruction, view: PreparedView, camera: PinholeCamera
) -> dict[int, PartCorrespondences]:
    """Corresponding points of every placed part, by label."""
    model = view.model
    rotation = model.bins.view_from_object(view.view_bin)
    to_units = _labelled_image_in_units(view, rotation)
    if to_units is None:
        return {}
    scale, shift = to_units
    pairs: dict[int, list[tuple[FloatArray, FloatArray]]] = {}
    for (label, rows), (_, polygon) in zip(view.rings, found.part_regions, strict=True):
        if label not in found.part_planes:
            continue
        part = model.part(label)
        on_class = _on_class_plane(view.region_points[rows] * scale + shift, part.plane, rotation)
        plane = found.part_planes[label]
        rays = camera.rays(polygon)
        with np.errstate(divide="ignore", invalid="ignore"):
            on_instance = rays * (-plane[3] / (rays @ plane[:3]))[:, None]
        good = np.isfinite(on_class).all(axis=1) & np.isfinite(on_instance).all(axis=1)
        good &= on_instance[:, 2] > 0
        pairs.setdefault(label, []).append((on_class[good], on_instance[good] @ found.cam_from_object))
    out = {}
    for label, both in pairs.items():
        a, b = np.concatenate([p[0] for p in both]), np.concatenate([p[1] for p in both])
        if len(a) >= 3:
            facing = float(abs(rotation[2] @ model.part(label).plane[:3]))
            out[label] = PartCorrespondences(a, b, facing**2)
    return out


def _on_class_plane(units: FloatArray, plane: FloatArray, rotation: FloatArray) -> FloatArray:
    """Points (m, 3) of the class model on a plane (4,) that a view shows at (m, 2), in units of the model."""
    through = -plane[3] * plane[:3]
    return np.asarray(through + (units - through @ rotation[:2].T) @ lift(plane[None, :3], rotation)[0].T)


def _labelled_image_in_units(view: PreparedView, rotation: FloatArray) -> tuple[float, FloatArray] | None:
    """Scale and shift (2,) from pixels of the labelled image to the model as its view bin shows it.

    They carry the centroids of the regions onto those of the parts, as learning did.
    """
    rows: dict[int, list[FloatArray]] = {}
    for label, which in view.rings:
        rows.setdefault(label, []).append(view.region_points[which])
    known = {p.label: p for p in view.model.parts}
    labels = [k for k in rows if k in known]
    if len(labels) < 2:
        return None
    # the largest ring is the outer one
    pixels = np.array([_area_centroid(rows[k][0]) for k in labels])
    units = np.array([known[k].centroid @ rotation[:2].T for k in labels])
    a, b = pixels - pixels.mean(axis=0), units - units.mean(axis=0)
    scale = float((a * b).sum() / max(float((a**2).sum()), 1e-12))
    return (scale, units.mean(axis=0) - scale * pixels.mean(axis=0)) if scale > 0 else None


def _area_centroid(ring: FloatArray) -> FloatArray:
    """Centroid (2,) of the area inside a ring (m, 2)."""
    a, b = ring, np.roll(ring, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = cross.sum()
    if abs(area) < 1e-9:
        return np.asarray(ring.mean(axis=0))
    return np.asarray(((a + b) * cross[:, None]).sum(axis=0) / (3 * area))


def _fit(
    parts: Mapping[int, PartCorrespondences],
    foot_heights: FloatArray,
    ground_height_m: float,
    config: TransformConfig,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Scale (3,), shift (3,) and the weights of the parts (k,).

    Iteratively reweighted: a part that lies farther off than the others usually do loses weight.
    """
    base = np.array([p.weight for p in parts.values()])
    weights = base / base.sum()
    for _ in range(config.robust_rounds):
        scale, shift = _weighted_fit(list(parts.values()), weights, foot_heights, ground_height_m, config)
        off = np.array(
            [
                np.sqrt(((p.model * scale + shift - p.instance) ** 2).sum(axis=1).mean())
                for p in parts.values()
            ]
        )
        usual = max(float(np.median(off)), 1e-6)
        weights = base / (1 + (off / usual) ** 2) ** 2
        weights /= weights.sum()
    return scale, shift, weights


def _weighted_fit(
    parts: list[PartCorrespondences],
    weights: FloatArray,
    foot_heights: FloatArray,
    ground_height_m: float,
    config: TransformConfig,
) -> tuple[FloatArray, FloatArray]:
    """Scale and shift along each axis, drawn to the common scale where the points do not spread."""
    a = np.concatenate([p.model for p in parts])
    b = np.concatenate([p.instance for p in parts])
    w = np.concatenate([np.full(len(p.model), v / len(p.model)) for p, v in zip(parts, weights, strict=True)])
    w_axis = [w, w, w]
    a_axis = [a[:, 0], a[:, 1], a[:, 2]]
    b_axis = [b[:, 0], b[:, 1], b[:, 2]]
    if len(foot_heights):
        # the feet stand on the ground
        share = np.full(len(foot_heights), config.ground_weight / len(foot_heights))
        w_axis[2] = np.concatenate([w, share])
        a_axis[2] = np.concatenate([a_axis[2], foot_heights])
        b_axis[2] = np.concatenate([b_axis[2], np.full(len(foot_heights), ground_height_m)])
    a_mean = np.array([np.average(x, weights=v) for x, v in zip(a_axis, w_axis, strict=True)])
    b_mean = np.array([np.average(x, weights=v) for x, v in zip(b_axis, w_axis, strict=True)])
    var = np.array([np.average((a_axis[k] - a_mean[k]) ** 2, weights=w_axis[k]) for k in range(3)])
    cov = np.array(
        [np.average((a_axis[k] - a_mean[k]) * (b_axis[k] - b_mean[k]), weights=w_axis[k]) for k in range(3)]
    )
    common = float(cov.sum() / max(float(var.sum()), 1e-12))
    prior = config.own_scale_spread**2
    scale = (cov + prior * common) / (var + prior)
    if common > 0:
        scale = np.clip(scale, common / config.max_stretch, common * config.max_stretch)
    return scale, b_mean - scale * a_mean
