"""What the study of relief found, as typed values, and the file relief.json that holds it."""

from collections.abc import Sequence
from enum import StrEnum
from itertools import pairwise
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from recon.arrays import FloatArray
from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.results.sweep_file import StudyNumber, StudyPart

SURFACES = {
    "true": "the true shape in the true pose",
    "framed": "the instance fitted to the box and the disparity",
    "seen": "the instance fitted to the disparity",
    "space": "the nearest shape of the class model in the true pose",
    "true_tilted": "the true shape, with a free plane of disparity added",
    "true_ideal": "the true shape, had the matcher no other errors than the noise",
    "true_textured": "the true shape, textured pixels alone",
    "true_edges": "the true shape, pixels at the car's edge too",
    "fit_shapes": "the nearest of the shapes that the fit tries, in the true pose",
    "fit_shapes_climbed": "the same, moved to where the disparity is likeliest",
    "space_climbed": "the nearest shape of the class model, moved and bent to the likeliest",
    "framed_tilted": "the framed instance, with a free plane of disparity added",
    "framed_strict": "the framed instance, what its silhouette leaves counted as wrong",
    "framed_climbed": "the framed instance, moved to where the disparity is likeliest",
    "framed_shaped": "the framed instance, moved and bent to the likeliest",
}
"""The surfaces that are compared with the best plane, with what each is."""
MAIN_SURFACES = ("true", "framed", "seen", "space")
DISTANCES_M = (0.0, 12.0, 18.0, 25.0, 60.0)
"""Edges of the groups by distance."""
TARGET_BELOW_M = 25.0
N_RESAMPLES = 1000
CONFIDENCE = 0.95
FEWEST_IMAGES = 3
"""Cars of fewer images have no interval."""


class View(StrEnum):
    """From where a car is seen, by its view bin of 30 degrees."""

    SIDE = "side"
    THREE_QUARTER = "three-quarter"
    END = "front or rear"

    @classmethod
    def of(cls, azimuth_deg: float) -> "View":
        """The view of an azimuth: within 15 degrees of an end, of a side, or between these."""
        beside = min(azimuth_deg % 180, 180 - azimuth_deg % 180)
        return cls.END if beside < 15 else cls.SIDE if beside >= 75 else cls.THREE_QUARTER


class MatcherErrors(StudyPart):
    """Measured less true disparity over some pixels of a car."""

    n_pixels: int
    measured_share: float
    bias_px: StudyNumber
    """Median of measured less true disparity; NaN where nothing is measured."""
    low_share: StudyNumber
    """Share of the measured ones that are too low, and so too far away, by more than two pixels."""
    high_share: StudyNumber
    """Share that is too high by more than two pixels."""


class ReliefCar(StudyPart):
    """One car."""

    image_id: int = 0
    rig: str = ""
    """Name of the stereo head."""
    annotation_id: int
    distance_m: float
    azimuth_deg: float
    view: View
    n_pixels: int
    """Pixels of the car without those at its edge."""
    measured_share: float
    """Share of these that are measured."""
    textured_share: float
    """Share of these where the picture gives a matcher something to match."""
    textured: MatcherErrors
    blank: MatcherErrors
    ratio: dict[str, StudyNumber]
    """Log likelihood ratio of each of ``SURFACES`` over the best plane, in nats; those of the fit are missing
    where nothing could be fitted."""
    place_error_m: StudyNumber
    """Distance of the framed instance from the truth."""
    heading_error_deg: StudyNumber
    covered_share: StudyNumber
    """Share of the samples that lie in the silhouette of the framed instance."""


class Middle(StudyPart):
    """A median over cars with its interval over resampled images; NaN ends for cars of too few images."""

    value: StudyNumber
    low: StudyNumber
    high: StudyNumber


class ReliefCell(StudyPart):
    """The cars of some views between two distances."""

    views: tuple[View, ...]
    from_m: float
    to_m: float
    n_cars: int
    n_fitted: int
    """Cars to which an instance was fitted: those in whose frame a ground is stated or trusted."""
    n_images: int
    median: dict[str, Middle]
    """Median ratio of each surface, of the fitted ones over the cars that have a fit."""
    share_of_true: Middle
    """Median of the framed instance over that of the true shape, both over the cars that have a fit.

    NaN where the latter is not above 0.
    """
    share_of_relief: Middle
    """Median of both with a free plane added, so that relief alone counts, one over the other."""
    above_plane: dict[str, StudyNumber]
    """Share of the cars that have a surface of which it explains the disparity better than the plane."""


class NoiseRecord(StudyPart):
    """The noise that all surfaces are compared with, as ``likelihood.MeasurementNoise`` has it."""

    sd_px: float
    outliers: float
    largest_px: float
    independent_px: float


class ReliefResult(StudyPart):
    """The content of relief.json."""

    command: str
    """What made it."""
    split: str
    n_images: int
    noise: NoiseRecord
    cells: tuple[ReliefCell, ...]
    """A cell a view and group of distances that has cars."""
    target: ReliefCell
    """Three-quarter views and ends below ``TARGET_BELOW_M``."""
    rigs: dict[str, ReliefCell]
    """The cars of ``target`` by the stereo head that sees them."""
    cars: tuple[ReliefCar, ...]


def relief_cells(cars: Sequence[ReliefCar], rng: np.random.Generator) -> tuple[ReliefCell, ...]:
    """The cells of all views and distances that have cars."""
    found = []
    for view in View:
        for low, high in pairwise(DISTANCES_M):
            own = [c for c in cars if c.view is view and low <= c.distance_m < high]
            if own:
                found.append(relief_cell(own, (view,), (low, high), rng))
    return tuple(found)


def target_cell(cars: Sequence[ReliefCar], rng: np.random.Generator) -> ReliefCell:
    """The cell of three-quarter views and ends that are near."""
    views = (View.THREE_QUARTER, View.END)
    own = [c for c in cars if c.view in views and c.distance_m < TARGET_BELOW_M]
    return relief_cell(own, views, (0.0, TARGET_BELOW_M), rng)


def rig_cells(cars: Sequence[ReliefCar], rng: np.random.Generator) -> dict[str, ReliefCell]:
    """The cells of ``target_cell`` by stereo head."""
    rigs = sorted({c.rig for c in cars})
    return {rig: target_cell([c for c in cars if c.rig == rig], rng) for rig in rigs}


def relief_cell(
    cars: Sequence[ReliefCar],
    views: tuple[View, ...],
    between_m: tuple[float, float],
    rng: np.random.Generator,
) -> ReliefCell:
    """The figures of some cars; intervals resample their images, since cars of one share its light."""
    images = sorted({c.image_id for c in cars})
    ratio = np.array([[c.ratio.get(name, np.nan) for name in SURFACES] for c in cars])
    ratio = ratio.reshape(-1, len(SURFACES))
    rows = [np.array([i for i, c in enumerate(cars) if c.image_id == image]) for image in images]
    drawn = [
        np.concatenate([rows[k] for k in rng.integers(len(rows), size=len(rows))])
        for _ in range(N_RESAMPLES if len(rows) >= FEWEST_IMAGES else 0)
    ]
    both = [ratio, *(ratio[r] for r in drawn)]
    middles = np.array([_medians(r) for r in both])
    of_fitted = np.array([_medians(r[np.isfinite(r[:, list(SURFACES).index("framed")])]) for r in both])
    return ReliefCell(
        views=views,
        from_m=between_m[0],
        to_m=between_m[1],
        n_cars=len(cars),
        n_fitted=sum("framed" in c.ratio for c in cars),
        n_images=len(images),
        median={name: _interval(middles[:, k]) for k, name in enumerate(SURFACES)},
        share_of_true=_share(of_fitted, "framed", "true"),
        share_of_relief=_share(of_fitted, "framed_tilted", "true_tilted"),
        above_plane={name: _above(ratio[:, k]) for k, name in enumerate(SURFACES)},
    )


def _medians(ratio: FloatArray) -> FloatArray:
    """Medians (surfaces,) over the cars that have each; NaN where none has."""
    columns = [column[np.isfinite(column)] for column in ratio.T]
    return np.array([np.median(column) if len(column) else np.nan for column in columns])


def _above(ratio: FloatArray) -> float:
    known = ratio[np.isfinite(ratio)]
    return float((known > 0).mean()) if len(known) else float("nan")


def _share(middles: FloatArray, above: str, below: str) -> Middle:
    """One median over another where that is above 0; a resample in which it is not may hide any share."""
    over, under = (middles[:, list(SURFACES).index(name)] for name in (above, below))
    return _interval(np.divide(over, under, out=np.full(len(middles), np.nan), where=under > 0))


def _interval(figure: FloatArray) -> Middle:
    """A figure (1 + r,) with its interval: its value on the cars as they are, then on r resamples.

    An undefined resample counts as the least at the lower end and as the largest at the upper one.
    """
    value, drawn = float(figure[0]), figure[1:]
    if not np.isfinite(value) or not len(drawn):
        return Middle(value=value, low=np.nan, high=np.nan)
    low, high = (
        float(np.quantile(np.where(np.isnan(drawn), hidden, drawn), share, method="inverted_cdf"))
        for hidden, share in ((-np.inf, (1 - CONFIDENCE) / 2), (np.inf, (1 + CONFIDENCE) / 2))
    )
    return Middle(value=value, low=low, high=high)


def write_relief(path: Path, result: ReliefResult) -> None:
    """Write relief.json."""
    write_json(path, result.as_json())


def read_relief(path: Path) -> ReliefResult:
    """The study in a file.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(ReliefResult), "a study of relief")
