"""The command that studies the width of w: study-weight."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import ALL_PROCESSORS, Jobs, Seed, app, read_data
from rescore.speech import say

if TYPE_CHECKING:
    from rescore.data.frames import DataSet
    from rescore.evidence.candidates import CandidateTable, RescoredTable
    from rescore.experiment.config import RunConfig
    from rescore.results.run_folder import RunFolder


@app.command("study-weight")
def study_weight(
    run: Annotated[Path, typer.Argument(help="Finished run of `rescore reproduce`: detectors and models.")],
    out: Annotated[Path, typer.Option(help="Folder for the page, its figure and numbers.")],
    dataset: Annotated[
        Path | None,
        typer.Option(
            help="Data set whose split validation is drawn from, such as one of preset weight-study.",
            show_default="that of the run",
        ),
    ] = None,
    keep: Annotated[
        Path | None, typer.Option(help="Folder to keep the candidates with their evidence in, for reuse.")
    ] = None,
    sizes: Annotated[str, typer.Option(help="Numbers of validation images.")] = "20,100,500",
    draws: Annotated[int, typer.Option(min=20, help="Subsets of each size.")] = 400,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """How wide w is: tune it on many subsets of a large validation set, for each detector and mode.

    Sizes larger than the validation set are left out.

    Example: [bold]rescore study-weight runs/paper --dataset data/weight --out runs/weight[/bold]
    """
    import numpy as np
    from rich.console import Console

    from reports.studies.weight import width_table, write_weight_study
    from rescore.data.splits import Splits
    from rescore.evidence.model import load_models
    from rescore.experiment.config import run_config
    from rescore.fusion.rescore_frame import Rescoring
    from rescore.results.run_folder import RunFolder
    from rescore.studies.weight import study_weight as study

    folder = RunFolder(run)
    config = run_config(run)
    validation = Splits.of(read_data(dataset or folder.data, config.class_name)).validation_set
    chosen = _sizes(sizes, len(validation.data.frames))
    studies = []
    for kind in config.detectors:
        table = _candidates(folder, kind, config, validation.data, keep, jobs)
        models = load_models(folder.evidence_model(kind)) if folder.evidence_model(kind).is_file() else {}
        for number, mode in enumerate(config.registrations):
            rng = np.random.default_rng([seed, number])
            rated = Rescoring(config.rescore, models.get(mode)).fuse(table).candidates
            studies.append(study(kind, mode, rated, validation, chosen, draws, config.tune, rng))
    Console().print(width_table(studies, short=True).rich())
    of_data = "" if dataset is None else f" --dataset {dataset}"
    command = f"rescore study-weight {run}{of_data} --out {out} --sizes {sizes} --draws {draws} --seed {seed}"
    say(f"width of w: {write_weight_study(studies, out, command)}")


def _sizes(text: str, n_images: int) -> list[int]:
    """The sizes of an option that the set can serve."""
    if not all(part.strip().isdigit() and int(part) for part in text.split(",")):
        raise RescoreError(
            f"--sizes: expected numbers with commas between them, such as 20,100, got {text!r}; mend it"
        )
    asked = [int(part) for part in text.split(",")]
    fit = [n for n in asked if n <= n_images]
    if not fit:
        raise RescoreError(
            f"--sizes: expected a number up to the {n_images} validation images, got {text}; choose a "
            "smaller one or render more images"
        )
    if len(fit) < len(asked):
        left_out = ", ".join(str(n) for n in asked if n > n_images)
        say(f"left out {left_out}: there are {n_images} validation images")
    return fit


def _candidates(
    folder: "RunFolder",
    kind: str,
    config: "RunConfig",
    validation: "DataSet",
    keep: Path | None,
    jobs: int,
) -> "CandidateTable":
    """The candidates of a detector of the run on validation images, with depth evidence, before w."""
    from recon.class_model import ClassModel
    from rescore.detectors.detect import detect_candidates
    from rescore.detectors.platt import load_scaling
    from rescore.detectors.registry import load_detector
    from rescore.experiment.config import part_as_json
    from rescore.experiment.stages import Stage, run_stage
    from rescore.formats import coco
    from rescore.fusion import rescore_frames
    from rescore.fusion.rescore_frame import Rescoring

    if validation.root.resolve() == folder.data.resolve():
        return coco.read_detections(folder.evidence_table(kind, "validation"), validation).table
    detector, scaling, model = folder.detector(kind), folder.scaling(kind), folder.class_model
    rescoring = Rescoring(config.rescore)

    def find() -> "RescoredTable":
        found = detect_candidates(load_detector(detector), load_scaling(scaling), validation, jobs)
        candidates = found.by_image([f.image_id for f in validation.frames])
        class_model = ClassModel.load(model)
        return rescore_frames.rescore_frames(
            validation, candidates, class_model, rescoring, jobs=jobs, progress=f"depth evidence {kind}"
        )

    if keep is None:
        return find().candidates
    stage = Stage(
        f"evidence_{kind}",
        part_as_json(config.rescore),
        (detector, scaling, model, validation.root / "annotations.json"),
        (keep / f"{kind}.json",),
        (rescore_frames, coco),
    )
    if run_stage(
        keep,
        stage,
        lambda out: coco.write_rescored(
            out, kind, find(), validation, w=rescoring.w, registration=rescoring.mode
        ),
    ).reused:
        say(f"{kind}: candidates of {keep}")
    return coco.read_detections(keep / f"{kind}.json", validation).table
