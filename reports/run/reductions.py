"""How many times fewer false positives a rescoring makes, as a cell of a table and as words.

A factor says nothing where there are no false positives before, none after, or where the recall is never
reached on one side: these corners are named in its place.
"""

from rescore.results.metrics_file import Reduction

NONE_BEFORE, NONE_AFTER, NONE = "none before", "none after", "none, none"
"""Cells of the corners without false positives before, after, and on both sides."""


def reduction_cell(figure: Reduction | None) -> str:
    """The factor with its interval, or the corner that it is in; a dash where it is undefined."""
    if figure is None or figure.interval is None:
        return "–"
    low, high = (_digits(end) for end in figure.interval)
    return f"{_corner_cell(figure) or _digits(figure.value)} ({low}–{high})"


def reduction_text(figure: Reduction | None) -> str:
    """The factor in words with its interval; empty where it is undefined."""
    if figure is None or figure.interval is None:
        return ""
    low, high = figure.interval
    if figure.none_before and figure.none_after:
        moves = figure.interval != (1.0, 1.0)
        return "none before, none after" + (f" ({_interval(low, high, 'times fewer')})" if moves else "")
    chance = "; chance may explain it" if _holds_one(low, high) else ""
    if figure.value is None or figure.value >= 1:
        ends, shown, what = (low, high), figure.value, "times fewer"
    else:
        ends, shown, what = (_inverse(high), _inverse(low)), _inverse(figure.value), "times as many"
    if shown is None:
        # a corner has no factor, so that its interval says of what it is one
        size = _corner_text(figure) or f"infinitely many {what}"
        return f"{size} ({_interval(*ends, what)}{chance})"
    size = f"{shown:.1f} {what}"
    if size == f"1.0 {what}":
        return f"about as many ({_interval(low, high, 'times fewer')})"
    return f"{size} ({_interval(*ends)}{chance})"


def _corner_cell(figure: Reduction) -> str:
    if figure.none_before and figure.none_after:
        return NONE
    return NONE_BEFORE if figure.none_before else NONE_AFTER if figure.none_after else ""


def _corner_text(figure: Reduction) -> str:
    """Words of a corner on one side; empty where the recall is not reached on the other."""
    return f"more: {NONE_BEFORE}" if figure.none_before else NONE_AFTER if figure.none_after else ""


def _interval(low: float | None, high: float | None, unit: str = "") -> str:
    ends = " to ".join("infinity" if end is None else f"{end:.1f}" for end in (low, high))
    return f"95 % interval {ends}" + (f" {unit}" if unit else "")


def _inverse(value: float | None) -> float | None:
    """1 / value, None for infinity on both sides."""
    return 0.0 if value is None else None if value == 0 else 1 / value


def _holds_one(low: float | None, high: float | None) -> bool:
    return low is not None and low <= 1 and (high is None or high >= 1)


def _digits(value: float | None) -> str:
    """Three digits as far as there is a point; None is infinity."""
    if value is None:
        return "∞"
    return f"{value:.{2 if value < 9.995 else 1 if value < 99.95 else 0}f}"
