"""What the depth evidence says of every thing of the bank of distractors, in all modes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.distractor_bank import BankConfig, BankItem, bank_item
from datasets_synth.photos.distractor_kinds import KIND, ORDINARY_CAR, POSTERS, TRUE_CARS
from datasets_synth.street.car_pictures import car_picture
from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.class_model import ClassModel
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.evidence.candidates import OK, Candidates
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.experiment.config import run_config
from rescore.files import write_json
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.parallel import one_thread, track
from rescore.results.sweep_file import StudyNumber, StudyPart
from rescore.studies.finished_run import finished_run
from rescore.studies.sweep import RECALL

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

    @property
    def title(self) -> str:
        """The kind in words."""
        return KIND[self.kind].title

    def without_pictures(self) -> "Judged":
        """The judged thing without its pictures: what is counted in the figures."""
        return replace(self, item=None)


def judge_bank(
    judge: Judge, kinds: Sequence[str], count: int, config: BankConfig, seed: int, jobs: Workers
) -> Iterator[Judged]:
    """``count`` things of each kind as they are done, kind by kind; cars are those of split "test"."""
    cars = tuple(cars_of_splits()["test"])
    rng = np.random.default_rng([seed, _PICTURE_STREAM])
    pictures = tuple(car_picture(cars, rng) for _ in range(config.synth.n_pictures))
    things = ((kind, index) for kind in kinds for index in range(count))
    return map_frames(_judged, things, _Shared(judge, cars, pictures, config, seed), jobs)


def judge_bank_of_run(
    root: Path, out: Path, count: int, *, detector: str, seed: int, jobs: Workers
) -> "tuple[BankResult, list[Judged]]":
    """Judge ``count`` things of every kind with the evidence of a finished run.

    Writes ``distractors.json`` to the folder ``out``.

    Returns:
        The content of the file, and the first thing of each kind with its pictures.

    Raises:
        RescoreError: the run is not finished, or has no such detector.
    """
    run = finished_run(root, detector, None)
    judge = Judge(run.class_model, run.config, run.models)
    bank = judge_bank(judge, tuple(KIND), count, BankConfig(synth=run_config(root).synth), seed, jobs)
    judged: list[Judged] = []
    first: dict[str, Judged] = {}
    for one in track(bank, "distractors", count * len(KIND)):
        first.setdefault(one.kind, one)
        judged.append(one.without_pictures())
    bank_of_all = bank_result(judged, RECALL)
    write_bank(out / "distractors.json", bank_of_all)
    return bank_of_all, list(first.values())


@dataclass(frozen=True, eq=False)
class _Shared:
    """What is the same for all things."""

    judge: Judge
    cars: Sequence[CarModel]
    pictures: Sequence[UInt8Array]
    config: BankConfig
    seed: int


def _judged(thing: tuple[str, int], shared: _Shared) -> Judged:
    kind, index = thing
    with one_thread():
        item = bank_item(KIND[kind], index, shared.cars, shared.pictures, shared.config, shared.seed)
        return Judged(kind, item.distance_m, item, differences(item, shared.judge))


def differences(item: BankItem, judge: Judge) -> dict[Registration, float]:
    """D of each mode."""
    one = Candidates(item.frame.image_id, item.xyxy_px[None], np.zeros(1), np.full(1, 0.5))
    evidence = rescore_frame(item.frame, one, judge.class_model, Rescoring(judge.config)).candidates
    modes = (Registration.PAPER, *judge.models)
    judged = {m: Rescoring(judge.config, judge.models.get(m)).fuse(evidence).candidates for m in modes}
    return {m: float(t.depth_difference[0]) if t.status[0] == OK else float("nan") for m, t in judged.items()}


def cut_at_recall(d: FloatArray, is_car: BoolArray, is_other: BoolArray, recall: float) -> float:
    """How many times fewer others than cars pass the threshold on D that lets ``recall`` of the cars pass.

    Without depth the same share of both passes. Infinity where none of the others passes. A candidate
    without evidence takes the median D of the cars, so that a threshold exists for it in every mode. The
    method itself does otherwise: in mode paper the candidate keeps its likelihood, in the others it gets
    the D of silent cues.

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


class Quartiles(StudyPart):
    """D of one kind in one mode; None where nothing of the kind has evidence."""

    low: float | None
    median: float | None
    high: float | None
    without: int
    """Things without evidence."""


class BankCut(StudyPart):
    """How many times fewer distractors than cars pass; see ``cut_at_recall``."""

    posters: StudyNumber
    """Against ordinary cars."""
    posters_dark: StudyNumber
    """Against ordinary and dark cars together."""
    all: StudyNumber
    """All kinds that are no cars, against ordinary cars."""


class BankKind(StudyPart):
    """All things of one kind."""

    name: str
    title: str
    is_car: bool
    count: int
    distance_m: tuple[float, ...]
    d: dict[str, Quartiles]
    """By mode."""
    values: dict[str, tuple[float | None, ...]]
    """D of each thing by mode; None without evidence."""
    below_cars: tuple[str, ...]
    """Modes in which the median is below that of ordinary cars, though the kind is no car."""


class BankResult(StudyPart):
    """The content of distractors.json."""

    recall: float
    cut: dict[str, BankCut]
    """By mode."""
    kinds: tuple[BankKind, ...]


def bank_result(judged: Sequence[Judged], recall: float) -> BankResult:
    """D of every thing by kind and mode, with quartiles."""
    kind_of = np.array([j.kind for j in judged])
    d = {m: np.array([j.difference[m] for j in judged]) for m in judged[0].difference}
    is_car = is_true_car(kind_of.tolist())
    ordinary, posters = kind_of == ORDINARY_CAR, np.isin(kind_of, POSTERS)
    cars = {m: float(np.nanmedian(own[ordinary])) for m, own in d.items()}
    return BankResult(
        recall=recall,
        cut={
            m.value: BankCut(
                posters=cut_at_recall(own, ordinary, posters, recall),
                posters_dark=cut_at_recall(own, is_car, posters, recall),
                all=cut_at_recall(own, ordinary, ~is_car, recall),
            )
            for m, own in d.items()
        },
        kinds=tuple(
            _bank_kind(kind, [j for j in judged if j.kind == kind], cars)
            for kind in dict.fromkeys(kind_of.tolist())
        ),
    )


def _bank_kind(kind: str, judged: Sequence[Judged], cars: Mapping[Registration, float]) -> BankKind:
    d = {m: np.array([j.difference[m] for j in judged]) for m in cars}
    is_car = kind in TRUE_CARS
    return BankKind(
        name=kind,
        title=KIND[kind].title,
        is_car=is_car,
        count=len(judged),
        distance_m=tuple(round(j.distance_m, 2) for j in judged),
        d={m.value: _quartiles(own) for m, own in d.items()},
        values={m.value: tuple(None if np.isnan(v) else float(v) for v in own) for m, own in d.items()},
        below_cars=tuple(m.value for m, own in d.items() if not is_car and np.nanmedian(own) < cars[m]),
    )


def _quartiles(d: FloatArray) -> Quartiles:
    known = d[np.isfinite(d)]
    without = len(d) - len(known)
    if not len(known):
        return Quartiles(low=None, median=None, high=None, without=without)
    low, median, high = np.quantile(known, [0.25, 0.5, 0.75]).tolist()
    return Quartiles(low=low, median=median, high=high, without=without)


def write_bank(path: Path, bank: BankResult) -> None:
    """Write distractors.json."""
    write_json(path, bank.as_json())
