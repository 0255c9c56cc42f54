"""An instance of a shape space fitted to the outline of an object that has been reconstructed roughly.

``joint_fit`` looks down on a table and in all directions. Here the camera may be as low as the object, the
fit starts near a pose, and the outline is that of any photograph: it may be cut off by the picture's edge,
hidden in part, or take in the shadow under the object.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull

from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.camera import GroundedCamera, PinholeCamera
from recon.errors import Failure, Reason
from recon.localization.outline_edges import outline_points
from recon.localization.standing_box import cam_from_ground, turn
from recon.outlines import largest_outline
from recon.reconstruction.instance import NEAR_M, Instance3D
from recon.reconstruction.matte import matte, near_silhouette, open_matte
from recon.shape_space import ShapeSpace

_BORDER_PX = 2.0
"""Outline points this near to the picture's edge, or to what hides the object, are no outline of it."""
_SAMPLES = 32
"""Places along each ray that are tried, over the diagonal of the box."""
_SIDE_POINTS = 24
"""Points on each side of the box."""
_SILHOUETTE_PX = 120
"""Longer side of the grid on which silhouettes are found."""
_LEAST_OVERLAP = 0.75
"""Least intersection over union of the matte and the silhouette of its shape."""
_BEYOND = 0.3
"""Silhouettes are compared with their box this far beyond it, in shares of its extent."""
_OVERLAP_NATS, _BESIDE_NATS = 30.0, 60.0
"""What a whole unit of missing overlap, and of distance from the box, speaks against a shape."""
_LEAST_SPREAD = 0.05
"""Least standard deviation of the logarithms of sizes beside what the shape says of them."""
_COARSE_STEPS, _FINE_STEPS = 10, 20
"""Steps of the fit with the mean shape, and with all unknowns."""
_COARSE_SLACK = 3.0
"""The outline's error counts as so many times larger in the first fit."""
_BEST_INSTANCES = 2
"""Number of instances of the space that are refined."""
_POSE_STEP = np.array([0.005, 0.005, 0.003, 0.003, 0.003, 0.003])
"""Steps in x and y (metres), yaw and logarithms of the size over which slopes are taken."""
_SHAPE_STEP = 0.05
"""Steps in coefficients over which slopes are taken."""
_MIRROR_PX = 7
"""Limbs thinner than this many pixels are not of the shape."""
_BROAD = 0.05
"""Half the width of a limb in whose silhouette there may be holes, in roots of the box's area."""
_OFF_PX = 3.0
"""A silhouette may be off by this much where colours see a limb beside it."""
_DOWN = 0.3
"""Sine of the angle below the level from which on an outward normal faces down."""

_ASTRAY_NATS = 2.0
"""An outline that colours gave is kept unless it agrees worse than another by this much."""


@dataclass(frozen=True)
class ShapeFitConfig:
    """Settings of the fit."""

    points: int = 120
    """Points on the outline."""
    starts_deg: tuple[float, ...] = (-15.0, 0.0, 15.0)
    """Directions from the rough pose that the fit starts from."""
    turn_deg: float = 10.0
    """Standard deviation of the direction about that of the rough pose, the middle of a view bin."""
    noise_share: float = 0.006
    """Expected error of the outline, as a share of its box's diagonal."""
    side_weight: float = 0.3
    """Weight of a side of the box that touches the object, in inverses of the error of the outline."""
    side_noise_share: float = 0.008
    """Expected error of the sides of the box, as a share of its diagonal, where thin limbs touch them."""
    below_weight: float = 0.1
    """Weight of points where the outline faces down: colours take in the shadow there, or lose tyres."""
    max_residual: float = 0.03
    """Largest median distance between outline and silhouette, as a share of the box's diagonal."""


@dataclass(frozen=True, eq=False)
class FittedShape:
    """A closed shape with its place in the camera frame."""

    space: ShapeSpace
    coefficients: FloatArray
    """Coefficients of the shape space, shape (k,)."""
    size_m: FloatArray
    """Length, width and height, shape (3,)."""
    cam_from_object: FloatArray
    """Pose (4, 4) of the object frame (x forward, y left, z up, origin under the middle), metres."""

    @property
    def hull(self) -> Float32Array:
        """The hull function on the grid of the space, metres."""
        return self.space.hull(self.coefficients)

    @property
    def parts_m(self) -> FloatArray:
        """Outlines of the parts of ``space.part_labels`` in the object frame, shape (p, m, 3)."""
        return self.space.part_outlines(self.coefficients, self.size_m)

    def silhouette(self, camera: PinholeCamera, xyxy_px: FloatArray) -> BoolArray:
        """Where a camera sees the shape, shape (h, w), in a box (4,) of the picture; false elsewhere."""
        out = np.zeros((camera.height_px, camera.width_px), bool)
        size = np.array([camera.width_px, camera.height_px])
        low = np.clip(np.floor(xyxy_px[:2]), 0, size - 1).astype(int)
        high = np.clip(np.ceil(xyxy_px[2:]), low + 1, size).astype(int)
        step = max(1.0, float((high - low).max()) / _SILHOUETTE_PX)
        width, height = np.maximum(2, np.ceil((high - low) / step)).astype(int).tolist()
        v, u = np.meshgrid(
            *(
                (np.arange(n) + 0.5) * (b - a) / n + a - 0.5
                for n, a, b in zip((height, width), low[::-1], high[::-1], strict=True)
            ),
            indexing="ij",
        )
        back = np.linalg.inv(self.cam_from_object)
        rays = _unit(camera.rays(np.stack([u.ravel(), v.ravel()], axis=1)) @ back[:3, :3].T)
        value = least_values(
            np.asarray(back[:3, 3], float), rays, self.space, self.hull, self.size_m, _SAMPLES
        )
        value = value.reshape(height, width).astype(np.float32)
        fine = cv2.resize(value, tuple((high - low).tolist()), interpolation=cv2.INTER_LINEAR)
        out[low[1] : high[1], low[0] : high[0]] = fine < 0
        return out


@dataclass(frozen=True)
class Agreement:
    """How well a fitted shape goes with the picture and with its box."""

    overlap: float
    """Intersection over union of the matte and the silhouette, in [0, 1]."""
    beside: float
    """Mean distance between the sides of the box that the picture does not cut and those of the silhouette,
    in shares of the box's extent."""

    @property
    def nats(self) -> float:
        """What speaks against the shape; 0 for one that agrees wholly."""
        return _OVERLAP_NATS * (1 - self.overlap) + _BESIDE_NATS * self.beside


@dataclass(frozen=True, eq=False)
class ShapeInBox:
    """A fitted shape with the matte that it explains."""

    matte: Float32Array
    """Shape (h, w), in [0, 1]."""
    shape: FittedShape
    agreement: Agreement


def shape_in_box(
    rgb: UInt8Array,
    inside: BoolArray,
    xyxy_px: FloatArray,
    rough: "Instance3D",
    space: ShapeSpace,
    seen_from: GroundedCamera,
    occluded: BoolArray | None = None,
    expected_px: FloatArray | None = None,
) -> ShapeInBox | Failure:
    """The shape that explains an object best, with its matte, or why none does.

    Colours cannot tell the shadow under an object from its tyres, a shape can; and a shape cannot follow a
    mirror, colours can. So the matte is found again along the border of the first shape, and fitted again.
    Where colours lead astray, into another object or the street, the class's own outline in the box is the
    better start: both are tried, and it is taken where its shape agrees clearly better.

    Args:
        rgb: the picture, shape (h, w, 3).
        inside: about where the object is, shape (h, w).
        xyxy_px: the box, drawn tightly, shape (4,), pixel edges.
        rough: where the object is and how it is turned, roughly.
        space: the shape space of the class.
        seen_from: the camera M and the ground plane Q_g.
        occluded: pixels (h, w) where something else hides the object; None for none.
        expected_px: the outline that the class has in such a box, shape (m, 2), pixel centres; None where it
            is not known. Objects with thin limbs do without.
    """
    full = matte(rgb, inside, xyxy_px)
    limbs = open_matte(rgb, full, xyxy_px) if space.is_thin else None
    share = full if limbs is None else limbs
    firsts = [_fit_to(share, xyxy_px, rough, space, seen_from, occluded)]
    if expected_px is not None and not space.is_thin:
        firsts.append(fit_shape(expected_px, xyxy_px, rough, space, seen_from, occluded))
    found = [
        first
        if isinstance(first, Failure)
        else _along_shape(rgb, xyxy_px, first, space, seen_from, occluded, limbs)
        for first in firsts
    ]
    by_colour = found[0]
    others = [one for one in found[1:] if isinstance(one, ShapeInBox)]
    if isinstance(by_colour, Failure):
        return others[0] if others else by_colour
    better = [one for one in others if one.agreement.nats < by_colour.agreement.nats - _ASTRAY_NATS]
    return better[0] if better else by_colour


def _along_shape(
    rgb: UInt8Array,
    xyxy_px: FloatArray,
    first: FittedShape,
    space: ShapeSpace,
    seen_from: GroundedCamera,
    occluded: BoolArray | None,
    limbs: Float32Array | None,
) -> ShapeInBox | Failure:
    """The matte (h, w) along the border of a shape, and the shape fitted again to it.

    That of an object that is seen through, ``limbs`` (h, w), is kept near the shape.
    """
    silhouette = first.silhouette(seen_from.camera, xyxy_px)
    if limbs is None:
        second = matte(rgb, silhouette, xyxy_px, fitted=True)
    else:
        second = near_silhouette(limbs, silhouette, xyxy_px)
    again = _fit_to(second, xyxy_px, first, space, seen_from, occluded)
    if isinstance(again, Failure):
        return again
    agreement = _agreement(second > 0.5, again, xyxy_px, seen_from.camera, occluded)
    filled = again.silhouette(seen_from.camera, xyxy_px)
    if space.is_thin:
        by_colour = matte(rgb, filled, xyxy_px) if limbs is None else second
        return ShapeInBox(_with_lost_limbs(by_colour, filled, xyxy_px), again, agreement)
    if agreement.overlap < _LEAST_OVERLAP:
        return Failure(
            Reason.REGISTRATION_FAILED,
            f"a silhouette that shares {_LEAST_OVERLAP:.0%} with the object expected, got "
            f"{agreement.overlap:.0%}",
        )
    if occluded is not None:
        filled &= ~occluded
    # tyres and sills are as dark as the shadow; what the shape surely covers is the object
    core = cv2.erode(filled.astype(np.float32), np.ones((_MIRROR_PX, _MIRROR_PX), np.uint8))
    return ShapeInBox(np.maximum(second, core.astype(np.float32)), again, agreement)


def _agreement(
    own: BoolArray,
    shape: FittedShape,
    xyxy_px: FloatArray,
    camera: PinholeCamera,
    occluded: BoolArray | None,
) -> Agreement:
    """How well a shape goes with the object's pixels (h, w) and with its box."""
    extent = np.tile(xyxy_px[2:] - xyxy_px[:2], 2)
    filled = shape.silhouette(camera, xyxy_px + np.array([-1, -1, 1, 1]) * _BEYOND * extent)
    if not filled.any():
        return Agreement(0.0, 1.0)
    rows, columns = np.nonzero(filled)
    sides = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
    size = np.array([camera.width_px, camera.height_px])
    whole = np.concatenate([xyxy_px[:2] > _BORDER_PX, xyxy_px[2:] < size - _BORDER_PX])
    off = (np.abs(sides - xyxy_px) / extent)[whole]
    if occluded is not None:
        own, filled = own & ~occluded, filled & ~occluded
    overlap = float((own & filled).sum() / max((own | filled).sum(), 1))
    return Agreement(overlap, float(off.mean()) if len(off) else 0.0)


def _with_lost_limbs(by_colour: Float32Array, filled: BoolArray, xyxy_px: FloatArray) -> Float32Array:
    """The matte of an object with thin limbs (h, w), and its silhouette (h, w) where that has lost a limb.

    Colours tell slats and spokes from what is seen between them. Where they see no limb at all, the shape is
    believed.
    """
    away = cv2.distanceTransform((by_colour <= 0.5).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    across = 2 * round(_BROAD * float(np.sqrt(np.prod(xyxy_px[2:] - xyxy_px[:2])))) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, across))
    broad = cv2.morphologyEx(filled.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0
    lost = filled & ~broad & (away > _OFF_PX)
    return np.maximum(by_colour, lost.astype(np.float32))


def _fit_to(
    share: Float32Array,
    xyxy_px: FloatArray,
    rough: "Instance3D | FittedShape",
    space: ShapeSpace,
    seen_from: GroundedCamera,
    occluded: BoolArray | None,
) -> FittedShape | Failure:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_MIRROR_PX, _MIRROR_PX))
    how = cv2.MORPH_CLOSE if space.is_thin else cv2.MORPH_OPEN
    ring = largest_outline(cv2.morphologyEx((share > 0.5).astype(np.uint8), how, disc) > 0)
    if ring is None or len(ring) < 8:
        return Failure(Reason.NO_OUTLINE, "an object of its own colours expected, found none in the box")
    return fit_shape(ring, xyxy_px, rough, space, seen_from, occluded)


def fit_shape(
    ring_px: FloatArray,
    xyxy_px: FloatArray,
    rough: "Instance3D | FittedShape",
    space: ShapeSpace,
    seen_from: GroundedCamera,
    occluded: BoolArray | None = None,
    config: ShapeFitConfig | None = None,
) -> FittedShape | Failure:
    """The instance of a shape space that explains an outline best, or why none does.

    Every ray through the outline must graze the object: the least value of the hull function along it is 0.

    Args:
        ring_px: the closed outline, shape (m, 2), centres of its border pixels.
        xyxy_px: the box, shape (4,), pixel edges; its sides touch the object unless the picture
            cuts it.
        rough: where the object is and how it is turned, roughly; a shape fitted before is refined.
        space: the shape space of the class.
        seen_from: the camera M and the ground plane Q_g.
        occluded: pixels (h, w) where something else hides the object; None for none.
        config: settings; None for the defaults.
    """
    config = config or ShapeFitConfig()
    pose = cam_from_ground(seen_from.ground)
    middle = (rough.cam_from_object[:3, 3] - pose[:3, 3]) @ pose[:3, :3]
    nose = rough.cam_from_object[:3, 0] @ pose[:3, :3]
    yaw = float(np.arctan2(nose[1], nose[0]))
    problem = _Problem(ring_px, xyxy_px, yaw, space, seen_from, occluded, config)
    if isinstance(rough, FittedShape):
        log_rest = np.log(rough.size_m) - space.log_size - space.log_size_modes @ rough.coefficients
        found = [problem.refined(np.concatenate([middle[:2], [yaw], log_rest, rough.coefficients]))]
    else:
        log_rest = np.zeros(3)
        found = [
            problem.fit(np.concatenate([middle[:2], [yaw + step], log_rest]))
            for step in np.deg2rad((0.0,) if space.is_thin else config.starts_deg)
        ]
    vector = min(found, key=lambda f: f[1])[0]
    size = space.size_m(vector[6:], vector[3:6])
    off = problem.median_residual(vector) / float(np.linalg.norm(size))
    if off > config.max_residual:
        return Failure(
            Reason.REGISTRATION_FAILED,
            f"a shape within {config.max_residual:.1%} of the outline expected, got {off:.1%}",
        )
    own = np.eye(4)
    own[:2, :2], own[:2, 3] = turn(float(vector[2])), vector[:2]
    return FittedShape(space, vector[6:], size, pose @ own)


class _Problem:
    """The problem of one outline: unknowns x, y, yaw, logarithms of the size, coefficients."""

    def __init__(
        self,
        ring_px: FloatArray,
        xyxy_px: FloatArray,
        yaw_rad: float,
        space: ShapeSpace,
        seen_from: GroundedCamera,
        occluded: BoolArray | None,
        config: ShapeFitConfig,
    ) -> None:
        self.yaw_rad = yaw_rad
        self.space, self.config = space, config
        points, normal = outline_points(ring_px, config.points)
        size = np.array([seen_from.camera.width_px, seen_from.camera.height_px])
        own = ((points > _BORDER_PX) & (points < size - 1 - _BORDER_PX)).all(axis=1)
        if occluded is not None:
            beyond = np.clip(np.rint(points + _BORDER_PX * normal).astype(int), 0, size - 1)
            own &= ~occluded[beyond[:, 1], beyond[:, 0]]
        self.outline = int(own.sum())
        self.sides = _sides(xyxy_px, size)
        points = np.concatenate([points[own], *self.sides])
        self.camera, self.box_px = seen_from.camera, xyxy_px
        self.whole = np.concatenate([xyxy_px[:2] > _BORDER_PX, xyxy_px[2:] < size - _BORDER_PX])
        self.ends = np.zeros((0, 3))
        self.cam_from_ground = cam_from_ground(seen_from.ground)[:3, :3]
        self.rays = _unit(seen_from.camera.rays(points)) @ cam_from_ground(seen_from.ground)[:3, :3]
        self.eye = np.array([0.0, 0.0, seen_from.ground.height_m])
        below = 1.0 if space.is_thin else config.below_weight
        self.trust = np.where(normal[own, 1] > _DOWN, below, 1.0)

    def fit(self, start: FloatArray) -> tuple[FloatArray, float]:
        """Unknowns and their cost, from a start (6,) without coefficients; first with the mean shape."""
        if self.space.is_thin:
            return self._fit_instances(start)
        spread = np.sqrt(self.space.log_size_rest**2 + (self.space.log_size_modes**2).sum(axis=1))
        return self.refined(self._placed(start, np.zeros(self.space.count), spread)[0])

    def _placed(
        self, start: FloatArray, coefficients: FloatArray, size_std: FloatArray
    ) -> tuple[FloatArray, float]:
        """Unknowns and their cost, from a start (6,), of a shape that is left as it is."""
        found, cost = self._solved(
            lambda v: self._costs(np.concatenate([v, coefficients]), size_std, _COARSE_SLACK),
            start,
            _COARSE_STEPS,
        )
        return np.concatenate([found, coefficients]), cost

    def _fit_instances(self, start: FloatArray) -> tuple[FloatArray, float]:
        """Unknowns and their cost, from a start (6,) and the instances of the space one by one.

        The mean of thin limbs is none.
        """
        rest = np.maximum(self.space.log_size_rest, _LEAST_SPREAD)
        rough = []
        for c in self.space.instances:
            self.ends = self._ends(c)
            rough.append(self._placed(start, c, rest))
        best = sorted(rough, key=lambda f: f[1])[:_BEST_INSTANCES]
        return min((self.refined(begin) for begin, _ in best), key=lambda f: f[1])

    def _ends(self, coefficients: FloatArray) -> FloatArray:
        """Points (n, 3) that span the convex hull of a shape, in units of its size."""
        nx, ny, nz = np.nonzero(self.space.hull(coefficients) < 0)
        count, reach = self.space.mean.shape, self.space.reach
        half = np.stack(
            [
                (2 * nx / (count[0] - 1) - 1) * reach[0],
                ny / (count[1] - 1) * reach[1],
                nz / (count[2] - 1) * reach[2],
            ],
            axis=1,
        )
        both = np.concatenate([half, half * [1, -1, 1]])
        return np.asarray(both[ConvexHull(both).vertices])

    def _beyond_sides(self, vector: FloatArray, size_m: FloatArray) -> FloatArray:
        """How far the shape's extent (k,) is off the sides of the box, in shares of the box's diagonal."""
        at = self.ends * size_m
        at[:, :2] = at[:, :2] @ turn(float(vector[2])).T + vector[:2]
        cam = (at - self.eye) @ self.cam_from_ground.T
        uv = self.camera.project(np.insert(cam[:, :2], 2, np.maximum(cam[:, 2], NEAR_M), axis=1))
        off = np.concatenate([uv.min(axis=0), uv.max(axis=0)]) - (self.box_px - 0.5)
        return np.asarray(off[self.whole] / np.linalg.norm(self.box_px[2:] - self.box_px[:2]))

    def refined(self, begin: FloatArray) -> tuple[FloatArray, float]:
        """Unknowns and their cost, from a start with coefficients."""
        rest = np.maximum(self.space.log_size_rest, _LEAST_SPREAD)
        if self.space.is_thin:
            self.ends = self._ends(begin[6:])
        return self._solved(lambda v: self._costs(v, rest, 1.0), begin, _FINE_STEPS)

    def _solved(
        self, costs: Callable[[FloatArray], FloatArray], start: FloatArray, steps: int
    ) -> tuple[FloatArray, float]:
        """Unknowns of least cost near a start, and that cost."""
        # hulls are sampled, so that shorter steps would see their cells
        step = np.concatenate([_POSE_STEP, np.full(len(start) - 6, _SHAPE_STEP)])

        def slopes(at: FloatArray) -> FloatArray:
            here = costs(at)
            return np.stack([(costs(at + d) - here) / d.sum() for d in np.diag(step)], axis=1)

        found = least_squares(costs, start, slopes, max_nfev=steps)
        return found.x, float(found.cost)

    def median_residual(self, vector: FloatArray) -> float:
        """Median distance in metres between outline and silhouette."""
        return float(np.median(np.abs(self._least_values(vector)[: self.outline])))

    def _costs(self, vector: FloatArray, size_std: FloatArray, slack: float) -> FloatArray:
        """Residuals in standard deviations; outlines that err alike count as 40 independent points."""
        least = self._least_values(vector)
        noise_m = slack * self.config.noise_share * float(np.exp(self.space.log_size).max())
        value, sides = least[: self.outline], least[self.outline :].reshape(-1, _SIDE_POINTS)
        weight = self.trust * np.sqrt(40 / len(value)) / noise_m
        touch = sides.min(axis=1) * self.config.side_weight / noise_m
        # Cauchy's loss for the outline; no outlier may outweigh the box and what is known of the class
        weighted = value * weight
        robust = np.sign(weighted) * np.sqrt(np.log1p(weighted**2))
        if self.space.is_thin:
            size_m = self.space.size_m(vector[6:], np.clip(vector[3:6], -1, 1))
            touch = self._beyond_sides(vector, size_m) / (slack * self.config.side_noise_share)
        turned = np.array([vector[2] - self.yaw_rad]) / np.deg2rad(self.config.turn_deg)
        return np.concatenate([robust, touch, turned, vector[3:6] / size_std, vector[6:]])

    def _least_values(self, vector: FloatArray) -> FloatArray:
        """Least value of the hull function along each ray, shape (n,), in metres."""
        size = self.space.size_m(vector[6:], np.clip(vector[3:6], -1, 1))
        back = np.eye(3)
        back[:2, :2] = turn(float(vector[2]))
        eye = (self.eye - np.array([*vector[:2], 0.0])) @ back
        hull = self.space.hull(vector[6:])
        return least_values(eye, self.rays @ back, self.space, hull, size, _SAMPLES)


def _sides(xyxy_px: FloatArray, size_px: NDArray[np.integer]) -> list[FloatArray]:
    """Points (k, 2) on each side of a box that the picture does not cut off."""
    x0, y0, x1, y1 = (xyxy_px - 0.5).tolist()
    across, down = np.linspace(x0, x1, _SIDE_POINTS), np.linspace(y0, y1, _SIDE_POINTS)
    lines = [
        (x0 > _BORDER_PX, (x0, down)),
        (y0 > _BORDER_PX, (across, y0)),
        (x1 < size_px[0] - 1 - _BORDER_PX, (x1, down)),
        (y1 < size_px[1] - 1 - _BORDER_PX, (across, y1)),
    ]
    return [np.stack(np.broadcast_arrays(*line), axis=1) for whole, line in lines if whole]


def _unit(rays: FloatArray) -> FloatArray:
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def least_values(
    eye_m: FloatArray,
    rays: FloatArray,
    space: ShapeSpace,
    hull: Float32Array,
    size_m: FloatArray,
    samples: int,
) -> FloatArray:
    """Least value of a hull function along rays (n, 3) of length 1 from a point (3,), object frame, in m."""
    middle = (np.array([0.0, 0.0, size_m[2] / 2]) - eye_m) @ rays.T
    step = float(np.linalg.norm(size_m)) / samples

    def values(along: FloatArray) -> FloatArray:
        return hull_values(eye_m + along[..., None] * rays[:, None], space, hull, size_m)

    along = middle[:, None] + step * (np.arange(samples) - samples / 2)
    best = along[np.arange(len(rays)), np.argmin(values(along), axis=1)]
    return np.asarray(values(best[:, None] + np.linspace(-step, step, 9)).min(axis=1))


def hull_values(
    points_m: FloatArray, space: ShapeSpace, hull: Float32Array, size_m: FloatArray
) -> FloatArray:
    """Values (...) of a hull function at points (..., 3) of the object frame, metres.

    They are positive below the ground, and grow off the grid.
    """
    unit = points_m.reshape(-1, 3) / size_m
    value = space.hull_values(unit, hull, size_m)
    return np.asarray(np.maximum(value, -unit[:, 2] * size_m[2])).reshape(points_m.shape[:-1])
