"""The parts of the depth evidence in plain words, with the values that speak for a car."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rescore.evidence.registration import CUES

STATUS_TEXT = {
    "ok": "depth compared",
    "no_outline": "no outline found",
    "registration_failed": "does not fit the view of the model",
    "no_ground_contact": "no part touches the ground",
    "above_horizon": "ground line above the horizon",
    "parts_not_placed": "too few parts placed",
    "no_stereo": "too little measured depth",
    "stereo_not_believed": "measured depth contradicts itself or the ground",
    "no_calibration": "camera not calibrated",
    "no_prediction": "no depth predicted in the box",
    "box_outside_image": "box outside the image",
}
"""Words for each status of a candidate."""


def status_text(status: str) -> str:
    """Words for a status, known or not."""
    return STATUS_TEXT.get(status, status.replace("_", " ") or "not rescored")


@dataclass(frozen=True)
class CueWords:
    """How a cue is told."""

    sentence: str
    """Sentence with one place for the value."""
    shown: Callable[[float], float]
    """Maps the stored value to the one told; rising."""
    form: str
    """Format of the value told, with its unit."""

    def value(self, stored: float) -> str:
        """The value alone."""
        return self.form.format(self.shown(stored)).replace("-0.0 ", "0.0 ")

    def told(self, stored: float) -> str:
        """The sentence with its value."""
        return self.sentence.format(self.value(stored))


def _share(sentence: str, form: str = "{:.0f} %") -> CueWords:
    return CueWords(sentence, lambda v: 100 * v, form)


def _times(sentence: str, form: str = "{:.1f} times") -> CueWords:
    return CueWords(sentence, lambda v: float(np.exp(v)), form)


def _metres(sentence: str, form: str = "{:.1f} m") -> CueWords:
    return CueWords(sentence, float, form)


_FINE = "{:.1f} %"
CUE_WORDS = {
    "relief_scale": _times("relief {} the predicted one"),
    "relief_residual": _share("off the fitted relief by {} of the distance", _FINE),
    "relief_gain": _times("the relief fits {} as well as a flat surface", "{:.2f} times"),
    "roughness": _share("depth varies by {} of the distance", _FINE),
    "width": _times("{} as wide as a car"),
    "height": _times("{} as tall as a car"),
    "foot": _metres("foot {} above the ground"),
    "compact": _share("{} of its middle at one depth"),
    "left": _share("to the left {} goes on at its depth"),
    "right": _share("to the right {} goes on at its depth"),
    "above": _share("above it {} goes on at its depth"),
    "behind_above": _share("above it {} lies behind"),
    "fill_left": _share("left rim {} filled"),
    "fill_right": _share("right rim {} filled"),
    "fill_top": _share("top {} filled"),
    "ground_below": _share("below it {} is ground"),
    "relief": _metres("upper part {} behind the lower"),
    "near": _share("{} covered by nearer things"),
    "support": _share("{} at the distance that its size asks for"),
    "lower": _share("{} of its foot at its depth"),
    "measured": _share("stereo measured on {}", _FINE),
    "depth_ratio": _times("at {} the distance of its ground line", "{:.2f} times"),
    "agreement": _share("{} of neighbouring measurements agree", _FINE),
    "ground_agreement": _share("{} of the ground measured where it is", _FINE),
}
assert set(CUE_WORDS) == set(CUES)


def words_of(cue: str, height_m: float | None = None) -> CueWords:
    """Words of a cue; ``height`` is told as the box's height in metres where the class's is given."""
    if cue != "height" or height_m is None:
        return CUE_WORDS[cue]
    return CueWords("{} tall", lambda v: height_m * float(np.exp(v)), "{:.1f} m")


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


def range_text(value: float, ranges: Sequence[tuple[float, float]], words: CueWords) -> str:
    """The range that holds a value or is nearest to it, as ``1.2 to 1.7 m``; empty where there is no
    range."""
    if not ranges:
        return ""
    low, high = min(ranges, key=lambda r: max(r[0] - value, value - r[1], 0.0))
    if np.isinf(low) and np.isinf(high):
        return ""
    if np.isinf(low):
        return f"up to {words.value(high)}"
    if np.isinf(high):
        return f"from {words.value(low)}"
    # the unit once
    return f"{words.value(low).partition(' ')[0]} to {words.value(high)}"
