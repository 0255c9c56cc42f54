"""The 3D transform from the class model to a recovered instance (section 4.4): it places occluded parts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from recon.errors import RescoreError
from recon.standing_box import turn

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InstanceTransform:
    """instance = turn about the vertical (scale * model) + translation; z is up in both frames."""

    yaw_rad: float
    scale: FloatArray
    """Along x, y and z of the model, shape (3,), positive."""
    translation: FloatArray
    """Shape (3,)."""

    def __call__(self, points: FloatArray) -> FloatArray:
        """Instance points (..., 3) of model points (..., 3)."""
        out = points * self.scale
        out[..., :2] = out[..., :2] @ turn(self.yaw_rad).T
        return np.asarray(out + self.translation)


def fit_instance_transform(
    model_points: FloatArray,
    instance_points: FloatArray,
    yaw_rad: float,
    *,
    max_turn_rad: float = float(np.deg2rad(25.0)),
    stretch: float = 0.15,
    outlier: float = 0.05,
) -> InstanceTransform:
    """The transform that maps model points (n, 3) near instance points (n, 3), robust against wrong ones.

    Args:
        model_points: points of the class model's parts.
        instance_points: the recovered place of each.
        yaw_rad: about how far the instance is turned: the middle of its view bin.
        max_turn_rad: the result is turned from ``yaw_rad`` by no more than this.
        stretch: expected spread of the logarithms of the three scales about their mean: parts seen from one
            side say little about the size across.
        outlier: residuals beyond this share of the instance's extent count little.

    Raises:
        RescoreError: fewer than three points, or all of them in one place.
    """
    extent = float(np.linalg.norm(np.ptp(instance_points, axis=0))) if len(instance_points) else 0.0
    if len(model_points) < 3 or not extent > 0:
        raise RescoreError(
            f"instance transform: expected at least three points apart, got {len(model_points)} "
            f"over {extent:g}; recover more parts"
        )
    spread = float(np.linalg.norm(np.ptp(model_points, axis=0)))
    middle = model_points.mean(axis=0)

    def made(unknown: FloatArray) -> InstanceTransform:
        scale = np.exp(unknown[1] + unknown[2:5]) * extent / spread
        flat = InstanceTransform(yaw_rad + float(unknown[0]), scale, np.zeros(3))
        return InstanceTransform(flat.yaw_rad, scale, unknown[5:8] * extent - flat(middle))

    def residual(unknown: FloatArray) -> FloatArray:
        off = (made(unknown)(model_points) - instance_points) / extent
        # soft_l1 acts on what it is given: the prior is scaled to lie well inside its quadratic part
        weight = outlier / stretch / np.sqrt(4.0 / len(model_points))
        return np.concatenate([off.ravel(), unknown[2:5] * weight * 0.5])

    start = np.zeros(8)
    start[5:8] = np.median(instance_points, axis=0) / extent
    bound = np.full(8, np.inf)
    bound[0] = max_turn_rad
    fit = least_squares(residual, start, loss="soft_l1", f_scale=outlier / 2, bounds=(-bound, bound))
    return made(fit.x)
