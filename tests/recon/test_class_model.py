"""The class model's file: readable, exact, and refused with a clear word where it is something else."""

import json
from pathlib import Path

import numpy as np
import pytest

from recon.class_model import ClassModel, ClassPart
from recon.errors import RescoreError
from recon.learning.learn import LearnConfig, learn_class_model
from recon.part_views import PartView, PartViews, load_part_views, save_part_views
from recon.view_bins import ViewBins
from tests.exact_primitives import exact_library
from tests.recon.box_car import PART_NAMES, box_car, labelled_view

BINS = ViewBins(12, np.deg2rad(10))


@pytest.fixture(scope="module")
def views() -> PartViews:
    return PartViews(
        PART_NAMES, BINS, tuple(labelled_view(box_car(), b, BINS, width_px=160) for b in (1, 2, 3))
    )


@pytest.fixture(scope="module")
def model(views: PartViews) -> ClassModel:
    return learn_class_model(views, "car", PART_NAMES, None, exact_library(BINS))


def test_round_trip_is_exact(model: ClassModel, tmp_path: Path) -> None:
    path = tmp_path / "car.json"
    model.save(path)
    back = ClassModel.load(path)
    assert (back.class_name, back.part_names, back.bins) == (model.class_name, model.part_names, model.bins)
    for a, b in zip(back.parts, model.parts, strict=True):
        assert (a.label, a.primitive, a.view_count) == (b.label, b.primitive, b.view_count)
        for name in ("centroid", "plane", "outline"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for a, b in zip(back.views, model.views, strict=True):
        assert (a.view_bin, a.instance_id) == (b.view_bin, b.instance_id)
        np.testing.assert_array_equal(a.labels, b.labels)
    back.save(tmp_path / "again.json")
    assert path.read_bytes() == (tmp_path / "again.json").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again.json", "car.json"]


def test_file_is_readable_json_with_the_view_rotations(model: ClassModel, tmp_path: Path) -> None:
    model.save(tmp_path / "car.json")
    data = json.loads((tmp_path / "car.json").read_text())
    assert data["format"] == "class-model 1"
    assert [p["name"] for p in data["parts"]] == [PART_NAMES[p.label - 1] for p in model.parts]
    np.testing.assert_array_equal(data["view_from_object"][3], BINS.view_from_object(3))


def test_learning_takes_the_bins_of_the_views(model: ClassModel, views: PartViews) -> None:
    assert model.bins == BINS
    explicit = learn_class_model(views.views, "car", PART_NAMES, LearnConfig(bins=BINS), exact_library(BINS))
    np.testing.assert_array_equal(explicit.parts[0].plane, model.parts[0].plane)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not json", "could not read it"),
        ("[1, 2]", "expected a file of format 'class-model 1', got 'list'"),
        ('{"format": "class-model 9"}', "got 'class-model 9'"),
        ('{"format": "class-model 1"}', "could not read it .KeyError"),
    ],
)
def test_wrong_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "car.json").write_text(text)
    with pytest.raises(RescoreError, match=message):
        ClassModel.load(tmp_path / "car.json")


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match="expected a class model, found no file"):
        ClassModel.load(tmp_path / "car.json")


def test_missing_view_and_part(model: ClassModel) -> None:
    with pytest.raises(RescoreError, match="expected a labelled view of bin 7, has bins 1, 2, 3"):
        model.view(7)
    with pytest.raises(KeyError):
        model.part(99)


def test_parts_are_checked() -> None:
    with pytest.raises(ValueError, match="length 1"):
        ClassPart(1, np.zeros(3), np.array([0.0, 2.0, 0.0, 0.0]), np.zeros((3, 3)), 0, 2)


def test_labelled_views_round_trip(views: PartViews, tmp_path: Path) -> None:
    save_part_views(tmp_path, views)
    back = load_part_views(tmp_path)
    assert (back.part_names, back.bins) == (views.part_names, views.bins)
    for a, b in zip(back.views, views.views, strict=True):
        assert (a.view_bin, a.instance_id) == (b.view_bin, b.instance_id)
        np.testing.assert_array_equal(a.labels, b.labels)


def test_labelled_views_with_faults(views: PartViews, tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match="expected labelled views, found no file"):
        load_part_views(tmp_path)
    save_part_views(tmp_path, views)
    next(tmp_path.glob("*bin02.png")).unlink()
    with pytest.raises(RescoreError, match="expected a PNG of part labels, found no file"):
        load_part_views(tmp_path)
    (tmp_path / "part_views.json").write_text('{"format": "part-views 0"}')
    with pytest.raises(RescoreError, match="got 'part-views 0'"):
        load_part_views(tmp_path)


def test_empty_labels_are_refused() -> None:
    with pytest.raises(RescoreError, match="expected at least one labelled part"):
        PartView(0, np.zeros((4, 4), np.uint8), "blank")
