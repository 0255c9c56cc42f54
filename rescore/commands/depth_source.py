"""What predicts depth in a command: the class model, or files of another system."""

# ruff: noqa: PLC0415 - imports inside functions keep `--help` quick

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recon.errors import RescoreError
from rescore.commands.base import configs_behind, detections_of
from rescore.speech import say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from recon.class_model import ClassModel
    from rescore.data.frames import DataSet
    from rescore.engines.executor import Workers
    from rescore.evidence.candidates import Candidates, CandidateTable
    from rescore.evidence.predicted_depth_files import PredictionFolder, Predictions
    from rescore.evidence.registration import Registration
    from rescore.fusion.rescore_frame import Rescoring

Model = Annotated[
    Path | None,
    typer.Option(help="Class model that `rescore learn` wrote; or --predicted.", show_default=False),
]
Predicted = Annotated[
    Path | None,
    typer.Option(
        help="In place of --model: JSON file that says where depth predicted by another system lies, and "
        "what it holds.",
    ),
]


@dataclass(frozen=True)
class Source:
    """What predicts depth, as the options of a command say: a class model, its file or itself, or a folder
    of predictions."""

    model: "Path | ClassModel | None"
    folder: "PredictionFolder | None"

    @property
    def depth_of(self) -> str:
        """Whose depth it is, for ``rescore.evidence.registration.check_depth_of``."""
        from rescore.evidence.registration import CLASS_MODEL

        return CLASS_MODEL if self.folder is None else self.folder.depth_of

    def on(self, data: "DataSet", candidates: "Mapping[int, Candidates]") -> "ClassModel | Predictions":
        """What predicts the depth of candidates in the frames of a data set."""
        from recon.class_model import ClassModel
        from rescore.evidence.predicted_depth_files import Predictions

        if self.folder is None:
            assert self.model is not None
            return self.model if isinstance(self.model, ClassModel) else ClassModel.load(self.model)
        return Predictions.of(self.folder, data, [i for i, found in candidates.items() if len(found)])


def source_of(model: Path | None, predicted: Path | None, modes: "tuple[Registration, ...]") -> Source:
    """What predicts depth, from the options of a command that uses ``modes``."""
    from rescore.evidence.predicted_depth import check_mode
    from rescore.evidence.predicted_depth_files import read_prediction_folder

    if (model is None) == (predicted is None):
        came = "neither" if model is None else "both"
        raise RescoreError(
            f"--model, --predicted: expected one of the two, got {came}; a class model or another "
            "system predicts depth"
        )
    if predicted is None:
        return Source(model, None)
    folder = read_prediction_folder(predicted)
    for mode in modes:
        check_mode(folder.unit, mode)
    return Source(None, folder)


def evidence_of(
    data: "DataSet",
    detections: Path,
    asked: Source,
    rescoring: "Rescoring",
    jobs: "Workers",
    folder: Path | None = None,
) -> "tuple[ClassModel | Predictions, CandidateTable, str]":
    """What predicts depth, the depth evidence of the detections of a file, and the detector's name.

    ``folder`` takes what led to each score, a folder a detector; doubts on predictions are told.
    """
    from rescore.fusion.rescore_frames import rescore_frames

    file = detections_of(detections, data)
    candidates = file.candidates(data)
    source = asked.on(data, candidates)
    found = rescore_frames(
        data,
        candidates,
        source,
        rescoring,
        jobs=jobs,
        evidence_dir=None if folder is None else folder / file.detector,
        progress=f"depth evidence {file.detector}",
    )
    table = found.candidates
    tell_doubts(source, table)
    return source, table, file.detector


def source_as_json(source: "ClassModel | Predictions") -> dict[str, Any]:
    """The predictions that were used, for the settings beside a result; empty for the class model."""
    from rescore.evidence.predicted_depth_files import Predictions

    return {"predicted": source.as_json()} if isinstance(source, Predictions) else {}


def predictions_behind(results: "Sequence[Path]") -> dict[str, Any]:
    """The predictions that made rescored detections, by file, as the settings beside them say."""
    found = {str(path): c["predicted"] for path, c in configs_behind(results) if "predicted" in c}
    return {"predicted": found} if found else {}


def tell_doubts(source: "ClassModel | Predictions", table: "CandidateTable") -> None:
    """Say what of the predictions of another system looks wrong."""
    from rescore.evidence.predicted_depth import prediction_doubts
    from rescore.evidence.predicted_depth_files import Predictions

    if isinstance(source, Predictions):
        for doubt in prediction_doubts(table):
            say(f"note: {source.kind.folder}: {doubt}")
