"""The commands of the detectors: train, detect."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import (
    ALL_PROCESSORS,
    TABLE_OUT,
    Address,
    Changes,
    Dataset,
    Engine,
    Jobs,
    Preset,
    Seed,
    Split,
    app,
    config_of,
    folder_target,
    read_data,
    read_split,
    table_target,
    workers_of,
)
from rescore.commands.parts.in_parts import detect_in_parts, in_parts
from rescore.speech import say


@app.command()
def train(
    out: Annotated[
        Path,
        typer.Option(help="Folder for <detector>.npz and <detector>.platt.json.", callback=folder_target),
    ],
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
    detector: Annotated[str, typer.Option(help="Detector to train, such as hog or boosted, or all.")] = "all",
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
    from rescore.detectors.crop_training import config_for_crops, read_crops
    from rescore.detectors.detect import calibrate_detector
    from rescore.detectors.platt import save_scaling
    from rescore.detectors.registry import (
        DETECTORS,
        learned_detectors,
        train_detector,
        train_detector_on_crops,
    )
    from rescore.experiment.config import part_as_json
    from rescore.files import write_provenance

    kinds = learned_detectors() if detector == "all" else tuple(k for k in DETECTORS if k == detector)
    if not kinds:
        known = ", ".join(DETECTORS)
        raise RescoreError(f"--detector: expected {known} or all, got {detector!r}; choose one of these")
    if (dataset is None) == (crops is None):
        raise RescoreError("train: expected a data set or --crops, got both or neither; give one of them")
    settings = config_of(preset, config)
    data = None if dataset is None else read_data(dataset, settings.class_name)
    examples = None if crops is None else read_crops(*crops)
    for kind in kinds:
        chosen = settings.detector_settings[kind]
        if data is not None:
            trained = train_detector(kind, data, chosen, seed, jobs)
            scaling = calibrate_detector(trained, data, jobs)
        else:
            assert examples is not None
            chosen = config_for_crops(chosen, examples.width_px, examples.height_px)
            trained, validation = train_detector_on_crops(kind, examples, chosen, seed, jobs)
            scaling = validation.scaling
            say(f"{kind}, scenes of held-out crops: {validation.curve.summary()}")
        trained.save(out / f"{kind}.npz")
        save_scaling(_scaling_of(out / f"{kind}.npz"), scaling)
        write_provenance(out / f"{kind}.npz", "train", part_as_json(chosen), seed)
        say(f"detector: {out / f'{kind}.npz'}")


@app.command()
def detect(
    dataset: Dataset,
    detector: Annotated[
        Path, typer.Option(help="Detector that `rescore train` wrote, with its .platt.json.")
    ],
    out: Annotated[Path, typer.Option(help=f"Detections to write: {TABLE_OUT}.", callback=table_target)],
    split: Split = "test",
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """Find the 15 best candidates of every frame, with raw scores and likelihoods.

    Example: [bold]rescore detect data/demo --detector models/hog.npz --out hog.json[/bold]
    """
    from recon.files import refuse_as_input
    from rescore.detectors.detect import detect_candidates
    from rescore.detectors.platt import load_scaling
    from rescore.detectors.registry import load_detector
    from rescore.files import write_provenance
    from rescore.formats.coco import write_detections

    workers = workers_of(engine, address, jobs)
    scaling = _scaling_of(detector)
    if in_parts(out):
        found = detect_in_parts(dataset, split, detector, scaling, out, workers)
        n, n_all = found.rows, sum(p.frames for p in found.parts)
        n_frames = f"{n_all - found.n_failed} of {n_all}" if found.n_failed else str(n_all)
    else:
        refuse_as_input(out, (dataset, dataset / "annotations.json"))
        data = read_split(dataset, split)
        trained = load_detector(detector)
        table = detect_candidates(trained, load_scaling(scaling), data, workers)
        write_detections(out, trained.name, table, data)
        n, n_frames = len(table), str(len(data.frames))
    write_provenance(out, "detect", {"detector": str(detector), "split": split}, None)
    say(f"{n} detections in {n_frames} frames: {out}")


def _scaling_of(detector: Path) -> Path:
    return detector.with_suffix(".platt.json")
