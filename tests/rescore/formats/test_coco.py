import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recon.errors import Failure, Reason, RescoreError
from rescore.data.frames import DataSet
from rescore.evidence.align_depth import DepthAlignment
from rescore.evidence.candidates import Candidates, CandidateTable, RescoredTable
from rescore.evidence.registration import Registration
from rescore.formats.coco import read_detections, write_detections, write_rescored
from rescore.formats.coco_dataset import read_dataset

Json = dict[str, Any]
Edit = Callable[[Json], object]


def annotations() -> Json:
    camera = {"fx": 700, "fy": 701, "cx": 320.5, "cy": 240, "baseline_m": 0.5, "height_m": 1.65}
    return {
        "images": [
            {"id": 5, "file_name": "l/5.png", "right_file_name": "r/5.png", "width": 640, "height": 480}
            | {"split": "validation", "camera": camera, "instance_file_name": "i/5.png"}
            | {"instances": [{"id": 1, "kind": "car"}, {"id": 2, "kind": "hedge"}]},
            {"id": 9, "file_name": "l/9.png", "disparity_file_name": "d/9.png", "width": 640, "height": 480},
        ],
        "annotations": [
            {
                "id": 1,
                "image_id": 5,
                "category_id": 3,
                "bbox": [10, 20, 30, 40],
                "iscrowd": 0,
                "visibility": 0.7,
            },
            {"id": 2, "image_id": 5, "category_id": 3, "bbox": [0, 0, 5, 5], "ignore": 1, "shape_id": "mini"},
            {"id": 3, "image_id": 9, "category_id": 4, "bbox": [1, 1, 5, 5]},
        ],
        "categories": [{"id": 3, "name": "car"}, {"id": 4, "name": "dog"}],
    }


def write(path: Path, value: object) -> Path:
    path.write_text(json.dumps(value))
    return path


@pytest.fixture
def data(tmp_path: Path) -> DataSet:
    write(tmp_path / "annotations.json", annotations())
    return read_dataset(tmp_path)


def test_reads_all_that_is_known(tmp_path: Path, data: DataSet) -> None:
    assert (data.category, data.category_id, data.root) == ("car", 3, tmp_path)
    first, second = data.frames
    assert first.left_path == tmp_path / "l/5.png"
    assert first.right_path == tmp_path / "r/5.png"
    assert first.camera is not None
    assert (first.camera.left.fy_px, first.camera.left.width_px, first.camera.baseline_m) == (701, 640, 0.5)
    assert first.ground is not None
    assert (first.ground.height_m, first.ground.pitch_rad) == (1.65, 0)
    assert first.instance_kinds == {1: "car", 2: "hedge"}
    assert (second.split, second.camera, second.ground, second.right_path) == ("test", None, None, None)
    truth = data.truth[5]
    assert truth.xyxy_px.tolist() == [[10, 20, 40, 60], [0, 0, 5, 5]]
    assert truth.ignore.tolist() == [False, True]
    np.testing.assert_array_equal(truth.visibility, [0.7, np.nan])
    assert truth.shape_id == ("", "mini")
    assert len(data.truth[9].annotation_id) == 0  # its only annotation is a dog


BROKEN: list[tuple[Edit, str]] = [
    (lambda d: d.pop("images"), "images: field required"),
    (lambda d: d["images"][0].pop("width"), r"images\[0\]\.width: field required"),
    (
        lambda d: d["images"][1].update(height="tall"),
        r"images\[1\]\.height: input should be a valid integer.*'tall'",
    ),
    (lambda d: d["images"][1].update(split="dev"), "image 9: expected split train, calibration.*got 'dev'"),
    (
        lambda d: d["images"][0]["camera"].update(baseline_m=-0.5),
        "image 5: camera: baseline_m must be positive",
    ),
    (
        lambda d: d["images"][0]["camera"].update(height_m=0),
        "image 5: ground plane: the camera must be above",
    ),
    (lambda d: d["images"][1].update(id=5), "expected each image id once, got 5 twice"),
    (lambda d: d["annotations"][1].update(id=1), "expected each annotation id once, got 1 twice"),
    (
        lambda d: d["annotations"][0].update(image_id=77),
        "annotation 1: expected a listed image, got image_id 77",
    ),
    (lambda d: d["annotations"][0].update(bbox=[1, 2, 3]), r"annotations\[0\]\.bbox\[3\]: field required"),
    (
        lambda d: d["annotations"][0].update(bbox=[1, 2, -3, 4]),
        "annotation 1: expected .* with positive sizes, got",
    ),
    (
        lambda d: d["annotations"][0].update(bbox=[1, 2, float("nan"), 4]),
        r"bbox\[2\]: input should be a finite number",
    ),
    (
        lambda d: d.update(categories=[{"id": 1, "name": "a"}, {"id": 2, "name": "b"}]),
        "named 'car', got .'a', 'b'.",
    ),
    (lambda d: d.update(images=3), r"images: input should be a valid (list|array) \(3\)"),
]


@pytest.mark.parametrize(("edit", "message"), BROKEN)
def test_a_broken_data_set_is_one_line(tmp_path: Path, edit: Edit, message: str) -> None:
    value = annotations()
    edit(value)
    path = write(tmp_path / "annotations.json", value)
    with pytest.raises(RescoreError, match=message) as caught:
        read_dataset(tmp_path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match="expected a data set in COCO's form, found no file"):
        read_dataset(tmp_path / "nowhere")
    (tmp_path / "annotations.json").write_text('{"images": [')
    with pytest.raises(RescoreError, match="invalid JSON: EOF"):
        read_dataset(tmp_path)


def detection(**changes: object) -> Json:
    return {"image_id": 5, "category_id": 3, "bbox": [1.5, 2, 30, 40], "score": 0.5} | changes


def test_detections_are_ordered_and_cut(tmp_path: Path, data: DataSet) -> None:
    found = [detection(score=s) for s in (0.1, 0.9, 0.5)] + [
        detection(image_id=9, score=0.3),
        detection(category_id=4),
    ]
    file = read_detections(write(tmp_path / "yolo.json", found), data, max_candidates=2)
    assert file.table.image_id.tolist() == [5, 5, 9]
    assert file.table.score.tolist() == [0.9, 0.5, 0.3]
    assert file.table.rank.tolist() == [0, 1, 0]
    assert (file.n_beyond_max, file.detector, file.posterior) == (1, "yolo", None)
    assert file.notes == (f"{tmp_path / 'yolo.json'}: left out boxes of other classes: 1 dog",)
    # scores in [0, 1] serve as likelihoods
    assert file.candidates(data)[5].likelihood.tolist() == [0.9, 0.5]


def test_no_detections_is_legal(tmp_path: Path, data: DataSet) -> None:
    file = read_detections(write(tmp_path / "d.json", []), data)
    assert {i: len(c) for i, c in file.candidates(data).items()} == {5: 0, 9: 0}


BAD_DETECTIONS: list[tuple[object, str]] = [
    ([detection(), detection(image_id=6)], "detection 1: expected an image of the data set, got image_id 6"),
    ([detection(score=float("nan"))], r"\[0\]\.score: input should be a finite number \(nan\)"),
    ([detection(bbox=[1, 2, -1, 4])], "detection 0: expected .* with positive sizes"),
    ([detection(bbox=[1, 2, float("inf"), 4])], r"\[0\]\.bbox\[2\]: input should be a finite number"),
    ([detection(likelihood=1.5)], r"detection 0: expected a likelihood in \[0, 1\], got 1\.5"),
    ([detection(category_id=4)], "expected detections of category_id 3 .'car'., got only 4"),
    (
        {"annotations": []},
        "expected detections as a list in COCO's results form, got input should be a valid",
    ),
    ([{"image_id": 5}], r"\[0\]\.bbox: field required, and 1 more"),
]


@pytest.mark.parametrize(("value", "message"), BAD_DETECTIONS)
def test_bad_detections_are_one_line(tmp_path: Path, data: DataSet, value: object, message: str) -> None:
    with pytest.raises(RescoreError, match=message) as caught:
        read_detections(write(tmp_path / "d.json", value), data)
    assert "\n" not in str(caught.value)


def test_scores_of_another_range_want_calibration(tmp_path: Path, data: DataSet) -> None:
    file = read_detections(write(tmp_path / "svm.json", [detection(score=-1.5), detection(score=2)]), data)
    with pytest.raises(
        RescoreError, match=r"detections of svm: .*got scores from -1\.5 to 2; map them to likelihoods"
    ):
        file.candidates(data)


def candidates() -> Candidates:
    boxes = np.array([[1.25, 2, 30, 40], [5, 6, 70, 80.5]])
    return Candidates(5, boxes, np.array([3.5, -1.25]), np.array([0.9, 0.2]))


def test_raw_detections_round_trip(tmp_path: Path, data: DataSet) -> None:
    table = CandidateTable.of_candidates([candidates()])
    write_detections(tmp_path / "d.json", "hog", table, data)
    back = read_detections(tmp_path / "d.json", data)
    assert (back.detector, back.posterior) == ("hog", None)
    np.testing.assert_array_equal(back.table.xyxy_px, table.xyxy_px)
    np.testing.assert_array_equal(back.table.likelihood, [0.9, 0.2])
    assert json.loads((tmp_path / "d.json").read_text())[0] == {
        "image_id": 5,
        "category_id": 3,
        "bbox": [1.25, 2, 28.75, 38],
        "score": 3.5,
        "detector": "hog",
        "likelihood": 0.9,
    }


def test_rescored_detections_round_trip(tmp_path: Path, data: DataSet) -> None:
    outcome = (DepthAlignment(0.25, -1.5, 0.125, 0.75, 8.0, 2.0), Failure(Reason.NO_OUTLINE, "gone"))
    table = CandidateTable.of_alignments(candidates(), outcome, ground="stereo")
    seen = {
        "view_bin": ["left front", ""],
        "view_probability": [0.75, np.nan],
        "second_view": ["right rear", ""],
    }
    table = replace(
        table,
        **{name: np.array(v, None if name == "view_probability" else object) for name, v in seen.items()},
    )
    posterior = np.array([0.0, 0.2])
    write_rescored(
        tmp_path / "r.json",
        "hog",
        RescoredTable(table, posterior),
        data,
        w=0.6,
        registration=Registration.PAPER,
    )
    rows = json.loads((tmp_path / "r.json").read_text())
    needed = {"detector_score", "likelihood", "depth_difference", "scale", "offset", "status"}
    assert all(needed <= set(row) for row in rows)
    assert rows[1]["depth_difference"] is None
    assert [row["status"] for row in rows] == ["ok", "no_outline"]
    back = read_detections(tmp_path / "r.json", data)
    # ordered by the detector's score still, although the posterior turned them round
    assert back.posterior is not None
    assert back.posterior.tolist() == [0.0, 0.2]
    assert back.w == 0.6
    for name in (
        "score",
        "likelihood",
        "depth_difference",
        "scale",
        "offset",
        "valid_share",
        "stereo_low",
        "stereo_span",
    ):
        np.testing.assert_array_equal(getattr(back.table, name), getattr(table, name), err_msg=name)
    assert back.table.reason_detail.tolist() == ["", "gone"]
    assert back.table.ground.tolist() == ["stereo", "stereo"]
    for name, values in seen.items():
        np.testing.assert_array_equal(getattr(back.table, name), values, err_msg=name)
    assert "view_bin" not in rows[1]
    write_rescored(
        tmp_path / "again.json",
        "hog",
        RescoredTable(back.table, back.posterior),
        data,
        w=0.6,
        registration=Registration.PAPER,
    )
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "r.json").read_bytes()


def test_reads_the_real_frames_as_they_come(kitti: Path) -> None:
    data = read_dataset(kitti)
    assert (len(data.frames), sum(len(t.annotation_id) for t in data.truth.values())) == (6, 15)
    assert all(f.camera is not None and f.ground is not None for f in data.frames)
    file = read_detections(kitti / "detections.json", data)
    assert (len(file.table), file.notes) == (21, ())
