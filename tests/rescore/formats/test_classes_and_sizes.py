"""Which boxes count: categories of one name, classes taken for others, boxes of no size, ignored boxes."""

import json
from pathlib import Path

import pytest

from recon.errors import RescoreError
from rescore.commands.base import detections_of
from rescore.data.frames import DataSet
from rescore.formats.labels import ClassMap
from rescore.formats.open import read_dataset, read_detections
from tests.rescore import own_data as own
from tests.rescore.spoiling import Json, Run


def detection(category_id: int, x: float = 10, **changes: object) -> Json:
    return {"image_id": 1, "category_id": category_id, "bbox": [x, 10, 20, 20], "score": 0.5} | changes


def box(number: int, category_id: int, x: float = 10, **changes: object) -> Json:
    return {"id": number, "image_id": 1, "category_id": category_id, "bbox": [x, 10, 20, 20]} | changes


def folder(root: Path, categories: list[Json], boxes: list[Json]) -> Path:
    value = own.annotations()
    value["categories"], value["annotations"] = categories, boxes
    return own.own_folder(root, value)


def found(path: Path, rows: list[Json]) -> Path:
    return own.write_text(path, json.dumps(rows))


@pytest.mark.parametrize("names", [("car", "car"), ("car", "Car"), ("CAR", "car")])
def test_every_category_of_the_class_counts_in_truth_and_detections(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    """Two cars and two hits, by either number; before, the number of one category alone was taken."""
    categories = [{"id": i, "name": name} for i, name in enumerate(names)]
    data = read_dataset(folder(tmp_path, categories, [box(1, 0), box(2, 1, 50)]))
    assert data.n_cars == 2
    file = read_detections(found(tmp_path / "f.json", [detection(0), detection(1, 50)]), data)
    assert sorted(file.table.xyxy_px[:, 0].tolist()) == [10, 50]
    assert file.notes == ()


def test_average_precision_counts_detections_of_either_number(tmp_path: Path, run: Run) -> None:
    categories = [{"id": 0, "name": "car"}, {"id": 1, "name": "car"}]
    data = folder(tmp_path / "data", categories, [box(1, 0), box(2, 1, 50)])
    file = found(tmp_path / "f.json", [detection(0), detection(1, 50)])
    code, _, err = run("evaluate", data, file, "--no-report", "--out", tmp_path / "run")
    assert code == 0, err
    (row,) = json.loads((tmp_path / "run" / "metrics.json").read_text())["rows"]
    # both cars are found, and nothing else is
    assert (row["average_precision"], row["recall_ceiling"]) == (1.0, 1.0)


def test_an_imported_data_set_keeps_the_numbers_of_its_class(tmp_path: Path, run: Run) -> None:
    categories = [{"id": 1, "name": "car"}, {"id": 2, "name": "van"}, {"id": 3, "name": "dog"}]
    data = folder(tmp_path / "data", categories, [box(1, 1), box(2, 2, 50), box(3, 3, 70)])
    assert run("import", data, "--map", "van=car", "--out", tmp_path / "out")[0] == 0
    imported = read_dataset(tmp_path / "out")
    assert (imported.n_cars, imported.class_ids) == (2, {1, 2})
    file = read_detections(found(tmp_path / "f.json", [detection(1), detection(2, 50)]), imported)
    assert len(file.table) == 2


VANS = [{"id": 1, "name": "car"}, {"id": 2, "name": "van"}]


def test_convert_maps_the_classes_of_json(tmp_path: Path, run: Run) -> None:
    data = folder(tmp_path / "data", VANS, [box(1, 1)])
    file = found(tmp_path / "f.json", [detection(1), detection(2, 50)])
    out = tmp_path / "out.json"
    code, _, err = run("convert", data, file, "--map", "van=car", "--out", out)
    assert (code, "took boxes of 1 van as car" in err) == (0, True), err
    assert [row["bbox"][0] for row in json.loads(out.read_text())] == [10, 50]
    assert run("convert", data, file, "--out", out)[0] == 0
    assert [row["bbox"][0] for row in json.loads(out.read_text())] == [10]


def test_categories_without_a_name_are_mapped_by_their_number(tmp_path: Path, run: Run) -> None:
    data = folder(tmp_path / "data", VANS[:1], [box(1, 1)])
    file = found(tmp_path / "f.json", [detection(7)])
    code, _, err = run("convert", data, file, "--out", tmp_path / "out.json")
    assert code == 1
    assert (
        "expected detections of category_id 1 ('car'), got only 7; take it for the class with --map 7=car"
        in err
    )
    assert run("convert", data, file, "--map", "7=car", "--out", tmp_path / "out.json")[0] == 0
    assert len(json.loads((tmp_path / "out.json").read_text())) == 1


def test_evaluate_maps_truth_and_detections(tmp_path: Path, run: Run) -> None:
    """Of a car and a van, both found, all are found with --map and with none of the two left out."""
    data = folder(tmp_path / "data", VANS, [box(1, 1), box(2, 2, 50)])
    file = found(tmp_path / "f.json", [detection(1), detection(2, 50)])
    code, _, err = run("evaluate", data, file, "--map", "van=car", "--no-report", "--out", tmp_path / "run")
    assert code == 0, err
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (metrics["n_cars"], metrics["n_candidates"], metrics["rows"][0]["average_precision"]) == (
        2,
        2,
        1.0,
    )


def test_evaluate_maps_text_whose_truth_has_no_such_class(tmp_path: Path, run: Run) -> None:
    data = folder(tmp_path / "data", VANS[:1], [box(1, 1)])
    van = own.KITTI_CAR.replace("Car", "Van", 1)
    own.write_text(tmp_path / "found" / "1.txt", f"{van} 0.5\n")
    code, _, err = run(
        "evaluate", data, tmp_path / "found", "--map", "van=car", "--no-report", "--out", tmp_path / "run"
    )
    assert (code, "took boxes of 1 Van as car" in err) == (0, True), err
    assert "--map names class 'van', the labels have 1 car" in err
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["n_candidates"] == 1


def test_a_class_that_is_another_by_map_alone_is_not_told_as_left_out(tmp_path: Path) -> None:
    classes = ClassMap.of("car", ["van=car"])
    data = read_dataset(folder(tmp_path, [*VANS[1:], {"id": 3, "name": "dog"}], [box(1, 2)]), "car", classes)
    assert (data.category, data.n_cars) == ("car", 1)
    assert data.notes == (f"{tmp_path / 'annotations.json'}: took boxes of 1 van as car",)


def test_boxes_of_no_size_are_left_out_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    boxes = [
        box(1, 1),
        box(2, 1, bbox=[5, 5, 0, 9]),
        box(3, 2, bbox=[5, 5, 9, 0]),
        box(4, 2, bbox=[5, 5, -9, 9]),
    ]
    data = read_dataset(folder(tmp_path, VANS, boxes))
    assert data.n_cars == 1
    assert f"{tmp_path / 'annotations.json'}: left out 3 boxes of width or height 0" in data.notes
    rows = [detection(1), detection(1, bbox=[5, 5, 0, 9]), detection(2, bbox=[5, 5, 0, 0])]
    file = detections_of(found(tmp_path / "f.json", rows), data)
    assert len(file.table) == 1
    assert "f.json: left out 1 box of width or height 0" in capsys.readouterr().err


def flat_kitti(root: Path) -> DataSet:
    own.kitti_folder(root)
    words = own.KITTI_CAR.split()
    words[6] = words[4]
    own.write_text(root / "label_2" / "000003.txt", f"{own.KITTI_CAR}\n{' '.join(words)}\n")
    return read_dataset(root)


def test_text_boxes_of_no_size_are_left_out_and_counted(tmp_path: Path) -> None:
    data = flat_kitti(tmp_path)
    assert len(data.truth[3].annotation_id) == 1
    assert f"{tmp_path / 'label_2'}: left out 1 box of width or height 0" in data.notes


@pytest.mark.parametrize("line", ["0 .5 .5 0 .1", "0 .1 .1 .2 .1 .3 .1"])
def test_yolo_boxes_of_no_size_are_left_out_and_counted(tmp_path: Path, line: str) -> None:
    """A box of width 0, and a polygon of height 0."""
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "labels" / "a.txt", f"0 .5 .5 .1 .1\n{line}\n")
    own.write_text(tmp_path / "labels" / "classes.txt", "car\n")
    data = read_dataset(tmp_path)
    assert data.n_cars == 1
    assert f"{tmp_path / 'labels'}: left out 1 box of width or height 0" in data.notes


def test_where_all_boxes_are_ignored_that_is_said(tmp_path: Path, run: Run) -> None:
    boxes = [box(1, 1, iscrowd=1), box(2, 1, 50, ignore=True)]
    data = folder(tmp_path / "data", VANS, boxes)
    why = (
        "2 boxes are annotated and none counts: all are ignored (iscrowd or ignore in COCO, difficult in VOC"
    )
    _, out, _ = run("doctor", data)
    assert why in out
    assert "check --class" not in out
    file = found(tmp_path / "f.json", [detection(1)])
    code, _, err = run("evaluate", data, file, "--no-report", "--out", tmp_path / "run")
    assert (code, why in err) == (0, True), err
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (metrics["n_cars"], metrics["n_ignored"]) == (0, 2)


BAD_NAMES = ["../../out", "/tmp/x", "a\\b", "..", ".hidden", "a\x1b[31mred", "a\nb", "\x00", "x" * 101]


@pytest.mark.parametrize("name", BAD_NAMES)
def test_names_that_are_no_file_are_refused(tmp_path: Path, run: Run, name: str) -> None:
    data = folder(tmp_path / "data", VANS, [box(1, 1)])
    file = found(tmp_path / "f.json", [detection(1, detector=name)])
    done = run("evaluate", data, file, "--no-report", "--out", tmp_path / "run")
    assert done[0] == 1
    assert "f.json: expected the name of a detector of letters and digits that could name a file" in done[2]
    assert "\x1b" not in done[2]
    assert done[2].count("\n") == 1
    assert not (tmp_path / "run" / "metrics.json").exists()


def test_texts_that_would_steer_a_terminal_are_refused(tmp_path: Path, run: Run) -> None:
    data = folder(tmp_path / "data", VANS, [box(1, 1)])
    file = found(tmp_path / "f.json", [detection(1, reason_detail="\x1b[2Jgone")])
    code, out, err = run("evaluate", data, file, "--no-report", "--out", tmp_path / "run")
    assert (code, out) == (1, "")
    assert "[0].reason_detail: string should match" in err
    assert "\x1b" not in err


def test_names_of_files_do_not_steer_the_terminal(tmp_path: Path, run: Run) -> None:
    code, _, err = run("convert", tmp_path / "no\x1b[31msuch", "--out", tmp_path / "out")
    assert code == 1
    assert "no\\x1b[31msuch" in err
    assert "\x1b" not in err


def test_the_names_in_a_run_folder_are_checked(tmp_path: Path, run: Run) -> None:
    data = folder(tmp_path / "data", VANS, [box(1, 1)])
    file = found(tmp_path / "f.json", [detection(1, detector="mine")])
    assert run("evaluate", data, file, "--no-report", "--out", tmp_path / "run")[0] == 0
    metrics = tmp_path / "run" / "metrics.json"
    metrics.write_text(metrics.read_text().replace('"mine"', '"../mine"'))
    code, _, err = run("report", tmp_path / "run")
    assert code == 1
    assert "metrics.json: expected the name of a detector of letters and digits" in err


def test_an_odd_file_name_is_no_detector(tmp_path: Path) -> None:
    data = read_dataset(folder(tmp_path, VANS, [box(1, 1)]))
    with pytest.raises(RescoreError, match="expected the name of a detector"):
        read_detections(found(tmp_path / "a\x1bb.json", [detection(1)]), data)
