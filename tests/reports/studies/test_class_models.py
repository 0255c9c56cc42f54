"""The page on class models, from a small study made by hand."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from recon.class_model import ClassModel, ClassPart
from recon.part_views import PartView
from recon.view_bins import ViewBins
from reports.studies.class_models import accuracy_table, write_study
from rescore.studies.class_models import AccuracyRow, ModelStudy, SelectionStudy, select_primitives


@pytest.fixture
def study() -> ModelStudy:
    cost = np.array([[1.0, 4.0, 9.0, 9.0, 9.0], [4.0, 1.0, 9.0, 9.0, 9.0], [9.0, 9.0, 1.0, 4.0, 4.0]]) / 100
    normals = np.concatenate([np.eye(3), [[0.6, 0.0, 0.8], [0.0, 0.6, 0.8]]])
    parts = (("chair", "seat"), ("chair", "back"), ("car_six_parts", "hood"))
    selection = SelectionStudy(parts, normals, cost, select_primitives(cost, 5))
    square = np.array([[0.5, 0.5, 0], [-0.5, 0.5, 0], [-0.5, -0.5, 0], [0.5, -0.5, 0]])
    part = ClassPart(1, np.zeros(3), np.array([0, 0, 1.0, 0]), square, 2, 2)
    model = ClassModel(
        "chair", ("seat",), ViewBins(), (part,), (PartView(1, np.ones((4, 4), np.uint8), "a"),)
    )
    rows = (AccuracyRow("chair", 20.0, 2, 6, 36, 4.04, 14.9, 0.0136, 0.0464),)
    return ModelStudy(selection, rows, (("bins 1 and 2 of a", model),))


def test_page_numbers_and_pictures(study: ModelStudy, tmp_path: Path) -> None:
    page = write_study(study, tmp_path / "models", "rescore study-models --out X").read_text()
    assert "Made by `rescore study-models --out X`" in page
    # all costs are 1/100 with three primitives: nothing is left to gain
    assert "0.0% with 3" in page
    assert "| chair | 20 deg | 2 | 6 | 36 | 4.0 deg | 14.9 deg | 1.4% | 4.6% |" in page
    numbers = json.loads((tmp_path / "models" / "models.json").read_text())
    assert numbers["selection"]["chosen_of_four"] == [
        study.selection.selection.order.tolist().index(k) for k in (0, 1, 2)
    ]
    for name in ("primitives_cost.png", "primitives_chosen.png", "models.png"):
        assert f"({name})" in page
        picture = imread(tmp_path / "models" / name)
        assert picture[..., :3].std() > 0.02


def test_table_has_a_row_for_each_number_of_views(study: ModelStudy) -> None:
    table = accuracy_table(study.accuracy * 3)
    assert len(table.rows) == 3
    assert len(table.head) == len(table.rows[0])
