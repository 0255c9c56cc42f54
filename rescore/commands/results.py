"""The commands that show results: evaluate, report, log."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rescore.commands.base import (
    ALL_PROCESSORS,
    DETECTION_FORMS,
    Address,
    AsJson,
    Dataset,
    Engine,
    Jobs,
    Maps,
    Report,
    Split,
    app,
    configs_behind,
    file_target,
    folder_target,
    print_json,
    workers_of,
)
from rescore.commands.depth_source import predictions_behind
from rescore.commands.parts.evaluating import SAMPLE, Evaluating, run_to_show
from rescore.speech import say

if TYPE_CHECKING:
    from rescore.results.metrics_file import Metrics


@app.command()
def evaluate(
    dataset: Dataset,
    detections: Annotated[
        list[Path], typer.Argument(help=f"Detections, rescored or not, of each detector: {DETECTION_FORMS}.")
    ],
    out: Annotated[Path, typer.Option(help="Run folder to write to.", callback=folder_target)],
    tuned: Annotated[
        list[Path] | None, typer.Option(help="What `rescore tune` wrote, to show the choice of w; repeat.")
    ] = None,
    min_iou: Annotated[
        float, typer.Option(min=0, max=1, help="Overlap from which a candidate found a car.")
    ] = 0.5,
    disparities: Annotated[
        int | None,
        typer.Option(help="Disparities to search where there is no disparity file, as for `rescore apply`."),
    ] = None,
    report: Report = True,
    split: Split = "test",
    maps: Maps = None,
    as_json: AsJson = False,
) -> None:
    """Match detections with the annotated cars: candidates.parquet, metrics.json, curves and report.

    Example: [bold]rescore evaluate data/demo rescored_hog.json rescored_boosted.json --out runs/mine[/bold]
    """
    from recon.files import refuse_as_input
    from rescore.evidence.settings import RescoreConfig, with_stereo_for
    from rescore.fusion.tuning_file import load_tuning
    from rescore.locks import locked
    from rescore.results.run_config_file import write_run_config
    from rescore.results.run_folder import RunFolder

    refuse_as_input(out, (dataset, *detections))
    tunings = {(t.detector, t.registration): t for t in (load_tuning(path) for path in tuned or [])}
    settings = {"detections": [str(p) for p in detections], "split": split, "min_iou": min_iou}
    settings |= predictions_behind(detections)
    asked = Evaluating(dataset, detections, out, split, maps, tunings, min_iou)
    large = asked.in_parts()
    with locked(out):
        metrics, names, cameras = asked.tables() if large else asked.files()
        detector_of = dict(zip(detections, names, strict=True))
        settings |= _rescored_with(detector_of)
        stereo = with_stereo_for(RescoreConfig(), cameras, disparities).stereo
        for run in (out, out / SAMPLE) if large else (out,):
            data = run / "data" if run != out else dataset
            own = {"sample_of_images": metrics.n_images} if run != out else {}
            file = RunFolder(run).config
            write_run_config(file, "evaluate", settings | own, None, stereo=stereo, data=data)
            _keep_evidence_models(run, detector_of)
        page = _report_of(out / SAMPLE if large else out) if report else None
    shown = {"report": page} if page else {"figures": RunFolder(out).metrics}
    print_results(metrics, shown, as_json, split)


def _report_of(run: Path) -> Path:
    from reports.page.report import build_report

    return build_report(run)


def _rescored_with(detector_of: dict[Path, str]) -> dict[str, Any]:
    """The settings that rescored detections, by detector and mode, but for the numbers of evidence models."""
    found: dict[str, dict[str, Any]] = {}
    for path, config in configs_behind(list(detector_of)):
        if "registration" in config:
            kept = {
                name: value for name, value in config.items() if name not in ("evidence_model", "predicted")
            }
            found.setdefault(detector_of[path], {})[config["registration"]] = kept
    return {"rescored": found} if found else {}


def _keep_evidence_models(out: Path, detector_of: dict[Path, str]) -> None:
    """Copy the evidence models of rescored detections into the run folder, where report and recording
    look."""
    from rescore.evidence.model import models_of_json, save_models
    from rescore.results.run_folder import RunFolder

    models: dict[str, dict[Any, Any]] = {}
    for path, config in configs_behind(list(detector_of)):
        if "evidence_model" in config:
            models.setdefault(detector_of[path], {}).update(models_of_json(config["evidence_model"], path))
    for detector, own in models.items():
        save_models(RunFolder(out).evidence_model(detector), own)


@app.command()
def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            help="Run folders of `rescore evaluate` or `rescore reproduce`; the others are compared with the "
            "first.",
            metavar="RUN...",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Page to write.",
            show_default="RUN/report.html; of several runs comparison.html of the first",
            callback=file_target,
        ),
    ] = None,
) -> None:
    """Write the report of a run: one HTML file with result, curves, gallery and tuning, for offline use.

    Several runs come side by side, with differences paired over the images that they share.

    Example: [bold]rescore report runs/demo runs/other --out comparison.html[/bold]
    """
    from reports.page.report import build_report

    page = build_report([run_to_show(run) for run in runs], out)
    say(f"report: {page} (open it in a browser)")


@app.command()
def log(
    run: Annotated[Path, typer.Argument(help="Run folder of `rescore evaluate` or `rescore reproduce`.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Recording to write.", show_default="RUN/recording.rrd", callback=file_target),
    ] = None,
    frames: Annotated[
        str,
        typer.Option(
            help="all, flips (a candidate changed sides) or worst (a car lost, a false alarm accepted)."
        ),
    ] = "all",
    max_frames: Annotated[
        int | None, typer.Option(min=1, help="At most so many frames; of all, evenly spread ones.")
    ] = None,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """Write a recording for the Rerun viewer: candidates and why they moved, depth, 3D, curves.

    Example: [bold]rescore log runs/demo && rerun runs/demo/recording.rrd[/bold]
    """
    from reports.recording.log import write_recording
    from reports.recording.story import Frames

    workers, run = workers_of(engine, address, jobs), run_to_show(run)
    shown, file = Frames.named(frames), out or run / "recording.rrd"
    file = write_recording(run, file, frames=shown, max_frames=max_frames, jobs=workers)
    say(f"recording: {file} (open it with: rerun {file})")


def print_results(metrics: "Metrics", paths: dict[str, Path], as_json: bool, split: str = "test") -> None:
    """Print the table of results, what rescoring changed, and where the files are."""
    if as_json:
        print_json(metrics.as_json() | {"files": {name: str(path) for name, path in paths.items()}})
        return
    from rich.console import Console

    from reports.run.tables import TERMINAL_CAPTION, terminal_comparison, terminal_table, tie_notes
    from reports.run.tables3d import TERMINAL_CAPTION_3D, terminal_boxes3d
    from rescore.data.frames import none_counts

    console = Console()
    if not metrics.n_cars:
        why = none_counts(metrics.n_ignored) if metrics.n_ignored else "no car is annotated in these frames"
        say(f"{why}: nothing is counted as right or wrong")
    else:
        console.print(terminal_table(metrics, split))
    for note in tie_notes(metrics):
        say(f"note: {note}")
    comparison = terminal_comparison(metrics) if metrics.n_cars else None
    if comparison is not None:
        console.print(comparison.rich(TERMINAL_CAPTION))
    solid = terminal_boxes3d(metrics)
    if solid is not None:
        console.print(solid.rich(TERMINAL_CAPTION_3D))
    for name, path in paths.items():
        console.print(f"{name}: {path}", soft_wrap=True, highlight=False)
