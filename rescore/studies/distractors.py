"""What the depth evidence says of every thing of the bank of distractors, in all modes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from joblib import delayed

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.distractor_bank import BankConfig, BankItem, bank_item
from datasets_synth.photos.distractor_kinds import KIND, ORDINARY_CAR, POSTERS, TRUE_CARS
from datasets_synth.street.pictures import car_picture
from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.class_model import ClassModel
from rescore.evidence.candidates import OK, Candidates
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.parallel import in_order, one_thread

_PICTURE_STREAM = 3_000_000
"""Seed number of printed pictures, larger than any index of a kind, so that no kind draws the same
numbers."""


@dataclass(frozen=True)
class Judge:
    """Everything that says D of a candidate."""

    class_model: ClassModel
    config: RescoreConfig
    models: Mapping[Registration, EvidenceModel]
    """Evidence models of the learned modes; eq. 6 needs none."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A thing of the bank with D of each mode; NaN where there is no evidence."""

    kind: str
    distance_m: float
    item: BankItem | None
    """The thing with its pictures; None where they are kept no longer."""
    difference: Mapping[Registration, float]

    def without_pictures(self) -> "Judged":
        """The judged thing without its pictures: what is counted in the figures."""
        return replace(self, item=None)


def judge_bank(
    judge: Judge, kinds: Sequence[str], count: int, config: BankConfig, seed: int, jobs: int
) -> Iterator[Judged]:
    """``count`` things of each kind as they are done, kind by kind; cars are those of split "test"."""
    cars = tuple(cars_of_splits()["test"])
    rng = np.random.default_rng([seed, _PICTURE_STREAM])
    pictures = tuple(car_picture(cars, rng) for _ in range(config.synth.n_pictures))
    tasks = (
        delayed(_judged)(judge, kind, index, cars, pictures, config=config, seed=seed)
        for kind in kinds
        for index in range(count)
    )
    return in_order(tasks, jobs)


def _judged(
    judge: Judge,
    kind: str,
    index: int,
    cars: Sequence[CarModel],
    pictures: Sequence[UInt8Array],
    *,
    config: BankConfig,
    seed: int,
) -> Judged:
    with one_thread():
        item = bank_item(KIND[kind], index, cars, pictures, config, seed)
        return Judged(kind, item.distance_m, item, differences(item, judge))


def differences(item: BankItem, judge: Judge) -> dict[Registration, float]:
    """D of each mode."""
    one = Candidates(item.frame.image_id, item.xyxy_px[None], np.zeros(1), np.full(1, 0.5))
    evidence = rescore_frame(item.frame, one, judge.class_model, Rescoring(judge.config)).candidates
    modes = (Registration.PAPER, *judge.models)
    judged = {m: Rescoring(judge.config, judge.models.get(m)).fuse(evidence).candidates for m in modes}
    return {m: float(t.depth_difference[0]) if t.status[0] == OK else float("nan") for m, t in judged.items()}


def cut_at_recall(d: FloatArray, is_car: BoolArray, is_other: BoolArray, recall: float) -> float:
    """How many times fewer others than cars pass the threshold on D that lets ``recall`` of the cars pass.

    Without evidence the same share of both passes. A candidate without evidence is judged like a car of
    middling D, since it keeps its likelihood. Infinity where none of the others passes.

    Args:
        d: shape (n,), NaN where there is no evidence.
        is_car: true cars, shape (n,).
        is_other: the others, shape (n,).
        recall: share of the cars, in (0, 1).
    """
    filled = np.where(np.isnan(d), np.nanmedian(d[is_car]), d)
    threshold = np.quantile(filled[is_car], recall, method="inverted_cdf")
    passing = float((filled[is_other] <= threshold).mean())
    own = float((filled[is_car] <= threshold).mean())
    return own / passing if passing else float("inf")


def is_true_car(kinds: Sequence[str]) -> BoolArray:
    """Whether each kind is a car seen from the side, shape (n,)."""
    return np.array([k in TRUE_CARS for k in kinds])


def bank_as_json(judged: Sequence[Judged], recall: float) -> dict[str, Any]:
    """D of every thing by kind and mode, with quartiles, as JSON values.

    ``cut`` is that of ``cut_at_recall``: against ordinary cars, and for posters also against
    ordinary and dark ones together. ``below_cars``: modes in which the median of a kind is below that of
    ordinary cars.
    """
    kinds = list(dict.fromkeys(j.kind for j in judged))
    modes = list(judged[0].difference)
    kind_of = np.array([j.kind for j in judged])
    d = {m: np.array([j.difference[m] for j in judged]) for m in modes}
    is_car = is_true_car(kind_of.tolist())
    ordinary, posters = kind_of == ORDINARY_CAR, np.isin(kind_of, POSTERS)
    cars = {m: float(np.nanmedian(d[m][ordinary])) for m in modes}
    return {
        "recall": recall,
        "cut": {
            m.value: {
                "posters": _or_inf(cut_at_recall(d[m], ordinary, posters, recall)),
                "posters_dark": _or_inf(cut_at_recall(d[m], is_car, posters, recall)),
                "all": _or_inf(cut_at_recall(d[m], ordinary, ~is_car, recall)),
            }
            for m in modes
        },
        "kinds": [
            {
                "name": kind,
                "title": KIND[kind].title,
                "is_car": kind in TRUE_CARS,
                "count": int((kind_of == kind).sum()),
                "distance_m": [round(j.distance_m, 2) for j in judged if j.kind == kind],
                "d": {m.value: _quartiles(d[m][kind_of == kind]) for m in modes},
                "values": {
                    m.value: [None if np.isnan(v) else float(v) for v in d[m][kind_of == kind]] for m in modes
                },
                "below_cars": [
                    m.value
                    for m in modes
                    if kind not in TRUE_CARS and np.nanmedian(d[m][kind_of == kind]) < cars[m]
                ],
            }
            for kind in kinds
        ],
    }


def _quartiles(d: FloatArray) -> dict[str, float | int | None]:
    known = d[np.isfinite(d)]
    low, median, high = np.quantile(known, [0.25, 0.5, 0.75]) if len(known) else (None, None, None)
    named = {"low": low, "median": median, "high": high}
    return {k: None if v is None else float(v) for k, v in named.items()} | {"without": len(d) - len(known)}


def _or_inf(value: float) -> float | str:
    return value if np.isfinite(value) else "inf"
