"""Where depth evidence breaks: test frames spoilt step by step, rescored with nothing fitted again."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from joblib import delayed

from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.stereo.sgbm import SgbmConfig, compute_disparity
from rescore.data.frames import DataSet, Frame, FrameRecord, load_frame
from rescore.data.pictures import read_rgb
from rescore.evidence.candidates import OK, Candidates, CandidateTable
from rescore.evidence.instances import predict_instances
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.fusion.tune import match_at
from rescore.metrics.bootstrap import BootstrapConfig, Comparison, Interval, bootstrap
from rescore.metrics.matching import TruthTable
from rescore.parallel import in_order, one_thread, track
from rescore.studies.degrade import Dial

RECALL = 0.7
"""Share of all cars at which false positives are compared."""
ALONE = "detector"
"""Name of the detector without depth among the modes."""
VISIBILITY = ((0.3, 0.6), (0.6, 0.85), (0.85, 1.001))
"""Groups of cars by their visible share: from, to below."""


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """What a sweep needs of a run: nothing of it is fitted again."""

    data: DataSet
    """Test frames of the run."""
    candidates: Mapping[int, Candidates]
    """Candidates of one detector, by image id."""
    class_model: ClassModel
    config: RescoreConfig
    sgbm: SgbmConfig
    """The matcher that made the disparity of the data set."""
    models: Mapping[Registration, EvidenceModel]
    weights: Mapping[Registration, float]
    """Weight w of the detector by mode."""


@dataclass(frozen=True)
class SweepConfig:
    """Settings of a sweep."""

    seed: int = 0
    jobs: int = 1
    bootstrap: BootstrapConfig = field(default_factory=lambda: BootstrapConfig(n_resamples=1000))


@dataclass(frozen=True)
class Figures:
    """One mode at one level of one dial."""

    fppi: Interval
    """False positives an image where ``RECALL`` of all cars are found."""
    auc: Interval
    """Area under the candidate ROC."""
    reduction: Interval | None
    """Paired: those of the detector alone over these; None for the detector itself."""
    with_evidence: float
    """Share of the candidates with depth evidence."""


@dataclass(frozen=True)
class Point:
    """One level of a dial."""

    level: float
    figures: Mapping[str, Figures]
    """Figures by mode; ``ALONE`` is the detector."""


Step = tuple[Dial | None, float]
"""A dial at a level; None leaves the frame as it is."""


def sweep(run: FinishedRun, dials: Sequence[Dial], config: SweepConfig) -> dict[str, tuple[Point, ...]]:
    """The points of every dial by its name, rising by level; level 0, the frames as they are, is in each."""
    steps: list[Step] = [(None, 0.0), *((dial, level) for dial in dials for level in dial.levels)]
    tables = tables_of_steps(run, steps, config)
    spoilt = track(zip(steps, tables, strict=True), "intervals", len(steps))
    points = [Point(level, figures_of(run, t, run.data, config)) for (_, level), t in spoilt]
    out: dict[str, tuple[Point, ...]] = {}
    for dial in dials:
        own = [p for (d, _), p in zip(steps, points, strict=True) if d is dial]
        out[dial.name] = tuple(sorted([points[0], *own], key=lambda p: p.level))
    return out


def tables_of_steps(run: FinishedRun, steps: Sequence[Step], config: SweepConfig) -> list[CandidateTable]:
    """The candidates of all frames with the evidence of each step."""
    tasks = (
        delayed(_frame_steps)(record, run, steps, config.seed)
        for record in run.data.frames
        if len(run.candidates[record.image_id])
    )
    frames = list(track(in_order(tasks, config.jobs), "sweep", len(run.data.frames)))
    return [CandidateTable.concatenate([frame[k] for frame in frames]) for k in range(len(steps))]


def figures_of(
    run: FinishedRun, table: CandidateTable, data: DataSet, config: SweepConfig
) -> dict[str, Figures]:
    """The figures of the detector alone and of every mode on frames with their truth."""
    truth = TruthTable.of(data)
    alone = replace(table, depth_difference=np.full(len(table), np.nan))
    scored = {m.value: Rescoring(run.config, run.models.get(m)).fuse(table).candidates for m in run.weights}
    matches = {ALONE: match_at(alone, truth, 1.0)}
    matches |= {m.value: match_at(scored[m.value], truth, w) for m, w in run.weights.items()}
    pairs = [(ALONE, m) for m in scored]
    # the same images are drawn for every level, so that levels can be compared
    drawn = bootstrap(
        matches, truth.cars_of_image, pairs, np.random.default_rng(config.seed), config.bootstrap
    )

    def of(mode: str, comparison: Comparison | None) -> Figures:
        intervals = drawn.tables[mode]
        has = (scored[mode].status == OK).mean() if mode in scored else 0.0
        reduction = comparison.reduction[RECALL] if comparison else None
        return Figures(intervals.fppi_at_recall[RECALL], intervals.auc, reduction, float(has))

    return {ALONE: of(ALONE, None)} | {m: of(m, drawn.comparisons[ALONE, m]) for m in scored}


def by_visibility(run: FinishedRun, table: CandidateTable, config: SweepConfig) -> list[dict[str, Any]]:
    """The figures on the cars of each group of ``VISIBILITY`` that has enough cars; other cars are
    ignored."""
    out = []
    for low, high in VISIBILITY:
        truth = {
            i: replace(t, ignore=t.ignore | ~((t.visibility >= low) & (t.visibility < high)))
            for i, t in run.data.truth.items()
        }
        group = replace(run.data, truth=truth)
        n_cars = TruthTable.of(group).n_cars
        if not n_cars:
            continue
        figures = figures_of(run, table, group, config)
        out.append(
            {
                "visible": [low, min(high, 1.0)],
                "n_cars": n_cars,
                "figures": {m: figures_as_json(f) for m, f in figures.items()},
            }
        )
    return out


def is_loss(figures: Figures) -> bool:
    """Whether depth makes significantly more false positives: the whole interval lies below 1."""
    return figures.reduction is not None and figures.reduction.high < 1


def sweep_as_json(points: Mapping[str, Sequence[Point]], dials: Sequence[Dial]) -> dict[str, Any]:
    """The points as JSON values; see ``interval_as_json`` for numbers that are none."""
    what = {d.name: d.what for d in dials}
    return {
        name: {
            "what": what[name],
            "points": [
                {"level": p.level, "figures": {m: figures_as_json(f) for m, f in p.figures.items()}}
                for p in row
            ],
        }
        for name, row in points.items()
    }


def figures_as_json(figures: Figures) -> dict[str, Any]:
    """The figures as JSON values."""
    return {
        "fppi": interval_as_json(figures.fppi),
        "auc": interval_as_json(figures.auc),
        "reduction": figures.reduction and interval_as_json(figures.reduction),
        "with_evidence": figures.with_evidence,
        "significant_loss": is_loss(figures),
    }


def interval_as_json(interval: Interval) -> dict[str, float | str | None]:
    """The interval as JSON values: "inf" for infinity, null for what is undefined."""
    return {k: v if np.isfinite(v) else "inf" if np.isinf(v) else None for k, v in asdict(interval).items()}


def _frame_steps(
    record: FrameRecord, run: FinishedRun, steps: Sequence[Step], seed: int
) -> list[CandidateTable]:
    """The candidates of one frame with the evidence of each step."""
    candidates = run.candidates[record.image_id]
    with one_thread():
        frame = load_frame(record, run.sgbm)
        right = read_rgb(record.right_path, record.width_px, record.height_px) if record.right_path else None
        own = predict_instances(frame, candidates, run.class_model, run.config)
        tables = []
        for dial, level in steps:
            spoilt = frame if dial is None else _spoilt(frame, right, dial, level, run.sgbm, seed)
            moved = dial is not None and dial.calibration is not None
            source = run.class_model if moved else own
            tables.append(rescore_frame(spoilt, candidates, source, Rescoring(run.config)).candidates)
        return tables


def _spoilt(frame: Frame, right: Any, dial: Dial, level: float, sgbm: SgbmConfig, seed: int) -> Frame:
    """The frame with its disparity or its calibration spoilt; the left picture stays."""
    # one stream a frame and dial, so that a larger level spoils more of the same
    rng = np.random.default_rng([seed, frame.image_id, zlib.crc32(dial.name.encode())])
    if dial.pictures is not None:
        if right is None:
            raise RescoreError(
                f"sweep: dial {dial.name!r} expects a right picture, image {frame.image_id} has none; "
                "leave the dial out"
            )
        pair = dial.pictures((frame.left_rgb, right), level, rng)
        return replace(frame, disparity_px=compute_disparity(*pair, sgbm))
    if dial.disparity is not None:
        return replace(frame, disparity_px=dial.disparity(frame.disparity_px, level, rng))
    if dial.calibration is None:
        raise ValueError(f"dial {dial.name!r} changes nothing")
    camera, ground = dial.calibration((frame.camera, frame.ground), level)
    return replace(frame, camera=camera, ground=ground)
