"""The commands of the experiment: synth, apply, reproduce."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rescore.commands.base import (
    ALL_PROCESSORS,
    DETECTION_FORMS,
    MAP_HELP,
    REGISTRATION_HELP,
    TABLE_OUT,
    AdaptShare,
    Address,
    AsJson,
    Changes,
    Dataset,
    Engine,
    EvidenceModelFile,
    Jobs,
    Preset,
    Seed,
    Split,
    TestMeshes,
    TrainMeshes,
    app,
    config_of,
    folder_target,
    table_target,
    workers_of,
)
from rescore.commands.depth_source import Model, Predicted
from rescore.commands.parts.applying import Applying
from rescore.commands.parts.in_parts import in_parts
from rescore.commands.results import print_results
from rescore.commands.what_rescores import Named
from rescore.speech import say

if TYPE_CHECKING:
    from rescore.experiment.stages import Done

STEREO_PANEL = "Camera and stereo matching"
CLASSES_PANEL = "Names of classes"
SECOND_PANEL = "Second boxes"


@app.command()
def synth(
    out: Annotated[Path, typer.Argument(help="Folder to write the data set to.", callback=folder_target)],
    preset: Preset = "demo",
    config: Changes = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    train_meshes: TrainMeshes = None,
    test_meshes: TestMeshes = None,
) -> None:
    """Render a data set of stereo street scenes with cars, and part-labelled views to learn from.

    A build that was stopped goes on where it was.

    Example: [bold]rescore synth data/demo --preset demo --seed 0[/bold]
    """
    from datasets_synth.build import build_dataset
    from rescore.locks import locked

    workers = workers_of(engine, address, jobs)
    settings = config_of(preset, config)
    with locked(out):
        build_dataset(
            settings.synth, out, seed=seed, jobs=workers, train_meshes=train_meshes, test_meshes=test_meshes
        )
    say(f"data set: {out}")


@app.command()
def apply(
    dataset: Dataset,
    detections: Annotated[Path, typer.Argument(help=f"Detections to rescore: {DETECTION_FORMS}.")],
    out: Annotated[
        Path, typer.Option(help=f"Rescored detections to write: {TABLE_OUT}.", callback=table_target)
    ],
    model: Model = None,
    predicted: Predicted = None,
    tuned: Annotated[Path | None, typer.Option(help="Weight that `rescore tune` wrote.")] = None,
    w: Annotated[
        float | None, typer.Option(min=0, max=1, help="The weight itself, in place of --tuned.")
    ] = None,
    registration: Annotated[
        str | None,
        typer.Option(
            help=REGISTRATION_HELP,
            show_default="paper where another option names what rescores",
        ),
    ] = None,
    evidence_model: EvidenceModelFile = None,
    adapt_share: AdaptShare = False,
    suppress: Annotated[
        bool,
        typer.Option(
            "--suppress",
            help="Rank second boxes of a car, found in 3D, below all others.",
            rich_help_panel=SECOND_PANEL,
        ),
    ] = False,
    evidence: Annotated[
        Path | None,
        typer.Option(
            help="Folder for what led to each score, by detector, an NPZ file an image.",
            callback=folder_target,
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="Camera that predicts depth: calibrated where known, or default (the report's).",
            rich_help_panel=STEREO_PANEL,
        ),
    ] = None,
    disparities: Annotated[
        int | None,
        typer.Option(
            help="Disparities to search where there is no disparity file.", rich_help_panel=STEREO_PANEL
        ),
    ] = None,
    split: Split = "test",
    maps: Annotated[
        list[str] | None, typer.Option("--map", help=MAP_HELP, rich_help_panel=CLASSES_PANEL)
    ] = None,
    preset: Preset = "paper",
    config: Changes = None,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """Rescore detections with stereo depth and a class model (eq. 7, with D of eq. 6 or what goes past it).

    Without options of what rescores the rescorer that comes with the package is used (mode instance).
    A candidate without depth evidence keeps its likelihood in mode paper.
    In the other modes it gets the D of silent cues. Its status says why. Into a folder the result is a table
    in parts, for very many frames: parts that are there are kept, and frames that fail are told.

    Example: [bold]rescore apply MY_DATA my_detections.json --out rescored.json[/bold]
    """
    workers = workers_of(engine, address, jobs)
    used = Named(model, predicted, tuned, w, registration, evidence_model).rescores(preset, config)
    applying = Applying(
        dataset, detections, out, split, maps, evidence, used, suppress, camera, disparities, workers
    )
    if in_parts(out):
        applying.to_parts(adapt_share)
    else:
        applying.to_file(adapt_share)


@app.command()
def reproduce(
    out: Annotated[Path, typer.Option(help="Run folder to write to.", callback=folder_target)],
    preset: Preset = "demo",
    config: Changes = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    train_meshes: TrainMeshes = None,
    test_meshes: TestMeshes = None,
    as_json: AsJson = False,
) -> None:
    """Run the whole experiment; stages that are done and whose inputs are unchanged are reused.

    Example: [bold]rescore reproduce --preset demo --out runs/demo[/bold]
    """
    from rescore.experiment.reproduce import Experiment
    from rescore.results.run_folder import RunFolder

    folder = RunFolder(out)
    settings = config_of(preset, config)
    metrics = Experiment(folder, settings, seed, jobs, _report_stage, train_meshes, test_meshes).all()
    print_results(metrics, {"report": folder.html, "recording": folder.recording}, as_json)


def _report_stage(done: "Done") -> None:
    what = "reused" if done.reused else f"{done.seconds:.1f} s"
    say(f"{done.name:<28} {what}")
