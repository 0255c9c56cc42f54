"""A shape space of one shape, a long low box with a cab at its rear: its depths are easily worked out."""

import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.camera import GroundedStereo, GroundPlane, PinholeCamera, StereoCamera
from recon.localization.depth_views import DepthViews, DepthViewsConfig, first_hit, render_depth_views
from recon.localization.standing_box import StandingBox, cam_from_ground
from recon.shape_space import ShapeSpace

SIZE_M = np.array([4.4, 1.8, 1.5])
HOOD_M = 0.9
"""Height of what is not under the cab, which is as high as the car."""
CAB_M = (-2.2, 0.6)
"""From where to where along the car the cab reaches: from the rear to before the middle."""
RIG = GroundedStereo(StereoCamera(PinholeCamera(720, 720, 620, 180, 1242, 375), 0.54), GroundPlane(1.65))


def _box_distance(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    out = np.maximum(low - points, points - high)
    return np.linalg.norm(np.maximum(out, 0), axis=-1) + np.minimum(out.max(axis=-1), 0)


def space(cab_m: tuple[float, float] = CAB_M) -> ShapeSpace:
    reach = (0.56, 0.68, 1.08)
    axes = (np.linspace(-reach[0], reach[0], 90), np.linspace(0, reach[1], 30), np.linspace(0, reach[2], 40))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) * SIZE_M
    half = SIZE_M / 2
    body = _box_distance(points, np.array([-half[0], -half[1], -1]), np.array([half[0], half[1], HOOD_M]))
    cab = _box_distance(points, np.array([cab_m[0], -half[1], -1]), np.array([cab_m[1], half[1], SIZE_M[2]]))
    mean = np.minimum(body, cab).astype(np.float32)
    return ShapeSpace(
        reach,
        mean,
        np.zeros((*mean.shape, 0), np.float32),
        np.log(SIZE_M),
        np.zeros((3, 0)),
        np.full(3, 0.01),
        (),
        np.zeros((0, 4, 3)),
        np.zeros((0, 4, 3, 0)),
        np.zeros((0, 0)),
    )


VIEWS_CONFIG = DepthViewsConfig(coefficients=((),))


def views() -> DepthViews:
    return render_depth_views(space(), 1.65, VIEWS_CONFIG)


def disparity_of(
    box: StandingBox,
    seen_from: GroundedStereo = RIG,
    wall_m: float = 45.0,
    noise_px: float = 0.0,
    shape: ShapeSpace | None = None,
) -> Float32Array:
    """Disparity of the car in a 3D box on bare ground before a wall, cast ray by ray."""
    camera = seen_from.stereo.left
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(float)
    rays = camera.rays(np.stack([u, v], axis=-1)).reshape(-1, 3)
    pose = cam_from_ground(seen_from.ground)
    own = rays @ pose[:3, :3]
    with np.errstate(divide="ignore"):
        ground = np.where(own[:, 2] < 0, seen_from.ground.height_m / -own[:, 2], np.inf)
        depth = np.minimum(ground, wall_m / own[:, 1])
    c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    eye = turn @ (np.array([0, 0, seen_from.ground.height_m]) - np.append(box.xy_m, 0))
    length = np.linalg.norm(own, axis=1)
    shape = shape or space()
    origin, direction = np.broadcast_to(eye, own.shape), own / length[:, None] @ turn.T
    hit = first_hit(shape, shape.mean, box.size_m, origin, direction)
    depth = np.fmin(depth, hit / length)
    disparity = seen_from.stereo.exact_disparity_px(depth).reshape(camera.height_px, camera.width_px)
    noise = np.random.default_rng(0).normal(0, noise_px, disparity.shape) if noise_px else 0
    return (disparity + noise).astype(np.float32)


def silhouette_of(disparity: Float32Array, empty: Float32Array) -> FloatArray:
    """Box around what differs from the empty scene, pixel edges, shape (4,)."""
    row, column = np.nonzero(np.abs(disparity - empty) > 0.05)
    return np.array([column.min(), row.min(), column.max() + 1, row.max() + 1], float)
