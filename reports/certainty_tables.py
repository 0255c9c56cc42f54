"""Tables of how sure the result is: reduction factors and differences with intervals, other ways of fusing,
reliability and the choice of w. Each is None where metrics.json, of an older version, does not say."""

from collections.abc import Mapping
from typing import Any

from reports.palette import detector_name, mode_name
from reports.tables import RECALLS, Table, number

LEVEL = "0.7"
"""Recall at which the small tables compare."""
RULE_TEXT = {
    "detector": "detector alone",
    "depth": "depth alone, 1 − D",
    "product": "product, l (1 − D)",
    "maximum": "maximum of l and 1 − D",
    "eq7": "eq. 7",
    "learned": "learned from log l and log(1 − D)",
}


def comparison_table(metrics: Mapping[str, Any]) -> Table | None:
    """What each mode changes against the detector alone, with intervals of 95 %, a row a mode."""
    rows = tuple(
        (
            detector_name(c["detector"]),
            mode_name(c["mode"]),
            *(factor(c["reduction"].get(level)) for level in RECALLS),
            factor((c["reduction_without_pictures"] or {}).get(LEVEL)),
            difference(c["auc_difference"]),
            difference(c["average_precision_difference"]),
        )
        for c in metrics.get("comparisons", ())
    )
    levels = (f"fewer FP at {float(r):.0%}" for r in RECALLS)
    head = ("detector", "scores", *levels, f"at {float(LEVEL):.0%} without pictures", "area", "AP")
    return Table("Change against the detector alone", head, rows, text_columns=2) if rows else None


def terminal_comparison(metrics: Mapping[str, Any]) -> Table | None:
    """The same for a terminal of 80 columns: short names, one recall, intervals below the figures."""
    rows = []
    for c in metrics.get("comparisons", ()):
        factors = (c["reduction"].get(LEVEL), (c["reduction_without_pictures"] or {}).get(LEVEL))
        areas = (c["auc_difference"], c["average_precision_difference"])
        rows.append(
            (
                f"{detector_name(c['detector'], short=True)}, {c['mode']}",
                *(factor(f).replace(" (", "\n(", 1) for f in factors),
                # no room for noughts before the point
                *(difference(f).replace(" (", "\n(", 1).replace("0.", ".") for f in areas),
            )
        )
    head = ("detector, scores", f"FP at {float(LEVEL):.0%}", "no pictures", "area", "AP")
    return Table("Change against the detector alone", head, tuple(rows)) if rows else None


TERMINAL_CAPTION = (
    f"FP at {float(LEVEL):.0%}: so many times fewer false positives per image, above 1 is better. "
    "no pictures: false alarms on flat pictures of cars left out. area, AP: difference. In brackets "
    "intervals of 95 %, paired over images."
)


def fusion_table(metrics: Mapping[str, Any]) -> Table | None:
    """Eq. 7 beside other ways of fusing, a row a detector, mode and way."""
    rows = tuple(
        (
            detector_name(f["detector"]),
            mode_name(f["mode"]),
            RULE_TEXT.get(f["rule"], f["rule"]),
            number(f["auc"]),
            number(f["average_precision"]),
            number(f["fppi_at_recall"].get(LEVEL), 2),
        )
        for f in metrics.get("fusion", ())
        if f["rule"] != "detector" or f["mode"] == _first_mode(metrics, f["detector"])
    )
    head = ("detector", "D", "score", "area (ROC)", "average precision", f"FP/image at {float(LEVEL):.0%}")
    return Table("Ways of fusing likelihood and depth", head, rows, text_columns=3) if rows else None


def reliability_table(metrics: Mapping[str, Any]) -> Table | None:
    """Brier score and calibration error of likelihoods and posteriors."""
    rows = tuple(
        (
            detector_name(r["detector"]),
            mode_name(r["mode"]),
            number(r["brier_score"]),
            number(r["calibration_error"]),
        )
        for r in metrics.get("reliability", ())
    )
    head = ("detector", "scores", "Brier score", "calibration error")
    return Table("Are scores probabilities?", head, rows, text_columns=2) if rows else None


def weight_table(metrics: Mapping[str, Any]) -> Table | None:
    """The choice of w of every detector and mode with its interval."""
    rows = tuple(
        (
            detector_name(name),
            mode_name(mode),
            number(t["w"], 2),
            f"{t['uncertainty']['low']:.2f} to {t['uncertainty']['high']:.2f}",
            "{:.2f} to {:.2f}".format(*t["uncertainty"]["plateau"]),
            t["sentence"],
        )
        for name, tuning in metrics.get("tuning", {}).items()
        for mode, t in tuning.get("modes", {}).items()
        if t.get("uncertainty")
    )
    head = ("detector", "scores", "w", "95 % interval", "within one standard error", "what the data tell")
    return Table("The weight w on the validation set", head, rows, text_columns=6) if rows else None


def weight_text(tuned: Mapping[str, Any]) -> str:
    """The chosen w with its interval, where it is known."""
    u = tuned.get("uncertainty")
    return f"{tuned['w']:g}" + (f" ({u['low']:.2f} to {u['high']:.2f})" if u else "")


def in_interval(tuned: Mapping[str, Any]) -> list[bool]:
    """Which w of the grid lie in the interval of the chosen one, which is known."""
    u = tuned["uncertainty"]
    return [u["low"] <= w <= u["high"] for w in tuned["w_grid"]]


def factor(figure: Mapping[str, Any] | None) -> str:
    """A reduction factor with its interval; a dash where it is undefined."""
    if figure is None or figure["interval"] is None:
        return "–"
    low, high = (_factor(end) for end in figure["interval"])
    return f"{_factor(figure['value'])} ({low}–{high})"


def difference(figure: Mapping[str, Any]) -> str:
    """A signed difference with its interval; a dash where it is undefined."""
    if figure["interval"] is None:
        return "–"
    value, low, high = (f"{v:+.3f}".replace("-", "−") for v in (figure["value"], *figure["interval"]))
    return f"{value} ({low}, {high})"


def _factor(value: float | None) -> str:
    """Three digits as far as there is a point; null is infinity."""
    if value is None:
        return "∞"
    return f"{value:.{2 if value < 9.995 else 1 if value < 99.95 else 0}f}"


def _first_mode(metrics: Mapping[str, Any], detector: str) -> str:
    """The mode beside which the detector alone is shown, once."""
    return next(str(f["mode"]) for f in metrics["fusion"] if f["detector"] == detector)
