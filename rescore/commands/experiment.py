"""The commands of the experiment: synth, train, detect, apply, evaluate, log, reproduce."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recon.errors import RescoreError
from rescore.commands.base import (
    ALL_PROCESSORS,
    AdaptShare,
    Changes,
    Dataset,
    EvidenceModelFile,
    Jobs,
    Preset,
    RegistrationMode,
    Report,
    Seed,
    Split,
    TestMeshes,
    TrainMeshes,
    app,
    config_of,
    detections_of,
    mode_of,
    read_data,
    read_split,
    say,
    with_share,
)
from rescore.commands.depth_source import (
    As,
    Factor,
    Masks,
    Model,
    PredictedDir,
    Unit,
    predictions_behind,
    source_as_json,
    source_of,
    tell_doubts,
)

if TYPE_CHECKING:
    from rescore.stages import Done


@app.command()
def synth(
    out: Annotated[Path, typer.Argument(help="Folder to write the data set to.")],
    preset: Preset = "demo",
    config: Changes = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    train_meshes: TrainMeshes = None,
    test_meshes: TestMeshes = None,
) -> None:
    """Render a data set of stereo street scenes with cars, and part-labelled views to learn from.

    A build that was stopped goes on where it was.

    Example: [bold]rescore synth data/demo --preset demo --seed 0[/bold]
    """
    from datasets_synth.build import build_dataset

    settings = config_of(preset, config)
    build_dataset(
        settings.synth, out, seed=seed, jobs=jobs, train_meshes=train_meshes, test_meshes=test_meshes
    )
    say(f"data set: {out}")


@app.command()
def train(
    out: Annotated[Path, typer.Option(help="Folder for <detector>.npz and <detector>.platt.json.")],
    dataset: Annotated[
        Path | None,
        typer.Argument(help="Folder with annotations.json, or of another layout (docs/own-data.md)."),
    ] = None,
    crops: Annotated[
        tuple[Path, Path] | None,
        typer.Option(
            help="In place of a data set: folders of crops of cars and of street, or patterns in quotes.",
            metavar="CARS STREET",
        ),
    ] = None,
    detector: Annotated[str, typer.Option(help="Detector to train: hog, boosted or all.")] = "all",
    preset: Preset = "paper",
    config: Changes = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """Train detectors on the split "train", and fit their Platt scaling on "calibration".

    With --crops, on pictures of one size, each a car or street; Platt scaling is fitted by cross-validation,
    on scenes made of crops that were held out.

    Example: [bold]rescore train data/demo --detector hog --out models[/bold]
    """
    from rescore import steps
    from rescore.config import part_as_json
    from rescore.detectors.crops import config_for_crops, read_crops
    from rescore.store import write_provenance

    kinds = [k for k in steps.DetectorKind if detector in ("all", k.value)]
    if not kinds:
        known = ", ".join(steps.DetectorKind)
        raise RescoreError(f"--detector: expected {known} or all, got {detector!r}; choose one of these")
    if (dataset is None) == (crops is None):
        raise RescoreError("train: expected a data set or --crops, got both or neither; give one of them")
    settings = config_of(preset, config)
    data = None if dataset is None else read_data(dataset, settings.class_name)
    examples = None if crops is None else read_crops(*crops)
    for kind in kinds:
        chosen = settings.detector(kind)
        if data is not None:
            trained = steps.train(data, chosen, seed, jobs)
            scaling = steps.calibrate(trained, data, jobs)
        else:
            assert examples is not None
            chosen = config_for_crops(chosen, examples.width_px, examples.height_px)
            trained, validation = steps.train_on_crops(examples, chosen, seed, jobs)
            scaling = validation.scaling
            say(f"{kind}, scenes of held-out crops: {validation.curve.summary()}")
        trained.save(out / f"{kind}.npz")
        steps.save_scaling(_scaling_of(out / f"{kind}.npz"), scaling)
        write_provenance(out / f"{kind}.npz", "train", part_as_json(chosen), seed)
        say(f"detector: {out / f'{kind}.npz'}")


@app.command()
def detect(
    dataset: Dataset,
    detector: Annotated[
        Path, typer.Option(help="Detector that `rescore train` wrote, with its .platt.json.")
    ],
    out: Annotated[Path, typer.Option(help="Detections to write, COCO results JSON.")],
    split: Split = "test",
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """Find the 15 best candidates of every frame, with raw scores and likelihoods.

    Example: [bold]rescore detect data/demo --detector models/hog.npz --out hog.json[/bold]
    """
    from rescore import steps
    from rescore.detectors.files import load_detector
    from rescore.formats.coco import write_detections
    from rescore.store import write_provenance

    data = read_split(dataset, split)
    trained = load_detector(detector)
    table = steps.detect(trained, steps.load_scaling(_scaling_of(detector)), data, jobs)
    write_detections(out, trained.name, table, data)
    write_provenance(out, "detect", {"detector": str(detector), "split": split}, None)
    say(f"{len(table)} detections in {len(data.frames)} frames: {out}")


@app.command()
def apply(
    dataset: Dataset,
    detections: Annotated[Path, typer.Argument(help="Detections to rescore, COCO results JSON.")],
    out: Annotated[Path, typer.Option(help="Rescored detections to write, COCO results JSON.")],
    model: Model = None,
    tuned: Annotated[Path | None, typer.Option(help="Weight that `rescore tune` wrote.")] = None,
    w: Annotated[float | None, typer.Option(min=0, max=1, help="The weight itself, in its place.")] = None,
    registration: RegistrationMode = "paper",
    evidence_model: EvidenceModelFile = None,
    adapt_share: AdaptShare = False,
    evidence: Annotated[
        Path | None, typer.Option(help="Folder for what led to each score: <folder>/<detector>/<image>.npz.")
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(help="Camera that predicts depth: calibrated where known, or default (the report's)."),
    ] = None,
    disparities: Annotated[
        int | None, typer.Option(help="Disparities to search where there is no disparity file.")
    ] = None,
    predicted_depth: PredictedDir = None,
    predicted_as: As = None,
    predicted_unit: Unit = None,
    predicted_factor: Factor = None,
    predicted_masks: Masks = None,
    split: Split = "test",
    preset: Preset = "paper",
    config: Changes = None,
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """Rescore detections with stereo depth and a class model (eq. 7, with D of eq. 6 or what goes past it).

    A candidate that gets no depth evidence keeps its likelihood; its status says why. With --predicted-depth
    the depth of another system is compared with stereo depth (docs/predicted-depth.md).

    Example: [bold]rescore apply data/demo hog.json --model car.json --tuned w.json --out rescored.json[/bold]
    """
    from rescore import steps
    from rescore.config import part_as_json
    from rescore.cues import check_depth_of
    from rescore.evidence_model import with_difference
    from rescore.formats.coco import write_rescored
    from rescore.fuse import fuse
    from rescore.store import write_provenance

    if (tuned is None) == (w is None):
        raise RescoreError("apply: expected either --tuned or --w, got both or neither; give one of them")
    mode, learned = mode_of(registration, evidence_model)
    asked = source_of(
        model, predicted_depth, predicted_as, predicted_unit, predicted_factor, predicted_masks, (mode,)
    )
    weight = w if tuned is None else steps.tuned_weight(tuned, mode, asked.depth_of)
    assert weight is not None
    if learned is not None:
        check_depth_of(str(evidence_model), learned.depth_of, asked.depth_of)
    settings = config_of(preset, config)
    data = read_split(dataset, split, settings.class_name)
    file = detections_of(detections, data)
    candidates = file.candidates(data)
    source = asked.on(data, candidates)
    rescoring = steps.with_stereo_for(steps.with_camera(settings.rescore, camera), data, disparities)
    table = steps.find_evidence(
        data,
        candidates,
        source,
        rescoring,
        jobs=jobs,
        detector=file.detector,
        evidence_dir=None if evidence is None else evidence / file.detector,
    )
    tell_doubts(source, table)
    learned, shift = with_share(learned, table, adapt_share)
    table = with_difference(table, learned)
    posterior = fuse(table.likelihood, table.depth_difference, weight)
    write_rescored(out, file.detector, table, posterior, w=weight, data=data, registration=mode)
    made_with = {"w": weight, "split": split, "registration": mode.value, "log_odds_shift": shift}
    made_with |= {"rescore": part_as_json(rescoring)}
    write_provenance(out, "apply", made_with | source_as_json(source), None)
    say(_grounds(table.image_id.tolist(), table.ground.tolist()))
    say(f"{_reasons(table.status.tolist())}: {out}")


@app.command()
def evaluate(
    dataset: Dataset,
    detections: Annotated[list[Path], typer.Argument(help="Detections, rescored or not; a file a detector.")],
    out: Annotated[Path, typer.Option(help="Run folder to write to.")],
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
) -> None:
    """Match detections with the annotated cars: candidates.parquet, metrics.json, curves and report.

    Example: [bold]rescore evaluate data/demo rescored_hog.json rescored_boosted.json --out runs/mine[/bold]
    """
    from rescore import steps
    from rescore.evaluate import evaluate as evaluate_files
    from rescore.pipeline import RescoreConfig
    from rescore.reproduce import write_run_config

    data = read_split(dataset, split)
    files = [detections_of(path, data) for path in detections]
    tunings = {(t.detector, t.registration): t for t in (steps.load_tuning(path) for path in tuned or [])}
    settings = {"detections": [str(p) for p in detections], "split": split, "min_iou": min_iou}
    settings |= predictions_behind(detections)
    stereo = steps.with_stereo_for(RescoreConfig(), data, disparities).stereo
    metrics = evaluate_files(data, files, out, tunings=tunings, min_iou=min_iou)
    write_run_config(out, "evaluate", settings, None, stereo=stereo, data=dataset)
    if report:
        from reports import build_report

        build_report(out)
    _print_results(metrics, {"report": out / "report.html"} if report else {"figures": out / "metrics.json"})


@app.command()
def log(
    run: Annotated[Path, typer.Argument(help="Run folder of `rescore evaluate` or `rescore reproduce`.")],
    out: Annotated[
        Path | None, typer.Option(help="Recording to write.", show_default="RUN/recording.rrd")
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
) -> None:
    """Write a recording for the Rerun viewer: candidates and why they moved, depth, 3D, curves.

    Example: [bold]rescore log runs/demo && rerun runs/demo/recording.rrd[/bold]
    """
    from reports.rerun_log import write_recording
    from reports.rerun_story import Frames

    file = write_recording(
        run, out or run / "recording.rrd", frames=Frames.named(frames), max_frames=max_frames
    )
    say(f"recording: {file} (open it with: rerun {file})")


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Run folder to write to.")],
    preset: Preset = "demo",
    config: Changes = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    train_meshes: TrainMeshes = None,
    test_meshes: TestMeshes = None,
) -> None:
    """Run the whole experiment; stages that are done and whose inputs are unchanged are reused.

    Example: [bold]rescore reproduce --preset demo --out runs/demo[/bold]
    """
    from rescore.reproduce import Run
    from rescore.run_folder import RunFolder

    folder = RunFolder(out)
    settings = config_of(preset, config)
    metrics = Run(folder, settings, seed, jobs, _report_stage, train_meshes, test_meshes).all()
    _print_results(metrics, {"report": folder.html, "recording": folder.recording})


def _scaling_of(detector: Path) -> Path:
    return detector.with_suffix(".platt.json")


def _reasons(status: list[str]) -> str:
    from collections import Counter

    counts = Counter(status)
    rest = ", ".join(f"{n} {reason}" for reason, n in sorted(counts.items()) if reason != "ok")
    return f"{len(status)} candidates, {counts['ok']} with depth evidence" + (f" ({rest})" if rest else "")


def _grounds(image_id: list[int], ground: list[str]) -> str:
    """In how many frames the ground plane comes from where."""
    from collections import Counter

    from recon.camera import DEFAULT_GROUND
    from rescore.frames import GroundSource

    counts = Counter(dict(zip(image_id, ground, strict=True)).values())
    text = (
        f"ground plane of {counts.total()} frames with candidates: {counts[GroundSource.STATED]} stated, "
        f"{counts[GroundSource.STEREO]} from stereo, {counts[GroundSource.DEFAULT]} the default "
        f"({DEFAULT_GROUND.height_m:g} m, level)"
    )
    return text + ("; `rescore doctor` says why" if counts[GroundSource.DEFAULT] else "")


def _report_stage(done: "Done") -> None:
    what = "reused" if done.reused else f"{done.seconds:.1f} s"
    say(f"{done.name:<28} {what}")


def _print_results(metrics: dict[str, Any], paths: dict[str, Path]) -> None:
    from rich.console import Console

    from reports.certainty_tables import TERMINAL_CAPTION, terminal_comparison
    from reports.tables import terminal_table

    console = Console()
    console.print(terminal_table(metrics))
    comparison = terminal_comparison(metrics)
    if comparison is not None:
        console.print(comparison.rich(TERMINAL_CAPTION))
    for name, path in paths.items():
        console.print(f"{name}: {path}", soft_wrap=True, highlight=False)
