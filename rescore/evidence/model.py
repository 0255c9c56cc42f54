"""From parts of the depth evidence to one D: a probability, calibrated on frames that tune and test nothing.

``1 - D`` is the probability that a candidate whose depth looks so is a car, whatever the detector says of it.
The logarithm of its odds is a sum of one piecewise linear function a cue (a generalised additive model,
Hastie and Tibshirani 1990), fitted by penalised logistic regression. So what each cue said for or against
a candidate can be read off.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.errors import Reason, RescoreError
from recon.reading import reading
from rescore.cues.plausibility import CHECKS
from rescore.data.frames import GroundSource
from rescore.evidence.candidates import OK, CandidateTable
from rescore.evidence.cues import checks_of, cue_column, cues_of
from rescore.evidence.registration import CLASS_MODEL, LEARNED, Registration
from rescore.files import read_json, write_json

FORMAT = "depth evidence 2"


@dataclass(frozen=True, eq=False)
class EvidenceModel:
    """D of one mode from its cues."""

    registration: Registration
    knots: Mapping[str, FloatArray]
    """Places of the knots of each cue, rising, shape (k,)."""
    log_odds: Mapping[str, FloatArray]
    """What the cue adds to the log odds at each knot, shape (k,); flat beyond the ends. Zero on average over
    the fitted candidates, and zero for a candidate that lacks the cue."""
    bias: float
    """Log odds of a candidate on which every cue is silent."""
    min_share: float
    """Smallest share of the cues that a candidate needs."""
    floors: Mapping[str, float]
    """Smallest value of each of ``checks_of(registration)``; a check that could not be made is passed."""
    depth_of: str = CLASS_MODEL
    """Whose depth it was fitted with (``PredictionFolder.depth_of``)."""

    def contributions(self, cues: FloatArray) -> FloatArray:
        """What each cue adds to the log odds that a candidate is a car, shape (n, k), columns ``CUES``.

        Zero for cues that the mode does not use and for those that the candidate lacks.
        """
        out = np.zeros_like(cues)
        weight = weights_of(cues, tuple(self.knots), self.registration)
        for name, knots in self.knots.items():
            column = cue_column(name)
            known = np.isfinite(cues[:, column])
            added = np.interp(cues[known, column], knots, self.log_odds[name])
            out[known, column] = weight[known] * added
        return out

    def shifted(self, log_odds: float) -> "EvidenceModel":
        """The model with ``log_odds`` added to the log odds of every candidate
        (``rescore.evidence.car_share``)."""
        return replace(self, bias=self.bias + log_odds)

    @property
    def neutral(self) -> float:
        """D where every cue is silent."""
        return float(_logistic(-self.bias))

    def difference(self, cues: FloatArray) -> FloatArray:
        """D in (0, 1) of candidates from their cues (n, k), shape (n,).

        NaN where too few cues are known, or where the measurements cannot be believed: they fail a check.
        """
        d = _logistic(-(self.bias + self.contributions(cues).sum(axis=1)))
        return np.where(self.complete(cues) & self.believable(cues), d, np.nan)

    def complete(self, cues: FloatArray) -> BoolArray:
        """Whether each candidate's cues (n, k) are enough of those that the model reads, shape (n,)."""
        return enough_cues(cues, tuple(self.knots), self.registration, self.min_share)

    def believable(self, cues: FloatArray) -> BoolArray:
        """Whether each candidate's cues (n, k) pass all checks of plausibility, shape (n,)."""
        passed = np.ones(len(cues), np.bool_)
        for name in self.floors:
            passed &= ~self.fails(cues, name)
        return passed

    def fails(self, cues: FloatArray, check: str) -> BoolArray:
        """Whether each candidate's cues (n, k) fail one check, shape (n,)."""
        return np.asarray(cues[:, cue_column(check)] < self.floors.get(check, -np.inf))


def weights_of(cues: FloatArray, names: Sequence[str], mode: Registration) -> FloatArray:
    """How much the cues of each candidate count in a mode, in [0, 1], shape (n,).

    In full where the mode weighs none, where the weight is not known, and where the cue that the mode needs
    is left out.

    Args:
        cues: Shape (n, k), columns ``CUES``; NaN where one is missing.
        names: The cues of the mode that are read.
        mode: The mode.
    """
    if mode.weighed_by is None or mode.needs not in names:
        return np.ones(len(cues))
    return np.nan_to_num(cues[:, cue_column(mode.weighed_by)], nan=1.0)


def enough_cues(cues: FloatArray, names: Sequence[str], mode: Registration, min_share: float) -> BoolArray:
    """Whether candidates have ``min_share`` of some cues, and the one that their mode needs, shape (n,).

    Args:
        cues: Shape (n, k), columns ``CUES``; NaN where one is missing.
        names: The cues of the mode that are read.
        mode: The mode.
        min_share: In [0, 1].
    """
    own = cues[:, [cue_column(name) for name in names]]
    enough = np.asarray(np.isfinite(own).mean(axis=1) >= min_share)
    # a check that could not be made is passed
    if mode.needs not in names or mode.needs in checks_of(mode):
        return enough
    return np.asarray(enough & np.isfinite(own[:, names.index(mode.needs)]))


def with_difference(table: CandidateTable, model: EvidenceModel | None) -> CandidateTable:
    """The candidates with D and status of a learned mode in place of those of eq. 6; as they are for None.

    A candidate without evidence gets the D of silent cues. Its likelihood alone would not do: eq. 7 lowers
    that of all others, since most candidates are no cars, and a false alarm that nothing is known of would
    rank above every car.
    """
    if model is None:
        return table
    d = model.difference(table.cues)
    has = np.isfinite(d)
    calibrated = np.isfinite(table.cues[:, cue_column("measured")])
    lost = np.where(table.status == OK, Reason.NO_STEREO.value, table.status)
    why = np.where(table.status == OK, "too few measured pixels in the predicted region", table.reason_detail)
    if model.registration.needs_calibration:
        lost = np.where(calibrated, Reason.NO_STEREO.value, Reason.NO_CALIBRATION.value)
        why = np.where(
            calibrated,
            "too few measured pixels in and around the box",
            "a calibrated camera expected, focal length or baseline is unknown",
        )
    if model.registration is Registration.INSTANCE:
        grounded = ~calibrated | (table.ground != GroundSource.DEFAULT.value)
        lost = np.where(grounded, lost, Reason.NO_GROUND.value)
        why = np.where(
            grounded, why, "a ground plane expected, none is stated and that of stereo is not trusted"
        )
    complete = model.complete(table.cues)
    for name, (reason, detail) in _FAILED.items():
        fails = complete & model.fails(table.cues, name)
        lost, why = np.where(fails, reason.value, lost), np.where(fails, detail, why)
    # nothing was looked at, whatever the mode
    failed = table.status == Reason.FRAME_FAILED
    lost, why = np.where(failed, table.status, lost), np.where(failed, table.reason_detail, why)
    return replace(
        table,
        depth_difference=np.where(has, d, model.neutral),
        status=np.where(has, OK, lost).astype(object),
        reason_detail=np.where(has, "", why).astype(object),
    )


_FAILED = {
    "side_on": (Reason.VIEW_NOT_LEARNED, "seen more from an end than wherever evidence was learned"),
    "relief_px": (Reason.RELIEF_TOO_SMALL, "the relief of a car is less than the evidence can tell"),
    **dict.fromkeys(
        ("measured", *CHECKS),
        (
            Reason.STEREO_NOT_BELIEVED,
            "fewer or less consistent measurements than wherever evidence was learned",
        ),
    ),
}
"""What it means that a candidate fails a check; of several the last one counts."""


def save_models(path: Path, models: Mapping[Registration, EvidenceModel]) -> None:
    """Write models as JSON."""
    write_json(path, models_as_json(models))


def models_as_json(models: Mapping[Registration, EvidenceModel]) -> dict[str, Any]:
    """Models as JSON values, as their files hold them."""
    modes = {
        mode.value: {
            "bias": model.bias,
            "min_share": model.min_share,
            "floors": dict(model.floors),
            "depth_of": model.depth_of,
            "cues": {
                name: {"knots": at.tolist(), "log_odds": model.log_odds[name].tolist()}
                for name, at in model.knots.items()
            },
            **_left_out(mode, model),
        }
        for mode, model in models.items()
    }
    return {"format": FORMAT, "modes": modes}


def _left_out(mode: Registration, model: EvidenceModel) -> dict[str, list[str]]:
    """Names of the cues of the mode that the model was fitted without, if there are any, under "without"."""
    names = [name for name in cues_of(mode) if name not in model.knots]
    return {"without": names} if names else {}


def load_models(path: Path) -> dict[Registration, EvidenceModel]:
    """Read what ``save_models`` wrote.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return models_of_json(read_json(path, "models of depth evidence"), path)


def models_of_json(value: Any, where: Path) -> dict[Registration, EvidenceModel]:
    """What ``models_as_json`` made; ``where`` names it in the error.

    Raises:
        RescoreError: something else.
    """
    with reading(where, f"models of depth evidence ({FORMAT!r})", "run `rescore fit-evidence` again"):
        if value["format"] != FORMAT:
            raise ValueError(f"format {value['format']!r}")
        return {Registration(m): _model(Registration(m), row) for m, row in value["modes"].items()}


def load_model(path: Path, mode: Registration) -> EvidenceModel:
    """The model of one mode from such a file.

    Raises:
        RescoreError: no such file, something else in it, or no model of the mode.
    """
    models = load_models(path)
    if mode not in models:
        raise RescoreError(
            f"{path}: expected a model for {mode}, got {', '.join(models)}; fit it on frames with calibrated "
            "cameras, and for instance with a class model that has a shape space"
        )
    return models[mode]


def _model(mode: Registration, row: Mapping[str, Any]) -> EvidenceModel:
    # a cue that is neither read nor named as left out is one that the file does not know
    if mode not in LEARNED or {*row["cues"], *row.get("without", ())} != set(cues_of(mode)):
        raise ValueError(f"cues of mode {mode}: {sorted(row['cues'])}")
    knots = {name: np.array(c["knots"], float) for name, c in row["cues"].items()}
    log_odds = {name: np.array(c["log_odds"], float) for name, c in row["cues"].items()}
    if any(k.shape != log_odds[n].shape or k.ndim != 1 or not len(k) for n, k in knots.items()):
        raise ValueError("knots and log_odds of different lengths")
    floors = {str(name): float(value) for name, value in row["floors"].items()}
    numbers = (*knots.values(), *log_odds.values(), [*floors.values(), row["bias"], row["min_share"]])
    if not all(np.isfinite(np.asarray(some, float)).all() for some in numbers):
        raise ValueError("numbers that are not finite")
    if not set(floors) <= set(checks_of(mode)):
        raise ValueError(f"checks of mode {mode}: {sorted(floors)}")
    depth_of = str(row.get("depth_of", CLASS_MODEL))
    return EvidenceModel(mode, knots, log_odds, float(row["bias"]), float(row["min_share"]), floors, depth_of)


def _logistic(log_odds: FloatArray | float) -> FloatArray:
    from scipy.special import expit  # noqa: PLC0415 (a third of a second)

    return np.asarray(expit(log_odds), float)
