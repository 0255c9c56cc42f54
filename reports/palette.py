"""Colours and names that every picture shares, so that a colour means the same thing everywhere.

The hues are those of Okabe and Ito (2008), which stay apart for the common kinds of colour blindness.
Where two things could be mixed up, line style, marker or text tells them apart as well.
"""

from collections.abc import Sequence
from typing import Any

from rescore.results.candidate_file import ALONE

BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
YELLOW = "#F0E442"
GREY = "#8A8A8A"

DETECTOR_NAME = {"hog": "Dalal-Triggs (HOG + SVM)", "boosted": "Murphy-Torralba-Freeman (boosted)"}
DETECTOR_SHORT = {"hog": "HOG + SVM", "boosted": "boosted"}
_DETECTOR_COLOUR = {"hog": BLUE, "boosted": VERMILION}
_SPARE = (GREEN, PURPLE, ORANGE, SKY)

MODE_NAME = {
    ALONE: "detector alone",
    "paper": "with depth (paper)",
    "guarded": "with depth (guarded)",
    "metric": "with depth (metric)",
}
_MODE_STYLE: dict[str, tuple[str, Any]] = {
    ALONE: ("#555555", "--"),
    "paper": (BLUE, "-."),
    "guarded": (ORANGE, (0, (1, 1))),
    "metric": (GREEN, "-"),
}
"""Colour and dashes, so that modes can be told apart in grey too."""

OUTCOMES = ("hit", "false_alarm", "duplicate", "ignored")
OUTCOME_NAME = {
    "hit": "hit",
    "false_alarm": "false alarm",
    "duplicate": "duplicate",
    "ignored": "ignored",
    "found": "annotated car, found",
    "missed": "annotated car, not found",
    "ignored_car": "annotated car that does not count",
}
OUTCOME_COLOUR = {
    "hit": GREEN,
    "false_alarm": VERMILION,
    "duplicate": PURPLE,
    "ignored": GREY,
    "found": SKY,
    "missed": YELLOW,
    "ignored_car": "#BBBBBB",
}

# Left and right of the same part share a hue; neighbours on a car differ in lightness.
_PARTS = (
    "#E6550D",
    "#FDAE6B",
    "#9ECAE1",
    "#6A51A3",
    "#C6DBEF",
    "#FDD0A2",
    "#A63603",
    "#2171B5",
    "#A1D99B",
    "#41AB5D",
    "#DADAEB",
    "#F768A1",
    "#AE017E",
    "#FFD92F",
    "#B8860B",
    "#1B9E77",
    "#D95F02",
    "#7570B3",
    "#66A61E",
    "#E7298A",
)


RUN_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Colours of runs that are drawn in one chart, in their order."""

PART_COLOURS = len(_PARTS)
"""Number of different part colours; more parts than this share them in turn."""


def detector_name(detector: str, short: bool = False) -> str:
    """Name for people of a detector; its own name where it is not one of ours."""
    return (DETECTOR_SHORT if short else DETECTOR_NAME).get(detector, detector)


def mode_name(mode: str) -> str:
    """Name for people of a way of scoring."""
    return MODE_NAME.get(mode, mode.replace("_", " "))


def mode_colour(mode: str) -> str:
    """Hex colour of a way of scoring."""
    return str(_MODE_STYLE.get(mode, (PURPLE, "-"))[0])


def mode_dash(mode: str) -> Any:
    """Matplotlib's line style of a way of scoring."""
    return _MODE_STYLE.get(mode, (PURPLE, "-"))[1]


def detector_colour(detector: str, detectors: Sequence[str]) -> str:
    """Hex colour of a detector; detectors other than ours take the spare hues in their order."""
    if detector in _DETECTOR_COLOUR:
        return _DETECTOR_COLOUR[detector]
    others = [d for d in detectors if d not in _DETECTOR_COLOUR]
    return _SPARE[others.index(detector) % len(_SPARE)]


def part_colour(label: int) -> str:
    """Hex colour of part ``label`` (1 is the first part; 0, no part, is dark grey)."""
    return "#303030" if label == 0 else _PARTS[(label - 1) % len(_PARTS)]


_BRIGHT = {BLUE: "#56B4E9", VERMILION: "#FF8C42", GREEN: "#2ED3A2", "#555555": "#C3C8D0"}


def on_dark(colour: str) -> str:
    """The colour to use on a dark page: the deep hues are too dim there, the others stay."""
    return _BRIGHT.get(colour, colour)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue in 0..255 of ``#RRGGBB``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
