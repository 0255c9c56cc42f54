"""A data set of streets seen along their length, on disk."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from datasets_synth.build import build_dataset
from datasets_synth.cars.models import cars_of_splits
from datasets_synth.street.frame_synth import car_schedule, synth_frame
from recon.camera import GroundPlane
from recon.stereo.sgbm import read_disparity
from rescore.data.frames import DataSet
from rescore.data.splits import Splits
from rescore.formats.coco_dataset import read_dataset
from tests.datasets_synth.small_streets import PICTURES, SMALL


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("streets") / "data"
    build_dataset(SMALL, out, seed=7)
    return out


@pytest.fixture(scope="module")
def annotations(folder: Path) -> Any:
    return json.loads((folder / "annotations.json").read_text())


@pytest.fixture(scope="module")
def data(folder: Path) -> DataSet:
    return read_dataset(folder)


def test_pictures_of_one_data_set_may_differ_in_size(folder: Path, annotations: Any, data: DataSet) -> None:
    sizes = {(i["width"], i["height"]) for i in annotations["images"]}
    assert sizes == {(rig.width_px, rig.height_px) for rig in SMALL.along.rigs}
    for image, frame in zip(annotations["images"], data.frames, strict=True):
        assert (frame.width_px, frame.height_px) == (image["width"], image["height"])
        for name in ("file_name", "right_file_name"):
            assert cv2.imread(str(folder / image[name])).shape == (image["height"], image["width"], 3)
        read_disparity(folder / image["disparity_file_name"], image["width"], image["height"])


def test_the_reader_finds_a_ground_where_one_is_stated(annotations: Any, data: DataSet) -> None:
    stated = 0
    for image, frame in zip(annotations["images"], data.frames, strict=True):
        truth = GroundPlane(**image["ground_truth"])
        assert 1.1 < truth.height_m < 1.9
        if "height_m" in image["camera"]:
            stated += 1
            assert frame.ground == truth
        else:
            assert frame.ground is None
    assert 0 < stated < len(data.frames)


def test_no_shape_of_a_split_stands_in_another(data: DataSet) -> None:
    assert len(Splits.of(data).test.frames) == 1


def test_annotations_are_of_one_category_with_their_3d_boxes(annotations: Any) -> None:
    kinds = {i["id"]: {e["kind"] for e in i["instances"]} for i in annotations["images"]}
    assert len(annotations["categories"]) == 1
    for a in annotations["annotations"]:
        assert a["category_id"] == 1
        assert a["kind"] in kinds[a["image_id"]]
        assert len(a["bbox3d"]) == 7
        assert a["bbox3d"][2] > 0
        assert -np.pi <= a["bbox3d"][6] <= np.pi


def test_the_reader_takes_3d_boxes_and_how_much_is_seen(annotations: Any, data: DataSet) -> None:
    for image, frame in zip(annotations["images"], data.frames, strict=True):
        rows = [a for a in annotations["annotations"] if a["image_id"] == image["id"]]
        truth = data.truth[frame.image_id]
        if not rows:
            continue
        assert truth.boxes3d is not None
        assert truth.boxes3d.centre_cam_m.tolist() == [a["bbox3d"][:3] for a in rows]
        assert truth.boxes3d.size_m.tolist() == [a["bbox3d"][3:6] for a in rows]
        assert truth.boxes3d.rotation_y_rad.tolist() == [a["bbox3d"][6] for a in rows]
        assert truth.truncated is not None
        assert truth.truncated.tolist() == [a["truncated"] for a in rows]
        assert truth.occluded is not None
        assert truth.occluded.tolist() == [a["occluded"] for a in rows]


def test_the_matcher_searches_what_each_rig_needs(folder: Path, annotations: Any) -> None:
    farthest = {}
    for image in annotations["images"]:
        measured = read_disparity(folder / image["disparity_file_name"], image["width"], image["height"])
        camera = image["camera"]
        # surfaces at 2.7 m are within reach: 214 px * 0.54 m / 2.7 m = 43, 131 * 0.12 / 2.7 = 5.8
        reach = -(-(camera["fx"] * camera["baseline_m"] / 2.7 + 1) // 16) * 16
        assert np.nanmax(measured) < reach
        farthest[image["rig"]] = reach
    assert farthest == {"wide": 48, "narrow": 16}


def test_streets_hold_as_many_cars_as_they_do() -> None:
    assert car_schedule(SMALL.splits["train"], 0, "train") == (None, None, None)


def test_a_frame_is_a_function_of_its_seed() -> None:
    cars = cars_of_splits()["train"]
    a, b, c = (
        synth_frame(SMALL, seed, "train", 0, n_cars=None, cars=cars, pictures=PICTURES) for seed in (3, 3, 4)
    )
    assert np.array_equal(a.render.left_rgb, b.render.left_rgb)
    assert np.array_equal(a.render.right_rgb, b.render.right_rgb)
    assert a.render.left_rgb.shape != c.render.left_rgb.shape or not np.array_equal(
        a.render.left_rgb, c.render.left_rgb
    )
