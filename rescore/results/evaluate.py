"""Evaluation: detections of a test set to the match table, ``candidates.parquet`` and ``metrics.json``."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import RescoreError
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.data.rendered_kinds import kinds_of_candidates
from rescore.detectors.base import Detections
from rescore.evidence.candidates import NOT_RESCORED, CandidateTable
from rescore.evidence.registration import CUES, Registration
from rescore.files import read_json, write_json
from rescore.formats.coco import DetectionFile
from rescore.fusion.fuse import posteriors
from rescore.fusion.tune import OBJECTIVE, Tuning
from rescore.fusion.weight_interval import uncertainty_as_json
from rescore.metrics.bootstrap import BootstrapConfig
from rescore.metrics.curves import Summary, summarise
from rescore.metrics.matching import HIT, IGNORED, OUTCOMES, MatchTable, TruthTable, greedy_match, ranking_of
from rescore.metrics.reliability import reliability
from rescore.results.candidate_file import write_candidates
from rescore.results.comparisons import certainty
from rescore.results.difficulty import difficulty

Columns = dict[str, NDArray[Any]]

DETECTOR_MODE = "detector"
"""Ranked by the raw score of the detector alone."""
RELIABILITY_BINS = 20
"""Fewer than one candidate in ten is a hit: with fewer bins nearly all hits would be in one."""


def evaluate(
    data: DataSet,
    files: Sequence[DetectionFile],
    run_dir: Path,
    *,
    tunings: Mapping[tuple[str, Registration], Tuning] | None = None,
    min_iou: float = 0.5,
    seed: int = 0,
) -> dict[str, Any]:
    """Write ``candidates.parquet`` and ``metrics.json`` of detections into a run folder; returns the metrics.

    Each detector gives a row "detector" and one for each mode in which it was rescored.

    Args:
        data: the test frames; every one counts, with candidates or not.
        files: one for each detector and mode; those of one detector hold the same candidates.
        run_dir: where to write.
        tunings: the choice of w by detector and mode, kept beside the figures.
        min_iou: overlap from which a candidate has found a car.
        seed: draws the images that the intervals come from.

    Raises:
        RescoreError: no frames, no detections, two files of one detector and mode, or files of one detector
            with different candidates.
    """
    _check(data, files)
    truth = TruthTable.of(data if has_cars(data) else unjudged(data))
    tunings = tunings or {}
    parts: list[Columns] = []
    found: dict[str, list[dict[str, Any]]] = {
        name: [] for name in ("rows", "comparisons", "fusion", "reliability")
    }
    firsts: list[DetectionFile] = []
    for own in _by_detector(files):
        matched = {f.registration: _match(f, truth, min_iou) for f in own if f.posterior is not None}
        alone = _match_alone(own[0], truth, min_iou)
        kind = _kinds(data, own[0].table)
        parts.append(_columns(own, alone, matched) | {"kind": kind})
        sure = certainty(
            {DETECTOR_MODE: alone, **{str(m): t for m, t in matched.items()}}, kind, truth.cars_of_image, seed
        )
        name = {"detector": own[0].detector}
        found["rows"] += [r | {"intervals": sure.intervals[r["mode"]]} for r in _rows(own, alone, matched)]
        found["comparisons"] += [name | c for c in sure.comparisons]
        for file in own:
            found["fusion"] += _fusion(file, alone, truth, min_iou, tunings)
        found["reliability"] += _reliabilities(own, alone, matched)
        firsts.append(own[0])
    metrics = {
        "n_images": truth.n_images,
        "n_cars": truth.n_cars,
        "n_candidates": sum(len(f.table) for f in firsts),
        **found,
        "bootstrap": {
            "n_resamples": BootstrapConfig().n_resamples,
            "confidence": BootstrapConfig().confidence,
            "seed": seed,
        },
        "stereo": _stereo(data),
        "reasons": {f.detector: dict(sorted(Counter(f.table.status.tolist()).items())) for f in firsts},
        "tuning": _tuning(tunings),
        "difficulty": {f.detector: _difficulty(data, f.table) for f in firsts},
    }
    names = dict.fromkeys(name for p in parts for name in p)
    table = {name: np.concatenate([_column(p, name) for p in parts]) for name in names}
    write_candidates(run_dir / "candidates.parquet", table)
    write_json(run_dir / "metrics.json", metrics)
    return metrics


def has_cars(data: DataSet) -> bool:
    """Whether any car is annotated that can be found."""
    return any((~truth.ignore).any() for truth in data.truth.values())


def unjudged(data: DataSet) -> DataSet:
    """The data set with an ignore region over each picture, so that no candidate is right or wrong.

    For frames without annotated cars: users' own without labels. Nothing is known of their candidates, and to
    call all of them false alarms would be a claim.
    """
    return replace(data, truth={f.image_id: _nothing_known(f) for f in data.frames})


def _nothing_known(frame: FrameRecord) -> Truth:
    # beyond the edges, since a candidate may lie there
    w, h = frame.width_px, frame.height_px
    region = np.array([[-w, -h, 2.0 * w, 2.0 * h]])
    return Truth(np.full(1, -1), region, np.ones(1, np.bool_), np.full(1, np.nan), ("",))


def _check(data: DataSet, files: Sequence[DetectionFile]) -> None:
    if not data.frames:
        raise RescoreError(
            f"{data.root}: expected frames to evaluate, got none of the split; choose another split"
        )
    if not files:
        raise RescoreError("evaluate: expected at least one file of detections, got none; name one")
    kinds = Counter((f.detector, f.registration if f.posterior is not None else "raw") for f in files)
    twice = [f"{name!r} ({kind})" for (name, kind), count in kinds.items() if count > 1]
    if twice:
        raise RescoreError(
            f"evaluate: expected one file a detector and mode, got two of {twice[0]}; rename one"
        )


def _by_detector(files: Sequence[DetectionFile]) -> list[list[DetectionFile]]:
    """The files of each detector, the one of eq. 6 first: its columns are always there."""
    groups: dict[str, list[DetectionFile]] = {}
    for file in files:
        groups.setdefault(file.detector, []).append(file)
    for own in groups.values():
        own.sort(key=lambda f: (f.posterior is None, list(Registration).index(f.registration)))
        first = own[0].table
        for other in own[1:]:
            t = other.table
            same = len(t) == len(first) and np.array_equal(t.xyxy_px, first.xyxy_px)
            if not (same and np.array_equal(t.image_id, first.image_id)):
                raise RescoreError(
                    f"evaluate: expected the same candidates in all files of {other.detector!r}, those of "
                    f"mode {other.registration} differ from those of mode {own[0].registration}; apply both "
                    "modes to one file of detections"
                )
    return list(groups.values())


def _match_alone(file: DetectionFile, truth: TruthTable, min_iou: float) -> MatchTable:
    t = file.table
    return greedy_match(t.image_id, t.xyxy_px, ranking_of(t.score, t.score), truth, min_iou)


def _match(file: DetectionFile, truth: TruthTable, min_iou: float) -> MatchTable:
    t = file.table
    assert file.posterior is not None
    return greedy_match(t.image_id, t.xyxy_px, ranking_of(file.posterior, t.score), truth, min_iou)


def _columns(
    own: Sequence[DetectionFile], alone: MatchTable, matched: Mapping[Registration, MatchTable]
) -> Columns:
    """The columns of one detector, with all its modes."""
    t = own[0].table
    # a file that was not rescored has no D, so it may stand for that of eq. 6
    file = next((f for f in own if f.registration is Registration.PAPER), None)
    nothing = np.full(len(t), np.nan)
    posterior = file.posterior if file is not None and file.posterior is not None else t.likelihood
    w = np.nan if file is None or file.w is None else file.w
    paper = matched.get(Registration.PAPER, alone)
    columns: Columns = {
        "detector": np.full(len(t), own[0].detector, dtype=object),
        "image_id": t.image_id,
        "rank": t.rank,
        **dict(zip(("x0", "y0", "x1", "y1"), t.xyxy_px.T, strict=True)),
        "detector_score": t.score,
        "likelihood": t.likelihood,
        "status": t.status,
        "reason_detail": t.reason_detail,
        "depth_difference": t.depth_difference if file is not None else nothing,
        "scale": t.scale,
        "offset": t.offset,
        "valid_share": t.valid_share,
        "stereo_low": t.stereo_low,
        "stereo_span": t.stereo_span,
        "posterior_paper": posterior,
        "w": np.full(len(t), w),
        "outcome_detector": _names(alone),
        "outcome_paper": _names(paper),
        "annotation_id_detector": alone.annotation_id,
        "annotation_id_paper": paper.annotation_id,
        **{f"cue_{name}": column for name, column in zip(CUES, t.cues.T, strict=True)},
    }
    for other in own:
        if other.registration in matched and other.registration is not Registration.PAPER:
            columns |= _mode_columns(other, matched[other.registration])
    return columns


def _mode_columns(file: DetectionFile, match: MatchTable) -> Columns:
    mode = file.registration.value
    assert file.posterior is not None
    return {
        f"difference_{mode}": file.table.depth_difference,
        f"status_{mode}": file.table.status,
        f"posterior_{mode}": file.posterior,
        f"w_{mode}": np.full(len(file.table), np.nan if file.w is None else file.w),
        f"outcome_{mode}": _names(match),
        f"annotation_id_{mode}": match.annotation_id,
    }


def _column(part: Columns, name: str) -> NDArray[Any]:
    """A column of one detector; where only others have the mode, what it would be without rescoring."""
    if name in part:
        return part[name]
    start = name.rpartition("_")[0]
    stand_in = {
        "posterior": "likelihood",
        "outcome": "outcome_detector",
        "annotation_id": "annotation_id_detector",
    }
    if start in stand_in:
        return part[stand_in[start]]
    n = len(part["image_id"])
    return np.full(n, NOT_RESCORED, dtype=object) if start == "status" else np.full(n, np.nan)


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


def _rows(
    own: Sequence[DetectionFile], alone: MatchTable, matched: Mapping[Registration, MatchTable]
) -> list[dict[str, Any]]:
    """The rows of one detector: alone, then in each mode."""
    weights = {f.registration: f.w for f in own}
    return [
        _row(own[0].detector, DETECTOR_MODE, 1.0, summarise(alone)),
        *(_row(own[0].detector, m, weights[m], summarise(match)) for m, match in matched.items()),
    ]


def _fusion(
    file: DetectionFile,
    alone: MatchTable,
    truth: TruthTable,
    min_iou: float,
    tunings: Mapping[tuple[str, Registration], Tuning],
) -> list[dict[str, Any]]:
    """The figures of each way of fusing in one mode, by ``rescore.fusion.fuse``; none without rescoring."""
    if file.posterior is None:
        return []
    t, tuning = file.table, tunings.get((file.detector, file.registration))
    tables = {DETECTOR_MODE: alone}
    for rule, score in posteriors(t, file.w, None if tuning is None else tuning.learned).items():
        ranking = ranking_of(score, t.score)
        tables[rule] = greedy_match(t.image_id, t.xyxy_px, ranking, truth, min_iou)
    name = {"detector": file.detector, "mode": file.registration.value}
    return [name | {"rule": rule} | _figures(summarise(match)) for rule, match in tables.items()]


def _reliabilities(
    own: Sequence[DetectionFile], alone: MatchTable, matched: Mapping[Registration, MatchTable]
) -> list[dict[str, Any]]:
    """Whether l and the posterior of each mode are what they say; none where scores are not calibrated."""
    scores = {
        f.registration.value: (f.posterior, matched[f.registration]) for f in own if f.registration in matched
    }
    found = []
    for mode, (score, match) in {DETECTOR_MODE: (own[0].table.likelihood, alone), **scores}.items():
        use = match.outcome != IGNORED
        if score is None or not use.any() or np.isnan(score[use]).any():
            continue
        r = reliability(score[use], match.outcome[use] == HIT, RELIABILITY_BINS)
        curve = {n: getattr(r, n).tolist() for n in ("likelihood", "hit_rate", "low", "high", "count")}
        figures = {"brier_score": r.brier_score, "calibration_error": r.calibration_error}
        found.append({"detector": own[0].detector, "mode": mode, **figures, **curve})
    return found


def _row(detector: str, mode: str, w: float | None, summary: Summary) -> dict[str, Any]:
    return {
        "detector": detector,
        "mode": mode,
        "w": w,
        **_figures(summary),
    }


def _figures(summary: Summary) -> dict[str, Any]:
    return {
        "auc": _number(summary.auc),
        "average_precision": _number(summary.average_precision),
        "recall_ceiling": _number(summary.recall_ceiling),
        "fppi_at_recall": {f"{level:g}": value for level, value in summary.fppi_at_recall.items()},
    }


def _number(value: float) -> float | None:
    """JSON has neither NaN nor infinity: an undefined figure, or one that is never reached, is null."""
    return value if np.isfinite(value) else None


def _difficulty(data: DataSet, table: CandidateTable) -> dict[str, Any]:
    """What the detector alone makes of the cars that are seen well (see ``rescore.results.difficulty``)."""
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


def _tuning(tunings: Mapping[tuple[str, Registration], Tuning]) -> dict[str, Any]:
    """The choice of w by detector: for eq. 6 as printed (or the first there is), the others under "modes"."""
    found: dict[str, Any] = {}
    for (name, mode), t in sorted(tunings.items(), key=lambda item: item[0][1] != Registration.PAPER):
        one = {
            "w": t.w,
            "objective_name": OBJECTIVE,
            "w_grid": t.grid.tolist(),
            "objective": [_number(v) for v in t.value.tolist()],
            "n_images": t.n_images,
            "sentence": t.sentence,
            "uncertainty": uncertainty_as_json(t.uncertainty),
            "learned": None if t.learned is None else asdict(t.learned),
        }
        found.setdefault(name, one | {"modes": {}})["modes"][str(mode)] = one
    return found
