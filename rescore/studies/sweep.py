"""Where depth evidence breaks: test frames spoilt step by step, rescored with nothing fitted again."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from recon.errors import RescoreError
from recon.stereo.sgbm import SgbmConfig, compute_disparity
from rescore.data.frames import DataSet, Frame, FrameRecord, load_frame
from rescore.data.pictures import read_rgb
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.evidence.candidates import OK, CandidateTable
from rescore.evidence.instance_fits import fit_instances
from rescore.evidence.instances import predict_instances
from rescore.evidence.views import views_of_fits
from rescore.files import write_provenance
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.fusion.tune import match_at
from rescore.metrics.bootstrap import BootstrapConfig, Comparison, Interval, bootstrap
from rescore.metrics.matching import TruthTable
from rescore.parallel import one_thread, track
from rescore.results.candidate_file import ALONE
from rescore.results.sweep_file import (
    SweepFigures,
    SweepPoint,
    SweepResult,
    SweptDial,
    SweptInterval,
    VisibilityGroup,
    write_sweep,
)
from rescore.studies.degradations import Dial
from rescore.studies.finished_run import FinishedRun, finished_run

RECALL = 0.7
"""Share of all cars at which false positives are compared."""
VISIBILITY = ((0.3, 0.6), (0.6, 0.85), (0.85, 1.001))
"""Groups of cars by their visible share: from, to below."""


@dataclass(frozen=True)
class SweepConfig:
    """Settings of a sweep."""

    seed: int = 0
    jobs: Workers = 1
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


def sweep_run(
    root: Path,
    out: Path,
    dials: Sequence[Dial],
    frames: int | None,
    *,
    detector: str,
    seed: int,
    jobs: Workers,
) -> SweepResult:
    """Sweep a finished run over dials; writes ``sweep.json`` to the folder ``out`` and returns its content.

    Args:
        root: The finished run.
        out: Folder to write to.
        dials: What is spoilt, each at all of its levels.
        frames: Test frames to use, evenly spread; None for all.
        detector: A detector of the run.
        seed: Of every random choice.
        jobs: Frames at a time.

    Raises:
        RescoreError: the run is not finished, or has no such detector.
    """
    run, config = finished_run(root, detector, frames), SweepConfig(seed=seed, jobs=jobs)
    points = sweep(run, dials, config)
    as_is = tables_of_steps(run, [(None, 0.0)], config)[0]
    result = SweepResult(
        detector=detector,
        n_images=len(run.data.frames),
        dials=swept_dials(points, dials),
        visibility=by_visibility(run, as_is, config),
    )
    write_sweep(out / "sweep.json", result)
    settings = {"dials": {d.name: d.levels for d in dials}, "frames": frames, "detector": detector}
    write_provenance(out / "sweep.json", "sweep", settings, seed)
    return result


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
    records = [record for record in run.data.frames if len(run.candidates[record.image_id])]
    found = map_frames(_frame_steps, records, (run, steps, config.seed), config.jobs)
    frames = list(track(found, "sweep", len(records)))
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


def by_visibility(
    run: FinishedRun, table: CandidateTable, config: SweepConfig
) -> tuple[VisibilityGroup, ...]:
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
        out.append(VisibilityGroup(visible=(low, min(high, 1.0)), n_cars=n_cars, figures=_recorded(figures)))
    return tuple(out)


def is_loss(figures: Figures) -> bool:
    """Whether depth makes significantly more false positives: the whole interval lies below 1."""
    return figures.reduction is not None and figures.reduction.high < 1


def swept_dials(points: Mapping[str, Sequence[Point]], dials: Sequence[Dial]) -> dict[str, SweptDial]:
    """The points of every dial as files hold them."""
    what = {d.name: d.what for d in dials}
    return {
        name: SweptDial(
            what=what[name],
            points=tuple(SweepPoint(level=p.level, figures=_recorded(p.figures)) for p in row),
        )
        for name, row in points.items()
    }


def _recorded(figures: Mapping[str, Figures]) -> dict[str, SweepFigures]:
    return {
        mode: SweepFigures(
            fppi=SweptInterval.of(f.fppi),
            auc=SweptInterval.of(f.auc),
            reduction=None if f.reduction is None else SweptInterval.of(f.reduction),
            with_evidence=f.with_evidence,
            significant_loss=is_loss(f),
        )
        for mode, f in figures.items()
    }


def _frame_steps(
    record: FrameRecord, shared: tuple[FinishedRun, Sequence[Step], int]
) -> list[CandidateTable]:
    """The candidates of one frame with the evidence of each step."""
    run, steps, seed = shared
    candidates = run.candidates[record.image_id]
    with one_thread():
        frame = load_frame(record, run.sgbm)
        right = read_rgb(record.right_path, record.width_px, record.height_px) if record.right_path else None
        fits = fit_instances(frame, candidates.xyxy_px, run.class_model, run.config.fit)
        sides = views_of_fits(fits, run.class_model.bins)
        own = predict_instances(frame, candidates, run.class_model, run.config, sides)
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
