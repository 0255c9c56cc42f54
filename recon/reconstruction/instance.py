"""The 3D instance of section 4: parts on planes, pose, size and box; and its depth from any camera."""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.class_model import ClassModel
from recon.depth_map import DepthMap
from recon.errors import Failure
from recon.outlines import largest_outline, resample
from recon.reconstruction.occluded_parts import ClassToInstance, TransformConfig, class_to_instance
from recon.reconstruction.part_registration import RegistrationConfig, prepare_view
from recon.reconstruction.reconstruct import Reconstruction

NEAR_M = 0.05
"""Surfaces nearer to a camera than this are cut off."""
_OUTLINE_POINTS = 96
MIN_SEEN_SINE = float(np.sin(np.deg2rad(20.0)))
"""Sine of the smallest angle at which the rays of a part may meet its plane for its outline to be of use: a
pixel is three times as long on the plane there, and errors of its outline with it."""
_MAX_CONTRADICTED = 0.6
"""A predicted part that the picture does not show is left out where more than this share of it would lie
outside the outline or before what the picture shows: this instance has no such part."""
_MAX_ASTRAY = 0.13
"""A placed plane farther than this share of the box's diagonal from where the class model has the part comes
from a border that is none in 3D; the part is predicted instead."""
_MAX_BEYOND = 0.2
"""A placed part whose outline leaves the box by more than this share of the box's diagonal is predicted
instead."""


@dataclass(frozen=True, eq=False)
class InstancePart:
    """One part of an instance: a polygon on a plane, in the camera frame of the picture."""

    label: int
    name: str
    plane: FloatArray
    """(a, b, c, d) with a X + b Y + c Z + d = 0 in metres, shape (4,); (a, b, c) has length 1."""
    outline_m: FloatArray
    """Polygon (m, 3) on the plane, metres."""
    seen: bool
    """Placed from the picture (section 4.3); False where the class model predicts it (section 4.4)."""

    def __post_init__(self) -> None:
        if self.plane.shape != (4,) or self.outline_m.ndim != 2 or self.outline_m.shape[1] != 3:
            raise ValueError(f"part {self.name}: {self.plane.shape}, {self.outline_m.shape}")
        if not np.isclose(np.linalg.norm(self.plane[:3]), 1.0):
            raise ValueError(f"part {self.name}: the normal must have length 1, got {self.plane}")

    @property
    def facing_sine(self) -> float:
        """Sine of the angle, in [0, 1], at which rays from the picture's camera meet the plane (mean)."""
        rays = self.outline_m / np.linalg.norm(self.outline_m, axis=1)[:, None]
        return float(np.abs(rays @ self.plane[:3]).mean())

    def depth_along(self, rays: FloatArray) -> FloatArray:
        """Z-depth (n,) at which rays (n, 3) with z = 1 meet the plane, within the depths of the outline.

        The bounds keep rays along a plane seen edge-on from leaving the object.
        """
        near, far = max(float(self.outline_m[:, 2].min()), NEAR_M), float(self.outline_m[:, 2].max())
        with np.errstate(divide="ignore", invalid="ignore"):
            z = -self.plane[3] / (rays @ self.plane[:3])
        # behind the camera means that the ray leaves the plane at its far end
        return np.clip(np.where(z > 0, z, far), near, max(near, far))


@dataclass(frozen=True)
class InstanceQuality:
    """What tells how far an instance can be trusted."""

    registration_cost: float
    """Mean chi-squared cost of the outline match, in [0, 1]."""
    placed_share: float
    """Share of the object's pixels on placed parts, in [0, 1]."""
    transform_residual_m: float
    """Root-mean-square distance of placed parts from the class model carried onto them."""


@dataclass(frozen=True, eq=False)
class Instance3D:
    """A reconstructed object.

    The object frame has x forward, y left, z up; its origin lies on the ground under the middle of the box.
    """

    class_name: str
    view_bin: int
    parts: tuple[InstancePart, ...]
    """Seen parts and predicted ones, by label; each label once."""
    cam_from_object: FloatArray
    """Pose (4, 4), metres: a rotation and a translation."""
    size_m: FloatArray
    """Length, width and height of the box along the object's axes, shape (3,)."""
    unplaced: dict[str, str]
    """Why parts have no plane of their own from the picture though it could show them, by name. Those in the
    picture are among the predicted parts; those that the instance seems not to have are in no list."""
    class_to_instance: ClassToInstance
    """The transform of section 4.4."""
    quality: InstanceQuality

    def __post_init__(self) -> None:
        turn = self.cam_from_object[:3, :3]
        if self.cam_from_object.shape != (4, 4) or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
            raise ValueError(f"instance: expected a rigid pose (4, 4), got {self.cam_from_object}")
        if self.size_m.shape != (3,) or not (self.size_m > 0).all():
            raise ValueError(f"instance: expected three positive sizes, got {self.size_m}")
        labels = [p.label for p in self.parts]
        if labels != sorted(set(labels)):
            raise ValueError(f"instance: labels {labels} must be sorted and differ")

    @property
    def corners_m(self) -> FloatArray:
        """Corners of the 3D box (8, 3), camera frame: rear, right, low before front, left, high."""
        length, width, height = self.size_m
        x, y, z = np.meshgrid([-length / 2, length / 2], [-width / 2, width / 2], [0, height], indexing="ij")
        corners = np.stack([x, y, z], axis=-1).reshape(8, 3)
        return np.asarray(corners @ self.cam_from_object[:3, :3].T + self.cam_from_object[:3, 3])

    @property
    def centroid_m(self) -> FloatArray:
        """Middle of the box (3,), camera frame."""
        return np.asarray(self.corners_m.mean(axis=0))

    @property
    def distance_m(self) -> float:
        """Distance in metres from the camera to the middle of the box."""
        return float(np.linalg.norm(self.centroid_m))

    @property
    def yaw_rad(self) -> float:
        """Heading of the nose about the object's up, in radians from the camera's right; positive away from
        the camera."""
        nose, up = self.cam_from_object[:3, 0], self.cam_from_object[:3, 2]
        right = np.array([1.0, 0.0, 0.0]) - up[0] * up
        return float(np.arctan2(nose @ np.cross(up, right), nose @ right))

    @property
    def azimuth_rad(self) -> float:
        """Direction of the camera seen from the object, [0, 2 pi): 0 before the nose, pi / 2 on its left."""
        x, y, _ = -self.cam_from_object[:3, :3].T @ self.cam_from_object[:3, 3]
        return float(np.arctan2(y, x) % (2 * np.pi))

    def depth(self, camera: PinholeCamera, cam_from_instance: FloatArray) -> DepthMap:
        """Z-depth of the nearest part at each pixel centre of a camera; NaN where there is none.

        Args:
            camera: the camera to look from.
            cam_from_instance: (4, 4) from the camera frame of the picture to the frame of that camera.
        """
        shape = (camera.height_px, camera.width_px)
        nearest = np.full(shape, np.inf)
        for part in self.parts:
            window = _part_depth(part, camera, cam_from_instance)
            if window is not None:
                rows, cols, depth = window
                np.fmin(nearest[rows, cols], depth, out=nearest[rows, cols])
        return DepthMap(0, 0, np.where(np.isfinite(nearest), nearest, np.nan).astype(np.float32))


def build_instance(
    found: Reconstruction,
    view_bin: int,
    model: ClassModel,
    seen_from: GroundedCamera,
    registration: RegistrationConfig | None = None,
    transform: TransformConfig | None = None,
    occluded: BoolArray | None = None,
) -> Instance3D | Failure:
    """The 3D instance of a reconstruction, completed by the class model; or why it cannot be completed.

    Args:
        found: what ``reconstruct`` returned, fresh (evidence files leave out what is needed here).
        view_bin: the bin that it was reconstructed with.
        model: the class model.
        seen_from: the camera and the ground plane that it was reconstructed with.
        registration: the settings of part registration that it was reconstructed with.
        transform: settings of the transform of section 4.4.
        occluded: pixels (h, w) of the picture where something else hides the object; that they do not show a
            part says nothing. None for no such pixels.
    """
    view = prepare_view(model, view_bin, registration or RegistrationConfig())
    moved = class_to_instance(found, view, seen_from, transform)
    if isinstance(moved, Failure):
        return moved
    pose, size = _box(moved, model, seen_from.ground)
    placed = _seen_parts(found, model, seen_from.camera)
    astray = _astray(placed, moved, model, pose, size)
    seen = [p for p in placed if p.label not in astray]
    have = {p.label for p in seen}
    predicted = [
        InstancePart(
            p.label, model.part_names[p.label - 1], moved.plane(p.plane), moved.points(p.outline), False
        )
        for p in model.parts
        if p.label not in have
    ]
    absent = _absent(found, seen, predicted, seen_from.camera, occluded)
    predicted = [p for p in predicted if p.label not in absent]
    unplaced = found.unplaced_parts | astray | absent
    return Instance3D(
        class_name=model.class_name,
        view_bin=view_bin,
        parts=tuple(sorted([*seen, *predicted], key=lambda p: p.label)),
        cam_from_object=pose,
        size_m=size,
        unplaced={model.part_names[k - 1]: why for k, why in unplaced.items()},
        class_to_instance=moved,
        quality=InstanceQuality(found.registration_cost, found.placed_share, moved.residual_m),
    )


def _astray(
    placed: list[InstancePart],
    moved: ClassToInstance,
    model: ClassModel,
    pose: FloatArray,
    size_m: FloatArray,
) -> dict[int, str]:
    """Why placed parts that contradict the class model are not used, by label."""
    diagonal_m = float(np.linalg.norm(size_m))
    limit_m, reach_m = _MAX_ASTRAY * diagonal_m, _MAX_BEYOND * diagonal_m
    low, high = size_m * np.array([-0.5, -0.5, 0.0]), size_m * np.array([0.5, 0.5, 1.0])
    out = {}
    for part in placed:
        off = abs(float(part.plane[:3] @ moved.points(model.part(part.label).centroid) + part.plane[3]))
        inside = (part.outline_m - pose[:3, 3]) @ pose[:3, :3]
        beyond = float(np.maximum(low - inside, inside - high).max())
        sine = part.facing_sine
        if sine < MIN_SEEN_SINE:
            out[part.label] = f"seen at {np.rad2deg(np.arcsin(sine)):.1f} degrees, too flat for its outline"
        elif off > limit_m:
            out[part.label] = f"its plane lies {off:.2f} m off the class model, more than {limit_m:.2f} m"
        elif beyond > reach_m:
            out[part.label] = f"its outline leaves the box by {beyond:.2f} m, more than {reach_m:.2f} m"
    return out


def _absent(
    found: Reconstruction,
    seen: list[InstancePart],
    predicted: list[InstancePart],
    camera: PinholeCamera,
    occluded: BoolArray | None = None,
) -> dict[int, str]:
    """Why predicted parts are left out that the picture would show but does not, by label."""
    shown = np.full((camera.height_px, camera.width_px), -np.inf)
    inside = np.zeros(shown.shape, bool)
    inside[found.depth.window] = found.part_labels > 0
    shown[inside] = np.inf
    for part in seen:
        window = _part_depth(part, camera, np.eye(4))
        if window is not None:
            rows, cols, depth = window
            np.fmin(shown[rows, cols], depth, out=shown[rows, cols], where=inside[rows, cols])
    in_picture = set(np.unique(found.part_labels).tolist())
    out = {}
    for part in predicted:
        window = _part_depth(part, camera, np.eye(4))
        if part.label in in_picture or window is None:
            continue
        rows, cols, depth = window
        own = np.isfinite(depth)
        if occluded is not None:
            own &= ~occluded[rows, cols]
        if not own.any():
            continue
        share = float((depth < shown[rows, cols])[own].mean() + (~inside[rows, cols])[own].mean())
        if share > _MAX_CONTRADICTED:
            out[part.label] = f"left out: {min(share, 1):.0%} of it would be in sight, the picture has none"
    return out


def _seen_parts(found: Reconstruction, model: ClassModel, camera: PinholeCamera) -> list[InstancePart]:
    """Placed parts with the outline of their largest region, lifted onto their planes."""
    parts = []
    good = np.isfinite(found.depth.depth)
    for label, plane in found.part_planes.items():
        ring = largest_outline((found.part_labels == label) & good)
        if ring is None or len(ring) < 3:
            continue
        ring = resample(ring, _OUTLINE_POINTS) if len(ring) > _OUTLINE_POINTS else ring
        rays = camera.rays(ring + np.array([found.x0_px, found.y0_px], float))
        outline = rays * (-plane[3] / (rays @ plane[:3]))[:, None]
        parts.append(InstancePart(label, model.part_names[label - 1], plane, outline, True))
    return parts


def _box(moved: ClassToInstance, model: ClassModel, ground: GroundPlane) -> tuple[FloatArray, FloatArray]:
    """Pose (4, 4) and size (3,): the box of the class model's outlines where the transform puts them.

    The planes of single parts scatter, the transform averages over them. The box stands on the ground.
    """
    points = np.concatenate([moved.in_object(p.outline) for p in model.parts])
    low, high = points.min(axis=0), points.max(axis=0)
    middle = moved.rotation @ ((low + high) / 2)
    top = moved.rotation @ np.array([0.0, 0.0, high[2]])
    pose = np.eye(4)
    pose[:3, :3] = moved.rotation
    pose[:3, 3] = middle - (middle @ ground.up + ground.height_m) * ground.up
    height = float(top @ ground.up) + ground.height_m
    return pose, np.array([high[0] - low[0], high[1] - low[1], max(height, 1e-3)])


def _part_depth(
    part: InstancePart, camera: PinholeCamera, transform: FloatArray
) -> tuple[slice, slice, FloatArray] | None:
    """Depth of a part in a window of a camera, NaN outside its outline; None out of the picture."""
    outline = _clip_near(part.outline_m @ transform[:3, :3].T + transform[:3, 3])
    if len(outline) < 3:
        return None
    uv = camera.project(outline)
    size = np.array([camera.width_px, camera.height_px])
    low = np.clip(np.floor(uv.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(uv.max(axis=0)) + 1, 0, size).astype(int)
    if (high <= low).any():
        return None
    inside = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    # far corners are cut to what fixed-point coordinates hold; 16 is two to the shift
    points = np.clip((uv - low) * 16, -(2**24), 2**24)
    cv2.fillPoly(inside, [np.round(points).astype(np.int32)], 1, shift=4)
    normal = transform[:3, :3] @ part.plane[:3]
    d = part.plane[3] - normal @ transform[:3, 3]
    v, u = np.mgrid[low[1] : high[1], low[0] : high[0]].astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -d / (camera.rays(np.stack([u, v], axis=-1)) @ normal)
    # fillPoly draws the border too, whose pixel centres an edge-on plane may meet far outside the polygon
    depth = np.clip(depth, outline[:, 2].min(), outline[:, 2].max())
    good = inside.astype(bool) & np.isfinite(depth)
    return slice(low[1], high[1]), slice(low[0], high[0]), np.where(good, depth, np.nan)


def _clip_near(polygon: FloatArray) -> FloatArray:
    """The part of a polygon (m, 3) at z of at least ``NEAR_M`` (Sutherland and Hodgman)."""
    ahead = polygon[:, 2] >= NEAR_M
    if ahead.all():
        return polygon
    kept: list[FloatArray] = []
    for a, b, a_in, b_in in zip(
        polygon, np.roll(polygon, -1, axis=0), ahead, np.roll(ahead, -1), strict=True
    ):
        if a_in:
            kept.append(a)
        if a_in != b_in:
            kept.append(a + (NEAR_M - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(kept).reshape(-1, 3)
