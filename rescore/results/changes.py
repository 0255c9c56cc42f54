"""What a rescoring changed, candidate by candidate, between a point of the curve before and one after.

Both points are thresholds of ``rescore.metrics.curves.recall_curve``. A car is found where an accepted
candidate has it as its hit; false positives are accepted false alarms and second
boxes (duplicates). So the changes add up:

- cars found after = before + gained - lost;
- false positives after = before + newly accepted - newly rejected + hits that became second boxes - second
  boxes that became hits (``ChangeCounts``).

A car that another box finds after is neither gained nor lost: both boxes are in the group ``MOVED_HIT``.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, IntArray
from recon.errors import RescoreError
from rescore.metrics.curves import index_at_fppi, index_at_recall, recall_ceiling, recall_curve
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, IGNORED, MatchTable
from rescore.results.candidate_file import places

DEFAULT_RECALL = 0.7
DEFAULT_FALSE_POSITIVES = 1.0
"""False positives an image of the default operating point where no car is annotated."""


class Group(StrEnum):
    """What became of a candidate; every candidate is in one group."""

    LOST_CAR = "lost_car"
    """The candidate had found a car that no accepted box finds now."""
    GAINED_CAR = "gained_car"
    """The candidate finds a car that no accepted box found before."""
    SWAPPED_CAR = "swapped_car"
    """The box overlaps two cars: one is lost and the other found."""
    REJECTED_FALSE_ALARM = "newly_rejected_false_alarm"
    """The candidate was a false positive before and is below the threshold now."""
    ACCEPTED_FALSE_ALARM = "newly_accepted_false_alarm"
    """The candidate was below the threshold before and is a false positive now."""
    MOVED_HIT = "flip"
    """The candidate's car is found before and after, but by another box in one of the two."""
    KEPT_CAR = "kept_car"
    """The candidate finds its car before and after."""
    KEPT_FALSE_ALARM = "kept_false_alarm"
    """The candidate is a false positive before and after."""
    REJECTED = "rejected"
    """The candidate is below the threshold before and after."""
    IGNORED = "ignored"
    """The candidate lies on an ignore region and is counted nowhere."""


GAINS = (Group.GAINED_CAR, Group.SWAPPED_CAR)
"""Groups whose candidates each gain one car."""
LOSSES = (Group.LOST_CAR, Group.SWAPPED_CAR)
"""Groups whose candidates each lose one car."""
CHANGED = (
    *(Group.LOST_CAR, Group.GAINED_CAR, Group.SWAPPED_CAR),
    *(Group.REJECTED_FALSE_ALARM, Group.ACCEPTED_FALSE_ALARM, Group.MOVED_HIT),
)
"""Groups whose candidates count otherwise than before."""


@dataclass(frozen=True)
class OperatingPoint:
    """The point of each curve that is compared, given by exactly one of its two fields."""

    recall: float | None = None
    """Share of all cars found; the point is the first one of the curve that reaches it."""
    false_positives: float | None = None
    """False positives an image; the point is the last one of the curve with at most this many."""

    def __post_init__(self) -> None:
        if (self.recall is None) == (self.false_positives is None):
            raise ValueError(f"expected a recall or false positives, got {self}")
        if self.recall is not None and not 0 < self.recall <= 1:
            raise RescoreError(f"recall: expected a share above 0 and up to 1, got {self.recall:g}")
        if self.false_positives is not None and not 0 <= self.false_positives < np.inf:
            raise RescoreError(
                f"false positives an image: expected 0 or more, got {self.false_positives:g}; give a number"
            )

    @property
    def text(self) -> str:
        """The operating point in words, for people."""
        if self.recall is not None:
            return f"{100 * self.recall:.4g} % of all cars"
        return f"{self.false_positives:g} false positives an image"

    def threshold(self, match: MatchTable) -> float:
        """Ranking of the worst candidate accepted; infinity where none is.

        Minus infinity where no car is annotated and every candidate is ignored.

        Raises:
            RescoreError: the recall is never reached.
        """
        if not match.n_cars and (match.outcome == IGNORED).all():
            return -np.inf
        curve = recall_curve(match)
        if self.recall is None:
            assert self.false_positives is not None
            return float(curve.threshold[index_at_fppi(curve, self.false_positives)])
        at = index_at_recall(curve, self.recall)
        if at is None:
            raise RescoreError(
                f"recall: expected at most {recall_ceiling(curve):.3f}, which all candidates together reach, "
                f"got {self.recall:g}; choose less, or a number of false positives an image"
            )
        return float(curve.threshold[at])


def default_point(*tables: MatchTable) -> OperatingPoint:
    """70 % of all cars; where a table never reaches that, the next tenth below that all reach.

    Where no car is found by all, 1 false positive an image.
    """
    ceilings = [recall_ceiling(recall_curve(t)) if t.n_cars else 0.0 for t in tables]
    # a ceiling is a quotient of integers: allow for its rounding
    tenths = np.floor(10 * min(DEFAULT_RECALL, *ceilings) + 1e-9)
    if tenths < 1:
        return OperatingPoint(false_positives=DEFAULT_FALSE_POSITIVES)
    return OperatingPoint(recall=float(tenths) / 10)


@dataclass(frozen=True, eq=False)
class Side:
    """One ranking with its threshold."""

    match: MatchTable
    threshold: float
    """Ranking of the worst candidate accepted; infinity where none is."""
    car: IntArray
    """Number of the car of each candidate, shape (n,): one for each image and annotation id, the same before
    and after."""

    @property
    def accepted(self) -> BoolArray:
        """Shape (n,)."""
        return np.asarray(self.match.ranking >= self.threshold)

    @property
    def found(self) -> BoolArray:
        """Accepted candidates that find a car, shape (n,): the true positives."""
        return np.asarray(self.accepted & (self.match.outcome == HIT))

    @property
    def false(self) -> BoolArray:
        """Accepted false alarms and second boxes, shape (n,): the false positives."""
        return np.asarray(self.accepted & np.isin(self.match.outcome, (FALSE_ALARM, DUPLICATE)))


@dataclass(frozen=True)
class ChangeCounts:
    """Counts of the changes; they add up to the two points of the curves."""

    cars_before: int
    cars_after: int
    gained: int
    lost: int
    moved: int
    """Cars found before and after, by another box."""
    false_before: int
    false_after: int
    newly_accepted: int
    newly_rejected: int
    became_false: int
    """Candidates accepted before and after that became false positives: hits whose car another box took."""
    became_hit: int
    """Candidates accepted before and after that were false positives and are none now."""


@dataclass(frozen=True, eq=False)
class Changes:
    """The candidates of one detector before and after, row by row as in the table of candidates."""

    point: OperatingPoint
    before: Side
    after: Side
    group: NDArray[np.object_]
    """``Group`` of each candidate, shape (n,)."""

    @classmethod
    def between(cls, before: MatchTable, after: MatchTable, point: OperatingPoint | None = None) -> Self:
        """The changes between two rankings of the same candidates.

        Args:
            before: match table of the detector alone (or of another mode).
            after: match table after rescoring, of the same candidates in the same order.
            point: which points of the two curves; None for ``default_point``.

        Raises:
            RescoreError: a curve never reaches the recall of ``point``.
        """
        if len(before.image) != len(after.image) or not np.array_equal(before.image, after.image):
            raise ValueError("two rankings of the same candidates expected")
        point = point or default_point(before, after)
        # annotation ids need be unique in an image only
        pairs = [np.stack([t.image, t.annotation_id], axis=1) for t in (before, after)]
        number = np.unique(np.concatenate(pairs), axis=0, return_inverse=True)[1].reshape(2, -1)
        one = Side(before, point.threshold(before), number[0])
        two = Side(after, point.threshold(after), number[1])
        return cls(point, one, two, _groups(one, two))

    @property
    def place_before(self) -> IntArray:
        """Place of each candidate in the whole test set before rescoring, 1 is best, shape (n,)."""
        return places(self.before.match.ranking)

    @property
    def place_after(self) -> IntArray:
        """Place of each candidate in the whole test set after rescoring, 1 is best, shape (n,)."""
        return places(self.after.match.ranking)

    @property
    def delta(self) -> IntArray:
        """Number of places of the whole test set by which each candidate rose, shape (n,); below 0: it
        fell."""
        return self.place_before - self.place_after

    @property
    def loss(self) -> IntArray:
        """The places by which each candidate moved the wrong way, shape (n,): a car down, another one up.

        Below 0 where it moved the right way; 0 on ignore regions.
        """
        outcomes = np.stack([self.before.match.outcome, self.after.match.outcome])
        hit, ignored = (outcomes == HIT).any(axis=0), (outcomes == IGNORED).any(axis=0)
        return np.where(hit, -self.delta, np.where(ignored, 0, self.delta))

    @property
    def rose(self) -> BoolArray:
        """Candidates that are accepted now and were not, or where that is as before stand higher, (n,)."""
        switched = self.after.accepted != self.before.accepted
        return np.where(switched, self.after.accepted, self.delta > 0)

    @property
    def stayed(self) -> BoolArray:
        """Candidates that keep their place and are accepted or not as before, shape (n,)."""
        return np.asarray((self.after.accepted == self.before.accepted) & (self.delta == 0))

    @property
    def tally(self) -> ChangeCounts:
        """The counts."""
        one, two = self.before, self.after
        both = one.accepted & two.accepted
        found = [dict(zip(s.car[s.found], np.flatnonzero(s.found), strict=True)) for s in (one, two)]
        return ChangeCounts(
            cars_before=int(one.found.sum()),
            cars_after=int(two.found.sum()),
            gained=int(np.isin(self.group, GAINS).sum()),
            lost=int(np.isin(self.group, LOSSES).sum()),
            moved=sum(int(found[0][car] != found[1][car]) for car in found[0].keys() & found[1].keys()),
            false_before=int(one.false.sum()),
            false_after=int(two.false.sum()),
            newly_accepted=int((two.false & ~one.accepted).sum()),
            newly_rejected=int((one.false & ~two.accepted).sum()),
            became_false=int((both & two.false & ~one.false).sum()),
            became_hit=int((both & one.false & ~two.false).sum()),
        )


def _groups(before: Side, after: Side) -> NDArray[np.object_]:
    """The group of each candidate (n,)."""
    lost = before.found & ~np.isin(before.car, after.car[after.found])
    gained = after.found & ~np.isin(after.car, before.car[before.found])
    same = before.found & after.found & (before.car == after.car)
    ignored = [side.match.outcome == IGNORED for side in (before, after)]
    counted = [side.accepted & ~of for side, of in zip((before, after), ignored, strict=True)]
    # the first that holds
    rules: list[tuple[Group, BoolArray]] = [
        (Group.SWAPPED_CAR, lost & gained),
        (Group.LOST_CAR, lost),
        (Group.GAINED_CAR, gained),
        (Group.KEPT_CAR, same),
        (Group.MOVED_HIT, before.found | after.found),
        (Group.REJECTED_FALSE_ALARM, before.false & ~after.accepted),
        (Group.ACCEPTED_FALSE_ALARM, after.false & ~before.accepted),
        (Group.KEPT_FALSE_ALARM, before.false & after.false),
        # accepted or not; what counted on one side only is told by the rules above
        (Group.IGNORED, (ignored[0] | ignored[1]) & ~counted[0] & ~counted[1]),
    ]
    group = np.full(len(before.match.image), Group.REJECTED, dtype=object)
    for name, holds in reversed(rules):
        group[holds] = name
    return group
