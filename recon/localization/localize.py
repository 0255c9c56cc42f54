"""Pose and bounding box of an object on a known ground plane from its outline (section 5.1).

Two ways: by the report's construction, and by a joint fit of pose and shape.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.class_model import ClassModel
from recon.errors import Failure, Reason
from recon.localization.heading import (
    FitLooks,
    Heading,
    HeadingConfig,
    NoseOdds,
    Posed,
    neutral_hull,
    read_surface,
)
from recon.localization.joint_fit import FittedInstance, JointFitConfig, joint_fits
from recon.localization.outline_edges import OutlineEdgeConfig, OutlinePoints, points_on_edges
from recon.localization.standing_box import StandingBox, angle_between, cam_from_ground
from recon.outlines import fill_polygon
from recon.reconstruction.border_evidence import EdgeWindow, EdgeWindowConfig
from recon.reconstruction.instance import Instance3D, build_instance
from recon.reconstruction.occluded_parts import TransformConfig
from recon.reconstruction.reconstruct import Reconstruction, reconstruct_outline
from recon.reconstruction.view_selection import ViewSelectionConfig, best_view_bin
from recon.shape_space import ShapeSpace
from recon.view_bins import ViewBins


@dataclass(frozen=True)
class FitConfig:
    """Settings of localisation by the joint fit."""

    view_bins: int = 12
    """Directions that the fit starts from."""
    outline_points: int = 160
    """Points on the outline."""
    max_cost: float = 600.0
    """A larger strain is a failure: the class does not explain the outline. That of cars is about 15."""
    usual_strain: float = 40.0
    """A larger strain says that the object is of no shape of the class, and its box is less to be relied on.
    Of shapes that the class was not learned from but is made of, one in twenty has more."""
    max_deviation: float = 12.0
    """A larger length of the shape coefficients is a failure: no object of the class looks like this. Where
    k of them are standard normal, it is about the root of k."""
    edges: OutlineEdgeConfig = field(default_factory=OutlineEdgeConfig)
    borders_weight: float = 80.0
    """Cost of 1 minus the correlation of edges in the picture with the borders of the visible parts; chosen
    on shapes that are neither learned from nor tested on."""
    window: EdgeWindowConfig = field(default_factory=EdgeWindowConfig)
    fit: JointFitConfig = field(default_factory=JointFitConfig)


@dataclass(frozen=True)
class PartsConfig:
    """Settings of localisation by the report's construction."""

    view: ViewSelectionConfig = field(default_factory=ViewSelectionConfig)
    """Choice of the view bin; its ``reconstruct`` also rules the reconstruction."""
    transform: TransformConfig = field(default_factory=lambda: TransformConfig(calibrated_ground=True))
    tried_bins: int = 4
    """View bins of least cost that are reconstructed."""
    turns_deg: tuple[float, ...] = (-12.0, -6.0, 0.0, 6.0, 12.0)
    """Ways in which the object may be turned from the middle of a view bin of 30 degrees."""
    fine_deg: tuple[float, ...] = (-3.0, 3.0)
    """Turns from the best one that are tried after it."""
    overlap_weight: float = 20.0
    """Nats of what the projected instance and the outline do not share (1 - IoU), beside the bin's cost."""
    borders_weight: float = 80.0
    """Nats of 1 minus the correlation of edges with the borders of the projected instance's visible parts."""
    proportions: float = 0.1
    """Standard deviation of the logarithms of length, width and height beside those of the class model, all
    enlarged alike: an object turned the wrong way fills its outline with a box that no object has."""
    window: EdgeWindowConfig = field(default_factory=EdgeWindowConfig)


@dataclass(frozen=True, eq=False)
class PartsLocalization:
    """What the report's construction says of one outline."""

    box: StandingBox
    instance: Instance3D
    turn_deg: float
    """How far the object is turned from the middle of its view bin."""
    cost: float
    """Cost of the view bin and of what the projected instance and the outline do not share, nats."""


def localize_by_parts(
    rgb: UInt8Array,
    ring_px: FloatArray,
    model: ClassModel,
    seen_from: GroundedCamera,
    config: PartsConfig,
    nose_rad: float | None = None,
) -> PartsLocalization | Failure:
    """The report's construction from the likeliest view bins; the instance that fits the outline best.

    Parts are registered to the outline and placed from the ground line up (section 4.3); the transform from
    the class model to the placed parts places the others (section 4.4), and all together give the box.

    Args:
        rgb: the picture, shape (h, w, 3).
        ring_px: outline from the segmentation, shape (m, 2), centres of its border pixels.
        model: the class model.
        seen_from: the camera M and the ground plane Q_g.
        config: settings.
        nose_rad: where the nose points in the ground frame, to within 90 degrees: in the report a detector
            says the view bin. None where nothing says it, so that the outline and the borders must tell.
    """
    xyxy = np.concatenate([ring_px.min(axis=0), ring_px.max(axis=0) + 1.0])
    choice = best_view_bin(rgb, xyxy, model, config.view, ring_px)
    if isinstance(choice, Failure):
        return choice
    trial = _PartsTrial(EdgeWindow(rgb, ring_px, config.window), ring_px, model, seen_from, config)
    found: list[PartsLocalization] = []
    failures: list[Failure] = []
    bins_left = config.tried_bins
    for view_bin in _facing(choice.order, xyxy, model.bins, seen_from, nose_rad):
        good, bad = trial.from_bin(view_bin, float(choice.cost[view_bin]), config.turns_deg)
        found, failures, bins_left = found + good, failures + bad, bins_left - bool(good)
        if not bins_left:
            break
    if not found:
        return failures[0]
    best = min(found, key=lambda t: t.cost)
    near = [best.turn_deg + step for step in config.fine_deg]
    view_bin = best.instance.view_bin
    found += trial.from_bin(view_bin, float(choice.cost[view_bin]), near)[0]
    return min(found, key=lambda t: t.cost)


def _facing(
    order: NDArray[np.intp],
    xyxy_px: FloatArray,
    bins: ViewBins,
    seen_from: GroundedCamera,
    nose_rad: float | None,
) -> list[int]:
    """The bins of an order in which an object in a box has its nose within 90 degrees of a direction; all
    where there are none."""
    every: list[int] = order.tolist()
    if nose_rad is None:
        return every
    away = seen_from.level_direction((xyxy_px[:2] + xyxy_px[2:]) / 2 - 0.5)
    x, y, _ = -away @ cam_from_ground(seen_from.ground)[:3, :3]
    to_camera = float(np.arctan2(y, x))
    near = [
        b for b in order.tolist() if angle_between(to_camera - bins.azimuth_rad(b), nose_rad) <= np.pi / 2
    ]
    return near or order.tolist()


@dataclass(frozen=True, eq=False)
class _PartsTrial:
    """What is the same for all view bins of one outline."""

    window: EdgeWindow
    ring_px: FloatArray
    model: ClassModel
    seen_from: GroundedCamera
    config: PartsConfig

    def from_bin(
        self, view_bin: int, cost: float, turns_deg: Sequence[float]
    ) -> tuple[list[PartsLocalization], list[Failure]]:
        """What one view bin of this cost gives, turned in each way, and why it gives nothing."""
        found: list[PartsLocalization] = []
        failures: list[Failure] = []
        rules, turns_rad = self.config.view.reconstruct, np.deg2rad(turns_deg).tolist()
        tried = reconstruct_outline(self.ring_px, view_bin, self.model, self.seen_from, rules, turns_rad)
        for turn_deg, built in zip(turns_deg, tried, strict=True):
            instance = self._completed(built, view_bin)
            if isinstance(instance, Failure):
                failures.append(instance)
            else:
                box = _standing_box(instance, self.seen_from.ground)
                found.append(PartsLocalization(box, instance, turn_deg, cost + self._misfit(instance)))
        return found, failures

    def _completed(self, built: Reconstruction | Failure, view_bin: int) -> Instance3D | Failure:
        """The whole instance of a reconstruction; a failure stays one."""
        if isinstance(built, Failure):
            return built
        registration = self.config.view.reconstruct.registration
        return build_instance(
            built, view_bin, self.model, self.seen_from, registration, self.config.transform
        )

    def _misfit(self, instance: Instance3D) -> float:
        """Cost of an instance in the picture, nats."""
        visible, iou = _project_model(instance, self.model, self.ring_px, self.seen_from.camera)
        agree = float(self.window.agreement([visible])[0])
        picture = self.config.overlap_weight * (1 - iou) + self.config.borders_weight * (1 - agree)
        stretch = np.log(instance.size_m) - self._class_log_size
        return picture + 0.5 * float(((stretch - stretch.mean()) ** 2).sum()) / self.config.proportions**2

    @cached_property
    def _class_log_size(self) -> FloatArray:
        """Logarithms (3,) of length, width and height of the class model, in its units."""
        return np.asarray(np.log(np.ptp(np.concatenate([p.outline for p in self.model.parts]), axis=0)))


def _standing_box(instance: Instance3D, ground: GroundPlane) -> StandingBox:
    pose = cam_from_ground(ground)
    middle = (instance.cam_from_object[:3, 3] - pose[:3, 3]) @ pose[:3, :3]
    return StandingBox(middle[:2], instance.yaw_rad, instance.size_m)


def _project_model(
    instance: Instance3D, model: ClassModel, ring_px: FloatArray, camera: PinholeCamera
) -> tuple[list[FloatArray], float]:
    """Outlines in pixels of the visible parts of the class model carried onto an instance, and the
    intersection over union of all parts with the outline's region, in [0, 1]."""
    low = np.floor(ring_px.min(axis=0)) - 20
    width, height = (np.ceil(ring_px.max(axis=0)) + 21 - low).astype(int)
    region = fill_polygon(ring_px - low, height, width)
    covered = np.zeros_like(region)
    visible = []
    for part in model.parts:
        cam = instance.class_to_instance.points(part.outline)
        if (cam[:, 2] <= 0).any():
            continue
        uv = camera.project(cam)
        covered |= fill_polygon(uv - low, height, width)
        if instance.class_to_instance.plane(part.plane)[3] > 0:  # the camera is on the outer side
            visible.append(uv)
    return visible, float((region & covered).sum() / (region | covered).sum())


@dataclass(frozen=True, eq=False)
class FitLocalization:
    """What the joint fit says of one outline."""

    box: StandingBox
    fit: FittedInstance
    outline: OutlinePoints
    """The points that were fitted."""
    outside: bool = False
    """Whether the outline is of a shape outside the space: the box is less to be relied on."""
    nose: NoseOdds | None = None
    """How sure it is which end is the front; None where no pictures were learned from, or no fit is the other
    way round."""


def localize_by_fit(
    light: Float32Array,
    background: Float32Array,
    ring_px: FloatArray,
    space: ShapeSpace,
    seen_from: GroundedCamera,
    config: FitConfig,
    heading: Heading | None = None,
) -> FitLocalization | Failure:
    """The joint fit of pose and shape, started from the middle of every view bin; the least cost wins.

    The cost is that of the outline and of how far the borders of the parts are from edges of the picture.
    Which end is the front is told by all cues of the heading, where the fit can be turned round.

    Args:
        light: linear light of the picture, shape (h, w, 3).
        background: the same of the empty scene.
        ring_px: outline from the segmentation, shape (m, 2), centres of its border pixels.
        space: the shape space of the class.
        seen_from: the camera M and the ground plane Q_g.
        config: settings.
        heading: what front and rear look like; None where no pictures were learned from.
    """
    if not np.isfinite(seen_from.ground_points_m(ring_px)).all():
        return Failure(Reason.ABOVE_HORIZON, "an outline below the horizon expected, got points above it")
    outline = points_on_edges(light, background, ring_px, config.outline_points, config.edges)
    scale = config.fit.model_scale
    fits = joint_fits(outline, space, seen_from, ViewBins(config.view_bins), config.fit)
    looker = FitLooker(light, ring_px, space, seen_from, config)
    agree = looker.agreement(fits)
    order = np.argsort([f.cost - config.borders_weight * a for f, a in zip(fits, agree, strict=True)])
    best, nose = fits[order[0]], None
    turned = next((i for i in order if _is_turned(fits[i], best)), None)
    if heading is not None and turned is not None:
        pair = [looker.looks(fits[i], float(agree[i]), heading.config) for i in (order[0], turned)]
        nose = heading.odds(*pair)
        if nose.log_odds < 0:
            best, nose = fits[turned], nose.reversed
    deviation = float(np.linalg.norm(best.coefficients))
    if best.strain > config.max_cost or deviation > config.max_deviation:
        return Failure(
            Reason.REGISTRATION_FAILED,
            f"a cost of at most {config.max_cost:g} and a deviation from the mean shape of at most "
            f"{config.max_deviation:g} expected, got {best.strain:.0f} and {deviation:.1f}",
        )
    outside = best.strain > config.usual_strain
    return FitLocalization(best.box(space, scale), best, outline, outside, nose)


_TURNED_RAD = float(np.deg2rad(135))
"""A fit whose nose differs by more is of the same object the other way round."""


def _is_turned(fit: FittedInstance, of: FittedInstance) -> bool:
    return angle_between(fit.yaw_rad, of.yaw_rad) > _TURNED_RAD


@dataclass(frozen=True, eq=False)
class FitLooker:
    """Compares fits with the picture inside one outline."""

    light: Float32Array
    """Linear light of the picture, shape (h, w, 3)."""
    ring_px: FloatArray
    """The outline from the segmentation, shape (m, 2)."""
    space: ShapeSpace
    seen_from: GroundedCamera
    config: FitConfig

    def agreement(self, fits: Sequence[FittedInstance]) -> FloatArray:
        """Correlation (n,) of edges of the picture with the borders of the visible parts of fits."""
        scale = self.config.fit.model_scale
        visible = [_visible_parts(f.parts_m(self.space, scale), self.seen_from) for f in fits]
        return EdgeWindow(self.light, self.ring_px, self.config.window).agreement(visible)

    def looks(self, fit: FittedInstance, agreement: float, heading: HeadingConfig) -> FitLooks:
        """What tells whether a fit is the right way round."""
        space, light = self.space, self.light
        box = fit.box(space, self.config.fit.model_scale)
        reading = read_surface(
            light, Posed(neutral_hull(space.mean), space.reach, box), self.seen_from, heading
        )
        return FitLooks(reading, fit.cost, agreement)


def _visible_parts(parts_m: FloatArray, seen_from: GroundedCamera) -> list[FloatArray]:
    """Outlines in pixels, a list of (m, 2), of the parts (p, m, 3) whose outer side faces the camera."""
    pose = cam_from_ground(seen_from.ground)
    cam = parts_m @ pose[:3, :3].T + pose[:3, 3]
    normal = np.cross(cam, np.roll(cam, -1, axis=1)).sum(axis=1)
    facing = (normal * cam.mean(axis=1)).sum(axis=1) < 0
    return [seen_from.camera.project(outline) for outline in cam[facing]]
