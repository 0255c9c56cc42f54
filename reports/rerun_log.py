"""The recording of a run for the Rerun viewer: test frames in 2D and 3D with their candidates, and curves."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from reports.curves import CurveSet, curve_sets
from reports.evidence_view import frame_views, run_data
from reports.palette import detector_colour, detector_name, mode_name
from reports.rerun_frame import (
    DEPTH_RANGE_M,
    IMAGE,
    WORLD,
    candidates_path,
    log_frame,
    log_static,
    models_path,
)
from reports.rerun_plot import Axis, Line, Plot
from reports.roc import left_edge
from reports.run_folder import Run, load_run
from reports.tables import number, short_table
from reports.templating import render
from rescore.progress import track
from rescore.store import atomic_path

APPLICATION_ID = "rescore"
_SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
_CHUNK_BYTES = 2 * 2**20


def write_recording(
    run_dir: Path,
    out: Path | None = None,
    max_frames: int | None = None,
    mode: str | None = None,
    show: bool = True,
) -> Path:
    """Write the recording of a run; frames are streamed, so memory does not grow with their number.

    Args:
        run_dir: the run folder.
        out: the file to write; None for ``recording.rrd`` in the run folder.
        max_frames: so many frames, evenly spread over the test set; None for all.
        mode: the way of scoring that is compared with the detector alone; None for the last of metrics.json.
        show: whether to show a progress bar.

    Returns:
        The path written.
    """
    run = load_run(run_dir)
    chosen = choose_frames(run, max_frames)
    part_names = run.part_names()
    mode = mode or run.modes[-1]
    out = Path(out) if out is not None else run.root / "recording.rrd"
    with atomic_path(out) as beside:
        # time-dependent batches would cut the same data in other places on every run
        batches = rr.ChunkBatcherConfig(flush_tick=3600.0, flush_num_bytes=_CHUNK_BYTES)
        rec = rr.RecordingStream(
            APPLICATION_ID, recording_id=run.root.name, send_properties=False, batcher_config=batches
        )
        rr.set_log_time_enabled(False, recording=rec)
        plots = _plots(run)
        rec.save(beside, default_blueprint=_blueprint(run, plots))
        log_static(rec, run.detectors, part_names)
        for plot in plots:
            plot.log(rec)
        text = rr.TextDocument(_guide(run, mode), media_type=rr.MediaType.MARKDOWN)
        rec.log("guide", text, static=True)
        views = frame_views(run, mode, chosen)
        packed = len({(f.width_px, f.height_px) for f in run_data(run).frames}) == 1
        for i, view in enumerate(track(views, "recording", len(chosen), show)):
            rec.set_time("frame", sequence=i)
            rec.set_time("image_id", sequence=view.image_id)
            log_frame(rec, view, packed)
        rec.flush()
        rec.disconnect()
    return out


def choose_frames(run: Run, max_frames: int | None) -> NDArray[np.int64]:
    """Ids of the images to show, in the order of the data set."""
    ids: NDArray[np.int64] = np.array([f.image_id for f in run_data(run).frames], dtype=np.int64)
    if max_frames is None or max_frames >= len(ids):
        return ids
    spread = np.unique(np.linspace(0, len(ids) - 1, max_frames).round().astype(int))
    return np.asarray(ids[spread])


def _plots(run: Run) -> tuple[Plot, ...]:
    curves = curve_sets(run)
    cars = f"share of all {run.metrics['n_cars']} annotated cars found"
    share = Axis("share of the hits accepted", 0, 1, _SHARES)
    left = left_edge(run.metrics)
    decades = tuple(10.0**k for k in range(-3, 2) if left <= 10.0**k <= 20)
    plots = [
        Plot(
            "curves/candidate_roc",
            "candidate ROC",
            Axis("share of the false candidates accepted", 0, 1, _SHARES),
            share,
            _lines(curves, lambda c: (c.candidate.x, c.candidate.y, f"area {number(c.row['auc'])}")),
            (0.7, 0.06),
        ),
        Plot(
            "curves/car_roc",
            "cars found, false positives",
            Axis("false positives per image (log; left edge: none)", left, 20, decades, log=True),
            Axis(cars, 0, 1, _SHARES),
            _lines(
                curves, lambda c: (c.cars.x, c.cars.y, f"AP {number(c.row['average_precision'])}"), steps=True
            ),
            (0.7, 0.06),
        ),
        Plot(
            "curves/precision_recall",
            "precision and recall",
            Axis(cars, 0, 1, _SHARES),
            Axis("share of accepted candidates that are hits", 0, 1, _SHARES),
            _lines(
                curves,
                lambda c: (
                    c.precision.recall,
                    c.precision.precision,
                    f"AP {number(c.row['average_precision'])}",
                ),
            ),
            (0.72, 0.68),
        ),
    ]
    return (*plots, *_weight_plot(run))


def _lines(
    curves: tuple[CurveSet, ...],
    points: Callable[[CurveSet], tuple[NDArray[np.float64], NDArray[np.float64], str]],
    steps: bool = False,
) -> tuple[Line, ...]:
    detectors = tuple(dict.fromkeys(c.detector for c in curves))
    lines = []
    for c in curves:
        x, y, figure = points(c)
        colour = detector_colour(c.detector, detectors)
        legend = f"{c.short_name}: {figure}"
        lines.append(Line(f"{c.detector}_{c.mode}", legend, x, y, colour, c.mode == "detector", steps))
    return tuple(lines)


def _weight_plot(run: Run) -> tuple[Plot, ...]:
    tuning = run.tuning()
    if not tuning:
        return ()
    values = np.concatenate([np.array(t["objective"], float) for t in tuning.values()])
    low, high = np.floor(np.nanmin(values) * 10) / 10, np.ceil(np.nanmax(values) * 10 + 1e-9) / 10
    ticks = tuple(float(v) for v in np.linspace(low, high, 6).round(3))
    name = next(iter(tuning.values()))["objective_name"].replace("_", " ")
    lines = tuple(
        Line(
            detector,
            f"{detector_name(detector, short=True)}: w = {t['w']:g}",
            np.array(t["w_grid"], float),
            np.array(t["objective"], float),
            detector_colour(detector, run.detectors),
        )
        for detector, t in tuning.items()
    )
    x = Axis("w (1: detector alone, 0: depth alone)", 0, 1, _SHARES)
    y = Axis(f"{name} on the validation set", float(low), float(high), ticks)
    return (Plot("curves/weight", "choice of w", x, y, lines, (0.5, 0.06)),)


def _blueprint(run: Run, plots: tuple[Plot, ...]) -> rrb.Blueprint:
    guide = rrb.TextDocumentView(origin="guide", name="how to read this")
    grid = rrb.Grid(*(p.view() for p in plots), grid_columns=2)
    overview = rrb.Horizontal(guide, grid, column_shares=[2, 5], name="overview")
    frames = [_frame_tab(detector) for detector in run.detectors]
    return rrb.Blueprint(
        rrb.Tabs(overview, *frames, active_tab=0),
        rrb.TimePanel(timeline="frame", state="collapsed", play_state="paused", fps=2),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def _frame_tab(detector: str) -> rrb.Horizontal:
    name = rr.escape_entity_path_part(detector)
    root, left = f"{IMAGE}/{name}", f"{IMAGE}/left"
    boxes, models = candidates_path(detector), models_path(detector)
    flat = rrb.Vertical(
        rrb.Spatial2DView(
            name="candidates", origin=IMAGE, contents=[left, f"{boxes}/**", f"- {boxes}/outlines"]
        ),
        rrb.Spatial2DView(
            name="outlines and parts", origin=IMAGE, contents=[left, f"{root}/parts", f"{boxes}/outlines"]
        ),
    )
    depths = rrb.Vertical(
        rrb.Spatial2DView(name="measured depth", origin=IMAGE, contents=[f"{IMAGE}/measured_depth/**"]),
        rrb.Spatial2DView(
            name="predicted depth, registered", origin=IMAGE, contents=[f"{root}/predicted_depth/**"]
        ),
        rrb.TextDocumentView(name="candidates of this frame", origin=f"tables/{name}"),
        row_shares=[3, 3, 3],
    )
    scene = rrb.Spatial3DView(
        name="stereo points and registered models",
        origin=WORLD,
        contents=[
            f"{WORLD}/stereo_points",
            f"{WORLD}/ground",
            f"{WORLD}/camera",
            IMAGE,
            left,
            f"{models}/**",
        ],
        background=[24, 26, 32],
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=(-6.0, -7.0, 6.5), look_target=(0.8, 11.0, 0.5), eye_up=(0, 0, 1)
        ),
        overrides={f"{models}/rest": rrb.EntityBehavior(visible=False)},
    )
    title = f"frames: {detector_name(detector, short=True)}"
    return rrb.Horizontal(flat, depths, scene, column_shares=[4, 3, 4], name=title)


def _guide(run: Run, mode: str) -> str:
    """How to read the recording, with the results, as Markdown."""
    low, high = (f"{v:g}" for v in DEPTH_RANGE_M)
    return render(
        "guide.md.j2",
        metrics=run.metrics,
        table=short_table(run.metrics, levels=("0.7",)).markdown(),
        mode=mode_name(mode),
        other_system=run.other_system,
        low=low,
        high=high,
    )
