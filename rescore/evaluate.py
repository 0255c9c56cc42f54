"""Evaluation: detections of a test set to the match table, ``candidates.parquet`` and ``metrics.json``."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import RescoreError
from rescore.detectors.base import Detections
from rescore.difficulty import difficulty
from rescore.evidence import NOT_RESCORED, CandidateTable
from rescore.formats.coco import DetectionFile
from rescore.frames import DataSet
from rescore.kinds import kinds_of_candidates
from rescore.matching import OUTCOMES, MatchTable, TruthTable, greedy_match, ranking_of
from rescore.metrics import Summary, summarise
from rescore.store import CANDIDATE_COLUMNS, read_json, write_candidates, write_json
from rescore.tune import Tuning

FloatArray = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]

DETECTOR_MODE = "detector"
"""Ranked by the raw score of the detector alone."""
PAPER_MODE = "paper"
"""Ranked by the posterior of eqs. 6 and 7 as printed."""


def evaluate(
    data: DataSet,
    files: Sequence[DetectionFile],
    run_dir: Path,
    *,
    tunings: Mapping[str, Tuning] | None = None,
    min_iou: float = 0.5,
) -> dict[str, Any]:
    """Write ``candidates.parquet`` and ``metrics.json`` of detections into a run folder; returns the latter.

    Each file gives a row "detector" and, where it was rescored, a row "paper".

    Args:
        data: the test frames; every one counts, with candidates or not.
        files: one for each detector.
        run_dir: where to write.
        tunings: the choice of w by detector, kept beside the figures.
        min_iou: overlap from which a candidate has found a car.

    Raises:
        RescoreError: no frames, no detections, or two files of one detector.
    """
    _check(data, files)
    truth = TruthTable.of(data)
    parts: list[Columns] = []
    rows: list[dict[str, Any]] = []
    for file in files:
        columns, matches = _match_file(file, truth, min_iou)
        columns["kind"] = _kinds(data, file.table)
        parts.append(columns)
        for mode, match in matches.items():
            w = 1.0 if mode == DETECTOR_MODE else file.w
            rows.append(_row(file.detector, mode, w, summarise(match)))
    metrics = {
        "n_images": truth.n_images,
        "n_cars": truth.n_cars,
        "n_candidates": sum(len(f.table) for f in files),
        "rows": rows,
        "stereo": _stereo(data),
        "reasons": {f.detector: dict(sorted(Counter(f.table.status.tolist()).items())) for f in files},
        "tuning": _tuning(tunings or {}),
        "difficulty": {f.detector: _difficulty(data, f.table) for f in files},
    }
    table = {name: np.concatenate([p[name] for p in parts]) for name in CANDIDATE_COLUMNS}
    write_candidates(run_dir / "candidates.parquet", table)
    write_json(run_dir / "metrics.json", metrics)
    return metrics


def _check(data: DataSet, files: Sequence[DetectionFile]) -> None:
    if not data.frames:
        raise RescoreError(
            f"{data.root}: expected frames to evaluate, got none of the split; choose another split"
        )
    if not files:
        raise RescoreError("evaluate: expected at least one file of detections, got none; name one")
    twice = [name for name, count in Counter(f.detector for f in files).items() if count > 1]
    if twice:
        raise RescoreError(f"evaluate: expected one file a detector, got two of {twice[0]!r}; rename one")


def _match_file(
    file: DetectionFile, truth: TruthTable, min_iou: float
) -> tuple[Columns, dict[str, MatchTable]]:
    """The columns of one detector, and its match table in each mode."""
    t = file.table
    detector = greedy_match(t.image_id, t.xyxy_px, ranking_of(t.score, t.score), truth, min_iou)
    matches = {DETECTOR_MODE: detector}
    posterior = t.likelihood
    if file.posterior is not None:
        posterior = file.posterior
        ranking = ranking_of(posterior, t.score)
        matches[PAPER_MODE] = greedy_match(t.image_id, t.xyxy_px, ranking, truth, min_iou)
    paper = matches.get(PAPER_MODE, detector)
    columns: Columns = {
        "detector": np.full(len(t), file.detector, dtype=object),
        "image_id": t.image_id,
        "rank": t.rank,
        **dict(zip(("x0", "y0", "x1", "y1"), t.xyxy_px.T, strict=True)),
        "detector_score": t.score,
        "likelihood": t.likelihood,
        "status": t.status,
        "reason_detail": t.reason_detail,
        "depth_difference": t.depth_difference,
        "scale": t.scale,
        "offset": t.offset,
        "valid_share": t.valid_share,
        "stereo_low": t.stereo_low,
        "stereo_span": t.stereo_span,
        "posterior_paper": posterior,
        "w": np.full(len(t), np.nan if file.w is None else file.w),
        "outcome_detector": _names(detector),
        "outcome_paper": _names(paper),
        "annotation_id_detector": detector.annotation_id,
        "annotation_id_paper": paper.annotation_id,
    }
    return columns, matches


def _names(match: MatchTable) -> NDArray[np.object_]:
    return np.array([o.value for o in OUTCOMES], dtype=object)[match.outcome]


def _kinds(data: DataSet, table: CandidateTable) -> NDArray[np.object_]:
    """What mostly fills each candidate's box, frame by frame."""
    kinds = np.full(len(table), NOT_RESCORED, dtype=object)
    for record in data.frames:
        rows = np.flatnonzero(table.image_id == record.image_id)
        if len(rows):
            kinds[rows] = kinds_of_candidates(record, table.xyxy_px[rows])
    return kinds


def _row(detector: str, mode: str, w: float | None, summary: Summary) -> dict[str, Any]:
    return {
        "detector": detector,
        "mode": mode,
        "w": w,
        "auc": _number(summary.auc),
        "average_precision": _number(summary.average_precision),
        "recall_ceiling": _number(summary.recall_ceiling),
        "fppi_at_recall": {f"{level:g}": value for level, value in summary.fppi_at_recall.items()},
    }


def _number(value: float) -> float | None:
    """JSON has no NaN: an undefined figure is null."""
    return None if np.isnan(value) else value


def _difficulty(data: DataSet, table: CandidateTable) -> dict[str, Any]:
    """What the detector alone makes of the cars that are seen well (see ``rescore.difficulty``)."""
    found = {
        f.image_id: Detections(table.xyxy_px[rows], table.score[rows])
        for f in data.frames
        if len(rows := np.flatnonzero(table.image_id == f.image_id))
    }
    hard = difficulty(data, found)
    return {
        "n_cars": hard.n_cars,
        "recall_ceiling": _number(hard.recall_ceiling),
        "fppi_at_70": hard.fppi_at_70,
        "share_by_kind": dict(hard.share_by_kind),
    }


def _stereo(data: DataSet) -> Any:
    """Error of the measured depth, where the data set was rendered and so knows it."""
    file = data.root / "stereo.json"
    return read_json(file, "stereo statistics") if file.is_file() else {}


def _tuning(tunings: Mapping[str, Tuning]) -> dict[str, Any]:
    return {
        name: {
            "w": t.w,
            "objective_name": t.objective.value,
            "w_grid": t.grid.tolist(),
            "objective": [_number(v) for v in t.value.tolist()],
        }
        for name, t in tunings.items()
    }
