"""Colours and names that every picture shares, so that a colour means the same thing everywhere.

The hues are those of Okabe and Ito (2008), which stay apart for the common kinds of colour blindness.
Where two things could be mixed up, line style, marker or text tells them apart as well.
"""

from collections.abc import Sequence
from typing import Literal

from rescore.detectors.registry import DETECTORS
from rescore.results.candidate_file import ALONE

BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
YELLOW = "#F0E442"
WINE, OLIVE = "#882255", "#999933"

CHARCOAL = "#303030"
DARK_GREY = "#555555"
"""The detector alone, and the frames of pictures."""
SOFT_GREY = "#777777"
"""Small words in a picture."""
GREY = "#8A8A8A"
"""What does not count, and lines to compare with."""
PALE_GREY = "#BBBBBB"
GRID_GREY = "#E3E3E3"
WHITE = "#FFFFFF"
HOLE_GREY = "#696969"
"""Pixels without a value in a still picture."""
PAPER = "#ECEEF1"
"""Background of pictures of meshes."""
BAND_INK = "#EBEBEB"
"""Words on a dark band above a picture."""

TRUTH, ESTIMATE = "#00C878", "#FF8C00"
"""The true box, and the one that was estimated."""
LEFT_EYE, RIGHT_EYE = "#FFC800", "#5AA0FF"
"""The two cameras in 3D."""
GROUND = "#789678"

NIGHT = "#16181D"
"""Background of the recording's 2D views."""
NIGHT_SKY = "#22252D"
"""Background of its 3D views."""
NIGHT_HOLE = "#0C0C0E"
"""Pixels without depth in it."""
NIGHT_GRID = "#343840"
NIGHT_AXIS = "#969CA5"
NIGHT_INK = "#E1E4E8"

Dash = Literal["solid", "longdash", "dashed", "dashdot", "dotted"]

_MODE_STYLE: dict[str, tuple[str, Dash]] = {
    ALONE: (DARK_GREY, "dashed"),
    "paper": (BLUE, "dashdot"),
    "guarded": (ORANGE, "dotted"),
    "metric": (GREEN, "solid"),
}
"""Colour and dashes, so that modes can be told apart in grey too."""
_OTHER_MODE: tuple[str, Dash] = (PURPLE, "solid")

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
    "ignored_car": PALE_GREY,
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


SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, WINE, OLIVE)
"""Colours of runs, and of detectors, that are drawn in one chart, in their order."""

PART_COLOURS = len(_PARTS)
"""Number of different part colours; more parts than this share them in turn."""


def detector_name(detector: str, short: bool = False) -> str:
    """Name for people of a detector; its own name where it is not one that can be trained here."""
    entry = DETECTORS.get(detector)
    if entry is None:
        return detector
    return entry.title if short or not entry.authors else f"{entry.authors} ({entry.title})"


def mode_name(mode: str) -> str:
    """Name for people of a way of scoring."""
    return "detector alone" if mode == ALONE else f"with depth ({mode.replace('_', ' ')})"


def mode_colour(mode: str) -> str:
    """Hex colour of a way of scoring."""
    return _MODE_STYLE.get(mode, _OTHER_MODE)[0]


def mode_dash(mode: str) -> Dash:
    """Dashes of a way of scoring."""
    return _MODE_STYLE.get(mode, _OTHER_MODE)[1]


def detector_colour(detector: str, detectors: Sequence[str]) -> str:
    """Hex colour of a detector: its place in the registry, or after it among the other ``detectors``."""
    others = [d for d in detectors if d not in DETECTORS]
    return SERIES[[*DETECTORS, *others].index(detector) % len(SERIES)]


def part_colour(label: int) -> str:
    """Hex colour of part ``label`` (1 is the first part; 0, no part, is dark grey)."""
    return CHARCOAL if label == 0 else _PARTS[(label - 1) % len(_PARTS)]


_BRIGHT = {BLUE: "#56B4E9", VERMILION: "#FF8C42", GREEN: "#2ED3A2", DARK_GREY: "#C3C8D0"}


def on_dark(colour: str) -> str:
    """The colour to use on a dark page: the deep hues are too dim there, the others stay."""
    return _BRIGHT.get(colour, colour)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue in 0..255 of ``#RRGGBB``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
