"""Evaluation: detections of a test set to the match table, ``candidates.parquet`` and ``metrics.json``."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from recon.errors import RescoreError
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.data.rendered_kinds import kinds_of_table
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.registration import Registration
from rescore.formats.coco import DetectionFile
from rescore.fusion.fuse import posteriors
from rescore.fusion.tune import Tuning
from rescore.fusion.weight_interval import WeightInterval
from rescore.metrics.bootstrap import BootstrapConfig
from rescore.metrics.curves import summarise, ties
from rescore.metrics.matching import HIT, IGNORED, MIN_IOU, MatchTable, TruthTable, greedy_match, ranking_of
from rescore.metrics.reliability import reliability
from rescore.results.candidate_file import ALONE, Columns, Given, detector_columns, joined, write_candidates
from rescore.results.comparisons import certainty
from rescore.results.difficulty import difficulty_of_table
from rescore.results.evaluate3d import TrueCars, boxes3d_rows
from rescore.results.metrics_file import (
    BootstrapSettings,
    Boxes3DRow,
    DetectorDifficulty,
    DetectorTuning,
    FusionRow,
    Intervals,
    Metrics,
    ModeComparison,
    ReliabilityRow,
    Row,
    StereoStatistics,
    TunedWeight,
    finite,
    read_stereo_statistics,
    write_metrics,
)
from rescore.results.run_folder import RunFolder

RELIABILITY_BINS = 20
"""Fewer than one candidate in ten is a hit: with fewer bins nearly all hits would be in one."""


def evaluate(
    data: DataSet,
    files: Sequence[DetectionFile],
    run_dir: Path,
    *,
    tunings: Mapping[tuple[str, Registration], Tuning] | None = None,
    min_iou: float = MIN_IOU,
    seed: int = 0,
) -> Metrics:
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
    rows: list[Row] = []
    comparisons: list[ModeComparison] = []
    fusion: list[FusionRow] = []
    reliabilities: list[ReliabilityRow] = []
    firsts: list[DetectionFile] = []
    solid: list[Boxes3DRow] = []
    hard: dict[str, DetectorDifficulty] = {}
    usual = min_iou == MIN_IOU and has_cars(data)
    cars3d = TrueCars.of(data)
    # one number for all detectors, which are resampled alike
    drawn = BootstrapConfig.for_candidates(max(len(f.table) for f in files))
    for own in _by_detector(files):
        matched = {f.registration: _match(f, truth, min_iou) for f in own if f.posterior is not None}
        alone = _match_alone(own[0], truth, min_iou)
        kind = kinds_of_table(data.frames, own[0].table.image_id, own[0].table.xyxy_px)
        parts.append(detector_columns([Given.of(f) for f in own], alone, matched, kind))
        by_mode = {ALONE: alone, **{str(m): t for m, t in matched.items()}}
        sure = certainty(own[0].detector, by_mode, kind, truth.cars_of_image, seed, drawn)
        rows += _rows(own, alone, matched, sure.intervals)
        comparisons += sure.comparisons
        for file in own:
            fusion += _fusion(file, alone, truth, min_iou, tunings)
        reliabilities += _reliabilities(own, alone, matched)
        firsts.append(own[0])
        hard[own[0].detector] = _difficulty(data, own[0].table, alone if usual else None)
        if cars3d is not None:
            solid += boxes3d_rows(cars3d, own, by_mode)
    metrics = Metrics(
        n_images=truth.n_images,
        n_cars=truth.n_cars,
        n_ignored=data.n_ignored,
        n_candidates=sum(len(f.table) for f in firsts),
        rows=tuple(rows),
        comparisons=tuple(comparisons),
        fusion=tuple(fusion),
        reliability=tuple(reliabilities),
        bootstrap=BootstrapSettings(n_resamples=drawn.n_resamples, confidence=drawn.confidence, seed=seed),
        stereo=_stereo(data),
        reasons={f.detector: dict(sorted(Counter(f.table.status.tolist()).items())) for f in firsts},
        tuning=tuning_rows(tunings),
        difficulty=hard,
        boxes3d=tuple(solid),
    )
    folder = RunFolder(run_dir)
    write_candidates(folder.candidates, joined(parts))
    write_metrics(folder.metrics, metrics)
    return metrics


def has_cars(data: DataSet) -> bool:
    """Whether any car is annotated that can be found."""
    return data.n_cars > 0


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


def _rows(
    own: Sequence[DetectionFile],
    alone: MatchTable,
    matched: Mapping[Registration, MatchTable],
    intervals: Mapping[str, Intervals | None],
) -> list[Row]:
    """The rows of one detector: alone, then in each mode."""
    weights = {ALONE: 1.0, **{str(f.registration): f.w for f in own if f.registration in matched}}
    tables = {ALONE: alone, **{str(m): match for m, match in matched.items()}}
    return [
        Row.of(own[0].detector, mode, weights[mode], summarise(match), intervals[mode], ties(match))
        for mode, match in tables.items()
    ]


def _fusion(
    file: DetectionFile,
    alone: MatchTable,
    truth: TruthTable,
    min_iou: float,
    tunings: Mapping[tuple[str, Registration], Tuning],
) -> list[FusionRow]:
    """The figures of each way of fusing in one mode, by ``rescore.fusion.fuse``; none without rescoring."""
    if file.posterior is None:
        return []
    t, tuning = file.table, tunings.get((file.detector, file.registration))
    summaries = {ALONE: summarise(alone)}
    for rule, score in posteriors(t, file.w, None if tuning is None else tuning.learned).items():
        ranking = ranking_of(score, t.score)
        summaries[rule] = summarise(greedy_match(t.image_id, t.xyxy_px, ranking, truth, min_iou))
    return [FusionRow.of(file.detector, file.registration.value, rule, s) for rule, s in summaries.items()]


def _reliabilities(
    own: Sequence[DetectionFile], alone: MatchTable, matched: Mapping[Registration, MatchTable]
) -> list[ReliabilityRow]:
    """Whether l and the posterior of each mode are what they say; none where scores are not calibrated."""
    scores = {
        f.registration.value: (f.posterior, matched[f.registration]) for f in own if f.registration in matched
    }
    found = []
    for mode, (score, match) in {ALONE: (own[0].table.likelihood, alone), **scores}.items():
        use = match.outcome != IGNORED
        if score is None or not use.any() or np.isnan(score[use]).any():
            continue
        r = reliability(score[use], match.outcome[use] == HIT, RELIABILITY_BINS)
        found.append(ReliabilityRow.of(own[0].detector, mode, r))
    return found


def _difficulty(data: DataSet, table: CandidateTable, alone: MatchTable | None) -> DetectorDifficulty:
    """What the detector alone makes of the cars that are seen well (see ``rescore.results.difficulty``)."""
    hard = difficulty_of_table(data, table.image_id, table.xyxy_px, table.score, alone=alone)
    return DetectorDifficulty(
        n_cars=hard.n_cars,
        recall_ceiling=finite(hard.recall_ceiling),
        fppi_at_70=hard.fppi_at_70,
        share_by_kind=dict(hard.share_by_kind),
    )


def _stereo(data: DataSet) -> StereoStatistics:
    """Error of the measured depth, where the data set was rendered and so knows it."""
    file = data.root / "stereo.json"
    return read_stereo_statistics(file) if file.is_file() else StereoStatistics()


def tuning_rows(tunings: Mapping[tuple[str, Registration], Tuning]) -> dict[str, DetectorTuning]:
    """The choice of w by detector: for eq. 6 as printed (or the first there is), the others under "modes"."""
    chosen: dict[str, dict[str, TunedWeight]] = {}
    for (name, mode), t in sorted(tunings.items(), key=lambda item: item[0][1] != Registration.PAPER):
        chosen.setdefault(name, {})[str(mode)] = _tuned_weight(t)
    return {name: DetectorTuning.first_of(modes) for name, modes in chosen.items()}


def _tuned_weight(t: Tuning) -> TunedWeight:
    return TunedWeight(
        w=t.w,
        objective_name=t.objective,
        w_grid=tuple(t.grid.tolist()),
        objective=tuple(finite(v) for v in t.value.tolist()),
        n_images=t.n_images,
        sentence=t.sentence,
        uncertainty=None if t.uncertainty is None else WeightInterval.of(t.uncertainty),
        learned=t.learned,
    )
