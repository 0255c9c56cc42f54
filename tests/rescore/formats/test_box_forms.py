"""Boxes that are whole in another form than left, top, width and height in pixels, and odd files."""

import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.formats.labels import refuse_other_form
from rescore.formats.open import read_dataset, read_detections
from tests.rescore import own_data as own
from tests.rescore.formats.test_box_formats import VOC, yolo
from tests.rescore.spoiling import Json, Run

EDGES = [[30, 20, 80, 60], [40, 30, 70, 62], [10, 15, 90, 50]]
"""Left, top, right, bottom in pictures of 96 x 64 pixels."""
KITTI_SHARES = own.KITTI_CAR.replace("10.0 20.0 40.5 44.0", ".1 .2 .4 .5")


def rows(boxes: Sequence[Sequence[float]]) -> list[Json]:
    return [{"image_id": 1, "category_id": 1, "bbox": box, "score": 0.5} for box in boxes]


def test_detections_of_edges_are_refused(tmp_path: Path) -> None:
    data = read_dataset(own.pair_folder(tmp_path))
    file = own.write_text(tmp_path / "found.json", json.dumps(rows(EDGES)))
    with pytest.raises(
        RescoreError, match=r"found.json: expected bbox as left, top, width, height, got .*bottom in all 3 \("
    ):
        read_detections(file, data)
    sizes = [[x0, y0, x1 - x0, y1 - y0] for x0, y0, x1, y1 in EDGES]
    own.write_text(file, json.dumps(rows(sizes)))
    assert sorted(read_detections(file, data).table.xyxy_px.tolist()) == sorted(EDGES)


def test_annotations_of_edges_are_refused(tmp_path: Path) -> None:
    value = own.annotations()
    first = value["annotations"][0]
    value["annotations"] = [first | {"id": i, "bbox": box} for i, box in enumerate(EDGES)]
    with pytest.raises(RescoreError, match=r"annotations.json: expected bbox as left, top, width, height"):
        read_dataset(own.own_folder(tmp_path, value))


def test_shares_of_the_picture_are_refused(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    file = own.write_text(tmp_path / "found.json", json.dumps(rows([[0.1, 0.2, 0.3, 0.2]])))
    with pytest.raises(RescoreError, match=r"expected boxes in pixels, got shares of .* in all 1, as"):
        read_detections(file, read_dataset(tmp_path))
    own.write_text(tmp_path / "label_2" / "a.txt", KITTI_SHARES)
    with pytest.raises(RescoreError, match=r"expected boxes in pixels, got shares of the picture"):
        read_dataset(tmp_path)


@pytest.mark.parametrize(
    "xyxy_px",
    [
        # two whole cars that the picture cuts: too few to tell
        [[30, 20, 110, 80], [40, 30, 110, 92]],
        # one of three reaches out
        [[30, 20, 110, 80], [10, 10, 30, 30], [1, 1, 60, 60]],
        # one is no box as edges
        [[30, 20, 110, 80], [40, 30, 110, 92], [50, 30, 60, 40]],
        [[0, 0, 1, 1.1]],
    ],
)
def test_boxes_that_may_be_what_they_say(xyxy_px: list[list[float]]) -> None:
    refuse_other_form("found.json", np.array(xyxy_px, float), np.array([[96.0, 64.0]] * len(xyxy_px)))


@pytest.mark.parametrize(("word", "ignored"), [("True", True), ("1", True), ("false", False), (" 0 ", False)])
def test_voc_difficult_in_words(tmp_path: Path, word: str, ignored: bool) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "Annotations" / "a.xml", VOC.replace("<difficult>0<", f"<difficult>{word}<"))
    assert read_dataset(tmp_path).truth[1].ignore.tolist() == [ignored, True]


def test_voc_difficult_of_another_kind_is_one_line(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "Annotations" / "a.xml", VOC.replace("<difficult>0<", "<difficult>2<"))
    with pytest.raises(RescoreError, match=r"a.xml: object 1: difficult: expected 0 or 1, got '2'; mend it"):
        read_dataset(tmp_path)


def test_a_class_name_of_two_lines_is_told_in_one(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "Annotations" / "a.xml", VOC.replace(">dog<", ">big\n dog<"))
    assert any(n.endswith("left out boxes of other classes: 1 big dog") for n in read_dataset(tmp_path).notes)


def test_an_empty_line_among_the_names_of_classes_is_refused(tmp_path: Path) -> None:
    """Before, the names behind it moved up, so that class 1 was a car here."""
    own.write_text(tmp_path / "classes.txt", "person\n\ncar\n")
    with pytest.raises(RescoreError, match=r"classes.txt: expected the names .* got an empty line 2; name"):
        yolo(tmp_path, "1 0.25 0.5 0.25 0.25\n", None)
    own.write_text(tmp_path / "classes.txt", "person\ncar\n\n \n")
    assert yolo(tmp_path, "1 0.25 0.5 0.25 0.25\n", None).n_cars == 1


def test_a_pipe_among_the_files_of_boxes_is_not_waited_for(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "label_2" / "a.txt", own.KITTI_CAR)
    os.mkfifo(tmp_path / "label_2" / "b.txt")
    data = read_dataset(tmp_path)
    assert data.n_cars == 1
    assert any(n.endswith("b.txt: 1 of 2 frames have no label file and count as empty") for n in data.notes)


def test_a_folder_without_boxes_names_every_place_for_them(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "labels" / "train" / "a.txt", "0 0.25 0.5 0.25 0.25\n")
    (note,) = read_dataset(tmp_path).notes
    places = "labels (YOLO), label_2 (KITTI), Annotations (VOC) or gtFine (Cityscapes)"
    assert note == f"{tmp_path}: no boxes in {places}, so no frame has a car"


def test_detections_that_map_takes_for_another_class_are_left_out(tmp_path: Path, run: Run) -> None:
    """Before, they were said to be left out and were written."""
    own.own_folder(tmp_path / "data")
    file = own.write_text(tmp_path / "found.json", json.dumps(rows([[10, 10, 20, 20]])))
    code, _, err = run("convert", tmp_path / "data", file, "--map", "car=bus", "--out", tmp_path / "out.json")
    assert code == 1
    assert "expected detections of category_id 1 ('car'), got only 1" in err
    assert not (tmp_path / "out.json").exists()
