"""What published studies say: their pages from their JSON alone, and the figures that prose tells."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from pydantic import TypeAdapter

from reports.studies.class_model_worth import worth_page
from reports.studies.localization import mean_without_flips
from reports.studies.relief import relief_page
from reports.studies.sweep import sweep_text
from rescore.formats.checked_json import read_checked
from rescore.grasping.basket import BasketResult, read_baskets
from rescore.grasping.result_file import REPORTED_PLACEMENTS, GraspResult, counted, read_grasps
from rescore.results.sweep_file import read_sweep
from rescore.studies.class_model_worth import read_worth
from rescore.studies.localization.result_file import read_localization
from rescore.studies.relief.relief_file import read_relief
from rescore.studies.view_bins import load_confusions
from rescore.studies.weight import WeightRecord

VIEW_STUDIES = ("car", "car_5_degrees")
"""Studies of view bins that prose tells of."""


def study_pages(published: Path) -> Iterator[tuple[Path, str]]:
    """The published pages whose text comes of their JSON alone, with that text."""
    worth, relief = (published / "streets" / name for name in ("class_model", "relief"))
    sweep = published / "evidence" / "sweep"
    yield worth / "README.md", worth_page(read_worth(worth / "class_model.json"))
    yield relief / "README.md", relief_page(read_relief(relief / "relief.json"))
    yield sweep / "README.md", sweep_text(read_sweep(sweep / "sweep.json"))


def study_figures(published: Path) -> dict[str, Any]:
    """The figures of the studies of localisation, of w and of view bins, by the names that templates use."""
    return {
        "localization": _localization(published / "localization" / "localization.json"),
        "grasping": GraspingFigures.of(published / "grasping"),
        "weights": {(w.detector, w.registration): w for w in _weights(published / "weight" / "weight.json")},
        "views": {name: _right_view(published / "view_bins" / f"{name}.json") for name in VIEW_STUDIES},
    }


def _localization(file: Path) -> SimpleNamespace:
    result = read_localization(file)
    rows = result.placements
    return SimpleNamespace(
        methods=result.methods,
        report=result.report,
        n=len(rows),
        n_cars=len({row.car for row in rows}),
        without_flips={name: mean_without_flips(result, name) for name in ("3dp", "3dp_report")},
    )


@dataclass(frozen=True)
class GraspingFigures:
    """The published figures of section 5.2."""

    result: GraspResult
    baskets: BasketResult

    @classmethod
    def of(cls, folder: Path) -> "GraspingFigures":
        """The figures in a folder."""
        return cls(read_grasps(folder / "grasp.json"), read_baskets(folder / "basket.json"))

    @property
    def as_reported(self) -> "GraspingFigures":
        """The figures of as many placements as the report has."""
        return replace(self, result=self.result.first(REPORTED_PLACEMENTS))

    @property
    def cars(self) -> int:
        """Number of cars."""
        return len(self.result.cars)

    @property
    def placements(self) -> int:
        """Placements of each car."""
        return self.result.placements

    def held(self, method: str, hand: str) -> str:
        """How many trials held the car, of how many."""
        return counted(self.result.verdicts(method, hand))[0]

    def gentle(self, method: str, hand: str) -> str:
        """How many trials held the car gently, of how many."""
        return counted(self.result.verdicts(method, hand))[1]

    def interval(self, method: str, hand: str) -> str:
        """Wilson's interval of the share gently held."""
        return counted(self.result.verdicts(method, hand))[3]

    def basket(self, basket: str, hand: str) -> str:
        """How many trials held a basket, of how many."""
        return counted([r.verdicts[hand] for r in self.baskets.rows if r.basket == basket])[0]


def _weights(file: Path) -> tuple[WeightRecord, ...]:
    return read_checked(file, TypeAdapter(tuple[WeightRecord, ...]), "a study of w")


def _right_view(file: Path) -> float:
    """The share of photographs for which the class model chooses the right view bin."""
    tables, _ = load_confusions(file)
    return tables["level_set"].shares().exact
