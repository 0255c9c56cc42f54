"""One car: how much more likely its disparity is under each surface than under the best plane."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial import cKDTree

from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.camera import GroundedStereo, StereoCamera
from recon.localization.depth_views import DepthViewsConfig
from recon.localization.disparity_fit import BoxFit
from recon.localization.standing_box import angle_between
from recon.shape_space import ShapeSpace
from rescore.studies.relief.likelihood import MeasurementNoise, best_plane
from rescore.studies.relief.posed_shapes import (
    ALL_FREE,
    NONE_FREE,
    POSE_FREE,
    Climb,
    PosedShape,
    fit_shapes,
    posed_instance,
)
from rescore.studies.relief.relief_file import MatcherErrors, ReliefCar, View
from rescore.studies.relief.shown_cars import ShownCar, sampled

MOST_SAMPLES = 800
"""Pixels of a car that are looked at, evenly taken; each stands for its share of all."""
FEWEST_SAMPLES = 60
"""A car with fewer measured pixels is left out."""
WRONG_PX = 2.0
"""A measurement that is farther from the truth counts as wrong."""
TEXTURED = 2.0
"""Mean slope of the picture along rows, in grey levels a pixel, from which a pixel counts as textured."""
_AROUND = 9
"""Pixels across the square over which that mean is taken."""
_EXACT = MeasurementNoise(sd_px=0.15)
"""How near to the true surface the nearest shape is asked to be."""


@dataclass(frozen=True, eq=False)
class SeenCar:
    """One car with what is measured of it and what was fitted."""

    car: ShownCar
    left_rgb: UInt8Array
    """The picture, shape (h, w, 3)."""
    measured_px: Float32Array
    """Measured disparity of the frame, shape (h, w), NaN in holes."""
    true_px: Float32Array
    """True disparity, shape (h, w)."""
    seen_from: GroundedStereo
    """The pair, and the ground that the fit was given; without a fit any."""
    fit: BoxFit | None
    """None where no ground was trusted, or nothing is measured in the box."""

    @property
    def textured(self) -> BoolArray:
        """The pixels (h, w) where the picture gives a matcher something to match."""
        grey = cv2.GaussianBlur(cv2.cvtColor(self.left_rgb, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1)
        slope = np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8))
        return np.asarray(cv2.blur(slope, (_AROUND, _AROUND)) >= TEXTURED)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Pixels (n,) of one car with its plane."""

    uv_px: FloatArray
    measured_px: FloatArray
    true_px: FloatArray
    weight: float
    """Number of independent measurements that one of them counts as."""
    noise: MeasurementNoise
    plane_px: FloatArray
    """Disparity of the best plane."""

    @staticmethod
    def of(
        one: SeenCar, where: BoolArray, noise: MeasurementNoise, rng: np.random.Generator
    ) -> "_Samples | None":
        """Measured pixels of a mask, a sample of them; None where they are too few."""
        known = where & np.isfinite(one.measured_px) & np.isfinite(one.true_px)
        at = sampled(known, MOST_SAMPLES)
        if len(at) < FEWEST_SAMPLES:
            return None
        row, column = at.T
        uv, measured = at[:, ::-1].astype(float), one.measured_px[row, column].astype(float)
        weight = float(known.sum()) / len(at) / noise.independent_px
        true = one.true_px[row, column].astype(float)
        return _Samples(uv, measured, true, weight, noise, best_plane(uv, measured, noise, rng))

    def ratio(self, predicted_px: FloatArray) -> float:
        """Log likelihood ratio of a surface (n,) over the plane, nats."""
        surface = self.noise.log_density(self.measured_px - predicted_px)
        return self.weight * float((surface - self.noise.log_density(self.measured_px - self.plane_px)).sum())

    def tilted(self, predicted_px: FloatArray) -> FloatArray:
        """A surface (n,) with the plane of disparity added that makes it likeliest."""
        plane = best_plane(self.uv_px, self.measured_px - predicted_px, self.noise, np.random.default_rng(0))
        return predicted_px + plane

    def as_if(self, noise: MeasurementNoise, rng: np.random.Generator) -> "_Samples":
        """The samples, had the matcher's errors been those of the noise."""
        drawn = noise.drawn(self.true_px, rng)
        return replace(self, measured_px=drawn, plane_px=best_plane(self.uv_px, drawn, noise, rng))

    def filled(self, predicted_px: FloatArray) -> FloatArray:
        """A surface (n,) that goes on at its nearest value where it is not seen; NaN where it never is."""
        known = np.isfinite(predicted_px)
        if known.all() or not known.any():
            return predicted_px
        _, nearest = cKDTree(self.uv_px[known]).query(self.uv_px)
        return np.asarray(predicted_px[known][nearest])


def compare_car(
    one: SeenCar,
    space: ShapeSpace,
    views: DepthViewsConfig,
    noise: MeasurementNoise,
    rng: np.random.Generator,
) -> ReliefCar | None:
    """The figures of one car; None where too little of it is measured.

    Args:
        one: The car.
        space: Shapes of its class.
        views: The shapes of the space that were fitted.
        noise: Of the measurements.
        rng: Draws planes and simulated measurements.
    """
    car, inner, textured = one.car, one.car.inner, one.textured
    samples = _Samples.of(one, inner, noise, rng)
    whole = _Samples.of(one, car.seen, noise, rng)
    if samples is None or whole is None:
        return None
    ideal = samples.as_if(noise, rng)
    ratio = {
        "true": samples.ratio(samples.true_px),
        "true_tilted": samples.ratio(samples.tilted(samples.true_px)),
        "true_edges": whole.ratio(whole.true_px),
        "true_ideal": ideal.ratio(ideal.true_px),
    }
    clear = _Samples.of(one, inner & textured, noise, rng)
    if clear is not None:
        ratio["true_textured"] = clear.ratio(clear.true_px)
    ratio |= _of_space(one, samples, space, views)
    ratio |= _of_fit(one, samples, space, views)
    place, heading, covered = _pose_errors(one, samples, space, views)
    off = (one.measured_px - one.true_px)[inner]
    blank, clear_off = _errors(off[~textured[inner]]), _errors(off[textured[inner]])
    return ReliefCar(
        annotation_id=car.annotation_id,
        distance_m=car.distance_m,
        azimuth_deg=car.azimuth_deg,
        view=View.of(car.azimuth_deg),
        n_pixels=int(inner.sum()),
        measured_share=float(np.isfinite(one.measured_px[inner]).mean()),
        textured_share=float(textured[inner].mean()),
        textured=clear_off,
        blank=blank,
        ratio=ratio,
        place_error_m=place,
        heading_error_deg=heading,
        covered_share=covered,
    )


def _errors(off_px: Float32Array) -> MatcherErrors:
    """What is measured less what is true at some pixels (n,), NaN in holes."""
    known = off_px[np.isfinite(off_px)].astype(float)
    bias, low, high = np.nan, np.nan, np.nan
    if len(known):
        bias = float(np.median(known))
        low, high = float((known < -WRONG_PX).mean()), float((known > WRONG_PX).mean())
    return MatcherErrors(
        n_pixels=len(off_px),
        measured_share=len(known) / max(1, len(off_px)),
        bias_px=bias,
        low_share=low,
        high_share=high,
    )


def _of_space(
    one: SeenCar, samples: _Samples, space: ShapeSpace, views: DepthViewsConfig
) -> dict[str, float]:
    """Ratios of shapes of the space in the true pose and near it."""
    stereo = one.seen_from.stereo
    to_truth = Climb(samples.uv_px, samples.true_px, 1.0, stereo, _EXACT)
    to_measured = Climb(samples.uv_px, samples.measured_px, samples.weight, stereo, samples.noise)
    mean = PosedShape(space, one.car.cam_from_object, np.zeros(space.count), one.car.size_m)
    nearest = to_truth.climbed(mean, NONE_FREE, 1.0)
    fitted = _nearest_of(_fit_shapes_at(one, space, views), samples, stereo)
    surfaces = {
        "space": nearest,
        "fit_shapes": fitted,
        "fit_shapes_climbed": to_measured.climbed(fitted, POSE_FREE, 0.0),
        "space_climbed": to_measured.climbed(nearest, ALL_FREE, 1.0),
    }
    return {
        name: samples.ratio(samples.filled(s.disparity_px(samples.uv_px, stereo)))
        for name, s in surfaces.items()
    }


def _fit_shapes_at(one: SeenCar, space: ShapeSpace, views: DepthViewsConfig) -> list[PosedShape]:
    """The shapes that the fit tries in the true pose, each as large as the car on the whole."""
    found = []
    for coefficients in fit_shapes(space, views):
        size = space.size_m(coefficients, np.zeros(3))
        size = size * (one.car.size_m.prod() / size.prod()) ** (1 / 3)
        found.append(PosedShape(space, one.car.cam_from_object, coefficients, size))
    return found


def _nearest_of(shapes: Sequence[PosedShape], samples: _Samples, stereo: StereoCamera) -> PosedShape:
    """The shape that is nearest to the true surface."""
    near = [_EXACT.log_density(samples.true_px - s.disparity_px(samples.uv_px, stereo)).sum() for s in shapes]
    return shapes[int(np.argmax(near))]


def _of_fit(one: SeenCar, samples: _Samples, space: ShapeSpace, views: DepthViewsConfig) -> dict[str, float]:
    """Ratios of the fitted instances, and of what they could be climbed to; empty without a fit."""
    if one.fit is None:
        return {}
    stereo = one.seen_from.stereo
    climb = Climb(samples.uv_px, samples.measured_px, samples.weight, stereo, samples.noise)
    framed, seen = (
        posed_instance(placed, space, views, one.seen_from) for placed in (one.fit.framed, one.fit.seen)
    )
    surfaces = {
        "framed": framed,
        "seen": seen,
        "framed_climbed": climb.climbed(framed, POSE_FREE, 0.0),
        "framed_shaped": climb.climbed(framed, ALL_FREE, 1.0),
    }
    predicted = {name: s.disparity_px(samples.uv_px, stereo) for name, s in surfaces.items()}
    found = {name: samples.ratio(samples.filled(p)) for name, p in predicted.items()}
    return found | {
        "framed_strict": samples.ratio(predicted["framed"]),
        "framed_tilted": samples.ratio(samples.tilted(samples.filled(predicted["framed"]))),
    }


def _pose_errors(
    one: SeenCar, samples: _Samples, space: ShapeSpace, views: DepthViewsConfig
) -> tuple[float, float, float]:
    """Distance in metres and turn in degrees of the framed instance from the truth, and the share of the
    samples that its silhouette covers; NaN without a fit."""
    if one.fit is None:
        return np.nan, np.nan, np.nan
    framed, true = posed_instance(one.fit.framed, space, views, one.seen_from), one.car.cam_from_object
    nose = true[:3, :3].T @ framed.cam_from_object[:3, 0]
    predicted = framed.disparity_px(samples.uv_px, one.seen_from.stereo)
    return (
        float(np.linalg.norm(framed.cam_from_object[:3, 3] - true[:3, 3])),
        float(np.degrees(angle_between(float(np.arctan2(nose[1], nose[0])), 0.0))),
        float(np.isfinite(predicted).mean()),
    )
