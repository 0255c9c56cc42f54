"""The instances of a class fitted to the boxes and the disparity of a frame."""

from functools import lru_cache

import numpy as np

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.localization.depth_views import DepthViews, DepthViewsConfig, render_depth_views
from recon.localization.disparity_fit import BoxFit, DisparityFit, DisparityFitConfig
from recon.shape_space import ShapeSpace
from rescore.data.frames import Frame

_HEIGHTS = 2 ** np.arange(-3.0, 4.0, 0.5)
"""Heights of the camera, in heights of the class, for which maps are rendered: the nearest one is used."""


def fit_instances(
    frame: Frame, xyxy_px: FloatArray, model: ClassModel, config: DisparityFitConfig
) -> tuple[BoxFit | None, ...]:
    """What the class and the disparity say of each box (n, 4), pixel edges.

    None for all where the camera or the ground is not known or the model has no shape space, and for a box in
    which nothing is measured.
    """
    if frame.seen_from is None or model.shape_space is None:
        return (None,) * len(xyxy_px)
    views = views_of_space(model.shape_space, frame.seen_from.ground.height_m, config.views)
    fit = DisparityFit(frame.disparity_px, frame.seen_from, views, config)
    return tuple(fit.fit(box) for box in xyxy_px)


def views_of_space(space: ShapeSpace, height_m: float, config: DepthViewsConfig) -> DepthViews:
    """Maps of a class for a camera of about this height above the ground; rendered once in a process."""
    unit = float(np.exp(space.log_size[2]))
    nearest = int(np.abs(np.log(_HEIGHTS * unit / height_m)).argmin())
    return _rendered(_ByContent(space), float(_HEIGHTS[nearest] * unit), config)


class _ByContent:
    """A shape space that equals another with the same content, as each worker process reads its own."""

    def __init__(self, space: ShapeSpace) -> None:
        self.space = space

    def __hash__(self) -> int:
        return hash(self.space.digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByContent) and self.space.digest == other.space.digest


@lru_cache(maxsize=4)
def _rendered(key: _ByContent, height_m: float, config: DepthViewsConfig) -> DepthViews:
    return render_depth_views(key.space, height_m, config)
