"""Trials of localisation: a car placed at random, photographed, and localised by every method."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.table_scene import (
    SCALE,
    SEEN_FROM,
    Placement,
    photograph,
    photograph_empty,
    place_at_random,
    project_ground,
)
from recon.arrays import FloatArray, UInt8Array
from recon.errors import Failure
from recon.localization.joint_fit import JointFitConfig
from recon.localization.localize import (
    FitConfig,
    FitLocalization,
    PartsConfig,
    PartsLocalization,
    localize_by_fit,
    localize_by_parts,
)
from recon.localization.single_plane import UprightSurface, lower_edge, single_plane
from recon.localization.standing_box import StandingBox
from recon.pixels import linear_from_srgb
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_thread
from rescore.studies.localization.learned import TableClass
from rescore.studies.localization.scores import Score, score
from rescore.studies.localization.segment import TableRegion, TableSegmentConfig, empty_table, segment_table

_CROP_MARGIN_PX = 60
"""Around the outline, so that the box is seen whole."""
_APART_PX = 20
"""Least distance of two cars in one picture, between their boxes: their outlines do not meet."""


@dataclass(frozen=True)
class TrialConfig:
    """Settings of all methods."""

    segment: TableSegmentConfig = field(default_factory=TableSegmentConfig)
    parts: PartsConfig = field(default_factory=PartsConfig)
    fit: FitConfig = field(default_factory=lambda: FitConfig(fit=JointFitConfig(model_scale=SCALE)))


@dataclass(frozen=True, eq=False)
class Trial:
    """One placement with what each method made of it."""

    shape_id: str
    index: int
    truth: StandingBox
    crop_rgb: UInt8Array
    """The picture around the car, shape (h, w, 3)."""
    crop_xy_px: tuple[int, int]
    """Column and row of the crop's first pixel."""
    ring_px: FloatArray | None
    """The outline from the segmentation; None where there is none."""
    fit: FitLocalization | Failure
    parts: PartsLocalization | Failure
    surface: UprightSurface | Failure

    @property
    def scores(self) -> dict[str, Score | Failure]:
        """Errors by method, or why there is no estimate."""
        return {
            "3dp": score(self.fit.box if isinstance(self.fit, FitLocalization) else self.fit, self.truth),
            "3dp_report": score(
                self.parts.box if isinstance(self.parts, PartsLocalization) else self.parts, self.truth
            ),
            "single_plane": score(self.surface, self.truth),
        }


def run_trials(
    cars: Sequence[CarModel],
    numbers: Sequence[int],
    table_class: TableClass,
    config: TrialConfig,
    seed: int,
    jobs: Workers,
) -> Iterator[Trial]:
    """Placements of these numbers, spread evenly over the cars, in order, as they are done.

    The same seed gives the same trials for any number of jobs.
    """
    return map_frames(_trial, numbers, (cars, table_class, config, seed), jobs)


def _trial(index: int, shared: tuple[Sequence[CarModel], TableClass, TrialConfig, int]) -> Trial:
    cars, table_class, config, seed = shared
    return run_trial(cars[index % len(cars)], index, table_class, config, seed)


def run_trial(car: CarModel, index: int, table_class: TableClass, config: TrialConfig, seed: int) -> Trial:
    """One placement from its random draw to the estimates."""
    rng = np.random.default_rng([seed, index])
    placement = place_at_random(car, rng)
    with one_thread():
        return localize_placement(placement, photograph([placement], rng), index, table_class, config)


def localize_placement(
    placement: Placement, rgb: UInt8Array, index: int, table_class: TableClass, config: TrialConfig
) -> Trial:
    """What each method says of a picture of one placement."""
    regions = segment_table(rgb, empty_table(config.segment))
    name, box = placement.car.shape_id, placement.box
    if isinstance(regions, Failure):
        return Trial(name, index, box, rgb, (0, 0), None, regions, regions, regions)
    region = regions[0]
    low = np.maximum(region.ring_px.min(axis=0) - _CROP_MARGIN_PX, 0).astype(int)
    high = (region.ring_px.max(axis=0) + _CROP_MARGIN_PX).astype(int)
    fit = fit_region(rgb, region, table_class, config)
    return Trial(
        name,
        index,
        box,
        np.ascontiguousarray(rgb[low[1] : high[1], low[0] : high[0]]),
        (int(low[0]), int(low[1])),
        region.ring_px,
        fit,
        construct_region(rgb, region, table_class, config, fit),
        surface_of_region(region),
    )


def surface_of_region(region: TableRegion) -> UprightSurface | Failure:
    """The upright surface over the lower edge of one thing on the table."""
    line = lower_edge(region.mask)
    if isinstance(line, Failure):
        return line
    surface = single_plane(region.ring_px, line, SEEN_FROM)
    return surface if isinstance(surface, Failure) else surface.on_ground(SEEN_FROM.ground)


def fit_region(
    rgb: UInt8Array, region: TableRegion, table_class: TableClass, config: TrialConfig
) -> FitLocalization | Failure:
    """The joint fit to one thing on the table."""
    light, empty = linear_from_srgb(rgb), photograph_empty()
    space, heading = table_class.space, table_class.heading
    return localize_by_fit(light, empty, region.ring_px, space, SEEN_FROM, config.fit, heading)


def construct_region(
    rgb: UInt8Array,
    region: TableRegion,
    table_class: TableClass,
    config: TrialConfig,
    fit: FitLocalization | Failure,
) -> PartsLocalization | Failure:
    """The report's construction of one thing on the table.

    The report has its view bin from a detector. There is none here, so that which end is the front is decided
    once for both ways: where there is a joint fit, its nose says it, to within 90 degrees, and nothing more.
    """
    nose_rad = fit.box.yaw_rad if isinstance(fit, FitLocalization) else None
    return localize_by_parts(rgb, region.ring_px, table_class.model, SEEN_FROM, config.parts, nose_rad)


def several_at_once(cars: Sequence[CarModel], rng: np.random.Generator) -> list[Placement]:
    """Placements of several cars that stand well apart; cars that find no room are left out."""
    placed: list[Placement] = []
    for car in cars:
        for _ in range(60):
            new = place_at_random(car, rng)
            if all(_apart(new, p) for p in placed):
                placed.append(new)
                break
    return placed


def _apart(a: Placement, b: Placement) -> bool:
    """Whether the boxes around two cars in the picture lie apart."""
    uv_a, uv_b = (project_ground(p.box.corners_m) for p in (a, b))
    gap = np.maximum(uv_a.min(axis=0) - uv_b.max(axis=0), uv_b.min(axis=0) - uv_a.max(axis=0))
    return bool(gap.max() > _APART_PX)
