"""What a recording tells of a run: modes, operating points, what changed there, which frames to show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from recon.arrays import BoolArray, FloatArray, IntArray
from recon.errors import RescoreError
from reports.run.changes_text import explain_config, model_of
from reports.run.curves import match_table, scores
from reports.run.frame_view import CandidateView, run_data
from rescore.data.frames import DataSet
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration
from rescore.metrics.matching import HIT, IGNORED, MatchTable
from rescore.results.candidate_file import ALONE, difference
from rescore.results.changes import CHANGED, Changes, Group, OperatingPoint, default_point
from rescore.results.explain import Explanation, explain
from rescore.results.run_folder import Run

_DISAGREEING = 0.2


class Frames(StrEnum):
    """The choice of frames that a recording shows."""

    ALL = "all"
    FLIPS = "flips"
    """Frames where a candidate counts otherwise after rescoring."""
    WORST = "worst"
    """Frames where a car is lost or a false alarm newly accepted."""

    @classmethod
    def named(cls, name: str) -> "Frames":
        """The choice of that name.

        Raises:
            RescoreError: there is none.
        """
        if name not in [f.value for f in cls]:
            raise RescoreError(
                f"--frames: expected {', '.join(f.value for f in cls)}, got {name!r}; choose one"
            )
        return cls(name)


@dataclass(frozen=True, eq=False)
class Story:
    """A run with the mode that is explained."""

    run: Run
    mode: str
    """The way of scoring that is compared with the detector alone."""
    points: Mapping[str, OperatingPoint]
    """Operating points by detector: where its curves are compared."""
    tables: Mapping[tuple[str, str], MatchTable]
    """Match tables by detector and mode."""
    changes: Mapping[tuple[str, str], Changes]
    """Changes against the detector alone, by detector and mode."""
    explanations: Mapping[str, tuple[Explanation, ...]]
    """Why each candidate of a detector rose or fell, by detector; empty where it was not rescored in the
    mode."""
    models: Mapping[str, EvidenceModel]
    """Models of depth evidence that were used, by detector, where the run folder has them."""
    data: DataSet
    """The frames that the run was evaluated on."""

    @classmethod
    def of(cls, run: Run, mode: str | None = None) -> "Story":
        """The story of a run; ``mode`` is the last of metrics.json unless it is named.

        Raises:
            RescoreError: the run has no such mode.
        """
        mode = mode or run.modes[-1]
        if mode not in run.modes:
            raise RescoreError(f"mode: expected one of {', '.join(run.modes)}, got {mode!r}; choose one")
        keys = [(row.detector, row.mode) for row in run.metrics.rows]
        found = {key: match_table(run, *key) for key in keys}
        points = {d: default_point(*(t for (own, _), t in found.items() if own == d)) for d in run.detectors}
        changes = {
            (d, m): Changes.between(found[d, ALONE], table, points[d]) for (d, m), table in found.items()
        }
        told: dict[str, tuple[Explanation, ...]] = {}
        models: dict[str, EvidenceModel] = {}
        for d in run.detectors:
            if mode != ALONE and (d, mode) in found:
                told[d], model = _explained(run, d, mode, changes[d, mode])
                models |= {} if model is None else {d: model}
        return cls(run, mode, points, found, changes, told, models, run_data(run))

    def mode_of(self, detector: str) -> str:
        """The mode that is explained; the detector alone where it was not rescored in that mode."""
        return self.mode if (detector, self.mode) in self.tables else ALONE

    def shows_fits(self, detector: str) -> bool:
        """Whether what is explained of a detector is what instances fitted to its boxes say."""
        return self.mode_of(detector) == Registration.INSTANCE

    def modes_of(self, detector: str) -> tuple[str, ...]:
        """The modes of a detector, it alone first."""
        return tuple(m for d, m in self.tables if d == detector)

    def accepted(self, detector: str, mode: str) -> BoolArray:
        """Whether each candidate (n,) of a detector is accepted at its operating point."""
        return self.changes[detector, mode].after.accepted

    def threshold(self, detector: str, mode: str) -> float:
        """The least score that is accepted at the operating point; 1 where none is."""
        score = scores(self.run, detector, mode)[self.accepted(detector, mode)]
        return float(score.min()) if len(score) else 1.0

    def group(self, detector: str, c: CandidateView) -> Group:
        """What became of a candidate in the mode that is explained."""
        return Group(self.changes[detector, self.mode_of(detector)].group[c.row])

    def rates(self, detector: str, mode: str, accepted: BoolArray) -> tuple[float, float, float]:
        """False positives an image, share of cars found and precision; NaN where undefined."""
        t = self.tables[detector, mode]
        hits = int(((t.outcome == HIT) & accepted).sum())
        wrong = int(((t.outcome != HIT) & (t.outcome != IGNORED) & accepted).sum())
        return wrong / max(t.n_images, 1), _share(hits, t.n_cars), _share(hits, hits + wrong)

    def most_telling(self, detector: str, candidates: Sequence[CandidateView]) -> CandidateView | None:
        """The candidate of a frame whose change says most: of the false alarms rejected (or else of what
        counts otherwise, or else of all) the one whose score moved most."""
        return max(candidates, key=lambda c: self._weight(detector, c), default=None)

    def moved(self, detector: str) -> FloatArray:
        """How much the score of each candidate (n,) moved: its logarithm, weighed with the larger score.

        Less where its own depth does not say so, that is, where others moved past it: a low D should rise.
        """
        return self._moved[detector]

    @cached_property
    def _moved(self) -> dict[str, FloatArray]:
        return {d: self._moves(d) for d in self.run.detectors}

    def _moves(self, detector: str) -> FloatArray:
        mode = self.mode_of(detector)
        before = np.maximum(scores(self.run, detector, ALONE), 1e-6)
        after = np.maximum(scores(self.run, detector, mode), 1e-6)
        d = difference(self.run.of(detector), mode)
        middle = np.nanmedian(d) if np.isfinite(d).any() else 0.0
        agrees = (middle - d) * self.changes[detector, mode].delta > 0
        weight = np.where(agrees, 1.0, _DISAGREEING)
        return np.asarray(weight * np.maximum(before, after) * np.abs(np.log(after / before)))

    def _weight(self, detector: str, c: CandidateView) -> tuple[int, bool, float]:
        group = self.group(detector, c)
        order = (Group.REJECTED_FALSE_ALARM, Group.LOST_CAR, Group.ACCEPTED_FALSE_ALARM, Group.GAINED_CAR)
        place = len(order) - order.index(group) if group in order else 0
        return place, c.registered is not None or c.fit is not None, float(self.moved(detector)[c.row])


def choose_frames(story: Story, which: Frames = Frames.ALL, max_frames: int | None = None) -> IntArray:
    """Ids of the images to show, the most telling first.

    Those come first where a car is found and the score of a candidate of the kind moved most.

    Of all frames, ``max_frames`` evenly spread ones; of the others the first so many.

    Raises:
        RescoreError: no frame is of that kind.
    """
    ids = np.array([f.image_id for f in story.data.frames], dtype=np.int64)
    most = np.array([_most_moved(story, d, which, ids) for d in story.run.detectors])
    if which is Frames.ALL and max_frames is not None and max_frames < len(ids):
        spread = np.unique(np.linspace(0, len(ids) - 1, max_frames).round().astype(int))
        ids, most = ids[spread], most[:, spread]
    # the first detector is the one that the blueprint shows
    kept = _keeps_a_car(story, story.run.detectors[0], ids)
    order = np.lexsort((np.arange(len(ids)), -most.max(axis=0), -most[0], ~(kept & (most[0] > 0))))
    if which is not Frames.ALL:
        order = order[most.max(axis=0)[order] > 0][:max_frames]
        if not len(order):
            raise RescoreError(
                f"frames: expected some with {which.value}, found none at "
                f"{story.points[story.run.detectors[0]].text}; choose --frames all"
            )
    return np.asarray(ids[order])


def count_flips(story: Story) -> int:
    """Number of frames in which a candidate counts otherwise after rescoring."""
    ids = np.array([f.image_id for f in story.data.frames], dtype=np.int64)
    most = [_most_moved(story, d, Frames.FLIPS, ids) for d in story.run.detectors]
    return int((np.max(most, axis=0) > 0).sum())


def _most_moved(story: Story, detector: str, which: Frames, ids: IntArray) -> FloatArray:
    """How much a candidate of the wanted kind moved at most in each image; 0 where none is."""
    wanted = (Group.LOST_CAR, Group.ACCEPTED_FALSE_ALARM) if which is Frames.WORST else CHANGED
    of_kind = np.isin(story.changes[detector, story.mode_of(detector)].group, wanted)
    image_id = story.run.of(detector)["image_id"]
    # one whose score stayed can change sides too, as others move past it
    moved = np.where(of_kind, np.maximum(story.moved(detector), 1e-9), 0.0)
    return np.array([moved[image_id == i].max(initial=0.0) for i in ids])


def _keeps_a_car(story: Story, detector: str, ids: IntArray) -> BoolArray:
    """Whether a car is found after rescoring in each image, shape of ``ids``."""
    found = story.changes[detector, story.mode_of(detector)].after.found
    return np.isin(ids, story.run.of(detector)["image_id"][found])


def _explained(
    run: Run, detector: str, mode: str, changes: Changes
) -> tuple[tuple[Explanation, ...], EvidenceModel | None]:
    """Why each candidate moved, and the model of the evidence; None where the folder has another one."""
    rows, config = run.of(detector), explain_config(run)
    try:
        model = model_of(run, detector, mode)
        return explain(rows, mode, changes.rose, model, config, changes.stayed), model
    except RescoreError:
        return explain(rows, mode, changes.rose, None, config, changes.stayed), None


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")
