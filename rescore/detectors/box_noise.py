"""A model of the boxes that a modern detector makes of a street: parts, doubles, two cars in one.

It was fitted to 374 boxes of a small detector on real road frames, each judged by eye. docs/detectors.md says
what was measured, what the model gives, and which of its numbers are assumptions.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from math import log2, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr, ndtri

from recon.arrays import BoolArray, FloatArray
from recon.boxes import iou_matrix, paired_overlap
from rescore.detectors.windows import clip_boxes

FLOOR = -1.386
"""Smallest raw score, the log odds of 0.2: the detector whose boxes were judged reported no lower ones."""
MIN_HEIGHT_PX = 18.0
"""Boxes that are lower were not judged, and are not drawn."""
MIN_WIDTH_PX = 9.0
"""Width of the narrowest box that was judged."""
SAME_CAR_IOU = 0.5
"""Overlap from which a box is a good one of a car."""
_REFERENCE_PX = 32.0
_ATTEMPTS = 20


class BoxKind(StrEnum):
    """What a drawn box is."""

    GOOD = "good"
    """A box of one car."""
    SECOND = "second"
    """Another box of a car that has a good one."""
    HALF = "half"
    """The left or right part of a car, about half of it."""
    SLICE = "slice"
    """A narrow upright part at a car's end."""
    UPPER = "upper"
    """The upper part: windows and roof."""
    BETWEEN = "between"
    """The end of a car and what is beside it, often the next car."""
    TWO_CARS = "two_cars"
    """A car and its neighbour in one box."""
    LARGE = "large"
    """Far more than a car."""
    VEHICLE = "vehicle"
    """On a van, a truck, a bus or a tram, whole or a part."""
    NOTHING = "nothing"
    """On no vehicle."""


@dataclass(frozen=True)
class ScoreLaw:
    """A normal distribution of log odds cut off at ``FLOOR``, whose mean grows with the height of the box."""

    mean: float
    """Mean of the whole distribution at a box of 32 px."""
    per_octave: float
    """What twice the height adds to it."""
    sd: float

    def draw(self, height_px: float, rng: np.random.Generator) -> float:
        """One raw score of a box."""
        mean = self.mean + self.per_octave * log2(height_px / _REFERENCE_PX)
        below = ndtr((FLOOR - mean) / self.sd)
        return float(mean + self.sd * ndtri(below + rng.uniform(1e-9, 1 - 1e-9) * (1 - below)))


@dataclass(frozen=True)
class PartLaw:
    """Normal distributions of the edges of a box in units of a car's box: 0 and 1 are the car's own edges."""

    mean: tuple[float, float, float, float]
    """Left, top, right, bottom, for a box at the car's right side."""
    sd: tuple[float, float, float, float]

    def draw(self, car_xyxy_px: FloatArray, at_right: bool, rng: np.random.Generator) -> FloatArray:
        """One box (4,), at the right or the left of a car's."""
        left, top, right, bottom = rng.normal(self.mean, self.sd)
        if not at_right:
            left, right = 1 - right, 1 - left
        x0, y0, x1, y1 = car_xyxy_px
        width, height = x1 - x0, y1 - y0
        return np.array([x0 + left * width, y0 + top * height, x0 + right * width, y0 + bottom * height])


@dataclass(frozen=True)
class BadBoxes:
    """How often a kind of bad box comes on a car, and what it is like."""

    rate: float
    """Number for each car of 32 px that is found."""
    per_octave: float
    """Logarithm to base 2 of what twice the height of the car makes of the rate."""
    part: PartLaw
    score: ScoreLaw
    takes_neighbour: bool = False
    """Whether it is drawn on the side of a neighbour alone, where the car has one."""


GOOD_SCORE = ScoreLaw(1.20, 1.02, 1.08)
SECOND_SCORE = ScoreLaw(0.85, 0.94, 1.36)
VEHICLE_SCORE = ScoreLaw(-0.70, 0.0, 1.16)
NOTHING_SCORE = ScoreLaw(-1.91, 0.0, 0.87)
SECOND_CHANCE = (0.10, -0.8)
"""Share of found cars of 32 px that have a second good box, and logarithm to base 2 of what twice the height
of the first makes of it."""
SECOND_PART = PartLaw((0.28, 0.03, 1.27, 0.97), (0.12, 0.12, 0.15, 0.15))
"""In units of the first box."""
BAD_BOXES: dict[BoxKind, BadBoxes] = {
    BoxKind.HALF: BadBoxes(
        0.22, 0.0, PartLaw((0.48, 0.07, 1.06, 0.94), (0.12, 0.17, 0.11, 0.10)), ScoreLaw(-0.35, 0.79, 1.40)
    ),
    BoxKind.SLICE: BadBoxes(
        0.15, 0.2, PartLaw((0.76, 0.10, 1.00, 0.93), (0.08, 0.13, 0.09, 0.12)), ScoreLaw(-1.93, 2.21, 1.39)
    ),
    BoxKind.UPPER: BadBoxes(
        0.32, -0.8, PartLaw((0.47, -0.02, 0.97, 0.56), (0.26, 0.11, 0.09, 0.07)), ScoreLaw(-0.80, 0.0, 0.35)
    ),
    BoxKind.BETWEEN: BadBoxes(
        0.30, -1.8, PartLaw((0.72, -0.03, 1.42, 0.88), (0.20, 0.17, 0.25, 0.20)), ScoreLaw(-0.25, 0.29, 0.92)
    ),
    BoxKind.TWO_CARS: BadBoxes(
        0.06, 0.0, PartLaw((0.19, -0.05, 1.90, 0.97), (0.13, 0.07, 0.30, 0.15)),
        ScoreLaw(-0.06, 0.0, 1.11), takes_neighbour=True,
    ),
    BoxKind.LARGE: BadBoxes(
        0.01, 0.0, PartLaw((-0.15, -0.25, 1.20, 1.60), (0.15, 0.20, 0.15, 0.40)), ScoreLaw(-0.06, 0.0, 1.11)
    ),
}  # fmt: skip
FOUND_MOST = 0.97
"""Chance of a good box of a large car in full view; an assumption, as are the next four."""
FOUND_HALF_PX = 16.0
"""Height of the cars in full view of which half as many are found."""
FOUND_OCTAVES = 0.3
FOUND_HALF_SHARE = 0.4
"""Visible share of the large cars of which half as many are found."""
FOUND_SHARE_WIDTH = 0.08
JITTER = 0.045
"""Scale of the double exponential distribution of a good box's edges, as a share of its width or height."""
JITTER_PX = 1.5
"""What it is more, in pixels, for a box as high as it is wide."""
VEHICLE_CHANCE = 0.5
"""Chance of a box on a vehicle that is no car, large and in full view, an assumption."""
VEHICLE_WHOLE = 0.6
"""Share of such boxes that frame the whole vehicle, an assumption."""
NOTHING_PER_FRAME = 0.67
NOTHING_HEIGHT_PX = (5.0, 1.0)
"""Median of what a box is higher than the lowest, and the standard deviation of its logarithm."""
NOTHING_ASPECT = (0.81, 0.45)
"""Median of width over height, and the standard deviation of its logarithm."""
NOTHING_BELOW_HORIZON = (0.037, 0.022)
"""Mean and standard deviation of the lower edge's slope below the camera's axis."""
NOTHING_MAX_SHARE = 0.25
"""Largest share of such a box that may lie on a vehicle's box."""


@dataclass(frozen=True, eq=False)
class Street:
    """What the model needs to know of a frame."""

    seen_xyxy_px: FloatArray
    """Shape (n, 4), extent of what is seen of each vehicle."""
    whole_xyxy_px: FloatArray
    """Shape (n, 4), the annotated box, hidden parts too."""
    visible_share: FloatArray
    """Shape (n,), in [0, 1]."""
    is_car: BoolArray
    """Shape (n,)."""
    things: NDArray[np.uint16]
    """Shape (h, w): instance numbers of what is neither ground nor sky nor a vehicle, 0 elsewhere."""
    fx_px: float
    axis_row_px: float
    """Row of the camera's axis."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the picture."""
        return self.things.shape[1], self.things.shape[0]


@dataclass(frozen=True, eq=False)
class DrawnBox:
    """One box of the model."""

    kind: BoxKind
    xyxy_px: FloatArray
    """Shape (4,), edges inside the picture."""
    score: float
    """Log odds."""


def chance_found(height_px: FloatArray, visible_share: FloatArray) -> FloatArray:
    """Chances (n,) that cars of given heights and visible shares get a good box."""
    octaves = np.log2(np.maximum(height_px, 1.0) / FOUND_HALF_PX)
    by_share = expit((visible_share - FOUND_HALF_SHARE) / FOUND_SHARE_WIDTH)
    return np.asarray(FOUND_MOST * expit(octaves / FOUND_OCTAVES) * by_share, dtype=float)


def draw_boxes(street: Street, rng: np.random.Generator) -> list[DrawnBox]:
    """All boxes of a frame before suppression, in no order of merit."""
    heights = street.seen_xyxy_px[:, 3] - street.seen_xyxy_px[:, 1]
    chances = chance_found(heights, street.visible_share)
    boxes: list[DrawnBox] = []
    for i, chance in enumerate(chances):
        if street.is_car[i]:
            boxes += _good_boxes(street, i, chance, rng)
            boxes += _bad_boxes(street, i, chance, rng)
        else:
            boxes += _vehicle_boxes(street, i, chance, rng)
    return [*boxes, *_boxes_of_nothing(street, rng)]


def _good_boxes(street: Street, i: int, chance: float, rng: np.random.Generator) -> Iterator[DrawnBox]:
    """A good box of car i, or none, and now and then a second one."""
    if rng.random() >= chance:
        return
    for _ in range(_ATTEMPTS):
        # some detectors frame what is seen, some the whole car: anything between
        seen, whole = street.seen_xyxy_px[i], street.whole_xyxy_px[i]
        box = _clipped(_jittered(seen + rng.random() * (whole - seen), rng), street)
        if box is not None and iou_matrix(box, street.whole_xyxy_px[i])[0, 0] >= SAME_CAR_IOU:
            yield DrawnBox(BoxKind.GOOD, box, GOOD_SCORE.draw(_height(box), rng))
            chance, per_octave = SECOND_CHANCE
            if rng.random() < chance * (_height(box) / _REFERENCE_PX) ** per_octave:
                second = _clipped(SECOND_PART.draw(box, rng.random() < 0.5, rng), street)
                if second is not None:
                    yield DrawnBox(BoxKind.SECOND, second, SECOND_SCORE.draw(_height(second), rng))
            return


def _bad_boxes(street: Street, i: int, chance: float, rng: np.random.Generator) -> Iterator[DrawnBox]:
    """The bad boxes on car i, as many as its size and visibility let a detector make."""
    car = street.seen_xyxy_px[i]
    octaves = np.log2(max(_height(car), 1.0) / _REFERENCE_PX)
    for kind, law in BAD_BOXES.items():
        rate = law.rate * 2 ** (law.per_octave * octaves) * chance / FOUND_MOST
        for _ in range(rng.poisson(rate)):
            at_right = _neighbour_side(street, i, rng) if law.takes_neighbour else rng.random() < 0.5
            if at_right is None:
                continue
            box = _clipped(law.part.draw(car, at_right, rng), street)
            if box is not None and (iou_matrix(box, street.whole_xyxy_px)[0] < SAME_CAR_IOU).all():
                yield DrawnBox(kind, box, law.score.draw(_height(box), rng))


def _vehicle_boxes(street: Street, i: int, chance: float, rng: np.random.Generator) -> Iterator[DrawnBox]:
    """A box on vehicle i that is no car, or none."""
    if rng.random() >= VEHICLE_CHANCE * chance / FOUND_MOST:
        return
    seen = street.seen_xyxy_px[i]
    if rng.random() < VEHICLE_WHOLE:
        drawn = _jittered(seen, rng)
    else:
        drawn = BAD_BOXES[BoxKind.HALF].part.draw(seen, rng.random() < 0.5, rng)
    box = _clipped(drawn, street)
    if box is not None:
        yield DrawnBox(BoxKind.VEHICLE, box, VEHICLE_SCORE.draw(_height(box), rng))


def _boxes_of_nothing(street: Street, rng: np.random.Generator) -> Iterator[DrawnBox]:
    """Boxes on things near the ground that are no vehicles."""
    for _ in range(rng.poisson(NOTHING_PER_FRAME)):
        for _ in range(_ATTEMPTS):
            box = _place_on_a_thing(street, rng)
            if box is not None and _is_apart(box, street.seen_xyxy_px):
                yield DrawnBox(BoxKind.NOTHING, box, NOTHING_SCORE.draw(_height(box), rng))
                break


def _place_on_a_thing(street: Street, rng: np.random.Generator) -> FloatArray | None:
    """A box (4,) whose lower half is centred on a thing; None where there is none at its height.

    Posts, signs and people draw more false alarms than walls, which fill more of the picture: all things of a
    row have the same chance.
    """
    median, spread = NOTHING_HEIGHT_PX
    height = MIN_HEIGHT_PX + median * np.exp(spread * rng.normal())
    width = height * NOTHING_ASPECT[0] * np.exp(NOTHING_ASPECT[1] * rng.normal())
    bottom = street.axis_row_px + street.fx_px * rng.normal(*NOTHING_BELOW_HORIZON)
    row = int(bottom - height / 4)
    if not 0 <= row < street.size_px[1]:
        return None
    there = np.unique(street.things[row])
    if not there.any():
        return None
    centre = float(rng.choice(np.flatnonzero(street.things[row] == rng.choice(there[there > 0]))))
    return _clipped(np.array([centre - width / 2, bottom - height, centre + width / 2, bottom]), street)


def _is_apart(box: FloatArray, vehicles_xyxy_px: FloatArray) -> bool:
    """Whether a box lies on no vehicle, and no small vehicle lies in it."""
    of_box = paired_overlap(box[None], vehicles_xyxy_px)[1]
    of_vehicle = paired_overlap(vehicles_xyxy_px, box[None])[1]
    return bool((np.maximum(of_box, of_vehicle) <= NOTHING_MAX_SHARE).all())


def _neighbour_side(street: Street, i: int, rng: np.random.Generator) -> bool | None:
    """Whether to take the neighbour at the right of vehicle i, or at the left; None where it has none."""
    own, others = street.seen_xyxy_px[i], street.seen_xyxy_px
    heights = others[:, 3] - others[:, 1]
    shared = np.minimum(own[3], others[:, 3]) - np.maximum(own[1], others[:, 1])
    beside = (shared > 0.5 * np.maximum(heights, _height(own))) & (heights > 0)
    offset = (others[:, [0, 2]].mean(axis=1) - own[[0, 2]].mean()) / max(own[2] - own[0], 1.0)
    near = {True: beside & (offset > 0.4) & (offset < 1.6), False: beside & (offset < -0.4) & (offset > -1.6)}
    sides = [side for side, there in near.items() if there.any()]
    return sides[int(rng.integers(len(sides)))] if sides else None


def _jittered(xyxy_px: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A box (4,) with edges as inexact as a detector's."""
    size = np.maximum(xyxy_px[2:] - xyxy_px[:2], 1.0)
    share = JITTER + JITTER_PX / sqrt(size[0] * size[1])
    return np.asarray(xyxy_px + rng.laplace(scale=np.tile(share * size, 2)), dtype=float)


def _clipped(xyxy_px: FloatArray, street: Street) -> FloatArray | None:
    """The part of a box (4,) inside the picture; None where it is smaller than what was judged."""
    box = np.asarray(clip_boxes(xyxy_px[None], *street.size_px)[0], dtype=float)
    large = box[2] - box[0] >= MIN_WIDTH_PX and _height(box) >= MIN_HEIGHT_PX
    return box if large else None


def _height(xyxy_px: FloatArray) -> float:
    return float(xyxy_px[3] - xyxy_px[1])
