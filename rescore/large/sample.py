"""The sample of a run in parts: the frames that a person would look at, as a run of their own.

Rescoring changes few of very many candidates. What changed at the operating point falls into strata: what it
was (a car lost or gained, a false alarm rejected or accepted), what fills the box where that is known, and
how large the box is. The sample takes the largest changes of each stratum in turn, so that a rare kind is
seen beside a common one. Figures of the sample are those of chosen frames: the run itself has the true ones.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray
from rescore.data.frames import DataSet
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.registration import Registration
from rescore.formats.coco import DetectionFile
from rescore.formats.coco_write import overwrite_dataset
from rescore.formats.parts.candidates import arrays_of_table, mode_of
from rescore.formats.parts.forms import RESCORED
from rescore.formats.parts.table import PartTable
from rescore.fusion.tune import Tuning
from rescore.large.inputs import Frames, chosen_frames
from rescore.large.rescored import PartsByImage
from rescore.metrics.curves import RECALL_LEVELS
from rescore.results.candidate_file import ALONE, score_column
from rescore.results.changes import DEFAULT_RECALL
from rescore.results.evaluate import evaluate
from rescore.results.metrics_file import Metrics

FRAMES_OF_SAMPLE = 200
"""Frames of a sample: as many as a person looks at, and a recording holds in a few hundred megabytes."""
HEIGHTS_PX = (40.0, 90.0)
"""Limits between small, middle and large boxes."""


def write_sample(
    run_dir: Path,
    metrics: Metrics,
    frames: Frames,
    tables: Sequence[PartTable],
    tunings: Mapping[tuple[str, Registration], Tuning],
    min_iou: float,
) -> DataSet:
    """Write the sample of a run as a run folder ``sample``, its data set beside it; returns that data set."""
    candidates = PartTable.read(run_dir / "candidates")
    data = chosen_frames(frames, frames_to_look_at(candidates, metrics))
    folder = run_dir / "sample"
    overwrite_dataset(folder / "data", data, copy=False)
    files = [_file(table, data) for table in tables]
    evaluate(data, files, folder, tunings=tunings, min_iou=min_iou)
    return data


def _file(table: PartTable, data: DataSet) -> DetectionFile:
    """The detections of a table on some images."""
    found = PartsByImage(table)
    rows = [found.rows(f.image_id) for f in data.frames]
    known = [r for r in rows if r is not None]
    rescored = table.kind == RESCORED
    posterior = np.concatenate([np.zeros(0), *(p for _, p in known if p is not None)])
    return DetectionFile(
        detector=str(table.said("detector")),
        table=CandidateTable.concatenate([t for t, _ in known]),
        posterior=posterior if rescored else None,
        w=table.about.get("w") if rescored else None,
        registration=mode_of(table),
        n_beyond_max=0,
    )


@dataclass(frozen=True, eq=False)
class _Change:
    """Candidates that count otherwise than before, n in all."""

    image_id: IntArray
    stratum: NDArray[np.object_]
    size: FloatArray
    """How much the score changed, shape (n,): the logarithm of its ratio."""

    def best(self, most: int) -> "_Change":
        """The largest changes of each stratum, the largest first."""
        order = np.argsort(-self.size, kind="stable")
        place = np.zeros(len(order), np.int64)
        seen: dict[str, int] = {}
        for k, name in enumerate(self.stratum[order].tolist()):
            place[k] = seen.get(name, 0)
            seen[name] = place[k] + 1
        kept = order[place < most]
        return _Change(self.image_id[kept], self.stratum[kept], self.size[kept])

    @staticmethod
    def joined(parts: "Sequence[_Change]") -> "_Change":
        return _Change(
            np.concatenate([p.image_id for p in parts]),
            np.concatenate([p.stratum for p in parts]),
            np.concatenate([p.size for p in parts]),
        )


def frames_to_look_at(candidates: PartTable, metrics: Metrics) -> IntArray:
    """Ids of the frames of the sample of a run, shape (k,); without rescoring, frames evenly spread."""
    keys = [(row.detector, row.mode) for row in metrics.rows]
    least = {key: _threshold(candidates, *key, metrics) for key in keys}
    best = _Change(np.zeros(0, np.int64), np.zeros(0, object), np.zeros(0))
    seen: list[IntArray] = []
    for columns in _columns(candidates, metrics.modes):
        seen.append(np.unique(columns["image_id"])[:1])
        for detector, mode in keys:
            own = columns["detector"] == detector
            if mode != ALONE and own.any():
                rows = {name: column[own] for name, column in columns.items()}
                found = _changes(rows, mode, least[detector, ALONE], least[detector, mode])
                best = _Change.joined([best, found]).best(FRAMES_OF_SAMPLE)
    chosen = _in_turn(best)
    if not len(chosen):
        chosen = np.concatenate([np.zeros(0, np.int64), *seen])[:FRAMES_OF_SAMPLE]
    return chosen


def _columns(candidates: PartTable, modes: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
    names = ["detector", "image_id", "kind", "y0", "y1", "detector_score"]
    for mode in modes:
        names += [score_column(mode), f"outcome_{mode}", f"annotation_id_{mode}"]
    for part in candidates.parts:
        yield arrays_of_table(candidates.columns(part, names))


def _threshold(candidates: PartTable, detector: str, mode: str, metrics: Metrics) -> float:
    """The score from which a mode finds the usual share of the cars, or the largest level that all reach."""
    ceilings = [row.recall_ceiling or 0.0 for row in metrics.rows if row.detector == detector]
    levels = [level for level in RECALL_LEVELS if level <= min(DEFAULT_RECALL, *ceilings) + 1e-9]
    if not levels:
        return -np.inf
    needed = int(np.ceil(max(levels) * metrics.n_cars - 1e-9))
    score = "detector_score" if mode == ALONE else score_column(mode)
    hits = []
    for part in candidates.parts:
        rows = arrays_of_table(candidates.columns(part, ["detector", score, f"outcome_{mode}"]))
        hits.append(rows[score][(rows["detector"] == detector) & (rows[f"outcome_{mode}"] == "hit")])
    found = np.concatenate(hits)
    return float(-np.partition(-found, needed - 1)[needed - 1])


def _changes(rows: Mapping[str, NDArray[Any]], mode: str, before: float, after: float) -> _Change:
    """The candidates of a detector in one part that count otherwise in a mode than alone."""
    was, now = rows["detector_score"] >= before, rows[score_column(mode)] >= after
    hit_was, hit_now = rows[f"outcome_{ALONE}"] == "hit", rows[f"outcome_{mode}"] == "hit"
    found_was = rows[f"annotation_id_{ALONE}"][was & hit_was]
    found_now = rows[f"annotation_id_{mode}"][now & hit_now]
    wrong = np.isin(rows[f"outcome_{mode}"], ("false_alarm", "duplicate"))
    masks = {
        "lost": was & hit_was & ~np.isin(rows[f"annotation_id_{ALONE}"], found_now),
        "gained": now & hit_now & ~np.isin(rows[f"annotation_id_{mode}"], found_was),
        "rejected": was & ~now & wrong,
        "accepted": now & ~was & wrong,
    }
    alone, score = (np.maximum(rows[score_column(m)], 1e-6) for m in (ALONE, mode))
    size = np.abs(np.log(score / alone))
    height = np.searchsorted(HEIGHTS_PX, rows["y1"] - rows["y0"])
    parts = []
    for name, mask in masks.items():
        stratum = [f"{name} {k} {h}" for k, h in zip(rows["kind"][mask], height[mask], strict=True)]
        parts.append(_Change(rows["image_id"][mask], np.array(stratum, dtype=object), size[mask]))
    return _Change.joined(parts)


def _in_turn(best: _Change) -> IntArray:
    """Frames of the largest changes, one of each stratum in turn."""
    waiting: dict[str, list[int]] = {}
    for name, image_id in zip(best.stratum.tolist(), best.image_id.tolist(), strict=True):
        waiting.setdefault(name, []).append(image_id)
    chosen: dict[int, None] = {}
    while waiting and len(chosen) < FRAMES_OF_SAMPLE:
        for name in sorted(waiting):
            own = waiting[name]
            while own and own[0] in chosen:
                own.pop(0)
            if not own:
                del waiting[name]
            elif len(chosen) < FRAMES_OF_SAMPLE:
                chosen[own.pop(0)] = None
    return np.array(list(chosen), np.int64)
