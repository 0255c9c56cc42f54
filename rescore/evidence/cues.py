"""The parts of the depth evidence of a candidate, by name, and the modes that they are evidence in.

A new cue is a function that computes it, and an entry of ``CUES``, which says how it is told, in which modes
it is evidence, and with which others it is left out in the study of what cues are worth.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from math import log

import numpy as np

from recon.arrays import FloatArray, median
from recon.depth_map import DepthMap
from recon.errors import RescoreError
from recon.localization.disparity_fit import BoxFit
from recon.view_bins import ViewBins
from rescore.cues.framing import FRAMING, FramingConfig, framing, resolved
from rescore.cues.plausibility import CHECKS, PlausibilityConfig, plausibility
from rescore.cues.rivals import rival, same_car
from rescore.cues.surroundings import SURROUNDINGS, SurroundingsConfig, surroundings
from rescore.cues.words import CueWords, Side, ends, metres, share, signed_nats, signed_share, times
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import Frame
from rescore.evidence.align_depth import measured_pixels
from rescore.evidence.guarded import GUARDED, GuardedConfig, guarded_alignment
from rescore.evidence.registration import Registration


@dataclass(frozen=True)
class CueConfig:
    """Settings of all parts of the evidence."""

    guarded: GuardedConfig = field(default_factory=GuardedConfig)
    surroundings: SurroundingsConfig = field(default_factory=SurroundingsConfig)
    plausibility: PlausibilityConfig = field(default_factory=PlausibilityConfig)
    framing: FramingConfig = field(default_factory=FramingConfig)
    depth_ratio_limit: float = 2.0
    """Logarithms of depth ratios are clipped to this, both ways."""


@dataclass(frozen=True, eq=False)
class CueInput:
    """What the cues of the candidates of a frame are computed from."""

    frame: Frame
    """Picture, disparity, camera and ground. Without a camera only the guarded cues are had."""
    xyxy_px: FloatArray
    """Boxes, shape (n, 4), pixel edges."""
    predicted: Sequence[DepthMap | None]
    """Depth predicted in each box; None, which leaves out what needs it, where there is none or its scale and
    offset are unknown."""
    azimuth_rad: FloatArray
    """Side from which each object is taken to be seen, shape (n,); NaN where nothing says it."""
    config: CueConfig
    fits: Sequence[BoxFit | None] = ()
    """The instance of the class fitted to each box, None where there is none; empty where none was fitted."""
    boxes3d: Boxes3D | None = None
    """The 3D box of each of these instances; None where none was fitted."""


Columns = Mapping[str, FloatArray]
"""Cues by name, each of shape (n,); NaN where one cannot be had."""


def relief(given: CueInput) -> Columns:
    """The cues ``GUARDED``, ``depth_ratio`` and ``relief_px``: predicted depth against measured depth, inside
    the box."""
    frame, limit = given.frame, given.config.depth_ratio_limit
    fits = np.full((len(given.xyxy_px), len(GUARDED)), np.nan)
    ratio, predicted_px = np.full((2, len(given.xyxy_px)), np.nan)
    for i, depth in enumerate(given.predicted):
        if depth is None:
            continue
        measured = frame.disparity_px[depth.window]
        use = measured_pixels(depth, measured, given.xyxy_px[i])
        disparity, metres = measured.take(use), depth.depth.take(use)
        fit = guarded_alignment(metres, disparity, given.config.guarded)
        if fit is None:
            continue
        fits[i], predicted_px[i] = fit.cues, fit.predicted_px
        middle = median(disparity * metres)
        if frame.camera is not None and middle > 0:
            # measured over predicted depth
            ratio[i] = min(max(log(frame.camera.focal_baseline / middle), -limit), limit)
    return {**dict(zip(GUARDED, fits.T, strict=True)), "depth_ratio": ratio, "relief_px": predicted_px}


def turned(given: CueInput) -> Columns:
    """The cue ``side_on``: how much of its side an object shows, by the view bin that it is taken for."""
    bins = ViewBins()
    known = np.isfinite(given.azimuth_rad)
    side_on = np.full(len(given.azimuth_rad), np.nan)
    middle = [bins.azimuth_rad(bins.containing(a)) for a in given.azimuth_rad[known].tolist()]
    side_on[known] = np.abs(np.sin(middle))
    return {"side_on": side_on}


def around(given: CueInput) -> Columns:
    """The cues ``SURROUNDINGS``: size, edges and ground contact, in and around the box."""
    frame = given.frame
    found = np.full((len(given.xyxy_px), len(SURROUNDINGS)), np.nan)
    if frame.camera is not None:
        found = surroundings(
            frame.disparity_px,
            given.xyxy_px,
            given.azimuth_rad,
            frame.seen_from or frame.camera,
            given.config.surroundings,
        )
    return dict(zip(SURROUNDINGS, found.T, strict=True))


def framed(given: CueInput) -> Columns:
    """The cues ``FRAMING``: whether the box frames one whole object of the class; and ``resolved``."""
    found = np.full((len(given.xyxy_px), len(FRAMING)), np.nan)
    tells = np.full(len(given.xyxy_px), np.nan)
    height, width = given.frame.disparity_px.shape
    fitted = {i: fit for i, fit in enumerate(given.fits) if fit is not None}
    if fitted:
        rows, fits = list(fitted), list(fitted.values())
        found[rows] = framing(fits, given.xyxy_px[rows], (width, height), given.config.framing)
        tells[rows] = [resolved(fit, given.config.framing) for fit in fits]
    return {**dict(zip(FRAMING, found.T, strict=True)), "resolved": tells}


def beside_others(given: CueInput) -> Columns:
    """The cue ``rival``: how much better another box frames the same car."""
    if given.boxes3d is None:
        return {"rival": np.full(len(given.xyxy_px), np.nan)}
    overlap = np.array([np.nan if fit is None else fit.overlap for fit in given.fits])
    return {"rival": rival(overlap, same_car(given.xyxy_px, given.boxes3d))}


def believable(given: CueInput) -> Columns:
    """The cues ``CHECKS``: whether the measured depth can be believed."""
    frame = given.frame
    found = plausibility(frame.disparity_px, given.xyxy_px, frame.seen_from, given.config.plausibility)
    return dict(zip(CHECKS, found.T, strict=True))


class Sense(IntEnum):
    """Direction in which a cue speaks as it rises."""

    FOR = 1
    """The more of it, the more it speaks for a whole car in the box, or as much."""
    AGAINST = -1
    EITHER = 0
    """A car has neither much more nor much less, as with a size."""


@dataclass(frozen=True)
class Cue:
    """One part of the depth evidence."""

    compute: Callable[[CueInput], Columns]
    """Computes this cue, and perhaps others at once: it is called once a frame for all of them."""
    words: CueWords
    """How it is told."""
    group: str
    """Cues of one group are left out together in the study of what cues are worth; "" for none."""
    modes: frozenset[Registration]
    """Modes in which it is evidence."""
    checked_in: frozenset[Registration] = frozenset()
    """Modes in which it must not be lower than where the mode was fitted, or a candidate has no evidence."""
    sense: Sense = Sense.EITHER
    """Direction in which it may speak as it rises: its function in an evidence model keeps to that."""


def _entries(
    compute: Callable[[CueInput], Columns],
    modes: Iterable[Registration],
    *named: tuple[str, str, Sense, CueWords],
) -> dict[str, Cue]:
    """Entries of cues that one function computes, from their names, groups, senses and words."""
    found = {}
    for name, group, sense, words in named:
        found[name] = Cue(compute, words, group, frozenset(modes), sense=sense)
    return found


_METRIC = (Registration.METRIC,)
_CALIBRATED = (Registration.METRIC, Registration.INSTANCE)
_FINE = "{:.1f} %"
_MOST = FramingConfig().most
_GAP = signed_share(
    "no car elsewhere explains the depth better",
    Side("a car in the box explains the depth {} better than elsewhere", "% better in it"),
    Side("a car elsewhere explains the depth {} better", "% better elsewhere"),
)
_EXPLAINED = signed_share(
    "an empty place explains the depth as well as a car",
    Side("an empty place explains the depth {} better", "% for none"),
    Side("a car in the box explains {} of what a car could", "% by a car"),
)
_SEEN_EXPLAINED = signed_share(
    "an empty place explains the depth as well as any car",
    Side("an empty place explains the depth {} better than any car", "% for none"),
    Side("the car depth shows explains {} of what a car could", "% by a car"),
)
_RIVAL = signed_share(
    "no other box frames this car better",
    Side("no other box frames this car as well, by {}", "% for the box"),
    Side("another box frames this car {} better", "% better by another"),
)
_OVER_PLANE = signed_nats(
    "a flat board explains the depth as well as a car",
    Side("a flat board explains the depth better, by {}", "for a board"),
    Side("a car explains it better than a flat board, by {}", "for a car"),
)
CUES: dict[str, Cue] = {
    **_entries(
        relief,
        (Registration.GUARDED, Registration.METRIC),
        ("relief_scale", "all relief", Sense.EITHER, times("its relief is {} the predicted one")),
        (
            "relief_residual",
            "all relief",
            Sense.AGAINST,
            share("it is off a car's relief by {} of its distance", _FINE),
        ),
        (
            "relief_gain",
            "all relief",
            Sense.FOR,
            times("a car's relief fits {} as well as a flat board", "{:.2f} times"),
        ),
        ("roughness", "all relief", Sense.EITHER, share("its depth varies by {} of its distance", _FINE)),
    ),
    **_entries(
        around,
        _METRIC,
        ("width", "all of size", Sense.EITHER, times("it is {} as wide as a car")),
        ("height", "all of size", Sense.EITHER, times("it is {} as tall as a car")),
    ),
    **_entries(
        around,
        _CALIBRATED,
        ("foot", "foot and ground", Sense.EITHER, metres("its foot is {} above the ground")),
        ("compact", "fill", Sense.FOR, share("{} of its middle is at one depth")),
        ("left", "edges beside", Sense.AGAINST, share("to its left {} is as far away as it is")),
        ("right", "edges beside", Sense.AGAINST, share("to its right {} is as far away as it is")),
        ("above", "edges above", Sense.AGAINST, share("above it {} is as far away as it is")),
        ("behind_above", "edges above", Sense.FOR, share("above it {} lies farther back")),
        ("fill_left", "fill", Sense.FOR, share("it fills {} of the box's left rim")),
        ("fill_right", "fill", Sense.FOR, share("it fills {} of the box's right rim")),
        ("fill_top", "fill", Sense.FOR, share("it fills {} of the box's upper rim")),
        ("ground_below", "foot and ground", Sense.FOR, share("below it {} is ground")),
    ),
    **_entries(
        around,
        _METRIC,
        ("relief", "all relief", Sense.EITHER, metres("its upper part is {} farther back")),
    ),
    **_entries(around, _CALIBRATED, ("near", "fill", Sense.AGAINST, share("nearer things cover {} of it"))),
    **_entries(
        around,
        _METRIC,
        ("support", "all of size", Sense.FOR, share("{} of it is where a car of this size would be")),
    ),
    **_entries(
        around, _CALIBRATED, ("lower", "fill", Sense.FOR, share("{} of its foot is as far as the rest"))
    ),
    "measured": Cue(
        around,
        share("stereo measured {} of it", _FINE),
        "measured share",
        frozenset(_CALIBRATED),
        frozenset(_CALIBRATED),
        Sense.FOR,
    ),
    # the median logarithm of measured over predicted depth: 0 where the thing stands where the ground line
    # and the part planes put it
    **_entries(
        relief,
        _METRIC,
        (
            "depth_ratio",
            "depth ratio",
            Sense.EITHER,
            times("it is {} as far away as its ground line", "{:.2f} times"),
        ),
    ),
    **_entries(
        framed,
        (Registration.INSTANCE,),
        (
            "overlap",
            "class model",
            Sense.FOR,
            share("a car where depth puts it overlaps the box by {}"),
        ),
        (
            "framed_overlap",
            "class model",
            Sense.FOR,
            share("the best-fitting car overlaps the box by {}"),
        ),
        ("end_left", "class model", Sense.EITHER, ends("left", _MOST)),
        ("end_top", "class model", Sense.EITHER, ends("upper", _MOST)),
        ("end_right", "class model", Sense.EITHER, ends("right", _MOST)),
        ("end_bottom", "class model", Sense.EITHER, ends("lower", _MOST)),
        ("gap", "class model", Sense.AGAINST, _GAP),
        ("explained", "class model", Sense.FOR, _EXPLAINED),
        ("seen_explained", "class model", Sense.FOR, _SEEN_EXPLAINED),
        ("over_plane", "class model", Sense.FOR, _OVER_PLANE),
        (
            "seen_through",
            "class model",
            Sense.AGAINST,
            share("something behind shows through {} of a car in the box"),
        ),
        (
            "hidden",
            "class model",
            Sense.AGAINST,
            share("nearer things hide {} of a car in the box"),
        ),
        (
            "beyond_box",
            "class model",
            Sense.AGAINST,
            share("{} of the car depth shows is outside the box"),
        ),
        (
            "goes_on_beside",
            "class model",
            Sense.AGAINST,
            share("beside a car in the box {} is as far as the car"),
        ),
        (
            "goes_on_above",
            "class model",
            Sense.AGAINST,
            share("above a car in the box {} is as far as the car"),
        ),
    ),
    **_entries(beside_others, (Registration.INSTANCE,), ("rival", "class model", Sense.AGAINST, _RIVAL)),
    # the rest says nothing for or against a car, but how much the others count and can be believed
    "resolved": Cue(framed, share("what depth says of a car counts {} at this distance"), "", frozenset()),
    "agreement": Cue(
        believable,
        share("{} of neighbouring measurements agree", _FINE),
        "",
        frozenset(),
        # the likelihood of a fitted instance knows outliers
        frozenset({Registration.GUARDED, Registration.METRIC}),
    ),
    "ground_agreement": Cue(
        believable,
        share("{} of the ground measured where it is", _FINE),
        "",
        frozenset(),
        frozenset(_CALIBRATED),
    ),
    "relief_px": Cue(
        relief,
        CueWords("a car's relief is {} of disparity here", float, "{:.2f} px"),
        "",
        frozenset(),
        frozenset({Registration.GUARDED}),
    ),
    "side_on": Cue(
        turned,
        share("{} of a side view"),
        "",
        frozenset(),
        frozenset({Registration.GUARDED}),
    ),
}
"""The cues by name, in the order of the columns of ``CandidateTable.cues``."""
MIRRORED = (("left", "right"), ("fill_left", "fill_right"), ("end_left", "end_right"))
"""Pairs of cues that change places where a picture is mirrored."""


def cue_names() -> tuple[str, ...]:
    """Names of the columns of ``CandidateTable.cues``."""
    return tuple(CUES)


def cue_column(name: str) -> int:
    """The column of a cue in ``CandidateTable.cues``."""
    return list(CUES).index(name)


def cues_of(mode: Registration) -> tuple[str, ...]:
    """Names of the parts of the evidence of a mode; none for ``PAPER``, whose D has a formula."""
    return tuple(name for name, cue in CUES.items() if mode in cue.modes)


def cues_of_groups(groups: Sequence[str]) -> tuple[str, ...]:
    """Names of the cues of some groups, of any mode.

    Raises:
        RescoreError: no such group.
    """
    known = dict.fromkeys(cue.group for cue in CUES.values() if cue.group)
    for group in groups:
        if group not in known:
            raise RescoreError(
                f"group of cues: expected {', '.join(known)}, got {group!r}; choose one of these"
            )
    return tuple(name for name, cue in CUES.items() if cue.group in groups)


def checks_of(mode: Registration) -> tuple[str, ...]:
    """Names of the cues that are checked in a mode (``Cue.checked_in``)."""
    return tuple(name for name, cue in CUES.items() if mode in cue.checked_in)


def frame_cues(given: CueInput) -> FloatArray:
    """The cues of the candidates of a frame, shape (n, k), columns ``CUES``; NaN where one cannot be had."""
    found: dict[str, FloatArray] = {}
    for compute in dict.fromkeys(cue.compute for cue in CUES.values()):
        found |= compute(given)
    return np.stack([found[name] for name in CUES], axis=1)
