"""3D boxes in annotations.json, COCO results, rescored files and KITTI's text, there and back."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.cli import main
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet
from rescore.evidence.candidates import Candidates, CandidateTable, RescoredTable
from rescore.evidence.registration import Registration
from rescore.formats.coco import write_detections, write_rescored
from rescore.formats.coco_write import write_dataset
from rescore.formats.kitti import alpha_of_azimuth, write_kitti_detections, write_kitti_labels
from rescore.formats.open import read_dataset, read_detections
from tests.rescore import own_data as own

BOX = [1.25, 0.95, 20.0, 4.0, 1.6, 1.5, -1.5]
DEVIATIONS = [0.1, 0.05, 0.4, 0.2, 0.05, 0.04, 0.1]


def same_boxes(a: Boxes3D | None, b: Boxes3D | None) -> None:
    assert a is not None
    assert b is not None
    np.testing.assert_allclose(a.values, b.values, atol=1e-12)
    assert (a.deviations is None) == (b.deviations is None)
    if a.deviations is not None and b.deviations is not None:
        np.testing.assert_array_equal(a.deviations, b.deviations)


def test_kittis_labels_have_boxes_and_dontcare_has_none(tmp_path: Path) -> None:
    data = read_dataset(own.kitti_folder(tmp_path))
    first, second = data.truth.values()
    assert first.boxes3d is not None
    # two cars and a van of 1.5 x 1.6 x 4.0 m, whose wheels are at 1.7 m below the camera
    assert first.boxes3d.known.tolist() == [True, True, True, False]
    np.testing.assert_allclose(first.boxes3d.values[0], [1.0, 0.95, 20.0, 4.0, 1.6, 1.5, 1.6])
    assert second.boxes3d is None


@pytest.mark.parametrize("form", ["kitti", "coco"])
def test_truth_there_and_back(tmp_path: Path, form: str) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    if form == "kitti":
        write_kitti_labels(tmp_path / "data" / "label_2", data)
        back = read_dataset(tmp_path / "data")
    else:
        write_dataset(tmp_path / "out", data, copy=False)
        back = read_dataset(tmp_path / "out")
        written = json.loads((tmp_path / "out" / "annotations.json").read_text())["annotations"]
        assert ["bbox3d" in a for a in written] == [True, True, True, False]
    for image_id, truth in data.truth.items():
        if truth.boxes3d is None:
            assert back.truth[image_id].boxes3d is None
        else:
            same_boxes(back.truth[image_id].boxes3d, truth.boxes3d)


def annotated(folder: Path, **changes: Any) -> Path:
    """A data set of ours whose first annotation is changed."""
    own.own_folder(folder)
    file = folder / "annotations.json"
    content = json.loads(file.read_text())
    content["annotations"][0] |= changes
    file.write_text(json.dumps(content))
    return folder


def test_annotations_may_have_boxes(tmp_path: Path) -> None:
    data = read_dataset(annotated(tmp_path, bbox3d=BOX))
    found = [t.boxes3d for t in data.truth.values() if t.boxes3d is not None]
    assert len(found) == 1
    np.testing.assert_array_equal(found[0].values[0], BOX)


@pytest.mark.parametrize(
    ("box", "match"),
    [
        ([*BOX[:3], 0, *BOX[4:]], r"bbox3d\[3\]: input should be greater than 0"),
        (BOX[:6], r"bbox3d\[6\]: field required"),
        ([*BOX[:6], None], r"bbox3d\[6\]: input should be a valid number"),
    ],
)
def test_annotations_with_half_a_box_are_refused(tmp_path: Path, box: list[Any], match: str) -> None:
    with pytest.raises(RescoreError, match=match):
        read_dataset(annotated(tmp_path, bbox3d=box))


def found_in(data: DataSet, boxes3d: Boxes3D | None) -> CandidateTable:
    """Three detections of the first frame, of which the second has no 3D box."""
    boxes = np.array([[1.25, 2.5, 30, 40], [5, 6, 70, 60.5], [0, 0, 9, 9]])
    score, azimuth = np.array([0.9, 0.5, 0.25]), np.array([10.0, 20, np.nan])
    return CandidateTable.of_candidates(
        [Candidates(data.frames[0].image_id, boxes, score, score, azimuth, boxes3d)]
    )


def boxes_of_three() -> Boxes3D:
    boxes = Boxes3D.of_rows([BOX, None, [*BOX[:6], 0.5]], [DEVIATIONS, None, None])
    assert boxes is not None
    return boxes


@pytest.mark.parametrize("form", ["kitti", "coco", "rescored"])
def test_detections_there_and_back(tmp_path: Path, form: str) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    table = found_in(data, boxes_of_three())
    path = tmp_path / ("found" if form == "kitti" else "found.json")
    if form == "kitti":
        write_kitti_detections(path, table, table.score, data)
    elif form == "coco":
        write_detections(path, "net", table, data)
    else:
        rescored = RescoredTable(table, table.score)
        write_rescored(path, "net", rescored, data, w=0.5, registration=Registration.PAPER)
    back = read_detections(path, data)
    boxes = boxes_of_three()
    same_boxes(back.table.boxes3d, Boxes3D.of_values(boxes.values) if form == "kitti" else boxes)
    # what rescoring is handed keeps them
    candidates = back.candidates(data)
    first, second = (candidates[f.image_id] for f in data.frames)
    np.testing.assert_allclose(CandidateTable.of_candidates([second, first]).boxes3d.values, boxes.values)  # type: ignore[union-attr]
    assert len(second) == 0


def test_kittis_columns(tmp_path: Path) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    table = found_in(data, boxes_of_three())
    write_kitti_detections(tmp_path / "found", table, table.score, data)
    first, second, third = (x.split() for x in (tmp_path / "found" / "000003.txt").read_text().splitlines())
    assert {len(first), len(second), len(third)} == {16}
    # height, width, length, the middle of the bottom, the turn
    assert [float(v) for v in first[8:15]] == pytest.approx([1.5, 1.6, 4.0, 1.25, 1.7, 20.0, -1.5])
    # alpha agrees with the box, not with what the detector said
    assert float(first[3]) == pytest.approx(-1.5 - np.arctan2(1.25, 20))
    assert second[8:15] == ["-1", "-1", "-1", "-1000", "-1000", "-1000", "-10"]
    assert float(second[3]) == pytest.approx(alpha_of_azimuth(20.0))


def test_keys_are_absent_where_there_is_no_box(tmp_path: Path) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    table = found_in(data, boxes_of_three())
    write_detections(tmp_path / "net.json", "net", table, data)
    rows = json.loads((tmp_path / "net.json").read_text())
    assert [sorted(k for k in r if k.startswith("bbox3d")) for r in rows] == [
        ["bbox3d", "bbox3d_sd"],
        [],
        ["bbox3d"],
    ]
    assert (rows[0]["bbox3d"], rows[0]["bbox3d_sd"]) == (BOX, DEVIATIONS)
    # the bytes of a file without 3D boxes are those of one whose detections have none
    for name, boxes3d in (("a.json", None), ("b.json", Boxes3D.none(3))):
        write_detections(tmp_path / name, "net", found_in(data, boxes3d), data)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert read_detections(tmp_path / "a.json", data).table.boxes3d is None


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"bbox3d": [*BOX[:4], -1, *BOX[5:]]}, r"\[0\]\.bbox3d\[4\]: input should be greater than 0"),
        (
            {"bbox3d": BOX, "bbox3d_sd": [-1, *DEVIATIONS[1:]]},
            r"bbox3d_sd\[0\]: input should be",
        ),
        ({"bbox3d_sd": DEVIATIONS}, "detection 0: expected bbox3d beside bbox3d_sd, got none"),
    ],
)
def test_damaged_detections_are_refused(tmp_path: Path, changes: dict[str, Any], match: str) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    row = {"image_id": data.frames[0].image_id, "bbox": [1, 2, 30, 40], "score": 0.5, **changes}
    (tmp_path / "found.json").write_text(json.dumps([row]))
    with pytest.raises(RescoreError, match=match):
        read_detections(tmp_path / "found.json", data)


def test_damaged_columns_of_kitti_are_named(tmp_path: Path) -> None:
    data = own.kitti_folder(tmp_path)
    file = data / "label_2" / "000003.txt"
    file.write_text(own.KITTI_CAR.replace(" 20.0 1.6", " far 1.6"))
    with pytest.raises(RescoreError, match=r"000003.txt:1: expected a finite number for z, got 'far'"):
        read_dataset(data)


def test_tables_pick_and_join_boxes(tmp_path: Path) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    table, flat = found_in(data, boxes_of_three()), found_in(data, None)
    assert table.take(np.array([1])).boxes3d is not None
    assert not table.take(np.array([1])).boxes3d.known.any()  # type: ignore[union-attr]
    joined = CandidateTable.concatenate([flat, table])
    assert joined.boxes3d is not None
    assert joined.boxes3d.known.tolist() == [False] * 3 + [True, False, True]
    assert CandidateTable.concatenate([flat, flat]).boxes3d is None
    assert flat.take(np.array([0])).boxes3d is None
    with pytest.raises(ValueError, match="3 boxes, 2 3D boxes"):
        replace(table.by_image([data.frames[0].image_id])[data.frames[0].image_id], boxes3d=Boxes3D.none(2))


def test_converted_by_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    write_detections(tmp_path / "net.json", "net", found_in(data, boxes_of_three()), data)
    for source, out in (("net.json", "text"), ("text", "again.json")):
        arguments = ["convert", str(tmp_path / "data"), str(tmp_path / source), "--out", str(tmp_path / out)]
        monkeypatch.setattr("sys.argv", ["rescore", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code
    same_boxes(
        read_detections(tmp_path / "again.json", data).table.boxes3d,
        Boxes3D.of_values(boxes_of_three().values),
    )
