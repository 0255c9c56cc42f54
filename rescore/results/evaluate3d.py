"""Evaluation of 3D boxes: KITTI's average precisions, nuScenes' errors, and the share of correct poses."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray, IntArray
from recon.boxes import paired_overlap
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet, Truth
from rescore.formats.coco import DetectionFile
from rescore.formats.kitti import UNKNOWN_ALPHA, alpha_of_azimuth
from rescore.formats.labels import UNKNOWN_OCCLUSION
from rescore.metrics.boxes3d import BoxErrors, box_errors, box_overlaps
from rescore.metrics.kitti_precision import (
    N_RECALLS,
    Judged,
    Touching,
    kitti_precision,
    orientation_similarity,
)
from rescore.metrics.matching import HIT, MatchTable, TruthTable, pairs_of_image, take_cars
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
    truncated: FloatArray
    """As in ``rescore.data.frames.Truth``, NaN where unknown, shape (m,)."""
    occluded: IntArray
    """As there, 3 where unknown, shape (m,)."""
    visibility: FloatArray
    """As there, NaN where unknown, shape (m,)."""

    @staticmethod
    def of(data: DataSet) -> "TrueCars | None":
        """The objects of a data set; None where no car that counts has a 3D box."""
        truths = [data.truth[f.image_id] for f in data.frames]
        if all(t.boxes3d is None for t in truths):
            return None
        boxes3d = [Boxes3D.filled(t.boxes3d, len(t.ignore)) for t in truths]
        cars = TrueCars(
            table=TruthTable.of(data),
            boxes3d=Boxes3D.concatenate(boxes3d),
            alpha_rad=_joined(_true_alphas(t, b) for t, b in zip(truths, boxes3d, strict=True)),
            truncated=_joined(_or_nan(t.truncated, t) for t in truths),
            occluded=_joined(_occluded(t) for t in truths).astype(np.int64),
            visibility=_joined(t.visibility for t in truths),
        )
        return cars if (cars.boxes3d.known & ~cars.table.ignore).any() else None

    @property
    def levels(self) -> tuple[Level, ...]:
        """KITTI's levels where their quantities are known, and that of every car."""
        known = self._levels_of_occlusion and not np.isnan(self.truncated).all()
        return (*LEVELS, EVERY_CAR) if known else (EVERY_CAR,)

    @property
    def _levels_of_occlusion(self) -> bool:
        return bool((self.occluded != UNKNOWN_OCCLUSION).any())

    @property
    def whole(self) -> BoolArray:
        """Cars that nothing is known to hide or cut off, shape (m,)."""
        hidden = np.isin(self.occluded, (1, 2)) | (self.visibility < WHOLE_VISIBILITY)
        if self._levels_of_occlusion:
            # where others have a level, one without is doubtful
            hidden |= (self.occluded == UNKNOWN_OCCLUSION) & np.isnan(self.visibility)
        return ~hidden & ~(self.truncated > WHOLE_TRUNCATION)

    def left_out(self, level: Level) -> BoolArray:
        """Cars that need not be found at a level, shape (m,)."""
        too_hard = (self.occluded > level.max_occlusion) | (self.truncated > level.max_truncation)
        too_small = _heights(self.table.xyxy_px) <= level.min_height_px
        return self.table.ignore | ~self.boxes3d.known | too_hard | too_small


@dataclass(frozen=True, eq=False)
class Ranked:
    """The detections of one detector in the order of one mode, n in all."""

    image: IntArray
    """Image of each, as ``TruthTable.car_image`` counts them, shape (n,)."""
    xyxy_px: FloatArray
    """Shape (n, 4)."""
    boxes3d: Boxes3D
    alpha_rad: FloatArray
    """KITTI's observation angle, NaN where unknown, shape (n,)."""
    match: MatchTable
    """What each found in the picture."""


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
    alpha = np.where(table.boxes3d.known, table.boxes3d.alpha_rad, _alphas(table.azimuth_deg))
    found = [Ranked(match.image, table.xyxy_px, table.boxes3d, alpha, match) for match in matched.values()]
    # modes rank the same boxes
    pairs = _Pairs.of(cars, found[0])
    return [
        _row(cars, files[0].detector, mode, ranked, pairs)
        for mode, ranked in zip(matched, found, strict=True)
    ]


def _row(cars: TrueCars, detector: str, mode: str, found: Ranked, pairs: "_Pairs") -> Boxes3DRow:
    return Boxes3DRow(
        detector=detector,
        mode=mode,
        n_boxes=int(found.boxes3d.known.sum()),
        precision=tuple(_precision(cars, found, pairs, level) for level in cars.levels),
        errors=_errors(cars, found, pairs),
        poses=_poses(cars, found),
    )


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Every pair of a detection and an object of one image, p in all."""

    detection: IntArray
    car: IntArray
    in_picture: FloatArray
    """IoU of the boxes in the picture, shape (p,), as the next two."""
    from_above: FloatArray
    in_space: FloatArray
    of_own_area: FloatArray
    """Share of the detection's box in the picture that lies in that of the object."""
    similarity: FloatArray
    errors: BoxErrors

    @staticmethod
    def of(cars: TrueCars, found: Ranked) -> "_Pairs":
        detection, car = pairs_of_image(found.image, cars.table.car_image)
        in_picture, of_own_area = paired_overlap(found.xyxy_px[detection], cars.table.xyxy_px[car])
        from_above, in_space = box_overlaps(found.boxes3d[detection], cars.boxes3d[car])
        similarity = orientation_similarity(found.alpha_rad[detection], cars.alpha_rad[car])
        errors = box_errors(found.boxes3d[detection], cars.boxes3d[car])
        return _Pairs(detection, car, in_picture, from_above, in_space, of_own_area, similarity, errors)

    def touching(self, overlap: FloatArray, min_iou: float) -> Touching:
        """The pairs whose overlap (p,) is larger than the limit."""
        keep = overlap > min_iou
        return Touching(self.detection[keep], self.car[keep], overlap[keep], self.similarity[keep])

    def any_of(self, keep: BoolArray, n: int) -> BoolArray:
        """Mask of the detections (n,) that have a pair of a mask (p,)."""
        return np.bincount(self.detection[keep], minlength=n) > 0


def _precision(cars: TrueCars, found: Ranked, pairs: _Pairs, level: Level) -> Precision3D:
    n, left_out = len(found.image), cars.left_out(level)
    small = _heights(found.xyxy_px) < level.min_height_px
    # what is ignored and has no 3D box is a region, as KITTI's DontCare, which takes any number
    region = cars.table.ignore & ~cars.boxes3d.known
    unknown = ~cars.table.ignore & ~cars.boxes3d.known
    on_unknown = pairs.any_of(unknown[pairs.car] & (pairs.in_picture >= SAME_CAR_IOU), n)
    ranking = found.match.ranking
    solid = Judged(ranking, small | ~found.boxes3d.known, on_unknown, left_out)
    figures: dict[str, dict[str, float | None]] = {
        name: {f"{iou:g}": None for iou in MIN_IOUS}
        for name in ("in_picture", "orientation", "from_above", "in_space")
    }
    for min_iou in MIN_IOUS if solid.n_cars >= MIN_CARS else ():
        on_region = pairs.any_of(region[pairs.car] & (pairs.of_own_area > min_iou), n)
        flat = kitti_precision(
            Judged(ranking, small, on_region, left_out), pairs.touching(pairs.in_picture, min_iou)
        )
        above = kitti_precision(solid, pairs.touching(pairs.from_above, min_iou))
        space = kitti_precision(solid, pairs.touching(pairs.in_space, min_iou))
        key = f"{min_iou:g}"
        figures["in_picture"][key] = finite(flat.average_precision)
        figures["orientation"][key] = finite(flat.orientation_similarity)
        figures["from_above"][key] = finite(above.average_precision)
        figures["in_space"][key] = finite(space.average_precision)
    return Precision3D(level=level.name, n_cars=solid.n_cars, **figures)


def _errors(cars: TrueCars, found: Ranked, pairs: _Pairs) -> BoxErrorFigures:
    """Errors of the detections that are taken, best first, by the nearest free car within 2 m, as nuScenes
    does."""
    apart = pairs.errors
    near = apart.translation_m < FOUND_WITHIN_M
    taken = take_cars(
        found.image,
        found.match.ranking,
        candidate=pairs.detection[near],
        car=pairs.car[near],
        overlap=-apart.translation_m[near],
        n_cars=len(cars.table.ignore),
    )
    detection = np.flatnonzero(taken >= 0)
    detection = detection[~cars.table.ignore[taken[detection]]]
    errors = box_errors(found.boxes3d[detection], cars.boxes3d[taken[detection]])
    return BoxErrorFigures(
        within_m=FOUND_WITHIN_M,
        n_cars=int((cars.boxes3d.known & ~cars.table.ignore).sum()),
        n_found=len(detection),
        translation_m=_mean_median(errors.translation_m),
        scale=_mean_median(errors.scale),
        orientation_rad=_mean_median(errors.orientation_rad),
    )


def _poses(cars: TrueCars, found: Ranked) -> tuple[PoseFigures, ...]:
    """The share of correct poses of all cars, and of whole ones by distance."""
    hit = np.flatnonzero(found.match.outcome == HIT)
    row_of = {int(a): i for i, a in enumerate(cars.table.annotation_id)}
    car = np.array([row_of[int(a)] for a in found.match.annotation_id[hit]], np.int64)
    hit, car = hit[cars.boxes3d.known[car]], car[cars.boxes3d.known[car]]
    errors = box_errors(found.boxes3d[hit], cars.boxes3d[car])
    distance, whole = cars.boxes3d.distance_m[car], cars.whole[car]
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


def _true_alphas(truth: Truth, boxes3d: Boxes3D) -> FloatArray:
    """Observation angles of annotated objects, as stated, else by their 3D boxes; NaN where unknown."""
    stated = _alphas(_or_nan(truth.azimuth_deg, truth))
    return np.where(np.isnan(stated), boxes3d.alpha_rad, stated)


def _alphas(azimuth_deg: FloatArray) -> FloatArray:
    """Observation angle of each azimuth (n,), NaN where unknown."""
    alpha = np.array([alpha_of_azimuth(a) for a in azimuth_deg.tolist()], float)
    return np.where(alpha == UNKNOWN_ALPHA, np.nan, alpha)
