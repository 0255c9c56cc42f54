"""Whether what was measured is in the unit that it is taken for, by all of a picture, not by one thing."""

from dataclasses import dataclass, replace

import numpy as np

from recon.arrays import FloatArray
from recon.camera import GroundPlane, StereoCamera
from recon.errors import RescoreError
from recon.stereo.ground import estimate_ground
from rescore.data.depth_files import Quantity
from rescore.data.frames import Frame, GroundSource

FARTHEST_M = 100.0
"""Depth in metres that something in a picture must be nearer than."""
NEAREST_M = 0.2
"""Depth in metres that something in a picture must be farther than."""
HEIGHT_M = (0.2, 6.0)
"""Heights in metres that a camera may have over ground that is seen and not stated."""
SIZE_FACTOR = 4.0
"""How many times too large or too small the things in a picture may be, by the median of their heights."""
MIN_THINGS = 3
"""Number of things in a picture from which their size tells of the unit; fewer may be posters or toys."""
CONFIDENT = 0.5
"""Likelihood from which a candidate is taken for a thing of its class."""


@dataclass(frozen=True, eq=False)
class Things:
    """Boxes that are taken for objects of a class, and how tall one is."""

    xyxy_px: FloatArray
    """Shape (n, 4), pixel edges."""
    height_m: float
    """Height of an object of the class."""

    @staticmethod
    def confident(xyxy_px: FloatArray, likelihood: FloatArray, height_m: float) -> "Things":
        """The candidates (n,) whose likelihood is ``CONFIDENT`` or more."""
        return Things(xyxy_px[likelihood >= CONFIDENT], height_m)


def unit_doubt(frame: Frame, quantity: Quantity) -> str:
    """Why a whole picture is in another unit than it is taken for, and the factor; empty where it is not.

    Args:
        frame: the picture with its disparity and camera.
        quantity: what was measured; of a pair, its disparity.
    """
    known = frame.disparity_px[np.isfinite(frame.disparity_px) & (frame.disparity_px > 0)]
    if not known.size:
        return ""
    # a few wrong matches are near everywhere, and a few far
    far, median, near = np.percentile(known, [2, 50, 98]).tolist()
    width = frame.disparity_px.shape[1]
    doubt = "" if frame.camera is None else _metric_doubt(frame.camera, quantity, far, near)
    if not doubt and quantity is Quantity.DISPARITY and near < 1:
        doubt = f"disparity is below a pixel everywhere (largest {near:.2f} px): shares of the width?"
    if not doubt and median > width:
        doubt = (
            f"half of the picture has a disparity beyond its width ({median:.0f} of {width} px): the "
            "baseline looks like millimetres, factor 1000"
        )
    return doubt or _ground_doubt(frame, quantity)


def _culprit(quantity: Quantity) -> str:
    return "depth" if quantity is Quantity.DEPTH else "the baseline"


def _metric_doubt(camera: StereoCamera, quantity: Quantity, far_px: float, near_px: float) -> str:
    culprit = _culprit(quantity)
    nearest_m, farthest_m = camera.focal_baseline / near_px, camera.focal_baseline / far_px
    if nearest_m > FARTHEST_M:
        # millimetres where the nearest thing is a metre away or more
        likely = "millimetres, factor 1000"
        if nearest_m < 1000:
            likely = "centimetres or millimetres, factor 100 or 1000"
        text = f"all that is measured is farther than {FARTHEST_M:g} m (nearest {nearest_m:.0f} m)"
        return f"{text}: {culprit} looks like {likely}"
    if farthest_m < NEAREST_M:
        text = f"all that is measured is nearer than {NEAREST_M:g} m (farthest {farthest_m:.2g} m)"
        return f"{text}: {culprit} is too small, as by a factor of 1000"
    return ""


def _ground_doubt(frame: Frame, quantity: Quantity) -> str:
    """Why the ground of a picture is none, by the height of the camera over it.

    Where no ground is found as cameras stand over it, one is looked for at ten times and a tenth of all
    lengths. A stated ground is believed: a camera on a mast has one.
    """
    if frame.ground_source is not GroundSource.DEFAULT or frame.camera is None:
        return ""
    for factor in (10.0, 0.1):
        found = _ground_at(frame, quantity, factor)
        if found is None:
            continue
        height_m = found.height_m * factor
        if not HEIGHT_M[0] <= height_m <= HEIGHT_M[1]:
            wrong = f"{_culprit(quantity)} is too {'large' if factor > 1 else 'small'}, as by a factor of 10"
            return (
                f"the camera stands {height_m:.2g} m above the ground (expected {HEIGHT_M[0]:g} to "
                f"{HEIGHT_M[1]:g} m): {wrong}; state the ground if the camera does stand so"
            )
    return ""


def _ground_at(frame: Frame, quantity: Quantity, factor: float) -> GroundPlane | None:
    """The ground of a frame whose lengths are divided by ``factor``; None where none is trusted."""
    assert frame.camera is not None
    smaller = replace(frame.camera, baseline_m=frame.camera.baseline_m / factor)
    tried = [(frame.disparity_px, smaller)]
    if quantity is Quantity.DEPTH:
        # a baseline that comes from noise has noise as it should be in the first, a stated one in the second
        tried.append((frame.disparity_px * np.float32(factor), frame.camera))
    found = (estimate_ground(d, camera, np.random.default_rng(0)) for d, camera in tried)
    return next((e.ground for e in found if e.trusted), None)


def size_doubt(frame: Frame, quantity: Quantity, things: Things) -> str:
    """Why what a picture shows is too large or too small to be what it is taken for; empty where it is not.

    Ground that is found where cameras stand over it says more than things, of which some may be posters.
    """
    trusted = frame.ground_estimate is not None and frame.ground_estimate.trusted
    if frame.camera is None or trusted or len(things.xyxy_px) < MIN_THINGS:
        return ""
    depth_m = np.array([_depth_m(frame, box) for box in things.xyxy_px])
    height_m = (things.xyxy_px[:, 3] - things.xyxy_px[:, 1]) * depth_m / frame.camera.left.fy_px
    known = height_m[np.isfinite(height_m)]
    if len(known) < MIN_THINGS:
        return ""
    factor = float(np.median(known)) / things.height_m
    if 1 / SIZE_FACTOR <= factor <= SIZE_FACTOR:
        return ""
    culprit, large = _culprit(quantity), factor > 1
    return (
        f"the objects are {np.median(known):.2g} m tall (median of {len(known)}; expected "
        f"{things.height_m:.2g} m): {culprit} is too {'large' if large else 'small'}, as by a factor of "
        f"{factor if large else 1 / factor:.2g}"
    )


def _depth_m(frame: Frame, box: FloatArray) -> float:
    """Median depth in metres of the middle of a box (4,), NaN where nothing is measured there."""
    assert frame.camera is not None
    height, width = frame.disparity_px.shape
    x0, y0, x1, y1 = box
    columns = np.clip(np.rint([0.75 * x0 + 0.25 * x1, 0.25 * x0 + 0.75 * x1]), 0, width).astype(int)
    rows = np.clip(np.rint([0.75 * y0 + 0.25 * y1, 0.25 * y0 + 0.75 * y1]), 0, height).astype(int)
    seen = frame.disparity_px[slice(*rows), slice(*columns)]
    seen = seen[np.isfinite(seen) & (seen > 0)]
    return frame.camera.focal_baseline / float(np.median(seen)) if seen.size else np.nan


def refuse_other_unit(where: str, frame: Frame, quantity: Quantity) -> None:
    """Raises RescoreError where ``unit_doubt`` has a doubt; ``where`` names the frame."""
    _refuse(where, unit_doubt(frame, quantity))


def refuse_other_size(where: str, frame: Frame, quantity: Quantity, things: Things) -> None:
    """Raises RescoreError where ``size_doubt`` has a doubt; ``where`` names the frame."""
    _refuse(where, size_doubt(frame, quantity, things))


def _refuse(where: str, doubt: str) -> None:
    if doubt:
        raise RescoreError(
            f"{where}: expected depth and baseline in metres and disparity in pixels, got other units, since "
            f"{doubt}; convert it"
        )
