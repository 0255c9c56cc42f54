"""Boxes and detections in KITTI's, VOC's, YOLO's and COCO's forms, there and back."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.errors import RescoreError
from rescore.cli import main
from rescore.data.frames import DataSet, Truth, load_frame
from rescore.evidence.candidates import CandidateTable
from rescore.formats.box_files import YoloClasses, yolo_classes
from rescore.formats.coco import write_detections
from rescore.formats.coco_write import write_dataset
from rescore.formats.kitti import (
    alpha_of_azimuth,
    azimuth_of_alpha,
    write_kitti_detections,
    write_kitti_labels,
)
from rescore.formats.labels import ClassMap
from rescore.formats.open import read_dataset, read_detections
from tests.rescore import own_data as own


def same_truth(a: Truth, b: Truth, exact: bool = True) -> None:
    np.testing.assert_allclose(a.xyxy_px, b.xyxy_px, rtol=0, atol=0 if exact else 1e-9)
    np.testing.assert_array_equal(a.ignore, b.ignore)
    np.testing.assert_array_equal(a.visibility, b.visibility)
    assert a.shape_id == b.shape_id
    for name in ("azimuth_deg", "truncated", "occluded"):
        mine, theirs = getattr(a, name), getattr(b, name)
        assert (mine is None) == (theirs is None), name
        if mine is not None:
            np.testing.assert_allclose(mine, theirs, atol=1e-9, err_msg=name)


def same_frames(a: DataSet, b: DataSet) -> None:
    for mine, theirs in zip(a.frames, b.frames, strict=True):
        for name in ("image_id", "split", "width_px", "height_px", "camera", "ground", "disparity_offset_px"):
            assert getattr(mine, name) == getattr(theirs, name), name
        x, y = load_frame(mine, own.STEREO), load_frame(theirs, own.STEREO)
        np.testing.assert_array_equal(x.left_rgb, y.left_rgb)
        np.testing.assert_array_equal(x.disparity_px, y.disparity_px)


@pytest.mark.parametrize(
    ("alpha", "azimuth"),
    [(np.pi / 2, 0), (np.pi, 90), (-np.pi, 90), (0, 270), (-np.pi / 2, 180), (-10, np.nan)],
)
def test_alpha_becomes_the_azimuth_it_is_seen_from(alpha: float, azimuth: float) -> None:
    np.testing.assert_allclose(azimuth_of_alpha(alpha), azimuth, atol=1e-9)


@given(st.floats(0, 359.9))
def test_azimuth_there_and_back(azimuth: float) -> None:
    alpha = alpha_of_azimuth(azimuth)
    assert -np.pi < alpha <= np.pi
    difference = (azimuth_of_alpha(alpha) - azimuth + 180) % 360 - 180
    assert difference == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("copy", [False, True])
@pytest.mark.parametrize("kind", ["kitti", "pair", "own", "scenes", "depth"])
def test_import_there_and_back(tmp_path: Path, kind: str, copy: bool) -> None:
    source = tmp_path / "source é"
    if kind == "scenes":
        own.middlebury(source, 3.25, 6)
    elif kind == "depth":
        own.depth_folder(source, ".png", 1000)
    else:
        {"kitti": own.kitti_folder, "pair": own.pair_folder, "own": own.own_folder}[kind](source)
    data = read_dataset(source)
    write_dataset(tmp_path / "out", data, copy=copy)
    back = read_dataset(tmp_path / "out")
    same_frames(data, back)
    for image_id, truth in data.truth.items():
        same_truth(truth, back.truth[image_id], exact=False)
    copied = sorted(p.parent.name for p in (tmp_path / "out").rglob("*.png"))
    kinds = ["depth", "left"] if kind == "depth" else ["left", "left", "right", "right"]
    assert copied == (kinds if copy else [])
    with pytest.raises(RescoreError, match="expected no data set here yet"):
        write_dataset(tmp_path / "out", data, copy=copy)


def test_kitti_labels_there_and_back(tmp_path: Path) -> None:
    own.kitti_folder(tmp_path)
    before = read_dataset(tmp_path)
    write_kitti_labels(tmp_path / "label_2", before)
    after = read_dataset(tmp_path)
    for image_id, truth in before.truth.items():
        same_truth(truth, after.truth[image_id])
    text = (tmp_path / "label_2" / "000003.txt").read_text()
    assert [line.split()[0] for line in text.splitlines()] == ["Car", "Car", "DontCare", "DontCare"]


def detections_of(data: DataSet) -> CandidateTable:
    boxes = np.array([[1.25, 2.5, 30, 40], [5, 6, 70, 60.5], [0, 0, 9, 9]])
    first, second = (f.image_id for f in data.frames)
    table = CandidateTable.of_candidates([])
    rows = {
        "image_id": np.array([first, first, second]),
        "rank": np.array([0, 1, 0]),
        "xyxy_px": boxes,
        "score": np.array([0.875, 1 / 3, 0.5]),
        "likelihood": np.array([0.875, 1 / 3, 0.5]),
        "status": np.array(["", "", ""], dtype=object),
        "reason_detail": np.array(["", "", ""], dtype=object),
        "cues": np.full((3, table.cues.shape[1]), np.nan),
        "azimuth_deg": np.array([10.0, np.nan, 300.0]),
        "ground": np.array(["", "", ""], dtype=object),
        "view_bin": np.array(["", "", ""], dtype=object),
        "view_probability": np.full(3, np.nan),
        "second_view": np.array(["", "", ""], dtype=object),
    }
    rest = ("depth_difference", "scale", "offset", "valid_share", "stereo_low", "stereo_span")
    return CandidateTable(**rows, **{name: np.full(3, np.nan) for name in rest})


@pytest.mark.parametrize("form", ["kitti", "coco"])
def test_detections_there_and_back(tmp_path: Path, form: str) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    table = detections_of(data)
    path = tmp_path / ("hog.json" if form == "coco" else "hog")
    if form == "coco":
        write_detections(path, "hog", table, data)
    else:
        write_kitti_detections(path, table, table.score, data)
    back = read_detections(path, data)
    assert (back.detector, back.notes) == ("hog", ())
    for name in ("image_id", "rank", "xyxy_px", "score", "likelihood"):
        np.testing.assert_array_equal(getattr(back.table, name), getattr(table, name), err_msg=name)
    np.testing.assert_allclose(back.table.azimuth_deg, table.azimuth_deg)
    candidates = back.candidates(data)[data.frames[0].image_id]
    assert candidates.azimuth_deg is not None
    np.testing.assert_allclose(candidates.azimuth_deg, [10, np.nan])
    # what rescoring makes of candidates keeps the column
    np.testing.assert_allclose(CandidateTable.of_candidates([candidates]).azimuth_deg, [10, np.nan])


def test_frames_without_a_file_have_no_detections_and_are_counted(tmp_path: Path) -> None:
    data = read_dataset(own.kitti_folder(tmp_path / "data"))
    own.write_text(
        tmp_path / "found" / "000003.txt", f"{own.KITTI_CAR} 0.7\n{own.KITTI_LABEL.split(chr(10))[2]} 1\n"
    )
    file = read_detections(tmp_path / "found", data)
    assert len(file.table) == 1
    assert any("1 of 2 frames have no file" in n for n in file.notes)
    assert any("left out boxes of other classes: 1 Van" in n for n in file.notes)


VOC = """<annotation><size><width>96</width><height>64</height></size>
<object><name>car</name><difficult>0</difficult>
  <bndbox><xmin>11</xmin><ymin>21</ymin><xmax>40</xmax><ymax>44</ymax></bndbox></object>
<object><name>car</name><difficult>1</difficult>
  <bndbox><xmin>1</xmin><ymin>1</ymin><xmax>5</xmax><ymax>5</ymax></bndbox></object>
<object><name>dog</name><bndbox><xmin>1</xmin><ymin>1</ymin><xmax>5</xmax><ymax>5</ymax></bndbox></object>
</annotation>"""


def test_voc_boxes(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "Annotations" / "a.xml", VOC)
    data = read_dataset(tmp_path)
    assert data.truth[1].xyxy_px.tolist() == [[10, 20, 40, 44], [0, 0, 5, 5]]
    assert data.truth[1].ignore.tolist() == [False, True]
    assert any("left out boxes of other classes: 1 dog" in n for n in data.notes)
    assert any("1 of 2 frames have no label file" in n for n in data.notes)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("labels/classes.txt", "dog\ncar\n"),
        ("data.yaml", "nc: 2\nnames: ['dog', 'car']\n"),
        ("data.yaml", "names:\n  0: dog\n  1: car\n"),
        ("data.yaml", "names:\n  1: car\n  0: dog\n"),
        ("data.yaml", "names:\n- dog  # the first\n# a line between\n- car  # the second\n"),
        ("data.yaml", "train: x\nnames: {0: dog, 1: 'car'}  # in one line\n"),
        ("dataset.yaml", "names: [\n  'dog',\n  \"car\" # last\n  ]\n"),
        ("data.yml", "nc: 2\nnames: ['dog, small', car]\n"),
    ],
)
def test_yolo_boxes(tmp_path: Path, name: str, text: str) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "labels" / "a.txt", "1 0.25 0.5 0.25 0.25\n0 0.5 0.5 0.1 0.1\n")
    own.write_text(tmp_path / "labels" / "b.txt", "")
    own.write_text(tmp_path / name, text)
    data = read_dataset(tmp_path)
    assert data.truth[1].xyxy_px.tolist() == [[12, 24, 36, 40]]
    assert len(data.truth[2].annotation_id) == 0
    own.write_text(tmp_path / "found" / "classes.txt", "dog\ncar\n")
    own.write_text(tmp_path / "found" / "a.txt", "1 0.25 0.5 0.25 0.25 0.625\n")
    file = read_detections(tmp_path / "found", data)
    assert file.table.score.tolist() == [0.625]
    assert file.table.xyxy_px.tolist() == [[12, 24, 36, 40]]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("names: ['dog, small', \"it's\", car]\n", ["dog, small", "it's", "car"]),
        ("names:\n  2: c\n  0: 'a: b'\n  1: no\n", ["a: b", "no", "c"]),
        (
            "nc: 12\nnames: {" + ", ".join(f"{i}: n{i}" for i in range(11, -1, -1)) + "}\n",
            [f"n{i}" for i in range(12)],
        ),
        ("path: a\n---\nnames: [1, 2.50, yes]\n", ["1", "2.50", "yes"]),
        ("names:\n  '1': b  # a comment\n  \"0\": a\n", ["a", "b"]),
        ("names: {0.0: a, 1.0: b}\n", ["a", "b"]),
    ],
)
def test_yolo_names_by_their_numbers(tmp_path: Path, text: str, names: list[str]) -> None:
    own.write_text(tmp_path / "data.yaml", text)
    assert names_in(tmp_path) == YoloClasses(dict(enumerate(names)))


def names_in(folder: Path) -> YoloClasses:
    return yolo_classes(folder, (), ClassMap("car"))[0]


def test_numbers_with_gaps_and_from_one(tmp_path: Path) -> None:
    own.write_text(tmp_path / "data.yaml", "names:\n  3: bus\n  1: person\n  2: car\n")
    assert names_in(tmp_path) == YoloClasses({1: "person", 2: "car", 3: "bus"})
    own.pair_folder(tmp_path)
    box = "0.25 0.5 0.25 0.25"
    own.write_text(tmp_path / "labels" / "a.txt", f"1 {box}\n1 {box}\n2 {box}\n2.0 0.5 0.5 0.25 0.25\n")
    data = read_dataset(tmp_path)
    assert data.truth[1].xyxy_px.tolist() == [[12, 24, 36, 40], [36, 24, 60, 40]]
    assert any("left out boxes of other classes: 2 person" in n for n in data.notes)
    own.write_text(tmp_path / "labels" / "a.txt", f"0 {box}\n")
    with pytest.raises(RescoreError, match=r"a.txt:1: expected a class number of 1, 2, 3, got '0'"):
        read_dataset(tmp_path)


def yolo(tmp_path: Path, lines: str, names: str | None = "names: [car]\n") -> DataSet:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "labels" / "a.txt", lines)
    own.write_text(tmp_path / "labels" / "b.txt", "")
    if names:
        own.write_text(tmp_path / "data.yaml", names)
    return read_dataset(tmp_path)


@pytest.mark.parametrize(
    ("line", "box"),
    [
        ("0.0 0.25 0.5 0.25 0.25", [12, 24, 36, 40]),
        ("0.000000000000000000e+00 0.25 0.5 0.25 0.25", [12, 24, 36, 40]),
        # a triangle, and a box that is turned
        ("0 0.25 0.25 0.5 0.5 0.125 0.5", [12, 16, 48, 32]),
        ("0 0.5 0.25 0.75 0.5 0.5 0.75 0.25 0.5", [24, 16, 72, 48]),
    ],
)
def test_lines_of_yolo(tmp_path: Path, line: str, box: list[float]) -> None:
    assert yolo(tmp_path, line).truth[1].xyxy_px.tolist() == [box]


def test_key_points_behind_a_box_are_no_polygon(tmp_path: Path) -> None:
    line = "0 0.25 0.5 0.25 0.25 0.9 0.9 1 0.1 0.1 2\n"
    assert yolo(tmp_path, line, "kpt_shape: [2, 3]\nnames: [car]\n").truth[1].xyxy_px.tolist() == [
        [12, 24, 36, 40]
    ]
    with pytest.raises(RescoreError, match=r"a.txt:1: expected shares of the picture in \[0, 1\]"):
        yolo(tmp_path, line)


def test_a_polygon_with_a_score(tmp_path: Path) -> None:
    data = yolo(tmp_path / "data", "")
    own.write_text(tmp_path / "found" / "classes.txt", "car\n")
    own.write_text(tmp_path / "found" / "a.txt", "0 0.25 0.25 0.5 0.5 0.125 0.5 0.75\n")
    table = read_detections(tmp_path / "found", data).table
    assert (table.xyxy_px.tolist(), table.score.tolist()) == ([[12, 16, 48, 32]], [0.75])


def test_numbers_of_tracks_are_no_scores_and_no_corners(tmp_path: Path) -> None:
    """With a score before it the number is left out, even where it could be a corner; alone it is refused."""
    data = yolo(tmp_path / "data", "0 0.25 0.5 0.25 0.25 0.9 1\n0 0.5 0.5 0.25 0.25 0.8 2\n")
    assert data.truth[1].xyxy_px.tolist() == [[12, 24, 36, 40], [36, 24, 60, 40]]
    own.write_text(tmp_path / "found" / "classes.txt", "car\n")
    own.write_text(tmp_path / "found" / "a.txt", "0 0.25 0.5 0.25 0.25 0.9 1\n0 0.5 0.5 0.25 0.25 0.8 2\n")
    assert read_detections(tmp_path / "found", data).table.score.tolist() == [0.9, 0.8]
    own.write_text(tmp_path / "found" / "a.txt", "0 0.25 0.5 0.25 0.25 1\n0 0.5 0.5 0.25 0.25 2\n")
    with pytest.raises(RescoreError, match=r"found: .* got whole numbers in all 2 lines, as of tracks"):
        read_detections(tmp_path / "found", data)


def test_boxes_are_not_written_among_pictures(tmp_path: Path) -> None:
    data = yolo(tmp_path, "0 0.25 0.5 0.25 0.25\n")
    with pytest.raises(RescoreError, match="left: expected a folder for files of boxes, got one of pictures"):
        write_kitti_labels(tmp_path / "left", data)


def test_class_numbers_without_names(tmp_path: Path) -> None:
    data = yolo(tmp_path, "0 0.25 0.5 0.25 0.25\n", None)
    assert data.truth[1].xyxy_px.tolist() == [[12, 24, 36, 40]]
    assert f"{tmp_path / 'labels'}: no names of classes, so class number 0 is taken for 'car'" in data.notes
    own.write_text(tmp_path / "labels" / "b.txt", "2 0.5 0.5 0.25 0.25\n")
    with pytest.raises(
        RescoreError, match=r"labels: expected the names .* numbers 0, 2; write classes.txt .* --map 0=car"
    ):
        read_dataset(tmp_path)
    mapped = read_dataset(tmp_path, "car", ClassMap.of("car", ["2=car"]))
    assert [len(t.annotation_id) for t in mapped.truth.values()] == [0, 1]
    assert any("took boxes of 1 of category 2 as car" in n for n in mapped.notes)


def test_of_two_kinds_of_labels_the_reader_says_which_it_takes(tmp_path: Path) -> None:
    own.write_text(tmp_path / "Annotations" / "a.xml", VOC)
    own.write_text(tmp_path / "label_2" / "a.txt", own.KITTI_LABEL)
    notes = yolo(tmp_path, "0 0.25 0.5 0.25 0.25\n").notes
    for other in ("Annotations", "label_2"):
        assert f"{tmp_path / 'labels'}: taken in place of the boxes in {other}" in notes


def test_two_label_files_of_one_name_are_refused(tmp_path: Path) -> None:
    yolo(tmp_path, "0 0.25 0.5 0.25 0.25\n")
    own.write_text(tmp_path / "labels" / "a.TXT", "")
    with pytest.raises(RescoreError, match=r"labels: expected one file of the name 'a', got a.TXT and a.txt"):
        read_dataset(tmp_path)


def test_hidden_files_hold_no_boxes(tmp_path: Path) -> None:
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "._a.txt").write_bytes(b"\x00\x05\x16\x07\xff")
    data = yolo(tmp_path, "0 0.25 0.5 0.25 0.25\n")
    assert data.truth[1].xyxy_px.tolist() == [[12, 24, 36, 40]]
    assert not any("belong to no picture" in n for n in data.notes)


def test_voc_in_small_letters(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "annotations" / "a.XML", VOC)
    assert read_dataset(tmp_path).truth[1].xyxy_px.tolist() == [[10, 20, 40, 44], [0, 0, 5, 5]]


def test_label_files_of_other_names_are_refused(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "label_2" / "c.txt", own.KITTI_LABEL)
    with pytest.raises(RescoreError, match=r"label_2: expected files of the names .*, as a.txt, got c.txt"):
        read_dataset(tmp_path)
    own.write_text(tmp_path / "label_2" / "a.txt", own.KITTI_LABEL)
    notes = read_dataset(tmp_path).notes
    assert f"{tmp_path / 'label_2'}: left out 1 files of boxes that belong to no picture" in notes


@pytest.mark.parametrize("score", [1.0000001, -1e-7])
def test_a_score_that_rounding_put_beyond_one_is_a_likelihood(tmp_path: Path, score: float) -> None:
    data = read_dataset(own.own_folder(tmp_path))
    rows = [{"image_id": 1, "bbox": [1, 2, 3, 4], "score": s} for s in (score, 0.5)]
    table = read_detections(own.write_text(tmp_path / "found.json", json.dumps(rows)), data).table
    assert sorted(table.likelihood.tolist()) == sorted([min(max(score, 0), 1), 0.5])
    rows[0]["score"] = 1.01
    table = read_detections(own.write_text(tmp_path / "found.json", json.dumps(rows)), data).table
    assert np.isnan(table.likelihood).all()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "names: {0: dog, 0.0: car}\n",
            "names: expected each name by a whole number of its own, got the numbers 0, 0.0",
        ),
        (
            "names: {0: dog, x: car}\n",
            "names: expected each name by a whole number of its own, got the numbers 0, x",
        ),
        ("names: {0: dog, 0: car}\n", r"expected YAML, got a mistake in line 1 \(a name that occurs twice\)"),
        ("names: [dog, '', car]\n", "names: expected texts, got an empty name or a list"),
        ("names: [dog, [car]]\n", "names: expected texts, got an empty name or a list"),
        ("names: dog\n", "names: expected one list of names, got other values"),
        ("names: [dog]\n---\nnames: [car]\n", "names: expected one list of names, got other values"),
        ("names: [dog, car\n", r"expected YAML, got a mistake in line 2 \(expected ',' or '\]'"),
        ("names: []\n", "expected names of classes, found none"),
    ],
)
def test_yolo_names_that_are_refused_in_one_line(tmp_path: Path, text: str, problem: str) -> None:
    own.write_text(tmp_path / "data.yaml", text)
    with pytest.raises(RescoreError, match=f"data.yaml: {problem}") as refused:
        names_in(tmp_path)
    assert "\n" not in str(refused.value)


def test_convert_keeps_every_box(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own.own_folder(tmp_path / "data")
    rows = [{"image_id": 1, "bbox": [i, 2, 3, 4], "score": 1 - i / 100} for i in range(40)]
    found = own.write_text(tmp_path / "found.json", json.dumps(rows))
    for out in ("out.json", "out"):
        monkeypatch.setattr(
            sys,
            "argv",
            ["rescore", "convert", *map(str, (tmp_path / "data", found)), "--out", str(tmp_path / out)],
        )
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code
    assert [r["bbox"][0] for r in json.loads((tmp_path / "out.json").read_text())] == list(range(40))
    assert len((tmp_path / "out" / "1.txt").read_text().splitlines()) == 40


@pytest.mark.parametrize("command", ["apply", "evaluate", "convert", "tune", "fit-evidence"])
def test_help_names_every_form_of_detections(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["rescore", command, "--help"])
    with pytest.raises(SystemExit):
        main()
    text = capsys.readouterr().out
    assert all(form in text for form in ("COCO", "KITTI", "YOLO"))


def test_every_form_is_evaluated_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def run(*arguments: object) -> None:
        monkeypatch.setattr(sys, "argv", ["rescore", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code, capfd.readouterr().err

    kitti = own.kitti_folder(tmp_path / "kitti")
    table = detections_of(read_dataset(kitti))
    write_kitti_detections(tmp_path / "hog", table, table.score, read_dataset(kitti))
    run("import", kitti, "--out", tmp_path / "ours")
    run("convert", kitti, tmp_path / "hog", "--out", tmp_path / "hog.json")
    run("convert", tmp_path / "ours", tmp_path / "hog.json", "--out", tmp_path / "back" / "hog")
    metrics = []
    for data, found in (("kitti", "hog"), ("ours", "hog.json"), ("ours", "back/hog"), ("kitti", "hog.json")):
        run("evaluate", tmp_path / data, tmp_path / found, "--no-report", "--out", tmp_path / "run")
        metrics.append(json.loads((tmp_path / "run" / "metrics.json").read_text()))
    assert metrics[0]["n_cars"] == 2
    assert metrics[0]["n_candidates"] == 3
    assert all(m == metrics[0] for m in metrics[1:])


@pytest.mark.parametrize("text", ["9" * 5000 + " 0.5 0.5 0.2 0.3", "2 0.5 0.5 0.2 0.3"])
def test_a_class_that_is_not_named_is_one_line_whatever_its_digits(tmp_path: Path, text: str) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "data.yaml", "names: [person, car]\n")
    own.write_text(tmp_path / "labels" / "a.txt", text)
    with pytest.raises(RescoreError, match=r"a\.txt:1: expected") as raised:
        read_dataset(tmp_path)
    assert len(str(raised.value)) < 500


def test_a_box_of_a_text_file_that_is_out_of_range_is_one_line(tmp_path: Path) -> None:
    own.kitti_folder(tmp_path)
    car = own.KITTI_CAR.replace("10.0 20.0", "-1e308 20.0")
    own.write_text(tmp_path / "found" / "000003.txt", f"{car} 0.7\n")
    with pytest.raises(RescoreError, match=r"found: image \d+: expected detections, got \[0\]\.bbox"):
        read_detections(tmp_path / "found", read_dataset(tmp_path))
