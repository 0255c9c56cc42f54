"""What predicts depth in a command: the class model, or files of another system."""

# ruff: noqa: PLC0415 - imports inside functions keep `--help` quick

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recon.errors import RescoreError
from rescore.commands.base import configs_behind, detections_of, say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from recon.class_model import ClassModel
    from rescore.data.frames import DataSet
    from rescore.evidence.candidates import Candidates, CandidateTable
    from rescore.evidence.predicted_files import PredictionFolder, Predictions
    from rescore.evidence.registration import Registration
    from rescore.evidence.settings import RescoreConfig

Model = Annotated[
    Path | None,
    typer.Option(help="Class model that `rescore learn` wrote; or --predicted-depth.", show_default=False),
]
PredictedDir = Annotated[
    Path | None,
    typer.Option(
        "--predicted-depth",
        help="In place of --model: folder of depth that another system predicts, a file a frame.",
        rich_help_panel="Predictions of another system",
    ),
]
As = Annotated[
    str | None,
    typer.Option(
        "--predicted-as",
        help="What the files hold: depth or inverse (as MiDaS gives it).",
        rich_help_panel="Predictions of another system",
    ),
]
Unit = Annotated[
    str | None,
    typer.Option(
        "--predicted-unit",
        help="relative (free scale and offset; registration paper alone) or metric.",
        show_default="relative",
        rich_help_panel="Predictions of another system",
    ),
]
Factor = Annotated[
    float | None,
    typer.Option(
        "--predicted-factor",
        help="Value of metric files for one metre, such as 1000.",
        show_default="1",
        rich_help_panel="Predictions of another system",
    ),
]
Masks = Annotated[
    Path | None,
    typer.Option(
        "--predicted-masks",
        help="Folder of grey PNG, not 0 on objects: nothing else in a box is compared.",
        rich_help_panel="Predictions of another system",
    ),
]


@dataclass(frozen=True)
class Source:
    """What predicts depth, as the options of a command say: a class model or a folder of predictions."""

    model: Path | None
    folder: "PredictionFolder | None"

    @property
    def depth_of(self) -> str:
        """Whose depth it is, for ``rescore.evidence.registration.check_depth_of``."""
        from rescore.evidence.registration import CLASS_MODEL

        return CLASS_MODEL if self.folder is None else self.folder.depth_of

    def on(self, data: "DataSet", candidates: "Mapping[int, Candidates]") -> "ClassModel | Predictions":
        """What predicts the depth of candidates in the frames of a data set."""
        from recon.class_model import ClassModel
        from rescore.evidence.predicted_files import Predictions

        if self.folder is None:
            assert self.model is not None
            return ClassModel.load(self.model)
        return Predictions.of(self.folder, data, [i for i, found in candidates.items() if len(found)])


def source_of(
    model: Path | None,
    folder: Path | None,
    predicted_as: str | None,
    unit: str | None,
    factor: float | None,
    masks: Path | None,
    modes: "tuple[Registration, ...]",
) -> Source:
    """What predicts depth, from the options of a command that uses ``modes``."""
    if (model is None) == (folder is None):
        came = "neither" if model is None else "both"
        raise RescoreError(
            f"--model, --predicted-depth: expected one of the two, got {came}; a class model or another "
            "system predicts depth"
        )
    if folder is not None:
        return Source(None, _folder(folder, predicted_as, unit, factor, masks, modes))
    given = {"as": predicted_as, "unit": unit, "factor": factor, "masks": masks}
    idle = [f"--predicted-{name}" for name, value in given.items() if value is not None]
    if idle:
        raise RescoreError(f"{idle[0]}: expected --predicted-depth with it, got none; give the folder too")
    return Source(model, None)


def _folder(
    folder: Path,
    predicted_as: str | None,
    unit: str | None,
    factor: float | None,
    masks: Path | None,
    modes: "tuple[Registration, ...]",
) -> "PredictionFolder":
    from rescore.evidence.predicted import PredictedAs, PredictedUnit, check_mode
    from rescore.evidence.predicted_files import PredictionFolder

    if predicted_as not in list(PredictedAs):
        raise RescoreError(
            f"--predicted-as: expected {' or '.join(PredictedAs)}, got {predicted_as!r}; say what the files "
            f"of {folder} hold"
        )
    unit = PredictedUnit.RELATIVE if unit is None else unit
    if unit not in list(PredictedUnit):
        raise RescoreError(
            f"--predicted-unit: expected {' or '.join(PredictedUnit)}, got {unit!r}; choose one of these"
        )
    if factor is not None and unit != PredictedUnit.METRIC:
        raise RescoreError(
            "--predicted-factor: expected metric predictions, got relative ones, whose scale is free; "
            "leave it out or give --predicted-unit metric"
        )
    for mode in modes:
        check_mode(unit, mode)
    kind = PredictedAs(predicted_as), PredictedUnit(unit)
    return PredictionFolder(folder, *kind, 1.0 if factor is None else factor, masks)


def evidence_of(
    data: "DataSet",
    detections: Path,
    asked: Source,
    config: "RescoreConfig",
    jobs: int,
    folder: Path | None = None,
) -> "tuple[ClassModel | Predictions, CandidateTable, str]":
    """What predicts depth, the depth evidence of the detections of a file, and the detector's name.

    ``folder`` takes what led to each score, a folder a detector; doubts on predictions are told.
    """
    from rescore.fusion.rescore_frame import Rescoring
    from rescore.fusion.rescore_frames import rescore_frames

    file = detections_of(detections, data)
    candidates = file.candidates(data)
    source = asked.on(data, candidates)
    found = rescore_frames(
        data,
        candidates,
        source,
        Rescoring(config),
        jobs=jobs,
        evidence_dir=None if folder is None else folder / file.detector,
        progress=f"depth evidence {file.detector}",
    )
    table = found.candidates
    tell_doubts(source, table)
    return source, table, file.detector


def source_as_json(source: "ClassModel | Predictions") -> dict[str, Any]:
    """The predictions that were used, for the settings beside a result; empty for the class model."""
    from rescore.evidence.predicted_files import Predictions

    return {"predicted": source.as_json()} if isinstance(source, Predictions) else {}


def predictions_behind(results: "Sequence[Path]") -> dict[str, Any]:
    """The predictions that made rescored detections, by file, as the settings beside them say."""
    found = {str(path): c["predicted"] for path, c in configs_behind(results) if "predicted" in c}
    return {"predicted": found} if found else {}


def tell_doubts(source: "ClassModel | Predictions", table: "CandidateTable") -> None:
    """Say what of the predictions of another system looks wrong."""
    from rescore.evidence.predicted import prediction_doubts
    from rescore.evidence.predicted_files import Predictions

    if isinstance(source, Predictions):
        for doubt in prediction_doubts(table):
            say(f"note: {source.kind.folder}: {doubt}")
