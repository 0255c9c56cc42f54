"""The ground plane from measured disparity: height, pitch and roll of the camera, and whether to trust them.

A plane before a rectified pair is a plane in (u, v, disparity) too, with the same noise everywhere
(Labayrade, Aubert and Tarel 2002 use its section, the line in v-disparity). It is searched with three points
at a time and a truncated square (MSAC, Torr and Zisserman 2000), and refined with Tukey's weights. Nothing
that is measured can lie below the ground, so points far below a plane speak against it; points above are what
stands there.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.camera import GroundPlane, StereoCamera


@dataclass(frozen=True)
class GroundFitConfig:
    """How the ground plane is searched, and what is asked of it before it is trusted."""

    farthest_m: float = 40.0
    """Distance in metres up to which streets are taken to be flat."""
    min_disparity_px: float = 2.0
    """Smaller disparities, in pixels, are mostly noise and not looked at."""
    tolerance_px: float = 1.0
    """A disparity at most this many pixels from the plane's disparity lies on the plane."""
    drop_m: float = 0.3
    """What lies deeper than this below the plane contradicts it; a kerb does not."""
    n_points: int = 4000
    """Pixels that are looked at, on a grid over the whole picture."""
    n_triples: int = 3000
    n_planes: int = 300
    """Largest number of planes that are compared: the first ones, through sampled triples, that could be
    ground."""
    n_refined: int = 8
    height_m: tuple[float, float] = (0.5, 4.0)
    pitch_deg: tuple[float, float] = (-10.0, 30.0)
    roll_deg: float = 6.0
    """Largest roll of a camera that is held level."""
    min_on: float = 0.25
    """Least share on the plane of the measurements where it predicts one within ``farthest_m``."""
    min_area: float = 0.04
    """Least share of the picture that lies on the plane."""
    max_below: float = 0.2
    """Largest share below the plane of the measurements on and below it."""
    min_width: float = 0.25
    """Least width of what lies on the plane, as a share of the picture's (5th to 95th percentile)."""
    min_depth_ratio: float = 1.4
    """Least ratio of far to near depth on the plane (95th over 5th percentile)."""
    max_residual_px: float = 0.9
    """Largest median absolute residual of what is within three tolerances; 1.5 would be chance."""
    max_height_sd: float = 0.04
    """Largest standard error of the height, as a share of the height."""
    max_pitch_sd_deg: float = 0.4


class GroundDoubt(StrEnum):
    """Why an estimate is not trusted; the value is for people."""

    FEW_MEASUREMENTS = "too few measurements"
    NO_PLANE = "nothing like a ground plane"
    IMPLAUSIBLE = "implausible height or angle"
    LITTLE_SUPPORT = "too little lies on it"
    MUCH_BELOW = "too much lies below it"
    SMALL_SPREAD = "too small a part of it is seen"
    UNEVEN = "it is not even"
    UNCERTAIN = "height or pitch is uncertain"


@dataclass(frozen=True)
class GroundSupport:
    """How well the measurements support a plane; ``GroundFitConfig`` sets a limit for each field."""

    on: float
    area: float
    below: float
    width: float
    depth_ratio: float
    residual_px: float
    """Median absolute residual of the measurements within three tolerances."""
    height_sd_m: float
    """Standard error of the height, with residuals taken to be alike in blocks of the picture."""
    pitch_sd_rad: float


@dataclass(frozen=True)
class GroundEstimate:
    """The ground plane that fits the measured disparity of one picture best."""

    ground: GroundPlane | None
    """None where no plane was found."""
    support: GroundSupport | None = None
    doubt: GroundDoubt | None = None
    """Why the estimate is not trusted; None where it is."""
    detail: str = ""
    """What was expected and what came, for a person; "" where the estimate is trusted."""

    @property
    def trusted(self) -> bool:
        """Whether the plane should be used where nothing better is known."""
        return self.doubt is None


def estimate_ground(
    disparity_px: Float32Array,
    camera: StereoCamera,
    rng: np.random.Generator,
    config: GroundFitConfig | None = None,
) -> GroundEstimate:
    """The ground plane of a picture from its disparity (h, w), NaN where there is no measurement.

    Args:
        disparity_px: of the left picture, in pixels.
        camera: of the pair.
        rng: for the points that planes are tried through.
        config: settings; the default ones where None.
    """
    config = config or GroundFitConfig()
    points = _Points.of(disparity_px, camera, config)
    n, least = len(points.disparity_px), config.min_area * points.n_grid
    if n < max(least, 100):
        return _doubted(GroundDoubt.FEW_MEASUREMENTS, f"{n} of {points.n_grid} pixels within range")
    plane = _search(points, rng, config)
    if plane is None:
        return _doubted(GroundDoubt.NO_PLANE, "no plane through three points is near to level")
    height, pitch, roll = (float(v) for v in _pose(plane))
    if not height > 0:
        return _doubted(GroundDoubt.NO_PLANE, "the best plane is not below the camera")
    support = _support(plane, points, config)
    doubt, detail = _judge(height, pitch, roll, support, config)
    return GroundEstimate(GroundPlane(height, pitch, roll), support, doubt, detail)


@dataclass(frozen=True, eq=False)
class _Points:
    """Measured pixels of a grid. A plane is (3,) with ``disparity = rays_px @ plane``, -up / height."""

    rays_px: FloatArray
    """``StereoCamera.disparity_rays``, shape (n, 3)."""
    uv_px: FloatArray
    """Shape (n, 2)."""
    disparity_px: FloatArray
    """Shape (n,)."""
    n_grid: int
    """Pixels of the grid, measured or not."""
    nearest_px: float
    """Disparity at the farthest that is looked at."""
    width_px: int

    @staticmethod
    def of(disparity_px: Float32Array, camera: StereoCamera, config: GroundFitConfig) -> "_Points":
        """The measurements within range."""
        h, w = disparity_px.shape
        step = max(1, round(float(np.sqrt(h * w / config.n_points))))
        rows, columns = np.arange(step // 2, h, step), np.arange(step // 2, w, step)
        seen = disparity_px[np.ix_(rows, columns)]
        least = max(config.min_disparity_px, float(camera.exact_disparity_px(config.farthest_m)))
        # of infinity there is nothing to fit to
        i, j = np.nonzero(np.isfinite(seen) & (seen >= least))
        uv = np.stack([columns[j], rows[i]], axis=1).astype(float)
        return _Points(camera.disparity_rays(uv), uv, seen[i, j].astype(float), seen.size, least, w)


def _pose(planes: FloatArray) -> FloatArray:
    """Height in metres, pitch and roll in radians of planes (..., 3), shape (3, ...)."""
    x, y, z = np.moveaxis(planes, -1, 0)
    in_section = np.hypot(y, z)
    # a plane that is above the camera has no height
    height = np.where(y > 0, 1 / np.maximum(np.hypot(in_section, x), 1e-9), np.nan)
    return np.stack([height, np.arctan2(z, y), np.arctan2(x, in_section)])


def _search(points: _Points, rng: np.random.Generator, config: GroundFitConfig) -> FloatArray | None:
    """The plane (3,) of least cost; None where no plane can be ground."""
    three = rng.integers(len(points.disparity_px), size=(config.n_triples, 3))
    matrices, values = points.rays_px[three], points.disparity_px[three]
    scale = np.prod(np.linalg.norm(matrices, axis=2), axis=1)
    # rays nearly in one plane fix nothing
    solvable = np.abs(np.linalg.det(matrices)) > 1e-5 * scale
    planes = np.linalg.solve(matrices[solvable], values[solvable, :, None])[..., 0]
    height, pitch, roll = _pose(planes)
    # wider than what is trusted, so that what lies outside is found and refused, not squeezed in
    low, high = np.radians(config.pitch_deg) + np.radians([-3, 3])
    likely = (height > 0.8 * config.height_m[0]) & (height < 1.25 * config.height_m[1])
    likely &= (pitch > low) & (pitch < high) & (np.abs(roll) < np.radians(2 * config.roll_deg))
    planes = planes[likely][: config.n_planes]
    if not len(planes):
        return None
    best = np.argsort(_cost(planes, points, config), kind="stable")[: config.n_refined]
    refined = _refined(planes[best], points, config)
    return np.asarray(refined[np.argmin(_cost(refined, points, config))])


def _cost(planes: FloatArray, points: _Points, config: GroundFitConfig) -> FloatArray:
    """Mean truncated square of planes (m, 3), shape (m,); points far below count twice."""
    seen = points.disparity_px.astype(np.float32)
    residual = seen - planes.astype(np.float32) @ points.rays_px.T.astype(np.float32)
    cost = np.minimum((residual / np.float32(config.tolerance_px)) ** 2, 1).mean(axis=1)
    return np.asarray(cost + _is_below(residual, seen, planes, config).mean(axis=1), float)


def _is_below(
    residual_px: NDArray[np.floating],
    seen_px: NDArray[np.floating],
    planes: FloatArray,
    config: GroundFitConfig,
) -> BoolArray:
    """Whether each point (n,) is over ``drop_m`` below each plane (..., 3), noise apart, shape (..., n)."""
    # a point stands height (1 - expected / seen) above a plane
    drop = config.drop_m * np.linalg.norm(planes, axis=-1)[..., None].astype(residual_px.dtype)
    return np.asarray(residual_px < -np.maximum(2 * config.tolerance_px, drop * seen_px))


def _refined(planes: FloatArray, points: _Points, config: GroundFitConfig, rounds: int = 6) -> FloatArray:
    """Planes (m, 3) after iteratively weighted least squares with Tukey's weights."""
    rays = points.rays_px
    products = (rays[:, :, None] * rays[:, None, :]).reshape(len(rays), 9)
    for _ in range(rounds):
        weight = _weights(points.disparity_px - planes @ rays.T, config)
        system = (weight @ products).reshape(-1, 3, 3)
        # a plane on which too little lies stays what it is
        solvable = np.linalg.matrix_rank(system) == 3
        moved = np.linalg.solve(system[solvable], ((weight * points.disparity_px) @ rays)[solvable, :, None])
        planes = planes.copy()
        planes[solvable] = moved[..., 0]
    return planes


def _weights(residual_px: FloatArray, config: GroundFitConfig) -> FloatArray:
    return np.asarray(np.clip(1 - (residual_px / (2 * config.tolerance_px)) ** 2, 0, None) ** 2)


def _support(plane: FloatArray, points: _Points, config: GroundFitConfig) -> GroundSupport:
    expected = points.rays_px @ plane
    residual = points.disparity_px - expected
    predicted = expected >= points.nearest_px
    on = predicted & (np.abs(residual) <= config.tolerance_px)
    below = predicted & _is_below(residual, points.disparity_px, plane, config)
    near = predicted & (np.abs(residual) <= 3 * config.tolerance_px)
    n_on = int(on.sum())
    column, depth = (
        np.percentile(v, [5, 95]) if n_on else np.ones(2) for v in (points.uv_px[on, 0], 1 / expected[on])
    )
    height_sd, pitch_sd = _standard_errors(plane, points, config)
    return GroundSupport(
        on=n_on / max(int(predicted.sum()), 1),
        area=n_on / points.n_grid,
        below=int(below.sum()) / max(n_on + int(below.sum()), 1),
        width=float(column[1] - column[0]) / points.width_px,
        depth_ratio=float(depth[1] / depth[0]),
        residual_px=float(np.median(np.abs(residual[near]))) if near.any() else float("inf"),
        height_sd_m=height_sd,
        pitch_sd_rad=pitch_sd,
    )


def _standard_errors(plane: FloatArray, points: _Points, config: GroundFitConfig) -> tuple[float, float]:
    """Standard errors of height (metres) and pitch (radians).

    By the sandwich estimator over blocks of a twentieth of the width, since a matcher errs alike in
    neighbouring pixels, and a street that is not flat differs from the plane alike over an area.
    """
    residual = points.disparity_px - points.rays_px @ plane
    weight = _weights(residual, config)
    block = (points.uv_px // (points.width_px / 20)).astype(int)
    _, of_block = np.unique(block[:, 0] + 1000 * block[:, 1], return_inverse=True)
    score = np.zeros((of_block.max() + 1, 3))
    np.add.at(score, of_block, points.rays_px * (weight * residual)[:, None])
    try:
        inverse = np.linalg.inv((points.rays_px * weight[:, None]).T @ points.rays_px)
    except np.linalg.LinAlgError:
        return float("inf"), float("inf")
    covariance = inverse @ (score.T @ score) @ inverse
    _, y, z = plane
    of_height = -plane / np.linalg.norm(plane) ** 3
    of_pitch = np.array([0, -z, y]) / np.hypot(y, z) ** 2
    height, pitch = (float(np.sqrt(max(g @ covariance @ g, 0.0))) for g in (of_height, of_pitch))
    return height, pitch


def _judge(
    height_m: float, pitch_rad: float, roll_rad: float, support: GroundSupport, config: GroundFitConfig
) -> tuple[GroundDoubt | None, str]:
    """The first doubt and what it is about, for a person; None and "" where there is none."""
    d, s, c, inf = GroundDoubt, support, config, float("inf")
    pitch, roll, pitch_sd = (float(np.degrees(v)) for v in (pitch_rad, roll_rad, s.pitch_sd_rad))
    # doubt, name, value, least, most, form of the three numbers
    rules: tuple[tuple[GroundDoubt, str, float, float, float, str], ...] = (
        (d.IMPLAUSIBLE, "height", height_m, *c.height_m, "{:.2f} m"),
        (d.IMPLAUSIBLE, "pitch", pitch, *c.pitch_deg, "{:.1f} degrees"),
        (d.IMPLAUSIBLE, "roll", roll, -c.roll_deg, c.roll_deg, "{:.1f} degrees"),
        (d.LITTLE_SUPPORT, "share of the picture", s.area, c.min_area, inf, "{:.0%}"),
        (d.LITTLE_SUPPORT, "share of what is measured there", s.on, c.min_on, inf, "{:.0%}"),
        (d.MUCH_BELOW, "share below", s.below, 0, c.max_below, "{:.0%}"),
        (d.SMALL_SPREAD, "share of the width", s.width, c.min_width, inf, "{:.0%}"),
        (d.SMALL_SPREAD, "far over near", s.depth_ratio, c.min_depth_ratio, inf, "{:.2f}"),
        (d.UNEVEN, "residual", s.residual_px, 0, c.max_residual_px, "{:.2f} px"),
        (d.UNCERTAIN, "error of the height", s.height_sd_m / height_m, 0, c.max_height_sd, "{:.1%}"),
        (d.UNCERTAIN, "error of the pitch", pitch_sd, 0, c.max_pitch_sd_deg, "{:.2f} degrees"),
    )
    for doubt, name, value, least, most, form in rules:
        if not least <= value <= most:
            limits = " to ".join(form.format(v) for v in (least, most) if np.isfinite(v))
            return doubt, f"{name} {form.format(value)}, expected {limits}{' or more' * (most == inf)}"
    return None, ""


def _doubted(doubt: GroundDoubt, detail: str) -> GroundEstimate:
    return GroundEstimate(None, doubt=doubt, detail=detail)
