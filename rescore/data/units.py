"""Whether what was measured is in the unit that it is taken for, by all of a picture, not by one thing."""

import numpy as np

from recon.camera import StereoCamera
from recon.errors import RescoreError
from rescore.data.depth_files import Quantity
from rescore.data.frames import Frame

FARTHEST_M = 100.0
"""Depth in metres that something in a picture must be nearer than."""
NEAREST_M = 0.2
"""Depth in metres that something in a picture must be farther than."""


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
    return doubt


def _metric_doubt(camera: StereoCamera, quantity: Quantity, far_px: float, near_px: float) -> str:
    culprit = "depth" if quantity is Quantity.DEPTH else "the baseline"
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


def refuse_other_unit(where: str, frame: Frame, quantity: Quantity) -> None:
    """Raises RescoreError where ``unit_doubt`` has a doubt; ``where`` names the frame."""
    doubt = unit_doubt(frame, quantity)
    if doubt:
        raise RescoreError(
            f"{where}: expected depth and baseline in metres and disparity in pixels, got other units, since "
            f"{doubt}; convert it"
        )
