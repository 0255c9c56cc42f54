import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from datasets_synth import build
from datasets_synth.build import build_dataset
from datasets_synth.presets import CarConfig, SplitSize, SynthConfig, synth_preset
from datasets_synth.street.frame_synth import car_schedule, synth_frame
from recon.errors import RescoreError
from recon.part_views import load_part_views
from recon.stereo.accuracy import disparity_error
from recon.stereo.sgbm import read_disparity
from rescore.data.frames import SPLITS
from rescore.data.splits import Splits
from rescore.formats.coco_dataset import read_dataset

TINY = replace(
    synth_preset("tiny"),
    splits={
        "train": SplitSize(2, 2),
        "calibration": SplitSize(1, 1),
        "validation": SplitSize(1, 0),
        "test": SplitSize(2, 3),
    },
    n_pictures=1,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("synth") / "data"
    build_dataset(TINY, out, seed=3)
    return out


@pytest.fixture(scope="module")
def annotations(folder: Path) -> Any:
    return json.loads((folder / "annotations.json").read_text())


def _bytes(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def test_a_killed_build_is_taken_up_again_and_gives_the_same_bytes(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    half = tmp_path / "data"
    shutil.copytree(folder, half)
    # as a kill leaves it: no annotations, one frame without a record, another half written
    (half / "annotations.json").unlink()
    (half / "records" / "test_0001.json").unlink()
    (half / "records" / "train_0000.json").unlink()
    (half / "left" / "test_0001.png").write_bytes(b"half a picture")
    (half / "disparity" / "train_0000.png").unlink()
    built: list[str] = []

    def watched(record: Any, shared: Any) -> None:
        split, index, _ = record
        built.append(f"{split}_{index:04d}")
        original(record, shared)

    original = build._build_frame
    monkeypatch.setattr(build, "_build_frame", watched)
    build_dataset(TINY, half, seed=3)
    assert built == ["train_0000", "test_0001"]
    assert _bytes(half) == _bytes(folder)


def test_two_frames_at_a_time_give_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    build_dataset(TINY, tmp_path / "data", seed=3, jobs=2)
    assert _bytes(tmp_path / "data") == _bytes(folder)


def test_another_seed_builds_anew_and_differs(folder: Path) -> None:
    cars, pictures = build.cars_of_splits()["train"], ()
    a, b = (
        synth_frame(TINY, seed, "train", 0, n_cars=1, cars=cars, pictures=pictures).render.left_rgb
        for seed in (3, 4)
    )
    assert not np.array_equal(a, b)


def test_the_planned_numbers_of_cars_are_annotated_exactly(annotations: Any) -> None:
    for split, size in TINY.splits.items():
        ids = {i["id"] for i in annotations["images"] if i["split"] == split}
        counted = [a for a in annotations["annotations"] if a["image_id"] in ids and not a["ignore"]]
        assert len(ids) == size.n_images
        assert len(counted) == size.n_cars


@pytest.mark.parametrize("split", SPLITS)
def test_the_schedule_of_the_paper_adds_up_and_has_frames_without_cars(split: str) -> None:
    size = synth_preset("paper").splits[split]
    counts = car_schedule(size, 0, split)
    assert len(counts) == size.n_images
    assert sum(counts) == size.n_cars
    assert 0 in counts
    assert max(counts) >= 2
    assert counts == car_schedule(size, 0, split)


def test_annotations_follow_the_contract(annotations: Any) -> None:
    for image in annotations["images"]:
        assert {
            "id",
            "file_name",
            "right_file_name",
            "disparity_file_name",
            "width",
            "height",
            "split",
        } <= set(image)
        assert {"truth_disparity_file_name", "instance_file_name", "instances"} <= set(image)
        assert set(image["camera"]) == {"fx", "fy", "cx", "cy", "baseline_m", "height_m", "pitch_rad"}
    for a in annotations["annotations"]:
        assert {
            "bbox",
            "iscrowd",
            "ignore",
            "visibility",
            "view_bin",
            "azimuth_deg",
            "pose",
            "size_m",
        } <= set(a)
        x, y, w, h = a["bbox"]
        assert x >= 0
        assert y >= 0
        assert x + w <= 320 + 1e-6
        assert y + h <= 240 + 1e-6
        if not a["ignore"]:
            assert a["view_bin"] == 3
            assert 75 <= a["azimuth_deg"] <= 105
            assert a["visibility"] >= TINY.cars.min_visibility


def test_the_reader_of_data_sets_takes_it_and_finds_no_leak(folder: Path) -> None:
    data = read_dataset(folder)
    splits = Splits.of(data)
    assert len(splits.test.frames) == 2
    frame = data.frames[0]
    assert frame.camera is not None
    assert frame.ground is not None
    assert frame.ground.height_m == pytest.approx(1.45, abs=0.26)


def test_the_ground_plane_of_the_record_fits_the_truth(folder: Path, annotations: Any) -> None:
    """The truth disparity on the road is that of the recorded ground plane."""
    checked = 0
    data = read_dataset(folder)
    for image, frame in zip(annotations["images"], data.frames, strict=True):
        road = [i["id"] for i in image["instances"] if i["kind"] == "road"]
        instance = cv2.imread(str(folder / image["instance_file_name"]), cv2.IMREAD_UNCHANGED)
        truth = read_disparity(folder / image["truth_disparity_file_name"], 320, 240)
        on_road = np.isin(instance, road)
        if on_road.sum() < 50 or frame.camera is None or frame.ground is None:
            continue
        v, u = np.nonzero(on_road)
        depth = frame.ground.intersect(frame.camera.left.rays(np.stack([u, v], 1).astype(float)))[:, 2]
        expected = frame.camera.disparity_px(depth)
        # files keep 1/256 px; manholes and marks lie 5 mm above the road
        assert np.nanmedian(np.abs(expected - truth[on_road])) < 0.02
        checked += 1
    assert checked >= 2


def test_instance_pictures_and_their_kinds_agree_with_the_boxes(folder: Path, annotations: Any) -> None:
    for image in annotations["images"]:
        instance = cv2.imread(str(folder / image["instance_file_name"]), cv2.IMREAD_UNCHANGED)
        assert instance.dtype == np.uint16
        assert set(np.unique(instance)) - {0} == {i["id"] for i in image["instances"]}
        cars = np.isin(instance, [i["id"] for i in image["instances"] if i["kind"] == "car"])
        boxes = [a["bbox"] for a in annotations["annotations"] if a["image_id"] == image["id"]]
        inside = np.zeros(cars.shape, bool)
        for x, y, w, h in boxes:
            inside[int(y) : int(np.ceil(y + h)), int(x) : int(np.ceil(x + w))] = True
        assert not (cars & ~inside).any()
        assert cars.any() == bool(boxes)


def test_stereo_statistics_are_those_of_the_files(folder: Path, annotations: Any) -> None:
    stereo = json.loads((folder / "stereo.json").read_text())["splits"]
    total = wrong = 0.0
    for image in annotations["images"]:
        measured = read_disparity(folder / image["disparity_file_name"], 320, 240)
        truth = read_disparity(folder / image["truth_disparity_file_name"], 320, 240)
        instance = cv2.imread(str(folder / image["instance_file_name"]), cv2.IMREAD_UNCHANGED)
        cars = np.isin(instance, [i["id"] for i in image["instances"] if i["kind"] == "car"])
        error = disparity_error(measured, truth, cars)
        total += error.n_truth
        wrong += error.n_wrong_filled
    # truth files are rounded to 1/256 px, which may move a pixel over the threshold
    assert stereo["all"]["car"]["n_pixels"] == total
    assert stereo["all"]["car"]["wrong_share"] == pytest.approx(wrong / total, abs=2e-3)
    assert 0 < stereo["all"]["car"]["density"] <= 1


def test_part_views_show_training_shapes_in_all_bins(folder: Path, annotations: Any) -> None:
    views = load_part_views(folder / "part_views")
    first = views.views[0].instance_id
    assert "sedan" in first
    assert {v.view_bin for v in views.views if v.instance_id == first} == set(range(12))
    training = {c.shape_id for c in build.cars_of_splits()["train"]}
    assert {v.instance_id for v in views.views} <= training


def test_a_street_that_cannot_be_is_one_error_line() -> None:
    config: SynthConfig = replace(TINY, cars=CarConfig(far_m=22.0, min_visibility=1.01))
    cars = build.cars_of_splits()["train"][:1]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("datasets_synth.street.frame_synth.MAX_ATTEMPTS", 2)
        with pytest.raises(
            RescoreError, match=r"frame train 0: expected a street with 1 cars in view, found none"
        ):
            synth_frame(config, 0, "train", 0, n_cars=1, cars=cars, pictures=())


def test_a_folder_that_cannot_be_written_is_one_error_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RescoreError, match="expected a folder to write to"):
        build_dataset(TINY, tmp_path / "file" / "data")


@pytest.mark.parametrize("damage", ["missing", "cut", "record", "no JSON", "poster"])
def test_a_build_makes_again_what_is_missing_cut_or_cannot_be_read(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: str
) -> None:
    half = tmp_path / "data"
    shutil.copytree(folder, half)
    name = "poster" if damage == "poster" else "test_0000"
    picture, record = half / "truth" / "test_0000.png", half / "records" / "test_0000.json"
    if damage == "missing":
        picture.unlink()
    elif damage == "cut":
        picture.write_bytes(picture.read_bytes()[:-40])
    elif damage == "record":
        record.write_text(json.dumps({"key": json.loads(record.read_text())["key"]}))
    elif damage == "no JSON":
        record.write_bytes(b"[" * 100_000)
    else:
        (half / "pictures" / "test_00.png").write_bytes(b"")
    made: list[str] = []
    build_one, render_picture = build._build_frame_alone, build._render_picture
    monkeypatch.setattr(build, "_build_frame_alone", lambda task: (made.append(task.name), build_one(task)))
    monkeypatch.setattr(
        build, "_render_picture", lambda path, *rest: (made.append("poster"), render_picture(path, *rest))
    )
    build_dataset(TINY, half, seed=3)
    assert set(made) == {name}
    assert _bytes(half) == _bytes(folder)
