"""What the study of class models found, as typed values, and the file models.json that holds it."""

from pathlib import Path
from typing import Self

from rescore.files import write_json
from rescore.results.sweep_file import StudyPart
from rescore.studies.class_models import SHOWN_PRIMITIVES, AccuracyRow, ModelStudy, SelectionStudy


class ChosenPrimitives(StudyPart):
    """Primitives in the order in which they were chosen, and the parts that they serve."""

    normals: tuple[tuple[float, float, float], ...]
    """Orientation of each."""
    cost: tuple[float, ...]
    """Mean cost of all parts with the first 1, 2, ... of them."""
    full_cost: float
    """Mean cost of all parts with the whole library."""
    parts: tuple[str, ...]
    """Class and name of each part, as "chair/seat"."""
    chosen_of_four: tuple[int, ...]
    """For each part, which of the first ``SHOWN_PRIMITIVES`` costs it least."""

    @classmethod
    def of(cls, study: SelectionStudy) -> Self:
        """The figures of a selection."""
        chosen = study.selection
        return cls(
            normals=tuple(study.normals[chosen.order].tolist()),
            cost=tuple(chosen.cost.tolist()),
            full_cost=chosen.full_cost,
            parts=tuple(f"{class_name}/{part}" for class_name, part in study.parts),
            chosen_of_four=tuple(study.best_of_first(SHOWN_PRIMITIVES).tolist()),
        )


class ModelsResult(StudyPart):
    """The content of models.json."""

    selection: ChosenPrimitives
    accuracy: tuple[AccuracyRow, ...]

    @classmethod
    def of(cls, study: ModelStudy) -> Self:
        """The figures of a study, without its models."""
        return cls(selection=ChosenPrimitives.of(study.selection), accuracy=study.accuracy)


def write_models(path: Path, result: ModelsResult) -> None:
    """Write models.json."""
    write_json(path, result.as_json())
