"""A joint fit of pose and shape to one outline: an instance of a shape space that stands on the ground.

Every ray through the outline must graze the object, so that the least value of the hull function along it is
0. These values are the residuals; no point of the model needs a partner in the image. Gauss-Newton steps with
Levenberg's damping find x, y, yaw, the logarithms of the size and the coefficients of the shape space.
"""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.camera import GroundedCamera
from recon.localization.outline_edges import OutlinePoints
from recon.localization.standing_box import StandingBox, angle_between, cam_from_ground, turn
from recon.shape_space import ShapeSpace, sample_hull
from recon.view_bins import ViewBins

_MAX_LOG_REST = 0.8
"""No object is more than about twice as large as its shape says, or less than half."""


@dataclass(frozen=True)
class JointFitConfig:
    """Settings of the fit."""

    model_scale: float = 1.0
    """Size of the object over the size of the objects that the shape space was learned from: 1 / 18 for model
    cars."""
    coarse_points: int = 60
    """Number of rays while the view bin is looked for."""
    coarse_steps: int = 10
    """Number of steps with the mean shape from the middle of each view bin."""
    kept_starts: int = 4
    """Number of best starts that are refined."""
    middle_steps: int = 6
    """Number of first steps of the refinement, with ``middle_outlier_m``."""
    middle_outlier_m: float = 0.15
    """Residuals beyond this lose weight in the first ``middle_steps`` steps of the refinement, in metres."""
    steps: int = 14
    """Number of last steps of the refinement, with ``outlier_m``."""
    size_tail: float = 3.0
    """Standard deviations up to which a size that the shape does not explain costs its square; beyond, it
    costs its logarithm, since some objects are larger or smaller than any that was learned from."""
    noise_m: float = 0.014
    """Least expected error of the outline at the object, in metres of the shape space; that of objects as
    those that the space was learned from."""
    misfit_weight: float = 1.5
    """The error is expected to be this multiple of what the best fit leaves, where that is more: what no
    shape of the space explains must not bend the size."""
    coarse_outlier_m: float = 0.3
    """Residuals beyond this lose weight while the view bin is looked for, in metres: the mean shape is a poor
    fit to unusual objects, and all of their outline must pull."""
    outlier_m: float = 0.05
    """Residuals beyond this lose weight (Cauchy) in the last steps, in metres: mirrors, shadows, gaps in the
    outline."""
    independent_points: float = 40.0
    """Number of independent points that the outline counts as, since neighbours err alike."""
    depth_samples: int = 32
    """Samples along each ray between the roof and the ground."""


@dataclass(frozen=True, eq=False)
class FittedInstance:
    """An instance of a shape space on the ground, in metres of the shape space (ground frame over scale)."""

    xy_m: FloatArray
    """Place of the middle of the footprint on the ground, shape (2,)."""
    yaw_rad: float
    log_rest: FloatArray
    """Logarithms of the size less those that the coefficients give, shape (3,)."""
    coefficients: FloatArray
    """Coefficients of the shape space, shape (k,)."""
    cost: float
    """Half the weighted sum of squares with the priors."""
    misfit_m: float
    """Root of the mean square distance of the outline from the shape, outliers bounded, in metres of the
    shape space."""
    strain: float
    """The cost where the outline is expected to err as that of a known object does: how far shapes of the
    space had to be bent, and what that left. Where it is large, the object is of no shape of the space."""

    @property
    def vector(self) -> FloatArray:
        """All unknowns: x, y, yaw, log_rest, coefficients."""
        return np.concatenate([self.xy_m, [self.yaw_rad], self.log_rest, self.coefficients])

    def parts_m(self, space: ShapeSpace, scale: float) -> FloatArray:
        """Outlines of the parts of ``space.part_labels`` in the ground frame, shape (p, m, 3)."""
        out = space.part_outlines(self.coefficients, space.size_m(self.coefficients, self.log_rest))
        out[..., :2] = out[..., :2] @ turn(self.yaw_rad).T + self.xy_m
        return out * scale

    def box(self, space: ShapeSpace, scale: float) -> StandingBox:
        """The bounding box in the ground frame."""
        size = space.size_m(self.coefficients, self.log_rest)
        return StandingBox(self.xy_m * scale, self.yaw_rad, size * scale)


@dataclass(frozen=True, eq=False)
class GroundRays:
    """Rays from one eye in the ground frame, in metres of the shape space."""

    origin: FloatArray
    """Place of the eye, shape (3,)."""
    direction: FloatArray
    """Shape (n, 3), going down by 1: origin height less t is the height."""
    outside_weight: FloatArray
    """Weights of residuals above 0, where the ray misses the object, shape (n,)."""
    inside_weight: FloatArray
    """Weights of residuals below 0, where it cuts the object, shape (n,)."""

    def weight(self, residual: FloatArray) -> FloatArray:
        """Weights (n,) of residuals (n,)."""
        return np.where(residual > 0, self.outside_weight, self.inside_weight)

    def between(self, high_m: float, samples: int) -> tuple[FloatArray, FloatArray]:
        """Heights (s,) from ``high_m`` to the ground and points (n, s, 3) of the rays there."""
        heights = np.linspace(high_m, 0.0, samples)
        t = self.origin[2] - heights
        return heights, self.origin + t[None, :, None] * self.direction[:, None, :]

    def at(self, heights: FloatArray) -> FloatArray:
        """Points (n, ..., 3) at heights (n, ...)."""
        t = self.origin[2] - heights
        shape = (len(self.direction),) + (1,) * (heights.ndim - 1) + (3,)
        return np.asarray(self.origin + t[..., None] * self.direction.reshape(shape))


def ground_rays(outline: OutlinePoints, seen_from: GroundedCamera, scale: float) -> GroundRays:
    """Rays of points of an outline, which look below the horizon."""
    pose = cam_from_ground(seen_from.ground)
    direction = seen_from.camera.rays(outline.uv_px) @ pose[:3, :3]
    return GroundRays(
        np.array([0.0, 0.0, seen_from.ground.height_m / scale]),
        direction / -direction[:, 2:],
        outline.outside_weight,
        outline.inside_weight,
    )


@dataclass(frozen=True, eq=False)
class _State:
    """One set of unknowns and what it leads to."""

    vector: FloatArray
    residual: FloatArray
    unit: FloatArray
    """Where each ray is deepest, in units of the size, shape (n, 3)."""
    hull: Float32Array
    size_m: FloatArray
    cost: float


class OutlineFit:
    """The problem of one outline."""

    def __init__(
        self,
        outline: OutlinePoints,
        space: ShapeSpace,
        seen_from: GroundedCamera,
        config: JointFitConfig,
    ) -> None:
        self.space, self.config = space, config
        self.rays = ground_rays(outline, seen_from, config.model_scale)
        few = outline.every(max(1, len(outline.uv_px) // config.coarse_points))
        self.coarse = ground_rays(few, seen_from, config.model_scale)
        self.start_xy = self._middle()

    def _middle(self) -> FloatArray:
        """Where the middle of the outline's box meets the height of the middle of the mean car."""
        height = 0.5 * float(np.exp(self.space.log_size[2]))
        points = self.rays.at(np.full(len(self.rays.direction), height))[:, :2]
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)

    def residuals(
        self, vector: FloatArray, rays: GroundRays, hull: Float32Array, size_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Least hull value along each ray (n,), and the points (n, 3) in units of the size where it is."""
        heights, points = rays.between(float(size_m[2]), self.config.depth_samples)
        n, s = points.shape[:2]
        values = self.space.hull_values(
            self._unit(points.reshape(-1, 3), vector, size_m), hull, size_m
        ).reshape(n, s)
        step = heights[0] - heights[1]
        middle = np.clip(heights[np.argmin(values, axis=1)], step, heights[0] - step)
        fine = middle[:, None] + np.linspace(step, -step, 9)
        unit = self._unit(rays.at(fine).reshape(-1, 3), vector, size_m)
        values = self.space.hull_values(unit, hull, size_m).reshape(n, 9)
        best = np.argmin(values, axis=1)
        row = np.arange(n)
        return values[row, best], unit.reshape(n, 9, 3)[row, best]

    def _unit(self, points: FloatArray, vector: FloatArray, size_m: FloatArray) -> FloatArray:
        out = points.copy()
        out[:, :2] = (points[:, :2] - vector[:2]) @ turn(vector[2])
        return out / size_m

    def jacobian(
        self, vector: FloatArray, unit: FloatArray, hull: Float32Array, size_m: FloatArray
    ) -> FloatArray:
        """Derivatives (n, 6 + k) of the least values; the place on the ray is the least one."""
        space = self.space
        step = 0.008
        gradient = np.stack(
            [
                (
                    self.space.hull_values(unit + d, hull, size_m)
                    - self.space.hull_values(unit - d, hull, size_m)
                )
                / (2 * step)
                for d in np.eye(3) * step
            ],
            axis=1,
        )
        c, s = np.cos(vector[2]), np.sin(vector[2])
        own = unit * size_m
        slope = gradient / size_m
        jac = np.empty((len(unit), 6 + space.count))
        jac[:, 0] = -slope[:, 0] * c + slope[:, 1] * s
        jac[:, 1] = -slope[:, 0] * s - slope[:, 1] * c
        jac[:, 2] = slope[:, 0] * own[:, 1] - slope[:, 1] * own[:, 0]
        jac[:, 3:6] = -gradient * unit
        at = space.grid_coordinates(unit)
        modes = np.stack([sample_hull(space.modes[..., k], at) for k in range(space.count)], axis=1)
        jac[:, 6:] = modes + jac[:, 3:6] @ space.log_size_modes
        return jac

    def refine(self, vector: FloatArray, stage: "FitStage") -> FittedInstance:
        """Gauss-Newton with Levenberg's damping on the unknowns that the stage frees."""
        state = self._state(vector, stage)
        damping = 1e-2
        for _ in range(stage.steps):
            normal, gradient = self._normal_equations(state, stage)
            better, damping = self._descend(state, stage, normal, gradient, damping)
            if better is None:
                break
            gain, state = state.cost - better.cost, better
            if gain < 1e-4 * state.cost:
                break
        x = state.vector
        misfit_m = self._misfit_m(state, stage)
        return FittedInstance(x[:2], float(x[2]), x[3:6], x[6:], state.cost, misfit_m, state.cost)

    def _misfit_m(self, state: "_State", stage: "FitStage") -> float:
        """Root of the mean square residual, outliers bounded."""
        weight = stage.rays.weight(state.residual) ** 2
        bounded = stage.outlier_m**2 * np.log1p((state.residual / stage.outlier_m) ** 2)
        return float(np.sqrt((weight * bounded).sum() / weight.sum()))

    def _normal_equations(self, state: "_State", stage: "FitStage") -> tuple[FloatArray, FloatArray]:
        """Matrix (f, f) and gradient (f,) of the cost in the free unknowns."""
        free = stage.free
        pull = stage.prior_pull(state.vector)[:free]
        weight = self._data_weight(state.residual, stage.rays)
        jac = self.jacobian(state.vector, state.unit, state.hull, state.size_m)[:, :free] * weight[:, None]
        robust = 1 / (1 + (state.residual / stage.outlier_m) ** 2)
        normal = (jac * robust[:, None]).T @ jac + np.diag(pull)
        gradient = jac.T @ (robust * state.residual * weight) + pull * state.vector[:free]
        return normal, gradient

    def _descend(
        self, state: "_State", stage: "FitStage", normal: FloatArray, gradient: FloatArray, damping: float
    ) -> tuple["_State | None", float]:
        """A state of less cost (None where four shorter and shorter steps find none) and the next damping."""
        free = len(gradient)
        for _ in range(4):
            trial = state.vector.copy()
            trial[:free] -= np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            moved = self._state(trial, stage)
            if moved.cost < state.cost:
                return moved, damping / 4
            damping *= 6
        return None, damping

    def _data_weight(self, residual: FloatArray, rays: GroundRays) -> FloatArray:
        """One over the standard deviation of each residual (n,)."""
        share = min(self.config.independent_points / len(residual), 1.0)
        return np.asarray(np.sqrt(share) / self.config.noise_m * rays.weight(residual))

    def _state(self, vector: FloatArray, stage: "FitStage") -> "_State":
        size = self.space.size_m(vector[6:], vector[3:6])
        hull = self.space.hull(vector[6:]) if vector[6:].any() else self.space.mean
        residual, unit = self.residuals(vector, stage.rays, hull, size)
        outlier = stage.outlier_m
        weight = self._data_weight(residual, stage.rays)
        data = ((weight * outlier) ** 2 * np.log1p((residual / outlier) ** 2)).sum()
        return _State(vector, residual, unit, hull, size, float(data) / 2 + stage.prior_cost(vector))

    def starts(self, yaws_rad: FloatArray) -> list[FittedInstance]:
        """The mean shape fitted from several directions of the nose, best first, one of each result."""
        empty = np.zeros(3 + self.space.count)
        stage = self._coarse_stage()
        found = [self.refine(np.concatenate([self.start_xy, [yaw], empty]), stage) for yaw in yaws_rad]
        kept: list[FittedInstance] = []
        for fit in sorted(found, key=lambda f: f.cost):
            turns = [angle_between(fit.yaw_rad, k.yaw_rad) for k in kept]
            if not turns or min(turns) > np.deg2rad(15):
                kept.append(fit)
        return kept

    def fit(self, vector: FloatArray) -> FittedInstance:
        """Pose and shape from a start: first with all of the outline, then without what does not belong."""
        for stage in self._fine_stages():
            found = self.refine(vector, stage)
            vector = found.vector
        return found

    def relaxed(self, fits: list[FittedInstance]) -> list[FittedInstance]:
        """The fits refined where the outline is expected to err by what the best of them leaves."""
        noise_m = self.config.misfit_weight * min(fits, key=lambda f: f.cost).misfit_m
        if noise_m <= self.config.noise_m:
            return fits
        problem = copy(self)
        problem.config = replace(self.config, noise_m=noise_m)
        last = problem._fine_stages()[-1]
        return [replace(problem.refine(f.vector, last), strain=f.strain) for f in fits]

    def _coarse_stage(self) -> "FitStage":
        config, space = self.config, self.space
        spread = np.sqrt(space.log_size_rest**2 + (space.log_size_modes**2).sum(axis=1))
        std = np.concatenate([spread, np.ones(space.count)])
        return FitStage(self.coarse, 6, config.coarse_steps, config.coarse_outlier_m, std, config.size_tail)

    def _fine_stages(self) -> list["FitStage"]:
        config, space = self.config, self.space
        std = np.concatenate([space.log_size_rest, np.ones(space.count)])
        return [
            FitStage(self.rays, 6 + space.count, steps, outlier, std, config.size_tail)
            for steps, outlier in (
                (config.middle_steps, config.middle_outlier_m),
                (config.steps, config.outlier_m),
            )
        ]


@dataclass(frozen=True, eq=False)
class FitStage:
    """One stage of the fit."""

    rays: GroundRays
    free: int
    """Number of unknowns that move, counted from the first."""
    steps: int
    outlier_m: float
    """Residuals beyond this lose weight."""
    std: FloatArray
    """Standard deviations of log_rest and the coefficients, shape (3 + k,)."""
    size_tail: float
    """Number of standard deviations beyond which log_rest is an unusual size, whose cost grows with its
    logarithm."""

    def prior_pull(self, vector: FloatArray) -> FloatArray:
        """Pull of the prior on each unknown (6 + k,), in multiples of the unknown; pose has none."""
        share = vector[3:] / self.std
        pull = 1 / self.std**2
        pull[:3] /= 1 + (share[:3] / self.size_tail) ** 2
        return np.concatenate([np.zeros(3), pull])

    def prior_cost(self, vector: FloatArray) -> float:
        """Cost of log_rest and coefficients."""
        if np.abs(vector[3:6]).max() > _MAX_LOG_REST:
            return np.inf
        share = vector[3:] / self.std
        size = self.size_tail**2 * np.log1p((share[:3] / self.size_tail) ** 2).sum()
        return float(size + (share[3:] ** 2).sum()) / 2


def joint_fits(
    outline: OutlinePoints,
    space: ShapeSpace,
    seen_from: GroundedCamera,
    bins: ViewBins,
    config: JointFitConfig,
) -> list[FittedInstance]:
    """Instances that explain an outline, best first, one of each direction.

    Args:
        outline: its points.
        space: the class.
        seen_from: the camera M and the ground plane Q_g.
        bins: view bins; the fit starts from the middle of each.
        config: settings.
    """
    problem = OutlineFit(outline, space, seen_from, config)
    to_camera = float(np.arctan2(-problem.start_xy[1], -problem.start_xy[0]))
    yaws = np.array([to_camera - bins.azimuth_rad(b) for b in range(bins.count)])
    starts = problem.starts(yaws)[: config.kept_starts]
    fits = [problem.fit(_with_usual_shape(s, space)) for s in starts]
    # from afar front and rear look alike: the best fit must also be better than itself turned round
    best = min(fits, key=lambda f: f.cost)
    fits.append(problem.fit(turned_round(best, space)))
    return sorted(problem.relaxed(fits), key=lambda f: f.cost)


def turned_round(fit: FittedInstance, space: ShapeSpace) -> FloatArray:
    """Unknowns of a start with front and rear exchanged: the same size, the mean shape."""
    turned = np.concatenate([fit.xy_m, [fit.yaw_rad + np.pi], fit.log_rest, np.zeros(space.count)])
    turned[3:6] += space.log_size_modes @ fit.coefficients
    return turned


def _with_usual_shape(start: FittedInstance, space: ShapeSpace) -> FloatArray:
    """Unknowns of a start with the shape that objects of its size have; unusual sizes keep a usual shape."""
    modes, rest = space.log_size_modes, np.diag(space.log_size_rest**2)
    expected = modes.T @ np.linalg.solve(modes @ modes.T + rest, start.log_rest)
    expected /= max(1.0, float(np.linalg.norm(expected)) / 2)
    log_rest = start.log_rest - modes @ expected
    return np.concatenate([start.xy_m, [start.yaw_rad], log_rest, expected])
