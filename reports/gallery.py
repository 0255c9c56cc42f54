"""Which candidates rescoring moved most, for better and for worse, with their pictures."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reports.curves import match_table
from reports.evidence_view import CandidateView, FrameView, frame_views
from reports.palette import OUTCOME_NAME
from reports.pictures import CandidatePanels, candidate_panels
from reports.run_folder import Run
from reports.tables import REASON_TEXT
from rescore.candidate_columns import difference, places
from rescore.changes import CHANGED, Changes, Group
from rescore.matching import FALSE_ALARM, HIT

GROUP_TEXT = {
    Group.LOST_CAR: "car lost",
    Group.GAINED_CAR: "car gained",
    Group.SWAPPED_CAR: "another car found",
    Group.REJECTED_FALSE_ALARM: "false alarm newly rejected",
    Group.ACCEPTED_FALSE_ALARM: "false alarm newly accepted",
    Group.MOVED_HIT: "other box on the car",
    Group.KEPT_CAR: "car kept",
    Group.KEPT_FALSE_ALARM: "false alarm still accepted",
    Group.REJECTED: "rejected before and after",
    Group.IGNORED: "ignored",
}
MAX_CARDS = 32
"""Candidates shown of all runs of a page together, so that the file stays small."""


@dataclass(frozen=True, eq=False)
class Mover:
    """One candidate of the gallery."""

    detector: str
    gain: bool
    """Whether it moved the right way."""
    group: Group
    view: CandidateView
    image_id: int
    before: int
    """Place among all candidates of the detector by its score, 1 is best."""
    after: int
    """The same after rescoring."""
    n: int
    panels: CandidatePanels
    metric: bool

    @property
    def outcome(self) -> str:
        """What became of it, for people."""
        return OUTCOME_NAME[self.view.outcome]

    @property
    def thing(self) -> str:
        """What it shows, for people; empty where unknown."""
        return self.view.kind.replace("_", " ")

    @property
    def title(self) -> str:
        """What happened, in words."""
        direction = "rose" if self.after < self.before else "fell"
        what = f"{self.outcome}{f' ({self.thing})' if self.thing else ''}"
        return f"{what[0].upper()}{what[1:]} {direction} from place {self.before} to {self.after} of {self.n}"

    @property
    def group_text(self) -> str:
        """What that does to the counts at the compared point."""
        return GROUP_TEXT[self.group]

    @property
    def evidence(self) -> str:
        """Why it moved, in words."""
        c = self.view
        return REASON_TEXT.get(c.status, c.status) + (f": {c.reason_detail}" if c.reason_detail else "")


@dataclass(frozen=True)
class _Item:
    """A candidate by its row among those of its detector, and its place before and after among ``n``."""

    detector: str
    image_id: int
    rank: int
    gain: bool
    group: Group
    before: int
    after: int
    n: int


@dataclass(frozen=True, eq=False)
class Gallery:
    """The largest moves of every detector in one mode."""

    point: str
    """Where the two curves are compared, in words."""
    movers: tuple[Mover, ...]


def build_gallery(run: Run, mode: str, max_cards: int = MAX_CARDS) -> Gallery:
    """The largest moves of each detector: right ones and wrong ones, of hits and of false alarms."""
    per_pick = max(1, max_cards // (4 * len(run.detectors)))
    items: list[_Item] = []
    points: list[str] = []
    for detector in run.detectors:
        changes = Changes.between(match_table(run, detector, "detector"), match_table(run, detector, mode))
        points.append(changes.point.text)
        items += _picks(run, detector, mode, changes, per_pick)
    # frames are read one after another; only the small pictures stay
    wanted = {(i.detector, i.image_id, i.rank): i for i in items}
    found = {key: mover for key, mover in _movers(run, mode, wanted)}
    return Gallery(" and ".join(dict.fromkeys(points)), tuple(found[key] for key in wanted))


def _picks(run: Run, detector: str, mode: str, changes: Changes, per_pick: int) -> Iterator[_Item]:
    """The candidates that moved most, by direction and outcome; first those that count otherwise than before."""
    rows = run.of(detector)
    before, after = places(changes.before.match.ranking), places(changes.after.match.ranking)
    counts = np.isin(changes.group, CHANGED)
    # a candidate without evidence keeps its score: others moved past it, depth did nothing to it
    moved = np.where(np.isfinite(difference(rows, mode)), before - after, 0)
    outcome = changes.after.match.outcome
    for gain in (True, False):
        for kind, up in ((FALSE_ALARM, not gain), (HIT, gain)):
            rise: NDArray[np.int64] = np.where(outcome == kind, moved if up else -moved, 0)
            order = np.lexsort((-rise, ~counts))
            for i in [i for i in order if rise[i] > 0][:per_pick]:
                place = int(rows["image_id"][i]), int(rows["rank"][i])
                ends = int(before[i]), int(after[i]), len(before)
                yield _Item(detector, *place, gain, changes.group[i], *ends)


def _movers(
    run: Run, mode: str, wanted: Mapping[tuple[str, int, int], _Item]
) -> Iterator[tuple[tuple[str, int, int], Mover]]:
    """The candidates with their pictures, in the order of the frames."""
    images = np.array(sorted({image_id for _, image_id, _ in wanted}), dtype=np.int64)
    for view in frame_views(run, mode, images) if len(images) else ():
        for detector, candidates in view.candidates.items():
            for c in candidates:
                key = (detector, view.image_id, c.rank)
                if key in wanted:
                    yield key, _mover(wanted[key], c, view)


def _mover(item: _Item, c: CandidateView, view: FrameView) -> Mover:
    return Mover(
        detector=item.detector,
        gain=item.gain,
        group=item.group,
        view=c,
        image_id=item.image_id,
        before=item.before,
        after=item.after,
        n=item.n,
        panels=candidate_panels(view, c),
        metric=view.metric,
    )
