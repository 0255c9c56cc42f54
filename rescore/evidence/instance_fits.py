"""The instances of a class fitted to the boxes and the disparity of a frame."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.localization.depth_views import DepthViews, DepthViewsConfig, render_depth_views
from recon.localization.disparity_fit import (
    BoxFit,
    DisparityFit,
    DisparityFitConfig,
    PlacedInstance,
)
from recon.localization.standing_box import cam_from_ground
from recon.shape_space import ShapeSpace
from rescore.data.boxes3d import Boxes3D
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
    looks = None if model.looks is None else model.looks.log_density(frame.left_rgb, xyxy_px)
    return fit.fit(xyxy_px, looks)


def views_of_space(space: ShapeSpace, height_m: float, config: DepthViewsConfig) -> DepthViews:
    """Maps of a class for a camera of about this height above the ground; rendered once in a process."""
    unit = float(np.exp(space.log_size[2]))
    nearest = int(np.abs(np.log(_HEIGHTS * unit / height_m)).argmin())
    return _rendered(_ByContent(space), float(_HEIGHTS[nearest] * unit), config)


def boxes_of_fits(fits: Sequence[BoxFit | None], frame: Frame) -> Boxes3D | None:
    """The 3D box of the instance that each box frames; None where no instance was fitted at all."""
    return placed_boxes([None if fit is None else fit.framed for fit in fits], frame)


def placed_boxes(instances: Sequence[PlacedInstance | None], frame: Frame) -> Boxes3D | None:
    """The 3D boxes of instances, with deviations; None where there is no instance at all."""
    if frame.seen_from is None or all(placed is None for placed in instances):
        return None
    pose = cam_from_ground(frame.seen_from.ground)
    values, deviations = np.full((len(instances), 7), np.nan), np.full((len(instances), 7), np.nan)
    for i, placed in enumerate(instances):
        if placed is None:
            continue
        box, sd = placed.box, placed.place_sd
        centre = pose[:3, :3] @ box.centroid_m + pose[:3, 3]
        nose = pose[:3, :3] @ [np.cos(box.yaw_rad), np.sin(box.yaw_rad), 0.0]
        values[i] = [*centre, *box.size_m, np.arctan2(-nose[2], nose[0])]
        # along the line of sight and across it, turned into the camera's axes
        ahead = np.append(box.xy_m / np.linalg.norm(box.xy_m), 0.0)
        across = np.array([ahead[1], -ahead[0], 0.0])
        spread = np.hypot(pose[:3, :3] @ ahead * sd[0], pose[:3, :3] @ across * sd[1])
        deviations[i] = [*spread, *(box.size_m * sd[3]), sd[2]]
    return Boxes3D.of_values(values, deviations)


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
