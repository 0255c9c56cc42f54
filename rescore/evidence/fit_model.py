"""Fit the models of depth evidence to labelled candidates, on frames that tune and test nothing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import Bounds, minimize
from scipy.special import expit
from scipy.stats import mannwhitneyu

from recon.arrays import BoolArray, FloatArray
from recon.errors import RescoreError
from rescore.data.splits import FittingSet
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.cues import CUES, MIRRORED, Sense, checks_of, cue_column, cues_of
from rescore.evidence.model import EvidenceModel, enough_cues
from rescore.evidence.registration import LEARNED, Registration
from rescore.metrics.matching import HIT, IGNORED, TruthTable, greedy_match, ranking_of


@dataclass(frozen=True)
class EvidenceConfig:
    """Settings of the fit."""

    knots: int = 5
    """Knots of each cue's function, at evenly spaced quantiles."""
    inverse_penalty: float = 0.1
    """The smaller, the stronger squares of coefficients are punished. About a hundred cars fit twenty
    functions, so it is strong."""
    min_share: float = 0.5
    """A candidate with a smaller share of a mode's cues has no evidence."""
    floor_quantile: float = 0.01
    """A candidate with a check below this quantile of the candidates that the model was fitted to has no
    evidence: nothing is known of such measurements."""
    min_cars: int = 10
    """Fewer cars among the candidates fit nothing that could be trusted."""
    folds: int = 5
    """Parts of the candidates that are held out in turn, to see where the evidence tells nothing."""
    relief_steps_px: tuple[float, ...] = (0.1, 0.15, 0.2, 0.25)
    """Predicted relief, in pixels of disparity, below which mode "guarded" may be silent: up to what the
    matcher is taken to be off by (``GuardedConfig.noise_px``)."""


def fit_evidence(
    cues: FloatArray,
    is_car: BoolArray,
    registration: Registration,
    config: EvidenceConfig,
    without: Sequence[str] = (),
) -> EvidenceModel:
    """The model of a mode from labelled candidates.

    Args:
        cues: shape (n, k), columns ``CUES``, NaN where one is missing.
        is_car: shape (n,).
        registration: the mode, not ``PAPER``.
        config: settings.
        without: cues of the mode that are left out, to learn what they are worth.

    Raises:
        RescoreError: too few cars, or nothing but cars, among candidates with evidence.
    """
    names = tuple(name for name in cues_of(registration) if name not in without)
    if not names:
        raise ValueError(f"mode {registration} has a formula, there is nothing to fit")
    use = enough_cues(cues, names, registration, config.min_share)
    cues, is_car = cues[use], is_car[use]
    n_cars = int(is_car.sum())
    if n_cars < config.min_cars or n_cars == len(is_car):
        raise RescoreError(
            f"depth evidence ({registration}): expected at least {config.min_cars} cars and some other "
            f"things among candidates with measured depth, got {n_cars} cars of {len(is_car)}; "
            "add labelled frames to fit it on (of a data set with splits: 'train' and 'calibration')"
        )
    model = _fitted(*_with_mirrored(cues, is_car, names), registration, names, config)
    checked = {name: cues[:, cue_column(name)] for name in checks_of(registration)}
    floors = {
        name: float(np.nanquantile(values, config.floor_quantile))
        for name, values in checked.items()
        if np.isfinite(values).any()
    }
    if _RELIEF in floors:
        floors[_RELIEF] = _least_relief_px(cues, is_car, registration, names, config)
    return replace(model, floors=floors)


def _with_mirrored(cues: FloatArray, is_car: BoolArray, names: Sequence[str]) -> tuple[FloatArray, BoolArray]:
    """Candidates and the same in a mirrored street, where some of the cues change places by mirroring."""
    pairs = [[cue_column(left), cue_column(right)] for left, right in MIRRORED if {left, right} <= {*names}]
    if not pairs:
        return cues, is_car
    mirrored = cues.copy()
    for pair in pairs:
        mirrored[:, pair] = cues[:, pair[::-1]]
    return np.concatenate([cues, mirrored]), np.concatenate([is_car, is_car])


def _fitted(
    cues: FloatArray,
    is_car: BoolArray,
    registration: Registration,
    names: Sequence[str],
    config: EvidenceConfig,
) -> EvidenceModel:
    """The model without its floors, from candidates that have evidence.

    All candidates count alike here. A model weighs them afterwards (``weights_of``), since the cameras of
    others err more at a distance than those that it is fitted to: infinity is off by parts of a pixel.
    """
    quantiles = np.linspace(0.02, 0.98, config.knots)
    knots: dict[str, FloatArray] = {}
    shapes: list[FloatArray] = []
    middles: list[FloatArray] = []
    for name in names:
        values = cues[:, cue_column(name)]
        known = np.isfinite(values)
        at = np.unique(np.quantile(values[known], quantiles)) if known.any() else np.zeros(1)
        shape = np.stack([np.interp(values[known], at, unit) for unit in np.eye(len(at))], axis=1)
        middle = _middle(shape, is_car[known], registration.even_odds)
        full = np.zeros((len(values), len(at)))
        full[known] = shape - middle
        knots[name] = at
        shapes.append(full)
        middles.append(middle)
    weight = _even_weights(is_car) if registration.even_odds else np.ones(len(is_car))
    keep_to = [_one_way(len(m), CUES[name].sense) for name, m in zip(names, middles, strict=True)]
    bias, coefficients = _logistic(np.hstack(shapes), is_car, weight, keep_to, config.inverse_penalty)
    splits = np.cumsum([len(m) for m in middles])[:-1]
    parts = np.split(coefficients, splits)
    log_odds = {n: part - float(part @ m) for n, part, m in zip(names, parts, middles, strict=True)}
    return EvidenceModel(registration, knots, log_odds, bias, config.min_share, {})


def _even_weights(is_car: BoolArray) -> FloatArray:
    """Weights of candidates that make cars and others count alike, shape (n,), one on average."""
    share = is_car.mean()
    return np.asarray(np.where(is_car, 0.5 / share, 0.5 / (1 - share)))


def _one_way(knots: int, sense: Sense) -> tuple[FloatArray, FloatArray]:
    """What keeps the function of one cue to its sense: a matrix (k, k) and lower bounds (k,).

    The matrix makes values at the knots of unknowns that are not below the bounds: the first value and, for
    a cue with a sense, the steps from knot to knot.
    """
    if sense is Sense.EITHER:
        return np.eye(knots), np.full(knots, -np.inf)
    steps = np.tril(np.full((knots, knots), float(sense)))
    steps[:, 0] = 1
    return steps, np.append(-np.inf, np.zeros(knots - 1))


def _logistic(
    features: FloatArray,
    is_car: BoolArray,
    weight: FloatArray,
    keep_to: Sequence[tuple[FloatArray, FloatArray]],
    inverse_penalty: float,
) -> tuple[float, FloatArray]:
    """Bias and coefficients (k,) of penalised logistic regression under the bounds of ``_one_way``."""
    make, lowest = block_diag(*(m for m, _ in keep_to)), np.concatenate([low for _, low in keep_to])
    sign = np.where(is_car, 1.0, -1.0)

    def loss(unknown: FloatArray) -> tuple[float, FloatArray]:
        coefficients = make @ unknown[1:]
        margin = sign * (unknown[0] + features @ coefficients)
        pull = -weight * sign * expit(-margin)
        value = weight @ np.logaddexp(0, -margin) + coefficients @ coefficients / (2 * inverse_penalty)
        slope = make.T @ (features.T @ pull + coefficients / inverse_penalty)
        return float(value), np.append(pull.sum(), slope)

    found = minimize(
        loss,
        np.zeros(1 + len(lowest)),
        jac=True,
        method="L-BFGS-B",
        bounds=Bounds(np.append(-np.inf, lowest), np.inf),
        options={"maxiter": 5000, "maxfun": 50000, "ftol": 1e-12, "gtol": 1e-7},
    )
    return float(found.x[0]), make @ found.x[1:]


_RELIEF = "relief_px"


def _least_relief_px(
    cues: FloatArray,
    is_car: BoolArray,
    registration: Registration,
    names: Sequence[str],
    config: EvidenceConfig,
) -> float:
    """The predicted relief, in pixels of disparity, below which the evidence is silent.

    It is the largest of ``config.relief_steps_px`` below which evidence that was fitted without them does not
    tell cars from other candidates: 0 where it tells them at every step.
    """
    held_out = np.full(len(is_car), np.nan)
    # candidates of an image stand together, so folds cut few images
    fold = np.arange(len(is_car)) * config.folds // len(is_car)
    for k in range(config.folds):
        rest = fold != k
        if not is_car[rest].any() or is_car[rest].all():
            return max(config.relief_steps_px)
        model = _fitted(cues[rest], is_car[rest], registration, names, config)
        held_out[fold == k] = model.contributions(cues[fold == k]).sum(axis=1)
    relief_px = cues[:, cue_column(_RELIEF)]
    silent = [s for s in config.relief_steps_px if not _tells(held_out, is_car, relief_px < s)]
    return max(silent, default=0.0)


def _tells(log_odds: FloatArray, is_car: BoolArray, some: BoolArray) -> bool:
    """Whether cars have higher log odds than others among some candidates, beyond chance (2.5 %)."""
    cars, others = log_odds[some & is_car], log_odds[some & ~is_car]
    if not len(cars) or not len(others):
        return False
    return float(mannwhitneyu(cars, others, alternative="greater").pvalue) < _CHANCE


_CHANCE = 0.025


def _middle(shape: FloatArray, is_car: BoolArray, even_odds: bool) -> FloatArray:
    """Mean of basis functions (n, k) over candidates, or of its means over cars and others, shape (k,)."""
    if even_odds and is_car.any() and not is_car.all():
        return np.asarray((shape[is_car].mean(axis=0) + shape[~is_car].mean(axis=0)) / 2)
    return shape.mean(axis=0) if len(shape) else np.zeros(shape.shape[1])


def labelled_cues(
    table: CandidateTable, fitting: FittingSet, min_iou: float = 0.5
) -> tuple[FloatArray, BoolArray]:
    """Cues (n, k) of the candidates on the fitting set that count, and whether each is a car (n,).

    A candidate is a car where it is the detector's best box of an annotated one; other boxes on a car are
    not, so that evidence prefers the box that fits. Candidates on ignore regions are left out.

    Raises:
        ValueError: ``table`` holds a candidate of another image.
    """
    truth = TruthTable.of(fitting.data)
    match = greedy_match(table.image_id, table.xyxy_px, ranking_of(table.score, table.score), truth, min_iou)
    use = match.outcome != IGNORED
    return table.cues[use], match.outcome[use] == HIT


def fit_modes(
    table: CandidateTable,
    fitting: FittingSet,
    config: EvidenceConfig,
    min_iou: float = 0.5,
    without: Sequence[str] = (),
) -> dict[Registration, EvidenceModel]:
    """The models of all learned modes from the candidates of one detector on the fitting set.

    See ``labelled_cues`` for what counts as a car.
    A mode that no candidate has cues for, as ``METRIC`` without calibrated cameras, is left out. So is one
    all of whose cues are among ``without``, which are left out of all modes.

    Raises:
        RescoreError: too few cars.
        ValueError: ``table`` holds a candidate of another image.
    """
    cues, is_car = labelled_cues(table, fitting, min_iou)
    return {
        mode: fit_evidence(cues, is_car, mode, config, without)
        for mode in LEARNED
        if set(cues_of(mode)) - set(without)
        and (mode.needs is None or np.isfinite(cues[:, cue_column(mode.needs)]).any())
    }
