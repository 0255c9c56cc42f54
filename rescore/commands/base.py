"""What the commands share: the application, options that several of them have, and how they speak."""

# ruff: noqa: PLC0415 - imports inside functions keep `--help` quick

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from datasets_synth.cars import MESH_FORMS
from recon.errors import RescoreError
from rescore.speech import say

if TYPE_CHECKING:
    from rescore.data.frames import DataSet
    from rescore.engines.executor import Executor
    from rescore.evidence.candidates import CandidateTable
    from rescore.evidence.model import EvidenceModel
    from rescore.evidence.registration import Registration
    from rescore.experiment.config import RunConfig
    from rescore.formats.bags.topics import Wanted
    from rescore.formats.coco import DetectionFile

app = typer.Typer(
    name="rescore",
    help="Rescore 2D object detections with stereo depth and a 3D class model, and show why.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)

LEARNED_PANEL = "Modes with a learned D"
DETECTION_FORMS = "COCO results JSON, a table in parts, or a folder of KITTI's or YOLO's text with scores"
TABLE_OUT = "a .json file in COCO's results form, else a folder for a table in parts"
SPLIT_HELP = "Frames to work on: train, calibration, validation, test or all."
Dataset = Annotated[
    Path, typer.Argument(help="Folder with annotations.json, or of another layout (docs/own-data.md).")
]
Preset = Annotated[str, typer.Option(help="Settings to start from: paper, demo, streets or tiny.")]
Changes = Annotated[
    Path | None, typer.Option("--config", help="JSON file with settings that replace those of the preset.")
]
Seed = Annotated[
    int,
    typer.Option(help="Seed of every random choice; it fixes every byte, of a recording the rows."),
]
Jobs = Annotated[
    int,
    typer.Option(min=1, help="Frames (or pictures, cars, trials) at a time.", show_default="all processors"),
]
CLUSTER_PANEL = "Clusters (docs/scale.md)"
Engine = Annotated[
    str,
    typer.Option(
        help="Who runs the frames: joblib (processes of this machine), dask or ray.",
        rich_help_panel=CLUSTER_PANEL,
    ),
]
Address = Annotated[
    str | None,
    typer.Option(
        help="A cluster that runs, such as tcp://host:8786 of Dask or auto of Ray; else one starts here.",
        rich_help_panel=CLUSTER_PANEL,
    ),
]
Split = Annotated[str, typer.Option(help=SPLIT_HELP)]
TrainMeshes = Annotated[Path | None, typer.Option(help=f"Folder of {MESH_FORMS} cars to train on.")]
TestMeshes = Annotated[Path | None, typer.Option(help=f"Folder of {MESH_FORMS} cars to test on.")]
REGISTRATION_HELP = "What D comes from: paper (eq. 6), guarded, metric or instance."
RegistrationMode = Annotated[str, typer.Option("--registration", help=REGISTRATION_HELP)]
EvidenceModelFile = Annotated[
    Path | None,
    typer.Option(
        "--evidence-model", help="What `rescore fit-evidence` wrote.", rich_help_panel=LEARNED_PANEL
    ),
]
AdaptShare = Annotated[
    bool,
    typer.Option(
        "--adapt-share",
        help="Let D assume as many cars as the likelihoods say: for a detector that D was not fitted to.",
        rich_help_panel=LEARNED_PANEL,
    ),
]
MAP_HELP = "Take a class for another, as van=car; may be repeated."
Maps = Annotated[list[str] | None, typer.Option("--map", help=MAP_HELP)]
Report = Annotated[bool, typer.Option("--report/--no-report", help="Also draw the curves and the report.")]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print JSON on standard output in place of text.", show_default=False)
]


def file_target(path: Path | None) -> Path | None:
    """The file that an option names to write; refused before any work where it cannot be written."""
    from recon.files import refuse_as_file
    from recon.stores import located

    path = None if path is None else located(path)
    if path is not None:
        refuse_as_file(path)
    return path


def folder_target(path: Path | None) -> Path | None:
    """The folder that an option names to write to; refused before any work where it cannot be."""
    from recon.files import refuse_as_folder
    from recon.stores import located

    path = None if path is None else located(path)
    if path is not None:
        refuse_as_folder(path)
    return path


def table_target(path: Path) -> Path:
    """The file or folder that an option names to write detections to: JSON, or a table in parts."""
    found = file_target(path) if path.suffix == ".json" else folder_target(path)
    assert found is not None
    return found


ALL_PROCESSORS = os.cpu_count() or 1


def workers_of(engine: str, address: str | None, jobs: int) -> "Executor":
    """Who runs the frames, by the options."""
    from rescore.engines.executor import Executor

    return Executor.of(engine, jobs, address)


def config_of(preset: str, changes: Path | None) -> "RunConfig":
    """The settings of a preset with the changes of a file."""
    from rescore.experiment.config import run_preset, with_changes

    config = run_preset(preset)
    return with_changes(config, changes) if changes else config


def read_data(
    dataset: Path, class_name: str = "car", maps: Sequence[str] | None = (), *, of_several: bool = False
) -> "DataSet":
    """A data set of any layout; what its reader left out or doubts is told.

    ``maps`` holds other names of the class, such as ``van=car``; ``of_several`` says that they are for
    detections too, which may lack some (see ``rescore.formats.labels.ClassMap``).
    """
    from rescore.formats.labels import ClassMap
    from rescore.formats.open import read_dataset

    return _told(
        read_dataset(dataset, class_name, ClassMap.of(class_name, maps or (), of_several=of_several))
    )


def imported_data(
    dataset: Path, class_name: str, maps: Sequence[str], out: Path, topics: "Wanted", *, rectify: bool
) -> "DataSet":
    """A data set to write to ``out``; a recording of ROS, or pictures to rectify, are written there already.

    Its notes are told.
    """
    from rescore.formats.bags.reader import is_bag
    from rescore.formats.bags.topics import Wanted
    from rescore.formats.bags.unpack import import_bag
    from rescore.formats.calibrations.rectify import rectified_dataset
    from rescore.formats.labels import ClassMap
    from rescore.formats.parts.manifest import refuse_data_set

    refuse_data_set(out)
    classes = ClassMap.of(class_name, maps)
    if is_bag(dataset):
        return _told(import_bag(dataset, topics, classes, out, rectify=rectify))
    if topics != Wanted():
        raise RescoreError(
            f"{dataset}: expected a recording of ROS to take topics from, got none; leave out --left, "
            "--right and --detections"
        )
    return (
        _told(rectified_dataset(dataset, classes, out)) if rectify else read_data(dataset, class_name, maps)
    )


def _told(data: "DataSet") -> "DataSet":
    for note in data.notes:
        say(f"note: {note}")
    return data


def read_split(
    dataset: Path, split: str, class_name: str = "car", maps: Sequence[str] | None = None
) -> "DataSet":
    """A data set cut to one split, or all of it; ``maps`` are for its boxes and for detections."""
    from rescore.data.frames import SPLITS

    if split not in (*SPLITS, "all"):
        raise RescoreError(
            f"--split: expected {', '.join(SPLITS)} or all, got {split!r}; choose one of these"
        )
    data = read_data(dataset, class_name, maps, of_several=True)
    chosen = data if split == "all" else data.split(split)
    if not chosen.frames:
        raise RescoreError(f"{dataset}: expected frames of split {split!r}, got none; choose another --split")
    return chosen


def detections_of(
    path: Path, data: "DataSet", maps: Sequence[str] | None = None, *, every: bool = False
) -> "DetectionFile":
    """The detections of a file or folder on the images of a data set; says what was left out.

    ``maps`` as for ``read_data``, by default those that the data set was read with; ``every`` keeps all
    detections, else the best of each image are kept.
    """
    from rescore.formats.coco import MAX_CANDIDATES
    from rescore.formats.labels import ClassMap
    from rescore.formats.open import read_detections

    most = None if every else MAX_CANDIDATES
    classes = None if maps is None else ClassMap.of(data.category, maps)
    file = read_detections(path, data, most, classes)
    for note in file.notes:
        say(f"note: {note}")
    if file.n_beyond_max:
        say(
            f"{path}: left out {file.n_beyond_max} detections beyond the {MAX_CANDIDATES} best of their image"
        )
    return file


def mode_of(registration: str, file: Path | None) -> "tuple[Registration, EvidenceModel | None]":
    """The mode of a name, and its model where its D is calibrated."""
    from rescore.evidence.model import load_model
    from rescore.evidence.registration import LEARNED, Registration

    if registration not in list(Registration):
        known = ", ".join(Registration)
        raise RescoreError(f"--registration: expected {known}, got {registration!r}; choose one of these")
    mode = Registration(registration)
    if mode not in LEARNED:
        return mode, None
    if file is None:
        raise RescoreError(
            f"--registration {mode}: expected --evidence-model, got none; `rescore fit-evidence` makes one"
        )
    return mode, load_model(file, mode)


def with_share(
    learned: "EvidenceModel | None", table: "CandidateTable", adapt: bool
) -> "tuple[EvidenceModel | None, float]":
    """The evidence model, for the share of cars among the candidates if asked, and its shift; says it.

    Where it is not asked for and matters, that is said.
    """
    from rescore.evidence.car_share import share_doubt, with_share_of
    from rescore.evidence.registration import LEARNED

    if not adapt:
        doubt = "" if learned is None else share_doubt(learned, table)
        if doubt:
            say(f"note: {doubt}")
        return learned, 0.0
    if learned is None:
        raise RescoreError(
            f"--adapt-share: expected --registration {', '.join(LEARNED)}, got paper, whose D is no "
            "probability; leave the option out"
        )
    adapted = with_share_of(learned, table)
    say(f"D for a share of {adapted.share:.0%} cars: log odds moved by {adapted.log_odds_shift:+.2f}")
    return adapted.model, adapted.log_odds_shift


def configs_behind(results: Sequence[Path]) -> "list[tuple[Path, dict[str, Any]]]":
    """The settings that lie beside results, for those that have some."""
    from rescore.files import read_json

    found = []
    for path in results:
        settings = path.with_name(path.name + ".config.json")
        value = read_json(settings, "the settings of a result") if settings.is_file() else None
        config = value.get("config") if isinstance(value, dict) else None
        if isinstance(config, dict):
            found.append((path, config))
    return found


def print_json(value: Any) -> None:
    """Print JSON values on standard output; numbers that JSON cannot hold become null."""
    import json

    from rescore.files import json_values

    print(json.dumps(json_values(value), indent=1, ensure_ascii=False))
