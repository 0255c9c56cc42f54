"""Polygons of labelling tools: what comes back of a drawn picture, and one error for each fault."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recon.errors import RescoreError
from recon.learning.label_files import read_labelled_views
from recon.part_views import PartViews, save_part_views
from recon.view_bins import ViewBins
from tests.recon.box_car import PART_NAMES, box_car, labelled_view

Change = Callable[[dict[str, Any]], object]
BODY = [1.0, 2.0, 19.0, 2.0, 19.0, 8.0, 1.0, 8.0]
WHEEL = [3.0, 6.0, 7.0, 6.0, 7.0, 9.0, 3.0, 9.0]


def coco() -> dict[str, Any]:
    """Two pictures of one car, bins 3 and 4: a wheel over a body in both, a roof in the second."""
    images = [
        {"id": 7, "file_name": "a.jpg", "width": 20, "height": 10, "view_bin": 3, "instance_id": "car1"},
        {
            "id": 9,
            "file_name": "b.jpg",
            "width": 20,
            "height": 10,
            "azimuth_deg": 118.0,
            "instance_id": "car1",
        },
    ]
    names = ["body", "wheel", "roof"]
    drawn = [(7, 1, BODY), (7, 2, WHEEL), (9, 1, BODY), (9, 2, WHEEL), (9, 3, [5, 0, 15, 0, 15, 2, 5, 2])]
    return {
        "images": images,
        "categories": [{"id": i + 1, "name": n, "supercategory": "car"} for i, n in enumerate(names)],
        "annotations": [
            {"id": i + 1, "image_id": image, "category_id": c, "segmentation": [polygon]}
            for i, (image, c, polygon) in enumerate(drawn)
        ],
    }


def labelme(polygon: list[float] = BODY, **keys: object) -> dict[str, Any]:
    shapes = [
        {"label": label, "points": np.reshape(p, (-1, 2)).tolist(), "shape_type": "polygon", "flags": {}}
        for label, p in (("body", polygon), ("wheel", WHEEL))
    ]
    size = {"imagePath": "x.jpg", "imageData": None, "imageHeight": 10, "imageWidth": 20}
    return {"version": "5.8.1", "flags": {}, "shapes": shapes} | size | keys


def write(path: Path, value: object) -> Path:
    path.write_text(json.dumps(value))
    return path


def test_coco(tmp_path: Path) -> None:
    found = read_labelled_views(write(tmp_path / "parts.json", coco()))
    assert found.class_name == "car"
    assert found.part_views.part_names == ("body", "wheel", "roof")
    assert found.part_views.bins == ViewBins()
    first, second = found.part_views.views
    assert (first.view_bin, first.instance_id) == (3, "car1")
    # 118 degrees is nearest to 4 x 30
    assert (second.view_bin, second.instance_id) == (4, "car1")
    assert first.labels.shape == (10, 20)
    # the wheel is drawn after the body, and lies over it
    assert (first.labels[6:9, 3:7] == 2).all()
    assert first.labels[4, 10] == 1
    assert not first.labels[:, 0].any()
    assert found.warnings == ("part 'roof': one view shows it; its plane will be taken to face that view",)


def test_bins_are_those_asked_for(tmp_path: Path) -> None:
    data = coco()
    data["images"][1]["azimuth_deg"] = 100.0
    bins = ViewBins(36, 0.2)
    found = read_labelled_views(write(tmp_path / "parts.json", data), bins)
    assert found.part_views.bins == bins
    assert [v.view_bin for v in found.part_views.views] == [3, 10]


def test_several_polygons_are_one_part(tmp_path: Path) -> None:
    data = coco()
    data["annotations"][0]["segmentation"] = [[1, 2, 5, 2, 5, 5, 1, 5], [12, 2, 18, 2, 18, 5, 12, 5]]
    labels = read_labelled_views(write(tmp_path / "parts.json", data)).part_views.views[0].labels
    assert labels[3, 3] == labels[3, 15] == 1
    assert labels[3, 9] == 0


def test_labelme_by_flags_and_by_keys(tmp_path: Path) -> None:
    flags = {"view_bin_03": True, "view_bin_04": False, "instance_car1": True, "blurred": True}
    write(tmp_path / "one.json", labelme(flags=flags))
    write(tmp_path / "two.json", labelme(view_bin=4, instance_id="car1"))
    write(tmp_path / "zwei.json", labelme(view_bin=4))
    found = read_labelled_views(tmp_path)
    views = found.part_views.views
    assert [(v.view_bin, v.instance_id) for v in views] == [(3, "car1"), (4, "car1"), (4, "zwei")]
    assert found.class_name is None
    assert found.warnings == ()
    coco_labels = read_labelled_views(write(tmp_path.with_suffix(".json"), coco())).part_views.views[0].labels
    np.testing.assert_array_equal(views[0].labels, coco_labels)


def test_labels_txt_names_the_parts(tmp_path: Path) -> None:
    write(tmp_path / "one.json", labelme(view_bin=3))
    (tmp_path / "labels.txt").write_text("__ignore__\nwheel\nbody\nroof\n")
    found = read_labelled_views(tmp_path)
    assert found.part_views.part_names == ("wheel", "body", "roof")
    assert [w.split(":")[0] for w in found.warnings[:3]] == ["part 'roof'", "part 'wheel'", "part 'body'"]
    assert "no two views share an instance" in found.warnings[3]
    (tmp_path / "labels.txt").write_text("wheels\nbody\n")
    with pytest.raises(RescoreError, match=r"one.json: part 'wheel': expected one of wheels, body"):
        read_labelled_views(tmp_path)


def test_rendered_views_as_before(tmp_path: Path) -> None:
    views = tuple(labelled_view(box_car(), b, ViewBins()) for b in (2, 3))
    save_part_views(tmp_path / "data" / "part_views", PartViews(PART_NAMES, ViewBins(), views))
    for path in (tmp_path / "data", tmp_path / "data" / "part_views"):
        back = read_labelled_views(path).part_views
        assert back.part_names == PART_NAMES
        for a, b in zip(back.views, views, strict=True):
            np.testing.assert_array_equal(a.labels, b.labels)


def _image(**keys: object) -> Change:
    return lambda d: d["images"][0].update(keys)


def _polygon(*polygon: object) -> Change:
    return lambda d: d["annotations"][1].update(segmentation=[list(polygon)])


def _annotation(**keys: object) -> Change:
    return lambda d: d["annotations"][1].update(keys)


COCO_FAULTS: list[tuple[Change, str]] = [
    (_polygon(1, 1, 5, 5), "image 'a.jpg': part 'wheel': expected at least 3 different points, got 2"),
    (
        _polygon(0, 0, 4, 4, 4, 0, 0, 4),
        "'a.jpg': part 'wheel': expected a polygon that does not cross itself",
    ),
    (
        _polygon(3, 6, 25, 6, 7, 9),
        r"'a.jpg': part 'wheel': expected points inside 20 x 10 pixels, got \(25, 6\)",
    ),
    (_polygon(3, 6, float("nan"), 6, 7, 9), r"'a.jpg': part 'wheel': expected finite coordinates, got \[nan"),
    (_polygon(1, 1, 3, 3, 5, 5), "'a.jpg': part 'wheel': expected an area of at least one pixel"),
    (_polygon(1, 1, 3), r"'wheel': expected polygons \[x1, y1, x2, y2, ...\], got \[1, 1, 3\]"),
    (_polygon(1, 1, "x", 3, 3, 4), "'wheel': expected points as pairs of numbers"),
    (_annotation(segmentation={"counts": "x", "size": [10, 20]}), "'wheel': expected polygons, got .*RLE"),
    (_annotation(segmentation=[]), "'wheel': expected a list of polygons as segmentation, got none"),
    (_annotation(category_id=8), "image 'a.jpg': expected a category_id of 1, 2, 3, got 8"),
    (_annotation(image_id=8), "annotation 2: expected a listed image, got image_id 8"),
    (
        lambda d: d["annotations"].append(
            d["annotations"][0] | {"segmentation": [[0, 0, 20, 0, 20, 10, 0, 10]]}
        ),
        "'a.jpg': part 'wheel': .*later polygons cover it",
    ),
    (_image(view_bin=12), "image 'a.jpg': view bin: expected 0 to 11, got 12"),
    (_image(view_bin=-1), "image 'a.jpg': view bin: expected 0 to 11, got -1"),
    (_image(view_bin=True), "image 'a.jpg': expected view_bin of type whole number, got True"),
    (lambda d: d["images"][1].update(azimuth_deg="left"), "'b.jpg': expected a finite number as azimuth_deg"),
    (lambda d: d["images"][0].pop("view_bin"), "'a.jpg': expected view_bin or azimuth_deg, got neither"),
    (_image(view_bin=4), "'b.jpg': expected one picture of instance 'car1' in view bin 4, got .*'a.jpg' too"),
    (_image(width=0), "'a.jpg': expected the size of a picture, got 0 x 10"),
    (_image(height="10"), "'a.jpg': expected height of type whole number, got '10'"),
    (lambda d: d.update(annotations=[]), "expected polygons of parts, got none"),
    (
        lambda d: d.update(annotations=d["annotations"][:2]),
        "'b.jpg': expected at least one polygon, got none",
    ),
    (lambda d: d.update(annotations={}), "expected annotations of type list, got {}"),
    (lambda d: d.update(categories=[3]), "categories: expected a list of objects, got 3"),
    (
        lambda d: d["categories"][0].update(supercategory="chair"),
        "of one class, got supercategories car, chair",
    ),
    (lambda d: d["categories"][0].update(name="wheel"), "expected each id and name once"),
    (
        lambda d: d.pop("images"),
        "got an object with annotations, categories; expected COCO segmentation JSON",
    ),
]


@pytest.mark.parametrize(("change", "message"), COCO_FAULTS)
def test_faults_of_coco(tmp_path: Path, change: Change, message: str) -> None:
    data = coco()
    change(data)
    _refused(write(tmp_path / "parts.json", data), message)


LABELME_FAULTS: list[tuple[dict[str, Any], str]] = [
    (labelme(), "one.json: expected a view bin, got none; tick a flag such as view_bin_03"),
    (labelme(flags={"view_bin_03": True, "view_bin_04": True}), "expected one ticked flag view_bin_"),
    (labelme(flags={"view_bin_left": True}), "expected a flag such as view_bin_03, got 'view_bin_left'"),
    (labelme(flags={"view_bin_12": True}), "one.json: view bin: expected 0 to 11, got 12"),
    (labelme(BODY[:4], view_bin=3), "one.json: part 'body': expected at least 3 different points, got 2"),
    (labelme(view_bin=3, shapes=[]), "one.json: expected at least one polygon, got none"),
    (
        labelme(
            view_bin=3, shapes=[{"label": "body", "points": [[1, 1], [5, 5]], "shape_type": "rectangle"}]
        ),
        "one.json: part 'body': expected shape_type 'polygon', got 'rectangle'",
    ),
    (coco(), "one.json: got an object with .*; expected LabelMe JSON alone"),
]


@pytest.mark.parametrize(("value", "message"), LABELME_FAULTS)
def test_faults_of_labelme(tmp_path: Path, value: dict[str, Any], message: str) -> None:
    write(tmp_path / "one.json", value)
    _refused(tmp_path, message)


def test_faults_of_paths(tmp_path: Path) -> None:
    _refused(tmp_path, "expected part_views.json, a COCO segmentation file or a folder of LabelMe files")
    _refused(tmp_path / "nothing", "check the path")
    (tmp_path / "broken.json").write_text("{")
    _refused(tmp_path, "broken.json: expected JSON")
    _refused(write(tmp_path / "list.json", [1, 2]), r"list.json: got \[1, 2\]; expected COCO")


def _refused(path: Path, message: str) -> None:
    with pytest.raises(RescoreError, match=message) as caught:
        read_labelled_views(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
def test_labelme_files_in_other_encodings(tmp_path: Path, encoding: str) -> None:
    value = json.dumps(labelme(view_bin=3)).encode(encoding)
    (tmp_path / "a.json").write_bytes(value)
    (tmp_path / "b.json").write_bytes(json.dumps(labelme(view_bin=4, instance_id="a")).encode(encoding))
    (tmp_path / "labels.txt").write_bytes("__ignore__\r\nwheel\r\nbody\r\n".encode(encoding))
    assert read_labelled_views(tmp_path).part_views.part_names == ("wheel", "body")


def test_labels_txt_in_an_encoding_that_is_not_told(tmp_path: Path) -> None:
    write(tmp_path / "a.json", labelme(view_bin=3))
    (tmp_path / "labels.txt").write_bytes("body\nroue arri\u00e8re\n".encode("latin-1"))
    with pytest.raises(
        RescoreError, match=r"labels.txt: expected names of parts as text in UTF-8 or UTF-16, got other"
    ):
        read_labelled_views(tmp_path)
