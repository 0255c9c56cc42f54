"""Evaluation of 3D boxes: KITTI's average precisions, nuScenes' errors, and the share of correct poses."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import starmap

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, FloatArray, IntArray
from recon.boxes import paired_overlap
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet, Truth
from rescore.formats.coco import DetectionFile
from rescore.formats.labels import UNKNOWN_OCCLUSION
from rescore.memory import give_back
from rescore.metrics.boxes3d import BoxErrors, box_errors, box_overlaps
from rescore.metrics.kitti_precision import (
    N_RECALLS,
    Judged,
    Touching,
    kitti_precision,
    orientation_similarity,
)
from rescore.metrics.matching import HIT, MatchTable, TruthTable, kept_rows, pairs_of_image, take_cars
from rescore.results.metrics_file import (
    BoxErrorFigures,
    Boxes3DRow,
    MeanMedian,
    PoseFigures,
    Precision3D,
    finite,
)

MIN_IOUS = (0.7, 0.5)
"""Overlaps from which a car is found: KITTI's, and the one at which methods without laser are compared."""
MIN_CARS = N_RECALLS + 1
"""Below this KITTI's rule, which reads each recall at a hit of its own, cannot reach 40 recalls, and perfect
boxes would get less than 1: the figures are then undefined."""
SAME_CAR_IOU = 0.5
"""Overlap in the picture from which a detection is on a car whose 3D box is unknown."""
FOUND_WITHIN_M = 2.0
"""Distance along the ground from which nuScenes takes its errors."""
CORRECT_WITHIN_M = 0.75
CORRECT_WITHIN_RAD = math.radians(22.5)
"""Limits of a correct pose (Coenen, Rottensteiner, Heipke 2017)."""
WHOLE_VISIBILITY = 0.8
"""Visible share from which a car counts as whole, where it is known."""
WHOLE_TRUNCATION = 0.15
"""Share outside the picture up to which a car counts as whole; KITTI's easy cars."""
DISTANCES_M = ((0.0, 25.0), (0.0, 10.0), (10.0, 15.0), (15.0, 25.0), (25.0, 40.0))
"""Distances of whole cars that are reported each for itself."""


@dataclass(frozen=True)
class Level:
    """The cars that are to be found at one of KITTI's levels of difficulty; the others are left out."""

    name: str
    min_height_px: float
    """Lower boxes are left out, detections too."""
    max_occlusion: int
    max_truncation: float


LEVELS = (Level("easy", 40, 0, 0.15), Level("moderate", 25, 1, 0.3), Level("hard", 25, 2, 0.5))
EVERY_CAR = Level("all", 0, UNKNOWN_OCCLUSION, math.inf)


@dataclass(frozen=True, eq=False)
class TrueCars:
    """The annotated objects of all images of a test set with what is known of them in 3D, m in all."""

    table: TruthTable
    boxes3d: Boxes3D
    alpha_rad: FloatArray
    """KITTI's observation angle, NaN where unknown, shape (m,)."""
    whole: BoolArray
    """Cars that nothing is known to hide or cut off, shape (m,)."""
    left_out: Mapping[str, BoolArray]
    """Cars that need not be found, by name of the level, shape (m,) each; the levels that are known."""

    @staticmethod
    def of(data: DataSet) -> "TrueCars | None":
        """The objects of a data set; None where no car that counts has a 3D box."""
        truths = [data.truth[f.image_id] for f in data.frames]
        if all(t.boxes3d is None for t in truths):
            return None
        return TrueCars.of_columns(
            TruthTable.of(data),
            Boxes3D.concatenate([Boxes3D.filled(t.boxes3d, len(t.ignore)) for t in truths]),
            azimuth_deg=_joined(_or_nan(t.azimuth_deg, t) for t in truths),
            truncated=_joined(_or_nan(t.truncated, t) for t in truths),
            occluded=_joined(_occluded(t) for t in truths).astype(np.int64),
            visibility=_joined(t.visibility for t in truths),
        )

    @staticmethod
    def of_columns(
        table: TruthTable,
        boxes3d: Boxes3D,
        *,
        azimuth_deg: FloatArray,
        truncated: FloatArray,
        occluded: IntArray,
        visibility: FloatArray,
    ) -> "TrueCars | None":
        """The objects of columns (m,) as ``rescore.data.frames.Truth`` has them, NaN where unknown, occlusion
        3; None where no car that counts has a 3D box."""
        if not (boxes3d.known & ~table.ignore).any():
            return None
        stated = _alphas(azimuth_deg)
        some_occluded = bool((occluded != UNKNOWN_OCCLUSION).any())
        levels = LEVELS if some_occluded and not np.isnan(truncated).all() else ()
        height = _heights(table.xyxy_px)
        needless = table.ignore | ~boxes3d.known
        hidden = np.isin(occluded, (1, 2)) | (visibility < WHOLE_VISIBILITY)
        if some_occluded:
            # where others have a level, one without is doubtful
            hidden |= (occluded == UNKNOWN_OCCLUSION) & np.isnan(visibility)
        return TrueCars(
            table=table,
            boxes3d=boxes3d,
            alpha_rad=np.where(np.isnan(stated), boxes3d.alpha_rad, stated),
            whole=~hidden & ~(truncated > WHOLE_TRUNCATION),
            left_out={
                level.name: needless
                | (occluded > level.max_occlusion)
                | (truncated > level.max_truncation)
                | (height <= level.min_height_px)
                for level in (*levels, EVERY_CAR)
            },
        )

    @property
    def levels(self) -> tuple[Level, ...]:
        """KITTI's levels where their quantities are known, and that of every car."""
        return tuple(level for level in (*LEVELS, EVERY_CAR) if level.name in self.left_out)


def boxes3d_rows(
    cars: TrueCars, files: Sequence[DetectionFile], matched: Mapping[str, MatchTable]
) -> list[Boxes3DRow]:
    """The rows of one detector, one for each mode; none where it has no 3D boxes.

    Args:
        cars: the truth.
        files: what there is of the detector, the same detections in each; the 3D boxes are those of the first
            file that has some.
        matched: what the detections found in the picture, by mode.
    """
    table = next((f.table for f in files if f.table.boxes3d is not None), None)
    if table is None or table.boxes3d is None or not matched:
        return []
    found = Found3D(cars, tuple(matched))
    first = next(iter(matched.values()))
    detections = Detections3D(first.image, table.xyxy_px, table.boxes3d, table.azimuth_deg)
    decided = {m: Decided((t.ranking,), t.outcome, t.annotation_id) for m, t in matched.items()}
    found.add(np.arange(cars.table.n_images), detections, decided)
    return found.rows(files[0].detector, ((mode, match.ranking) for mode, match in matched.items()))


@dataclass(frozen=True, eq=False)
class Detections3D:
    """Detections of some images of a test set, n in all."""

    image: IntArray
    """Image of each, counted within those, shape (n,)."""
    xyxy_px: FloatArray
    """Shape (n, 4)."""
    boxes3d: Boxes3D
    azimuth_deg: FloatArray
    """As the detector tells it, NaN where it does not, shape (n,)."""

    @property
    def alpha_rad(self) -> FloatArray:
        """KITTI's observation angle, NaN where unknown, shape (n,)."""
        return np.where(self.boxes3d.known, self.boxes3d.alpha_rad, _alphas(self.azimuth_deg))


@dataclass(frozen=True, eq=False)
class Decided:
    """What became of detections in the picture in one mode."""

    keys: tuple[FloatArray, ...]
    """What they are ranked by, (n,) each: the first, then the next where it ties."""
    outcome: NDArray[np.int8]
    """Index into ``rescore.metrics.matching.OUTCOMES``, shape (n,)."""
    annotation_id: IntArray
    """The car hit, as in match tables, shape (n,)."""


class Found3D:
    """The detections of one detector against the cars, of all images at once or of some at a time.

    What is kept of a detection is a few bits, and its pairs with cars that it overlaps by half.
    """

    def __init__(self, cars: TrueCars, modes: Sequence[str]) -> None:
        self._cars = cars
        self._n = 0
        self._flags: dict[str, list[BoolArray]] = {}
        """Masks of the detections by what they tell, some at a time."""
        self._pairs: dict[str, list[Touching]] = {name: [] for name in _OVERLAPS}
        self._errors: dict[str, list[BoxErrors]] = {m: [] for m in modes}
        """Errors of the detections that nuScenes pairs with a car, by mode."""
        self._hits: dict[str, list[_Hits]] = {m: [] for m in modes}

    def add(self, images: IntArray, found: Detections3D, decided: Mapping[str, Decided]) -> None:
        """The detections of some images, by their places in the truth, with what became of them by mode."""
        cars = self._cars
        rows = cars.table.rows_of(images)
        truth, solid = cars.table.take(images), cars.boxes3d[rows]
        detection, car = pairs_of_image(found.image, truth.car_image)
        in_picture, of_own_area = paired_overlap(found.xyxy_px[detection], truth.xyxy_px[car])
        apart = np.hypot(*(found.boxes3d.centre_cam_m[detection, ::2] - solid.centre_cam_m[car, ::2]).T)
        from_above, in_space = np.zeros(len(car)), np.zeros(len(car))
        # what lies farther apart than two circles about the footprints does not overlap
        close = np.flatnonzero(apart <= _reach_m(found.boxes3d)[detection] + _reach_m(solid)[car])
        from_above[close], in_space[close] = box_overlaps(found.boxes3d[detection[close]], solid[car[close]])
        alpha, true_alpha = found.alpha_rad, cars.alpha_rad[rows]
        for name, overlap in zip(_OVERLAPS, (in_picture, from_above, in_space), strict=True):
            at = np.flatnonzero(overlap > min(MIN_IOUS))
            d, c = detection[at], car[at]
            similarity = orientation_similarity(alpha[d], true_alpha[c])
            self._pairs[name].append(Touching(d + self._n, rows[c], overlap[at], similarity))
        # what is ignored and has no 3D box is a region, as KITTI's DontCare, which takes any number
        region, unknown = truth.ignore & ~solid.known, ~truth.ignore & ~solid.known
        n = len(found.image)

        def any_of(keep: BoolArray) -> BoolArray:
            """Mask of the detections (n,) that have a pair of a mask (p,)."""
            return np.bincount(detection[keep], minlength=n) > 0

        flags = {
            "known": found.boxes3d.known,
            "unknown": any_of(unknown[car] & (in_picture >= SAME_CAR_IOU)),
            **{f"region {iou:g}": any_of(region[car] & (of_own_area > iou)) for iou in MIN_IOUS},
            **{f"small {le.name}": _heights(found.xyxy_px) < le.min_height_px for le in cars.levels},
        }
        for name, mask in flags.items():
            self._flags.setdefault(name, []).append(mask)
        near = np.flatnonzero(apart < FOUND_WITHIN_M)
        for mode, one in decided.items():
            taken = take_cars(
                found.image,
                *one.keys,
                candidate=detection[near],
                car=car[near],
                overlap=-apart[near],
                n_cars=len(truth.ignore),
            )
            who = np.flatnonzero(taken >= 0)
            who = who[~truth.ignore[taken[who]]]
            self._errors[mode].append(box_errors(found.boxes3d[who], solid[taken[who]]))
            self._hits[mode].append(_hits(found, one, truth, solid, cars.whole[rows]))
        self._n += n

    def rows(self, detector: str, rankings: Iterable[tuple[str, FloatArray]]) -> list[Boxes3DRow]:
        """The figures by mode; to be asked for once, since what was kept is given away.

        Args:
            detector: its name.
            rankings: each mode, and what all detections are ranked by in it, larger is better, (n,).
        """
        flags = {name: np.concatenate(self._flags.pop(name)) for name in list(self._flags)}
        pairs = {name: Touching.joined(self._pairs.pop(name)).by_car() for name in _OVERLAPS}
        give_back()
        # by starmap, which lets the ranking of a mode go before it asks for the next
        return list(starmap(partial(self._row, detector, flags, pairs), rankings))

    def _row(
        self,
        detector: str,
        flags: Mapping[str, BoolArray],
        pairs: Mapping[str, Touching],
        mode: str,
        ranking: FloatArray,
    ) -> Boxes3DRow:
        return Boxes3DRow(
            detector=detector,
            mode=mode,
            n_boxes=int(flags["known"].sum()),
            precision=tuple(
                _precision(level, self._cars.left_out[level.name], flags, pairs, ranking)
                for level in self._cars.levels
            ),
            errors=self._error_figures(mode),
            poses=_poses(_Hits.joined(self._hits.pop(mode))),
        )

    def _error_figures(self, mode: str) -> BoxErrorFigures:
        """Errors of the detections that are taken, best first, by the nearest free car within 2 m: nuScenes'
        rule."""
        cars, errors = self._cars, BoxErrors.joined(self._errors.pop(mode))
        return BoxErrorFigures(
            within_m=FOUND_WITHIN_M,
            n_cars=int((cars.boxes3d.known & ~cars.table.ignore).sum()),
            n_found=len(errors.translation_m),
            translation_m=_mean_median(errors.translation_m),
            scale=_mean_median(errors.scale),
            orientation_rad=_mean_median(errors.orientation_rad),
        )


_OVERLAPS = ("in_picture", "from_above", "in_space")
"""Overlaps by which detections and cars are paired."""


def _precision(
    level: Level,
    left_out: BoolArray,
    flags: Mapping[str, BoolArray],
    pairs: Mapping[str, Touching],
    ranking: FloatArray,
) -> Precision3D:
    small, known = flags[f"small {level.name}"], flags["known"]
    solid = Judged(ranking, small | ~known, flags["unknown"], left_out)
    figures: dict[str, dict[str, float | None]] = {
        name: {f"{iou:g}": None for iou in MIN_IOUS} for name in (*_OVERLAPS, "orientation")
    }
    for min_iou in MIN_IOUS if solid.n_cars >= MIN_CARS else ():
        key = f"{min_iou:g}"
        flat = Judged(ranking, small, flags[f"region {key}"], left_out)
        for name, judged in zip(_OVERLAPS, (flat, solid, solid), strict=True):
            found = kitti_precision(judged, pairs[name][kept_rows(pairs[name].overlap > min_iou)])
            figures[name][key] = finite(found.average_precision)
            if judged is flat:
                figures["orientation"][key] = finite(found.orientation_similarity)
    return Precision3D(level=level.name, n_cars=solid.n_cars, **figures)


@dataclass(frozen=True, eq=False)
class _Hits:
    """The detections that found a car with a 3D box in the picture, k in all."""

    errors: BoxErrors
    distance_m: FloatArray
    whole: BoolArray

    @staticmethod
    def joined(parts: "Sequence[_Hits]") -> "_Hits":
        return _Hits(
            BoxErrors.joined([p.errors for p in parts]),
            np.concatenate([p.distance_m for p in parts]),
            np.concatenate([p.whole for p in parts]),
        )


def _hits(
    found: Detections3D, decided: Decided, truth: TruthTable, solid: Boxes3D, whole: BoolArray
) -> _Hits:
    hit = np.flatnonzero(decided.outcome == HIT)
    order = np.argsort(truth.annotation_id, kind="stable")
    # of two with one number the later
    at = np.searchsorted(truth.annotation_id[order], decided.annotation_id[hit], side="right") - 1
    car = order[at]
    hit, car = hit[solid.known[car]], car[solid.known[car]]
    errors = box_errors(found.boxes3d[hit], solid[car])
    return _Hits(errors, solid.distance_m[car], whole[car])


def _poses(hits: _Hits) -> tuple[PoseFigures, ...]:
    """The share of correct poses of all cars, and of whole ones by distance."""
    errors, distance, whole = hits.errors, hits.distance_m, hits.whole
    by_distance = [
        _pose(errors[whole & (distance >= low) & (distance < high)], True, (low, high))
        for low, high in DISTANCES_M
    ]
    return (_pose(errors, False, (0.0, None)), *by_distance)


def _pose(errors: BoxErrors, whole: bool, distance_m: tuple[float, float | None]) -> PoseFigures:
    n = len(errors.translation_m)
    # a comparison with NaN is false: a car whose detection has no 3D box has no correct pose
    correct = (errors.translation_m <= CORRECT_WITHIN_M) & (errors.orientation_rad <= CORRECT_WITHIN_RAD)
    return PoseFigures(
        whole=whole,
        distance_m=distance_m,
        n_found=n,
        n_boxes=int((~np.isnan(errors.translation_m)).sum()),
        correct_share=float(correct.mean()) if n else None,
        median_translation_m=_mean_median(errors.translation_m[correct]).median,
        median_orientation_rad=_mean_median(errors.orientation_rad[correct]).median,
    )


def _reach_m(boxes3d: Boxes3D) -> FloatArray:
    """Radius of a circle about each footprint (n,)."""
    return np.asarray(np.hypot(boxes3d.size_m[:, 0], boxes3d.size_m[:, 1]) / 2)


def _mean_median(values: FloatArray) -> MeanMedian:
    if not len(values):
        return MeanMedian(mean=None, median=None)
    return MeanMedian(mean=float(values.mean()), median=float(np.median(values)))


def _heights(xyxy_px: FloatArray) -> FloatArray:
    return np.asarray(xyxy_px[:, 3] - xyxy_px[:, 1])


def _joined(columns: Iterable[FloatArray]) -> FloatArray:
    return np.concatenate([np.zeros(0), *columns])


def _or_nan(column: FloatArray | None, truth: Truth) -> FloatArray:
    return np.full(len(truth.ignore), np.nan) if column is None else column


def _occluded(truth: Truth) -> FloatArray:
    unknown = np.full(len(truth.ignore), UNKNOWN_OCCLUSION)
    return (unknown if truth.occluded is None else truth.occluded).astype(float)


def _alphas(azimuth_deg: FloatArray) -> FloatArray:
    """KITTI's observation angle of each azimuth (n,), NaN where unknown."""
    return np.radians(180 - (90 - azimuth_deg) % 360)
