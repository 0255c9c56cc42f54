"""Several runs side by side: what changes from one to another, paired over the frames that both evaluated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from recon.arrays import IntArray
from recon.errors import RescoreError
from reports.palette import detector_name, mode_name
from reports.run.curves import match_table
from reports.run.frame_view import run_data
from reports.run.reductions import reduction_cell
from reports.run.tables import Table, difference, number
from rescore.data.content import content_digest
from rescore.data.frames import DataSet
from rescore.metrics.bootstrap import BootstrapConfig, FigureIntervals, bootstrap
from rescore.metrics.curve_bands import CurveBands, curve_bands
from rescore.metrics.matching import MatchTable, TruthTable
from rescore.results.comparisons import estimate, reductions
from rescore.results.metrics_file import Reduction
from rescore.results.run_folder import Run

MIN_SHARED = 2
"""Smallest number of shared frames that gives an interval."""
LEVEL = 0.7
"""Recall at which false positives are compared."""


Scores = tuple[str, str]
"""A detector and a mode."""


@dataclass(frozen=True, eq=False)
class _Change:
    """What changes from the scores of one run to those of another."""

    before: Scores
    after: Scores
    difference: FigureIntervals
    reduction: Reduction


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A run with the truth that it was evaluated on."""

    name: str
    """Name of the run for people, unique on a page."""
    run: Run

    @cached_property
    def data(self) -> DataSet:
        """The frames that were evaluated.

        Raises:
            RescoreError: the data set is not where the run says.
        """
        return run_data(self.run)

    @cached_property
    def truth(self) -> TruthTable:
        """Images and cars in the order of the data set; raises as ``data`` does."""
        return TruthTable.of(self.data)

    @cached_property
    def frame_keys(self) -> tuple[str, ...]:
        """What makes a frame the same in two runs, by frame in the order of the truth: left pixels and cars.

        Raises:
            RescoreError: a picture is missing or damaged, or as ``data`` does.
        """
        truths = ((f, self.data.truth[f.image_id]) for f in self.data.frames)
        return tuple(
            f"{content_digest(f.left_path)} {t.xyxy_px.round(3).tolist()} {t.ignore.tolist()}"
            for f, t in truths
        )

    def match(self, detector: str, mode: str) -> MatchTable:
        """The match table, its images counted in the order of the truth."""
        ids = self.run.of(detector)["image_id"]
        order = np.argsort(self.truth.image_id)
        place = np.searchsorted(self.truth.image_id, ids, sorter=order)
        return replace(match_table(self.run, detector, mode), image=order[place])

    def bands(self) -> dict[tuple[str, str], CurveBands | None]:
        """Bands around all curves, by detector and mode.

        Raises:
            RescoreError: the data set is not where the run says.
        """
        cars = self.truth.cars_of_image
        rows = [(row.detector, row.mode) for row in self.run.metrics.rows]
        return {key: curve_bands(self.match(*key), cars, self.run.metrics.seed) for key in rows}


@dataclass(frozen=True, eq=False)
class PairedRuns:
    """What changes from the first run to another."""

    first: str
    other: str
    note: str
    """Note on the frames on which the runs were compared, or why they were not."""
    table: Table | None


def compare_runs(runs: Sequence[Evaluated]) -> tuple[PairedRuns, ...]:
    """Each later run against the first."""
    return tuple(_compare(runs[0], other) for other in runs[1:])


def side_by_side(runs: Sequence[Evaluated]) -> Table:
    """The figures of all runs, a row a run, detector and mode."""
    rows = tuple(
        (
            one.name,
            detector_name(row.detector),
            mode_name(row.mode),
            number(row.w, 2),
            number(row.auc),
            number(row.average_precision),
            number(row.fppi_at_recall.get(f"{LEVEL:g}"), 2),
            number(row.recall_ceiling),
        )
        for detector in dict.fromkeys(d for one in runs for d in one.run.detectors)
        for one in runs
        for row in one.run.metrics.rows
        if row.detector == detector
    )
    head = (
        "run",
        "detector",
        "scores",
        "w",
        "area (ROC)",
        "average precision",
        "FP/image at 70%",
        "recall ceiling",
    )
    return Table("All runs", head, rows, text_columns=3)


def _compare(first: Evaluated, other: Evaluated) -> PairedRuns:
    try:
        pairs = shared_frames(first.frame_keys, other.frame_keys)
    except RescoreError as error:
        return PairedRuns(first.name, other.name, f"Not compared: a data set cannot be read ({error}).", None)
    counts = f"{first.name} has {len(first.frame_keys)} images, {other.name} {len(other.frame_keys)}"
    if len(pairs) < MIN_SHARED:
        shared = "no image" if not len(pairs) else "one image"
        note = (
            f"{counts}; they share {shared} (same picture, same annotated cars). So nothing can be paired: "
            "the figures above differ by chance of the images too, and their intervals are each run's own."
        )
        return PairedRuns(first.name, other.name, note, None)
    compared = scores_to_compare(first.run, other.run)
    if not compared:
        note = "The runs share no detector of one name, so nothing can be paired."
        return PairedRuns(first.name, other.name, note, None)
    changes = _paired_changes(first, other, compared, pairs)
    all_images = len(pairs) == len(first.frame_keys) == len(other.frame_keys)
    which = f"all {len(pairs)} images" if all_images else f"the {len(pairs)} images that both have; {counts}"
    note = f"{other.name} less {first.name}, on {which}."
    return PairedRuns(first.name, other.name, note, _table(first.name, other.name, changes))


def scores_to_compare(first: Run, other: Run) -> list[tuple[Scores, Scores]]:
    """Detectors and modes that a person would compare, those of the first run before those of the other.

    The detectors alone, each mode that both runs have, and the last modes of both where they differ. One
    detector a run is paired with the other whatever their names.
    """
    names = [(d, d) for d in first.detectors if d in other.detectors]
    if not names and len(first.detectors) == len(other.detectors) == 1:
        names = [(first.detectors[0], other.detectors[0])]
    found = []
    for ours, theirs in names:
        modes, their_modes = _modes(first, ours), _modes(other, theirs)
        pairs = [(mode, mode) for mode in modes if mode in their_modes]
        last = (modes[-1], their_modes[-1])
        pairs += [last] if last not in pairs else []
        found += [((ours, a), (theirs, b)) for a, b in pairs]
    return found


def _modes(run: Run, detector: str) -> list[str]:
    return [row.mode for row in run.metrics.rows if row.detector == detector]


def shared_frames(first: Sequence[str], other: Sequence[str]) -> IntArray:
    """Places in both lists of the frames that both hold, shape (k, 2), in the order of the first."""
    place = {key: i for i, key in enumerate(other)}
    # a frame that is there twice is taken once
    pairs = [(i, place.pop(key)) for i, key in enumerate(first) if key in place]
    return np.array(pairs, np.int64).reshape(-1, 2)


def restricted(match: MatchTable, images: IntArray, n_cars: int) -> MatchTable:
    """The table of some images, counted from 0 in the order given.

    Args:
        match: the whole table.
        images: places of the images to keep, none twice.
        n_cars: annotated cars in these images.
    """
    new = np.full(match.n_images, -1, np.int64)
    new[images] = np.arange(len(images))
    keep = new[match.image] >= 0
    columns = {name: getattr(match, name)[keep] for name in ("ranking", "outcome", "annotation_id")}
    return replace(match, n_images=len(images), n_cars=n_cars, image=new[match.image[keep]], **columns)


def _paired_changes(
    first: Evaluated, other: Evaluated, compared: Sequence[tuple[Scores, Scores]], pairs: IntArray
) -> list[_Change]:
    cars = first.truth.cars_of_image[pairs[:, 0]]
    n_cars = int(cars.sum())
    tables, names = {}, []
    for i, both in enumerate(compared):
        for one, scores, column in ((first, both[0], 0), (other, both[1], 1)):
            tables[f"{i} {column}"] = restricted(one.match(*scores), pairs[:, column], n_cars)
        names.append((f"{i} 0", f"{i} 1"))
    found = bootstrap(tables, cars, names, np.random.default_rng(0), BootstrapConfig())
    return [
        _Change(*both, found.comparisons[name].difference, reductions(found, *name)[f"{LEVEL:g}"])
        for both, name in zip(compared, names, strict=True)
    ]


def _table(first: str, other: str, changes: Sequence[_Change]) -> Table:
    rows = tuple(
        (
            " → ".join(dict.fromkeys(detector_name(d) for d in (c.before[0], c.after[0]))),
            mode_name(c.before[1]),
            mode_name(c.after[1]),
            reduction_cell(c.reduction),
            difference(estimate(c.difference.auc)),
            difference(estimate(c.difference.average_precision)),
        )
        for c in changes
    )
    head = ("detector", first, other, f"times fewer FP at {LEVEL:.0%}", "area", "average precision")
    return Table("Paired differences", head, rows, text_columns=3)
