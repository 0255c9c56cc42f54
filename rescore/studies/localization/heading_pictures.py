"""Pictures of cars on the table in all kinds of looks, from which front and rear are told apart."""

from dataclasses import dataclass

import numpy as np

from datasets_synth.cars.models import repainted
from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.table_scene import SCALE, SEEN_FROM, photograph, photograph_empty, place_at_random
from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.errors import Failure
from recon.localization.heading import FitLooks, HeadingConfig, Posed, neutral_hull, read_surface
from recon.localization.joint_fit import FittedInstance, JointFitConfig, OutlineFit, turned_round
from recon.localization.localize import FitConfig, FitLooker
from recon.localization.outline_edges import points_on_edges
from recon.localization.standing_box import StandingBox
from recon.pixels import linear_from_srgb
from recon.shape_space import ShapeSpace
from rescore.parallel import one_thread
from rescore.studies.localization.segment import TableSegmentConfig, empty_table, segment_table

_SEED = 20090625
_USUAL_EVERY = 4
"""Every so many pictures show a car in its usual looks."""


@dataclass(frozen=True)
class BoxError:
    """Standard deviations of the errors of a box, as fits have."""

    place_m: float = 0.005
    turn_rad: float = 0.03
    log_size: float = 0.05

    def of(self, true: StandingBox, rng: np.random.Generator) -> StandingBox:
        """The box with errors."""
        return StandingBox(
            true.xy_m + rng.normal(0, self.place_m, 2),
            true.yaw_rad + rng.normal(0, self.turn_rad),
            true.size_m * np.exp(rng.normal(0, self.log_size, 3)),
        )


def surface_readings(
    car: CarModel, stream: int, count: int, space: ShapeSpace, config: HeadingConfig
) -> list[FloatArray]:
    """Readings (3, cells) of the surface of a car in pictures of it, its box known but for small errors.

    Args:
        car: The car.
        stream: Number of its stream of random choices.
        count: Pictures.
        space: The class.
        config: Settings of the reading.
    """
    out, hull = [], neutral_hull(space.mean)
    with one_thread():
        for k in range(count):
            rgb, true, rng = _picture(car, stream, k)
            placed = Posed(hull, space.reach, BoxError().of(true, rng))
            out.append(read_surface(linear_from_srgb(rgb), placed, SEEN_FROM, config))
    return out


def fitted_pairs(
    car: CarModel, stream: int, count: int, space: ShapeSpace, config: HeadingConfig
) -> list[tuple[FitLooks, FitLooks]]:
    """A fit near the truth and the same car fitted the other way round, for pictures in which it is found."""
    with one_thread():
        found = [_pair(*_picture(car, stream, k), space, config) for k in range(count)]
    return [pair for pair in found if pair is not None]


def _picture(car: CarModel, stream: int, k: int) -> tuple[UInt8Array, StandingBox, np.random.Generator]:
    rng = np.random.default_rng([_SEED, stream, k])
    placement = place_at_random(car if k % _USUAL_EVERY == 0 else repainted(car), rng)
    return photograph([placement], rng), placement.box, rng


def _pair(
    rgb: UInt8Array, true: StandingBox, rng: np.random.Generator, space: ShapeSpace, heading: HeadingConfig
) -> tuple[FitLooks, FitLooks] | None:
    regions = segment_table(rgb, empty_table(TableSegmentConfig()))
    if isinstance(regions, Failure):
        return None
    ring_px, light = regions[0].ring_px, linear_from_srgb(rgb)
    config = FitConfig(fit=JointFitConfig(model_scale=SCALE))
    fits = _both_ways(light, ring_px, BoxError().of(true, rng), space, config)
    looker = FitLooker(light, ring_px, space, SEEN_FROM, config)
    agree = looker.agreement(fits)
    fit, turned = (looker.looks(f, float(a), heading) for f, a in zip(fits, agree, strict=True))
    return fit, turned


def _both_ways(
    light: Float32Array, ring_px: FloatArray, near: StandingBox, space: ShapeSpace, config: FitConfig
) -> list[FittedInstance]:
    """A fit that starts from a box, and one from its result turned round."""
    outline = points_on_edges(light, photograph_empty(), ring_px, config.outline_points, config.edges)
    problem = OutlineFit(outline, space, SEEN_FROM, config.fit)
    log_rest = np.log(near.size_m / SCALE) - space.log_size
    start = np.concatenate([near.xy_m / SCALE, [near.yaw_rad], log_rest, np.zeros(space.count)])
    fit = problem.fit(start)
    return problem.relaxed([fit, problem.fit(turned_round(fit, space))])
