"""Which candidates rescoring moved most, for better and for worse, with their pictures."""

from dataclasses import dataclass

import numpy as np

from reports.curves import match_table
from reports.evidence_view import CandidateView, FrameView, frame_views
from reports.palette import OUTCOME_NAME, detector_name
from reports.pictures import CandidatePanels, candidate_panels
from reports.run_folder import Run
from rescore.candidate_columns import places
from rescore.cue_words import status_text


@dataclass(frozen=True)
class Mover:
    """One candidate of the gallery."""

    detector: str
    image_id: int
    rank: int
    """Place by detector score in its image, 0 is best."""
    outcome: str
    kind: str
    before: int
    """Place among all candidates of the detector by its score, 1 is best."""
    after: int
    """The same after rescoring."""
    n: int
    likelihood: float
    posterior: float
    depth_difference: float
    evidence: str
    panels: CandidatePanels
    metric: bool

    @property
    def title(self) -> str:
        """What happened, in words."""
        what = f"{OUTCOME_NAME[self.outcome]}{f' ({self.kind})' if self.kind else ''}"
        direction = "rose" if self.after < self.before else "fell"
        return f"{what} {direction} from place {self.before} to {self.after} of {self.n}"


@dataclass(frozen=True)
class Shelf:
    """One group of the gallery."""

    title: str
    text: str
    movers: tuple[Mover, ...]


def build_gallery(run: Run, mode: str, per_shelf: int = 6) -> tuple[Shelf, ...]:
    """The largest moves of each detector: right ones and wrong ones."""
    picks = {d: _picks(run, d, mode, per_shelf) for d in run.detectors}
    wanted = {(d, i.image_id, i.rank): i for d, groups in picks.items() for g in groups.values() for i in g}
    images = np.array(sorted({image_id for _, image_id, _ in wanted}), dtype=np.int64)
    # frames are read one after another; only the small pictures stay
    movers: dict[tuple[str, int, int], Mover] = {}
    for view in frame_views(run, mode, images):
        for detector, candidates in view.candidates.items():
            for c in candidates:
                key = (detector, view.image_id, c.rank)
                if key in wanted:
                    movers[key] = _mover(detector, wanted[key], c, view)
    return tuple(
        Shelf(f"{detector_name(d)}: {title}", text, tuple(movers[d, i.image_id, i.rank] for i in items))
        for d, groups in picks.items()
        for (title, text), items in groups.items()
        if items
    )


_GROUPS = {
    ("right moves", "False alarms that fell and hits that rose: what the depth is for."): (
        "false_alarm",
        "hit",
    ),
    ("wrong moves", "Hits that fell and false alarms that rose: what it costs."): ("hit", "false_alarm"),
}


@dataclass(frozen=True)
class _Item:
    """A candidate by image and rank, and its place before and after among ``n``."""

    image_id: int
    rank: int
    before: int
    after: int
    n: int


def _picks(run: Run, detector: str, mode: str, per_shelf: int) -> dict[tuple[str, str], list[_Item]]:
    """The candidates that moved most, by group."""
    rows = run.of(detector)
    before = places(match_table(run, detector, "detector").ranking)
    after = places(match_table(run, detector, mode).ranking)
    outcome = rows[f"outcome_{mode}" if f"outcome_{mode}" in rows else "outcome_detector"]
    groups = {}
    for words, (falling, rising) in _GROUPS.items():
        moved = np.where(outcome == falling, after - before, np.where(outcome == rising, before - after, 0))
        if falling == "false_alarm":
            # a candidate without evidence keeps its score: others moved past it, depth did nothing to it
            moved = np.where(np.isfinite(rows["depth_difference"]), moved, 0)
        best = [i for i in np.argsort(-moved, kind="stable")[:per_shelf] if moved[i] > 0]
        groups[words] = [
            _Item(int(rows["image_id"][i]), int(rows["rank"][i]), int(before[i]), int(after[i]), len(before))
            for i in best
        ]
    return groups


def _mover(detector: str, item: _Item, c: CandidateView, view: FrameView) -> Mover:
    return Mover(
        detector=detector,
        image_id=item.image_id,
        rank=item.rank,
        outcome=c.outcome,
        kind=c.kind.replace("_", " "),
        before=item.before,
        after=item.after,
        n=item.n,
        likelihood=c.likelihood,
        posterior=c.posterior,
        depth_difference=c.depth_difference,
        evidence=status_text(c.status) + (f": {c.reason_detail}" if c.reason_detail else ""),
        panels=candidate_panels(view, c),
        metric=view.metric,
    )
