"""The candidates of one detector before and after rescoring, each with the reason for its change."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, IntArray
from recon.errors import RescoreError
from rescore.evidence.cues import CUES
from rescore.evidence.model import EvidenceModel
from rescore.metrics.matching import places_in_image
from rescore.results.candidate_file import (
    ALONE,
    Columns,
    difference,
    match_table,
    of_mode,
    score_column,
    status,
)
from rescore.results.changes import CHANGED, GAINS, LOSSES, Changes, Group, OperatingPoint
from rescore.results.explain import ExplainConfig, Explanation, explain


class Only(StrEnum):
    """The choice of candidates that are listed."""

    CHANGED = "changed"
    ALL = "all"
    NEWLY_REJECTED_FALSE_ALARMS = "newly-rejected-false-alarms"
    NEWLY_ACCEPTED_FALSE_ALARMS = "newly-accepted-false-alarms"
    LOST_CARS = "lost-cars"
    GAINED_CARS = "gained-cars"
    FLIPS = "flips"

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups listed."""
        return {
            Only.CHANGED: CHANGED,
            Only.ALL: tuple(Group),
            Only.NEWLY_REJECTED_FALSE_ALARMS: (Group.REJECTED_FALSE_ALARM,),
            Only.NEWLY_ACCEPTED_FALSE_ALARMS: (Group.ACCEPTED_FALSE_ALARM,),
            Only.LOST_CARS: LOSSES,
            Only.GAINED_CARS: GAINS,
            Only.FLIPS: (Group.MOVED_HIT,),
        }[self]


class Sort(StrEnum):
    """What comes first."""

    DELTA = "delta"
    """The candidates that moved over most places first, up or down."""
    LOSS = "loss"
    """The candidates that moved over most places the wrong way first."""
    DEPTH_DIFFERENCE = "depth_difference"
    """The candidates with the largest D first; those without D come last."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """One detector in one mode against the detector alone; rows as in its part of candidates.parquet."""

    detector: str
    mode: str
    rows: Columns
    """The detector's rows of candidates.parquet."""
    changes: Changes
    explanations: tuple[Explanation, ...]

    @classmethod
    def of(
        cls,
        rows: Columns,
        mode: str,
        n_images: int,
        n_cars: int,
        point: OperatingPoint | None = None,
        model: EvidenceModel | None = None,
        config: ExplainConfig | None = None,
    ) -> Self:
        """The changes of one detector in one mode, explained.

        Args:
            rows: its rows of candidates.parquet.
            mode: a way of rescoring that the rows have.
            n_images: images of the test set.
            n_cars: annotated cars of the test set.
            point: the points of the two curves; None for ``rescore.results.changes.default_point``.
            model: what D was made with; None where it is not known.
            config: settings of the run.

        Raises:
            RescoreError: the rows lack the mode, a curve never reaches the point, or the model is another.
        """
        before, after = (match_table(rows, m, n_images, n_cars) for m in (ALONE, mode))
        changes = Changes.between(before, after, point)
        detector = str(rows["detector"][0]) if len(rows["detector"]) else ""
        return cls(
            detector, mode, rows, changes, explain(rows, mode, changes.rose, model, config, changes.stayed)
        )

    def listed(
        self, only: Only = Only.CHANGED, sort: Sort = Sort.DELTA, image_id: int | None = None
    ) -> IntArray:
        """Indices of the rows of the groups of ``only`` (and of one image), in the order of ``sort``.

        Raises:
            RescoreError: no candidate is of this image.
        """
        # where no car is annotated no candidate counts otherwise than before: all may be of interest
        unjudged = only is Only.CHANGED and not self.changes.after.match.n_cars
        keep = np.isin(self.changes.group, (Only.ALL if unjudged else only).groups)
        if image_id is not None:
            keep &= self._in_image(image_id)
        key = {
            Sort.DELTA: np.abs(self.changes.delta).astype(float),
            Sort.LOSS: self.changes.loss.astype(float),
            Sort.DEPTH_DIFFERENCE: difference(self.rows, self.mode),
        }[sort]
        order = np.argsort(-np.where(np.isnan(key), -np.inf, key), kind="stable")
        return np.asarray(order[keep[order]])

    def _in_image(self, image_id: int) -> BoolArray:
        found = np.asarray(self.rows["image_id"] == image_id)
        if not found.any():
            ids = np.unique(self.rows["image_id"])
            between = f", of {ids[0]} to {ids[-1]}" if len(ids) else ""
            raise RescoreError(
                f"--frame: expected the id of an image with candidates of {self.detector}{between}, got "
                f"{image_id}; the column 'frame' of the table has them"
            )
        return found

    def columns(self) -> dict[str, NDArray[Any]]:
        """Everything of every candidate as columns, for files."""
        rows, c = self.rows, self.changes
        n = len(c.group)
        return {
            "detector": np.full(n, self.detector, object),
            "mode": np.full(n, self.mode, object),
            "image_id": rows["image_id"],
            "rank": rows["rank"],
            "rank_after": places_in_image(c.after.match.image, c.after.match.ranking),
            "place_before": c.place_before,
            "place_after": c.place_after,
            "delta": c.delta,
            "loss": c.loss,
            "detector_score": rows["detector_score"],
            "score_before": rows[score_column(ALONE)],
            "score_after": rows[score_column(self.mode)],
            "depth_difference": difference(rows, self.mode),
            "status": status(rows, self.mode),
            "accepted_before": c.before.accepted,
            "accepted_after": c.after.accepted,
            "outcome_before": of_mode(rows, "outcome", ALONE),
            "outcome_after": of_mode(rows, "outcome", self.mode),
            "annotation_id_before": of_mode(rows, "annotation_id", ALONE),
            "annotation_id_after": of_mode(rows, "annotation_id", self.mode),
            "group": np.array([str(g) for g in c.group], object),
            "kind": rows.get("kind", np.full(n, "", object)),
            **{name: rows[name] for name in ("x0", "y0", "x1", "y1")},
            **self._log_odds(),
            "reason": np.array([e.text for e in self.explanations], object),
        }

    def _log_odds(self) -> Mapping[str, NDArray[Any]]:
        """What each cue adds, as columns ``log_odds_<cue>``; none where the model is not known."""
        said = [{p.cue: p.log_odds for p in e.parts} for e in self.explanations]
        names = [cue for cue in CUES if any(cue in s for s in said)]
        return {f"log_odds_{cue}": np.array([s.get(cue, 0.0) for s in said]) for cue in names}
