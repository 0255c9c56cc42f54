"""Gallery of the candidates that rescoring moved most, for better and for worse, with their pictures."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reports.palette import OUTCOME_NAME
from reports.run.candidate_panels import CandidatePanels, candidate_panels
from reports.run.changes_text import GROUP_TEXT, inspect_run, summary
from reports.run.frame_view import CandidateView, FrameView, frame_views
from rescore.metrics.matching import FALSE_ALARM, HIT
from rescore.results.candidate_file import difference
from rescore.results.changes import CHANGED, Group
from rescore.results.explain import EvidencePart
from rescore.results.ranked_changes import Inspection
from rescore.results.run_folder import Run

Key = tuple[str, int, int]
"""Detector, image id and rank of a candidate."""

CAR, BAD_BOX = "car", "car, badly framed"
"""What a box shows that lies on a car, and what such a false alarm is called."""
N_PARTS = 8
"""Parts of the evidence listed beside the large pictures."""
N_TELLING = 3
"""Candidates on the first screen."""
MAX_CARDS = 32
"""Candidates shown of all runs of a page together, so that the file stays small."""


@dataclass(frozen=True, eq=False)
class Mover:
    """One candidate of the gallery."""

    detector: str
    gain: bool
    """Whether the candidate moved the right way."""
    group: Group
    reason: str
    """Why the candidate moved, in words."""
    parts: tuple[EvidencePart, ...]
    """What the parts of its depth evidence say, those that say most first."""
    image_id: int
    before: int
    """Place among all candidates of the detector by its score, 1 is best."""
    after: int
    """Place among all candidates of the detector after rescoring, 1 is best."""
    n: int
    view: CandidateView
    panels: CandidatePanels
    metric: bool
    """Whether the depths of the candidate's pictures are in metres."""

    @property
    def outcome(self) -> str:
        """Outcome of the candidate, for people."""
        return OUTCOME_NAME[self.view.outcome]

    @property
    def thing(self) -> str:
        """What the candidate's box shows, for people; empty where unknown."""
        return self.view.kind.replace("_", " ")

    @property
    def title(self) -> str:
        """What happened, in words."""
        direction = "rose" if self.after < self.before else "fell"
        what = "candidate" if self.group is Group.IGNORED else self.outcome
        # what is on a car and counts as a false alarm is badly placed; any other box on a car is no news
        thing = self.thing if self.thing != CAR else BAD_BOX if self.view.outcome == "false_alarm" else ""
        what += f" ({thing})" if thing else ""
        return f"{what[0].upper()}{what[1:]} {direction} from place {self.before} to {self.after} of {self.n}"

    @property
    def move(self) -> str:
        """Direction in which the candidate moved: gain or loss, or, where nothing is known of it, rise or
        fall."""
        if self.group is Group.IGNORED:
            return "rise" if self.after < self.before else "fall"
        return "gain" if self.gain else "loss"

    @property
    def verdict(self) -> str:
        """The move and what it does to the counts, in words."""
        move = self.move.capitalize()
        return move if self.group is Group.IGNORED else f"{move}: {self.group_text}"

    @property
    def group_text(self) -> str:
        """What that does to the counts at the compared point."""
        return GROUP_TEXT[self.group]


@dataclass(frozen=True, eq=False)
class Gallery:
    """The largest moves of every detector in its last mode."""

    summaries: tuple[str, ...]
    """What changed at the compared points of the curves, a sentence a detector."""
    movers: tuple[Mover, ...]

    @property
    def telling(self) -> tuple[Mover, ...]:
        """The few that tell most: a false alarm that fell, a car that rose, a loss; then what comes next."""
        counting = [m for m in self.movers if m.group in CHANGED]
        kinds = ((True, "false_alarm"), (True, "hit"), (False, None))
        first = [
            next((m for m in counting if m.gain is gain and outcome in (None, m.view.outcome)), None)
            for gain, outcome in kinds
        ]
        chosen = [m for m in first if m is not None]
        return (*chosen, *(m for m in self.movers if m not in chosen))[:N_TELLING]


def build_gallery(run: Run, mode: str, max_cards: int = MAX_CARDS, explained: bool = True) -> Gallery:
    """The largest moves of each detector: right ones and wrong ones, of hits and of false alarms.

    Args:
        run: the run folder.
        mode: a way of rescoring; detectors without it are left out.
        max_cards: candidates of all detectors together.
        explained: whether the parts of D are told, which takes the model that made it.

    Raises:
        RescoreError: the data set is not where the run says, or the model of the evidence is another.
    """
    having = [d for d in run.detectors if any((r.detector, r.mode) == (d, mode) for r in run.metrics.rows)]
    inspections = {d: inspect_run(run, d, mode, explained=explained) for d in having}
    per_pick = max(1, max_cards // (4 * len(inspections)))
    # frames are read one after another; only the small pictures stay
    picks = [(i, gain, picked) for i in inspections.values() for gain, picked in _picks(i, per_pick)]
    # one of each kind in turn, so that the first ones show everything
    wanted = {
        (i.detector, int(i.rows["image_id"][picked[turn]]), int(i.rows["rank"][picked[turn]])): (
            picked[turn],
            gain,
        )
        for turn in range(per_pick)
        for i, gain, picked in sorted(picks, key=lambda pick: not pick[1])
        if turn < len(picked)
    }
    found = dict(_movers(run, mode, inspections, wanted))
    summaries = tuple(summary(i) for i in inspections.values())
    return Gallery(summaries, tuple(found[key] for key in wanted))


AGAINST_ITS_MOVE = {
    True: (Group.LOST_CAR, Group.ACCEPTED_FALSE_ALARM),
    False: (Group.GAINED_CAR, Group.REJECTED_FALSE_ALARM),
}
"""Groups of candidates that moved one way and count the other: the compared point moved past them."""


def _picks(inspection: Inspection, per_pick: int) -> Iterator[tuple[bool, Sequence[int]]]:
    """Rows of the candidates that moved most, and whether the right way, by direction and outcome.

    Those that count otherwise than before come first.
    """
    changes = inspection.changes
    counts = np.isin(changes.group, CHANGED)
    # in mode paper a candidate without evidence keeps its score: others moved past it, depth did nothing
    told = np.isfinite(difference(inspection.rows, inspection.mode))
    outcome = changes.after.match.outcome
    if not changes.after.match.n_cars:
        # nothing is right or wrong: what rose and what fell
        for rose in (True, False):
            moved = np.where(told, changes.delta if rose else -changes.delta, 0)
            yield rose, [int(row) for row in np.argsort(-moved, kind="stable") if moved[row] > 0][:per_pick]
        return
    for gain in (True, False):
        for kind in (FALSE_ALARM, HIT):
            right = ~np.isin(changes.group, AGAINST_ITS_MOVE[gain])
            moved = np.where((outcome == kind) & told & right, -changes.loss if gain else changes.loss, 0)
            order = np.lexsort((-moved, ~counts))
            yield gain, [int(row) for row in order if moved[row] > 0][:per_pick]


def _movers(
    run: Run,
    mode: str,
    inspections: Mapping[str, Inspection],
    wanted: Mapping[Key, tuple[int, bool]],
) -> Iterator[tuple[Key, Mover]]:
    """The candidates with their pictures, in the order of the frames."""
    images = np.array(sorted({image_id for _, image_id, _ in wanted}), dtype=np.int64)
    for view in frame_views(run, mode, images) if len(images) else ():
        for detector, candidates in view.candidates.items():
            for c in candidates:
                key = (detector, view.image_id, c.rank)
                if key in wanted:
                    yield key, _mover(inspections[detector], *wanted[key], c, view)


def _mover(inspection: Inspection, row: int, gain: bool, c: CandidateView, view: FrameView) -> Mover:
    changes = inspection.changes
    return Mover(
        detector=inspection.detector,
        gain=gain,
        group=changes.group[row],
        reason=_sentence(inspection.explanations[row].text),
        parts=inspection.explanations[row].parts[:N_PARTS],
        image_id=view.image_id,
        before=int(changes.place_before[row]),
        after=int(changes.place_after[row]),
        n=len(changes.group),
        view=c,
        panels=candidate_panels(view, c),
        metric=view.metric,
    )


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
