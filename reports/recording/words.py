"""What a recording says of a candidate in words, and the bars beside them."""

from dataclasses import dataclass
from textwrap import shorten

import numpy as np

from reports.palette import OUTCOME_NAME, detector_name, mode_name
from reports.recording.story import Story
from reports.run.changes_text import GROUP_TEXT
from reports.run.frame_view import CandidateView, FrameView
from rescore.results.candidate_file import ALONE
from rescore.results.words import status_text

MAX_BARS = 6
"""Parts of the evidence that have a bar of their own."""
_LINE = 66
"""Letters of the line above a bar."""


@dataclass(frozen=True)
class ColourRange:
    """What the colours of a candidate's pictures mean, in metres."""

    near: float
    far: float
    residual: float
    """Residual of the end colours, in metres, both ways."""


@dataclass(frozen=True)
class Bar:
    """One bar: a part of the evidence."""

    name: str
    value: float


def evidence_bars(story: Story, detector: str, c: CandidateView) -> tuple[Bar, ...]:
    """What the parts of the evidence add to the log odds that a candidate is a car, largest first.

    Beyond the largest, one bar sums the others up. Where the model of the evidence is not known, or the mode
    has none, the two terms of eq. 7.
    """
    if detector not in story.models:
        return _terms_of_eq_7(story, detector, c)
    parts = story.explanations[detector][c.row].parts
    bars = [Bar(_short(p.text), p.log_odds) for p in parts[:MAX_BARS]]
    if parts[MAX_BARS:]:
        rest = parts[MAX_BARS:]
        bars.append(Bar(f"{len(rest)} other parts together", sum(p.log_odds for p in rest)))
    return tuple(bars)


def why(story: Story, detector: str, view: FrameView, c: CandidateView, colours_m: ColourRange) -> str:
    """Why a candidate rose or fell, as Markdown."""
    mode = story.mode_of(detector)
    changes = story.changes[detector, mode]
    was, now = bool(changes.before.accepted[c.row]), bool(changes.after.accepted[c.row])
    kind = f" ({c.kind.replace('_', ' ')})" if c.kind and c.outcome == "false_alarm" else ""
    told = story.explanations.get(detector)
    score = (
        f"*l* = {c.likelihood:.3f} from the detector"
        + (f", D = {c.depth_difference:.3f} from depth" if np.isfinite(c.depth_difference) else ", no D")
        + f", score {c.posterior:.3f}."
    )
    unit = (
        ""
        if view.metric
        else " The camera is not calibrated: depths are relative, the median is set to 10 m."
    )
    lines = [
        f"## {GROUP_TEXT[story.group(detector, c)].capitalize()}: {_moved(changes.delta[c.row])}",
        f"**{OUTCOME_NAME[c.outcome]}{kind}** in {view.file}, place {c.rank + 1} → {c.new_rank + 1} of this "
        f"image, {changes.place_before[c.row]} → {changes.place_after[c.row]} of all {len(changes.group)} of "
        f"{detector_name(detector, short=True)}, {mode_name(mode)}.",
        score,
    ]
    if story.run.metrics.n_cars:
        lines.append(
            f"{_verdict(was)} before, {_verdict(now).lower()} after, at {story.points[detector].text}: "
            f"least *l* {_least(story, detector, ALONE)}, least score {_least(story, detector, mode)}."
        )
    if told is not None:
        text = told[c.row].text
        lines.append(f"**Why:** {text[:1].upper()}{text[1:]}.{_sum(story, detector, c)}")
    elif c.status != "ok":
        lines.append(f"No evidence: {status_text(c.status)}.")
    if c.view:
        lines.append(f"{c.view.capitalize()}.")
    fits = story.shows_fits(detector)
    if fits and c.fit is None:
        lines.append("No car was placed here: the pictures of one and what is left stay empty.")
    elif not fits and c.registered is None:
        lines.append("No model could be registered here: predicted depth and residual stay empty.")
    lines.append(
        f"*Colours:* depth dark {colours_m.near:.1f} m to bright {colours_m.far:.1f} m, black not measured. "
        f"Residual: red nearer than predicted, white 0, blue farther, ±{colours_m.residual:.1f} m, grey "
        f"nothing to compare.{unit}"
    )
    return "\n\n".join(lines)


def _sum(story: Story, detector: str, c: CandidateView) -> str:
    """How the parts make D."""
    model = story.models.get(detector)
    if model is None or c.status != "ok":
        return ""
    total = sum(p.log_odds for p in story.explanations[detector][c.row].parts)
    odds = f"log odds {total + model.bias:+.2f}"
    return f" All parts {total:+.2f}, and {model.bias:+.2f} for any candidate, make {odds}."


def _terms_of_eq_7(story: Story, detector: str, c: CandidateView) -> tuple[Bar, ...]:
    w = story.run.row(detector, story.mode_of(detector)).w
    if w is None or not np.isfinite(c.depth_difference) or c.likelihood <= 0 or c.depth_difference >= 1:
        return ()
    return (
        Bar("detector: w log l", float(w * np.log(c.likelihood))),
        Bar("depth: (1 − w) log(1 − D)", float((1 - w) * np.log1p(-c.depth_difference))),
    )


def _short(sentence: str) -> str:
    """The sentence as one line, without what cars usually have, which the words beside the bars say."""
    return shorten(sentence.partition(" (cars")[0], _LINE, placeholder=" …")


def _moved(delta: int) -> str:
    if delta == 0:
        return "stayed"
    return (
        f"{'rose' if delta > 0 else 'fell'} by {abs(int(delta))} {'place' if abs(delta) == 1 else 'places'}"
    )


def _verdict(accepted: bool) -> str:
    return "Accepted" if accepted else "Below the threshold"


def _least(story: Story, detector: str, mode: str) -> str:
    return f"{story.threshold(detector, mode):.3f}"
