"""The pair that would measure depth as finely as a depth camera did, told from one depth picture.

Evidence works in disparity, where a matcher's noise is much the same everywhere. A camera that measures depth
without a pair has no disparity of its own: any baseline turns its depth into one, and the noise in pixels
grows with the baseline. The one for which that noise is the matcher's own makes measurements count for what
they are worth.
"""

import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.camera import PinholeCamera, StereoCamera

MATCHER_NOISE_PX = 0.1
"""``local_noise`` of disparities that ``recon.stereo.sgbm`` measures, in the middle of what pairs show: 0.07
to 0.09 on rendered streets, 0.09 to 0.15 on KITTI's, 0.12 to 0.18 on rendered pairs of poorer cameras; by
``python -m tests.recon.stereo.matcher_noise FOLDER``."""
LIMITS_M = (0.02, 2.0)
"""Least and largest baseline in metres."""
MIN_TRIPLES = 100
"""Number of triples of neighbours from which their differences tell of noise."""
_APART_PX = 2
"""Distance of neighbours: a matcher and a sensor smooth over those beside each other."""
_KEPT = 0.75
"""Share of the triples, the smoothest, that noise is told from: the others may lie over edges."""
_MOST_VALUES = 2**16
_MIN_STEPS = 16
"""Number of different values from which a picture may be one of steps, not of a few level planes."""
_SHARE_OF_STEPS = 0.1
"""Share of the pixels of a picture in steps that have a next value one step away."""


def equivalent_pair(depth_m: Float32Array, camera: PinholeCamera) -> StereoCamera:
    """The pair with the baseline for which measured depth is as noisy, in disparity, as a matched pair.

    It does not depend on how the depth came about, so that one depth picture has one baseline. Where too few
    neighbours are measured to tell of noise, it is the least one: nothing is made of what is not known.

    Args:
        depth_m: z of the camera, shape (h, w); NaN where there is no measurement.
        camera: of the picture.
    """
    # disparity for a baseline of one metre
    disparity = camera.fx_px / depth_m.astype(float)
    noise = max(local_noise(disparity), _noise_of_steps(depth_m.astype(float), camera.fx_px))
    if not np.isfinite(noise):
        return StereoCamera(camera, LIMITS_M[0])
    return StereoCamera(camera, float(np.clip(MATCHER_NOISE_PX / max(noise, 1e-9), *LIMITS_M)))


def local_noise(picture: FloatArray | Float32Array) -> float:
    """The mean absolute second difference of the smoothest three quarters of a picture, in its own unit.

    Planes are linear in disparity and add nothing. White noise of standard deviation s gives 1.26 s. Infinity
    where fewer than ``MIN_TRIPLES`` triples along rows and columns are known.

    Args:
        picture: Shape (h, w), NaN where unknown.
    """
    triples = np.concatenate([_second_differences(p) for p in (picture, picture.T)])
    if len(triples) < MIN_TRIPLES:
        return np.inf
    kept = int(_KEPT * len(triples))
    return float(np.partition(triples, kept)[:kept].mean())


def _second_differences(picture: FloatArray | Float32Array) -> FloatArray:
    """Absolute second differences along the rows, those that are known, shape (n,)."""
    a = _APART_PX
    difference = np.abs(picture[:, 2 * a :] - 2 * picture[:, a:-a] + picture[:, : -2 * a])
    return difference[np.isfinite(difference)]


def _noise_of_steps(depth_m: FloatArray, fx_px: float) -> float:
    """Noise of disparity from the steps in which depth, or its inverse, is stored, as ``local_noise`` has it.

    Neighbours on one step have no difference, though each may be off by half a step.
    """
    known = depth_m[np.isfinite(depth_m)]
    if not known.size:
        return 0.0
    sample = known[:: -(-known.size // _MOST_VALUES)]
    of_inverse, of_depth = _step(fx_px / sample), _step(sample) * fx_px / float(np.median(sample)) ** 2
    return 1.26 / float(np.sqrt(12)) * max(of_inverse, of_depth)


def _step(values: FloatArray) -> float:
    """The step between stored values (n,); 0 where there is none to speak of."""
    level, count = np.unique(values, return_counts=True)
    if len(level) < _MIN_STEPS:
        return 0.0
    gap = np.diff(level)
    nearest = np.minimum(np.append(gap, np.inf), np.append(np.inf, gap))
    order = np.argsort(nearest)
    pixels = np.cumsum(count[order])
    place = int(np.searchsorted(pixels, _SHARE_OF_STEPS * pixels[-1]))
    return float(nearest[order][place])
