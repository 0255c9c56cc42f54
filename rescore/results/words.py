"""The parts of the depth evidence in plain words, with the values that speak for a car."""

from collections.abc import Sequence

import numpy as np

from recon.errors import Reason
from rescore.cues.words import CueWords
from rescore.evidence.candidates import OK
from rescore.evidence.cues import CUES

STATUS_TEXT: dict[str, str] = {
    OK: "depth compared",
    Reason.NO_OUTLINE: "no outline found",
    Reason.REGISTRATION_FAILED: "does not fit the view of the model",
    Reason.NO_GROUND_CONTACT: "no part touches the ground",
    Reason.ABOVE_HORIZON: "ground line above the horizon",
    Reason.PARTS_NOT_PLACED: "too few parts placed",
    Reason.NO_STEREO: "too little measured depth",
    Reason.STEREO_NOT_BELIEVED: "measured depth contradicts itself or the ground",
    Reason.VIEW_NOT_LEARNED: "seen from a side that was not learned",
    Reason.RELIEF_TOO_SMALL: "relief too small to tell",
    Reason.NO_CALIBRATION: "camera not calibrated",
    Reason.NO_GROUND: "ground not known",
    Reason.NO_PREDICTION: "no depth predicted in the box",
    Reason.BOX_OUTSIDE_IMAGE: "box outside the image",
    Reason.FRAME_FAILED: "the frame failed",
    Reason.SECOND_BOX: "a second box of a car",
}
"""Words for each status of a candidate."""


SURE = 0.95
"""Probability of a side from which the next one is not told."""


def status_text(status: str) -> str:
    """Words for a status, known or not."""
    return STATUS_TEXT.get(status, status.replace("_", " ") or "not rescored")


def view_text(view: str, probability: float, second: str) -> str:
    """Words for the side from which the fitted instance shows an object; empty where none was fitted."""
    if not view:
        return ""
    other = f", else from its {second}" if probability < SURE else ""
    return f"seen from its {view} ({100 * probability:.0f} %){other}"


def words_of(cue: str, height_m: float | None = None) -> CueWords:
    """Words of a cue; ``height`` is told as the box's height in metres where the class's is given."""
    if cue != "height" or height_m is None:
        return CUES[cue].words
    return CueWords("it is {} tall", lambda v: height_m * float(np.exp(v)), "{:.1f} m")


def favourable(knots: Sequence[float], log_odds: Sequence[float]) -> list[tuple[float, float]]:
    """Ranges of a piecewise linear function, flat beyond its ends, where it is above 0; rising.

    A range without a lower or upper end has minus or plus infinity there.
    """
    at, f = np.asarray(knots, float), np.asarray(log_odds, float)
    positive = f > 0
    ranges: list[tuple[float, float]] = []
    start = -np.inf
    for i in range(len(at) - 1):
        if positive[i] == positive[i + 1]:
            continue
        crossing = float(at[i] + (at[i + 1] - at[i]) * f[i] / (f[i] - f[i + 1]))
        if positive[i]:
            ranges.append((start, crossing))
        else:
            start = crossing
    return [*ranges, (start, np.inf)] if positive[-1] else ranges


def range_text(ranges: Sequence[tuple[float, float]], words: CueWords) -> str:
    """The only range, as ``1.2 to 1.7 m``; empty where there is none, or several, which would confuse."""
    if len(ranges) != 1:
        return ""
    low, high = ranges[0]
    if np.isinf(low) and np.isinf(high):
        return ""
    if np.isinf(low):
        return words.at_most(high)
    if np.isinf(high):
        return words.at_least(low)
    return words.span(low, high)
