"""The match table: which candidate found which car. Decided here alone; every figure comes from it."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, FloatArray, IntArray
from recon.boxes import paired_overlap
from rescore.data.frames import DataSet


class Outcome(StrEnum):
    """What became of a candidate."""

    HIT = "hit"
    """The best-ranked candidate on a car that no better-ranked one had taken."""
    FALSE_ALARM = "false_alarm"
    """The candidate lies on no car."""
    DUPLICATE = "duplicate"
    """The candidate lies on a car that a better-ranked one has taken: counts as a false alarm."""
    IGNORED = "ignored"
    """The candidate lies on an ignore region: counts neither for nor against."""


OUTCOMES = tuple(Outcome)
"""Outcome of each code in ``MatchTable.outcome``."""
HIT, FALSE_ALARM, DUPLICATE, IGNORED = range(4)
MIN_IOU = 0.5
"""Overlap from which a candidate has found a car, where nothing else is asked for."""
AT_A_TIME = 2**16
"""Candidates whose pairs with all cars of their images are held at once."""


@dataclass(frozen=True, eq=False)
class TruthTable:
    """All annotated cars of a set of images, in one table."""

    image_id: IntArray
    """Every image of the set, with or without cars, shape (n_images,)."""
    car_image: IntArray
    """Index into ``image_id`` of each car, shape (m,)."""
    annotation_id: IntArray
    """Shape (m,)."""
    xyxy_px: FloatArray
    """Shape (m, 4)."""
    ignore: BoolArray
    """Shape (m,)."""

    @staticmethod
    def of(data: DataSet) -> "TruthTable":
        """The cars of every frame of a data set."""
        ids = np.array([f.image_id for f in data.frames], dtype=np.int64)
        truths = [data.truth[int(i)] for i in ids]
        counts = [len(t.annotation_id) for t in truths]
        return TruthTable(
            ids,
            np.repeat(np.arange(len(ids)), counts),
            np.concatenate([np.zeros(0, np.int64), *(t.annotation_id for t in truths)]),
            np.concatenate([np.zeros((0, 4)), *(t.xyxy_px for t in truths)]),
            np.concatenate([np.zeros(0, bool), *(t.ignore for t in truths)]),
        )

    def take(self, images: IntArray) -> "TruthTable":
        """The cars of some images, by their places in ``image_id``, in that order; cars lie by image."""
        cars, count = self._cars_of(images)
        return TruthTable(
            self.image_id[images],
            np.repeat(np.arange(len(images)), count),
            self.annotation_id[cars],
            self.xyxy_px[cars],
            self.ignore[cars],
        )

    def rows_of(self, images: IntArray) -> IntArray:
        """The rows of the cars of some images, as ``take`` takes them."""
        return self._cars_of(images)[0]

    def _cars_of(self, images: IntArray) -> tuple[IntArray, IntArray]:
        """The rows of the cars of images, and their number in each."""
        first = np.searchsorted(self.car_image, images, side="left")
        count = np.searchsorted(self.car_image, images, side="right") - first
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        return np.repeat(first, count) + within, count

    @property
    def n_images(self) -> int:
        """Number of all images, with and without a car: the denominator of false positives per image."""
        return len(self.image_id)

    @property
    def n_cars(self) -> int:
        """Cars that are not to be ignored: the denominator of the true-positive rate."""
        return int((~self.ignore).sum())

    @property
    def cars_of_image(self) -> IntArray:
        """Cars of each image that are not to be ignored, shape (n_images,)."""
        return np.bincount(self.car_image[~self.ignore], minlength=self.n_images)


@dataclass(frozen=True, eq=False)
class MatchTable:
    """One row a candidate, in the order given."""

    n_images: int
    n_cars: int
    image: IntArray
    """Image of each candidate, counted from 0 to ``n_images`` - 1 in the order of the truth, shape (n,)."""
    ranking: FloatArray
    """What the candidates were ranked by, larger is better, shape (n,)."""
    outcome: NDArray[np.int8]
    """Index into ``OUTCOMES``, shape (n,)."""
    annotation_id: IntArray
    """The car hit, the taken car of a duplicate, the region of an ignored one; else -1. Shape (n,)."""


def ranking_of(posterior: FloatArray, detector_score: FloatArray) -> FloatArray:
    """A ranking (n,), larger is better: by posterior, then by the detector's raw score where posteriors tie.

    Platt scaling saturates: two scores can both become likelihood 1. The second key keeps the detector's
    order there. Rows that are equal in both get the same value.
    """
    order, fresh = ranked_order(posterior, detector_score)
    ranking = np.zeros(len(order))
    ranking[order] = falling_ranks(fresh)
    return ranking


def falling_ranks(fresh: BoolArray) -> FloatArray:
    """Whole numbers (n,) that fall to 0, by one where a row differs from the one before it, as the first
    does."""
    # exact below 2^53; in place, since rows may be many millions
    ranks = np.cumsum(fresh, dtype=float)
    np.subtract(ranks[-1] if len(ranks) else 0.0, ranks, out=ranks)
    return ranks


def best_first(ranking: FloatArray) -> IntArray | slice:
    """What puts rows (n,) in the order of a ranking, larger first, equal ones as given: an index (n,), or a
    slice of all, which takes no time or memory, where they are in that order."""
    if (ranking[1:] <= ranking[:-1]).all():
        return slice(None)
    return np.argsort(-ranking, kind="stable")


def kept_rows(mask: BoolArray) -> BoolArray | slice:
    """A mask (n,) of rows, or a slice where it keeps all: that copies nothing."""
    return slice(None) if mask.all() else mask


def ranked_order(*keys: FloatArray) -> tuple[IntArray, BoolArray]:
    """The rows (n,), best first, and whether each differs in a key from the one before it, shape (n,).

    The best is the largest by the first key, then by the next where it ties, then as given; NaN comes last.

    Quicker than a sort of rows: the first key and the row share an integer, and integers alone are sorted.
    What the integer has no room for is put right where it matters.
    """
    keys = tuple({id(key): np.asarray(key, float) for key in keys}.values())
    n = len(keys[0])
    low = n.bit_length()
    # floats in the order of integers; the difference has no negative zero
    packed = (0.0 - keys[0]).view(np.int64)
    np.bitwise_xor(packed, np.iinfo(np.int64).max, out=packed, where=packed < 0)
    packed[np.isnan(keys[0])] = np.iinfo(np.int64).max
    # in place, since rows may be many millions
    packed >>= low
    packed <<= low
    packed |= np.arange(n)
    packed.sort()
    begins = packed[1:] ^ packed[:-1] >= 1 << low
    order = np.bitwise_and(packed, (1 << low) - 1, out=packed)
    fresh = _differs(keys, order)
    if (fresh & ~begins).any():
        run = np.append(0, np.cumsum(begins))
        mixed = np.zeros(run[-1] + 1, np.bool_)
        mixed[run[1:][fresh & ~begins]] = True
        at = np.flatnonzero(mixed[run])
        own = order[at]
        order[at] = own[np.lexsort((own, *(-key[own] for key in reversed(keys)), run[at]))]
        fresh = _differs(keys, order)
    return order, np.append(True, fresh)[:n]


def _differs(keys: tuple[FloatArray, ...], order: IntArray) -> BoolArray:
    """Whether each row in an order (n,) differs in a key from the one before it, shape (n - 1,)."""
    found = np.zeros(max(len(order) - 1, 0), np.bool_)
    for key in keys:
        value = key[order]
        found |= (value[1:] != value[:-1]) & ~(np.isnan(value[1:]) & np.isnan(value[:-1]))
    return found


def greedy_match(
    image_id: IntArray, xyxy_px: FloatArray, ranking: FloatArray, truth: TruthTable, min_iou: float = MIN_IOU
) -> MatchTable:
    """The match table of candidates (n,) against the cars of the same images.

    In each image, best ranking first (equal ones in the order given): a candidate takes the free car that it
    overlaps most, if by at least ``min_iou``. If there is none, it is ignored where at least half of its own
    area lies in an ignore region (as COCO does for crowds; a region can take any number), a duplicate where
    it overlaps a taken car by ``min_iou``, else a false alarm.

    Raises:
        ValueError: a candidate of an image that ``truth`` does not hold.
    """
    return Overlaps.of(image_id, xyxy_px, truth, min_iou).matched(ranking)


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Candidates (n,) and the cars that they lie on, for rankings of any number; see ``greedy_match``."""

    truth: TruthTable
    image: IntArray
    """Image of each candidate, as ``TruthTable.car_image`` counts them, shape (n,)."""
    unranked: NDArray[np.int8]
    """Outcome of each candidate where it takes no car, shape (n,)."""
    annotation_id: IntArray
    """The car or region of that outcome, else -1, shape (n,)."""
    candidate: IntArray
    """Candidate of each pair with a car that it lies on, shape (p,)."""
    car: IntArray
    """Car of each pair, shape (p,)."""
    overlap: FloatArray
    """IoU of each pair, shape (p,)."""

    @staticmethod
    def of(image_id: IntArray, xyxy_px: FloatArray, truth: TruthTable, min_iou: float) -> "Overlaps":
        """The overlaps of candidates with the cars of the same images.

        Raises:
            ValueError: a candidate of an image that ``truth`` does not hold.
        """
        order_of_ids = np.argsort(truth.image_id, kind="stable")
        place = np.searchsorted(truth.image_id, image_id, sorter=order_of_ids)
        image = order_of_ids[np.minimum(place, max(truth.n_images - 1, 0))] if truth.n_images else place
        if len(image_id) and (not truth.n_images or (truth.image_id[image] != image_id).any()):
            raise ValueError("a candidate's image is not among the images of the truth")

        candidate, car, overlap, of_own_area = _pairs(image, xyxy_px, truth, min_iou)
        outcome = np.full(len(image), FALSE_ALARM, np.int8)
        annotation = np.full(len(image), -1, np.int64)

        on_region, on_car = truth.ignore[car], ~truth.ignore[car]
        best_car = _best_pair(candidate[on_car], car[on_car], overlap[on_car], len(image))
        outcome[best_car >= 0] = DUPLICATE
        annotation[best_car >= 0] = truth.annotation_id[best_car[best_car >= 0]]
        region = _best_pair(candidate[on_region], car[on_region], of_own_area[on_region], len(image))
        outcome[region >= 0] = IGNORED
        annotation[region >= 0] = truth.annotation_id[region[region >= 0]]
        return Overlaps(truth, image, outcome, annotation, candidate[on_car], car[on_car], overlap[on_car])

    def matched(self, ranking: FloatArray) -> MatchTable:
        """The match table of the candidates in the order of a ranking (n,), larger is better."""
        outcome, annotation = self.decided(ranking)
        images, cars = self.truth.n_images, self.truth.n_cars
        return MatchTable(images, cars, self.image, np.asarray(ranking, float), outcome, annotation)

    def decided(self, *keys: FloatArray) -> tuple[NDArray[np.int8], IntArray]:
        """Outcome and car of each candidate as match tables have them, each of shape (n,).

        Args:
            keys: what they are ranked by, (n,) each, larger is better: the first, then the next where it
                ties.
        """
        outcome, annotation = self.unranked.copy(), self.annotation_id.copy()
        taken = take_cars(
            self.image,
            *keys,
            candidate=self.candidate,
            car=self.car,
            overlap=self.overlap,
            n_cars=len(self.truth.ignore),
        )
        hit = np.flatnonzero(taken >= 0)
        outcome[hit] = HIT
        annotation[hit] = self.truth.annotation_id[taken[hit]]
        return outcome, annotation


def take_cars(
    image: IntArray,
    *keys: FloatArray,
    candidate: IntArray,
    car: IntArray,
    overlap: FloatArray,
    n_cars: int,
) -> IntArray:
    """The car each candidate takes, -1 where none; a round for each place in the ranking by some keys, images
    together."""
    taken_by = np.full(len(image), -1, np.int64)
    # where a candidate and a car have only each other, nobody is in the way
    alone = (np.bincount(candidate, minlength=len(image))[candidate] == 1) & (np.bincount(car)[car] == 1)
    taken_by[candidate[alone]] = car[alone]
    candidate, car, overlap = candidate[~alone], car[~alone], overlap[~alone]
    rows, own = np.unique(candidate, return_inverse=True)
    place = places_in_image(image[rows], *(np.asarray(key)[rows] for key in keys))[own]
    free = np.ones(n_cars, bool)
    for p in range(int(place.max(initial=-1)) + 1):
        now = np.flatnonzero(place == p)
        now = now[free[car[now]]]
        best = _best_pair(own[now], car[now], overlap[now], len(rows))
        winners = np.flatnonzero(best >= 0)
        taken_by[rows[winners]] = best[winners]
        free[best[winners]] = False
    return taken_by


def places_in_image(image: IntArray, *keys: FloatArray) -> IntArray:
    """Place of each candidate (n,) in its image by some keys, larger is better, 0 is best; equal ones in the
    order given."""
    order = np.lexsort((*(-np.asarray(key) for key in reversed(keys)), image))
    first = np.searchsorted(image[order], image[order], side="left")
    place = np.empty(len(image), np.int64)
    place[order] = np.arange(len(image)) - first
    return place


def _best_pair(candidate: IntArray, car: IntArray, overlap: FloatArray, n: int) -> IntArray:
    """The car with the largest overlap of each candidate (n,), -1 where it has no pair."""
    best = np.full(n, -1, np.int64)
    order = np.argsort(overlap, kind="stable")
    # ascending, so that the last write, which stays, is the best one (of equal ones the later car, as in
    # COCO's tool)
    best[candidate[order]] = car[order]
    return best


def _pairs(
    image: IntArray, xyxy_px: FloatArray, truth: TruthTable, min_iou: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Every (candidate, car) of one image that lie on each other: indices, IoU, share of the candidate's area
    in the car's box. On an ignore region lies what it holds half of, on a car what overlaps it by
    ``min_iou``."""
    parts = []
    for first in range(0, max(len(image), 1), AT_A_TIME):
        candidate, car = pairs_of_image(image[first : first + AT_A_TIME], truth.car_image)
        candidate += first
        overlap, share = paired_overlap(xyxy_px[candidate], truth.xyxy_px[car])
        on = np.flatnonzero(np.where(truth.ignore[car], share >= 0.5, overlap >= min_iou))
        parts.append((candidate[on], car[on], overlap[on], share[on]))
    candidate, car, overlap, share = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return candidate, car, overlap, share


def pairs_of_image(image: IntArray, car_image: IntArray) -> tuple[IntArray, IntArray]:
    """Every (candidate, car) that are of one image, as two arrays of indices (p,).

    Args:
        image: image of each candidate, shape (n,).
        car_image: image of each car, shape (m,).
    """
    order = np.argsort(car_image, kind="stable")
    sorted_image = car_image[order]
    first = np.searchsorted(sorted_image, image, side="left")
    count = np.searchsorted(sorted_image, image, side="right") - first
    candidate = np.repeat(np.arange(len(image)), count)
    within = np.arange(len(candidate)) - np.repeat(np.cumsum(count) - count, count)
    return candidate, order[np.repeat(first, count) + within]
