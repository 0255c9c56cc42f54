"""Text as other machines save it: with a byte order mark, in UTF-16, with other ends of lines."""

import json
from pathlib import Path

import pytest

from rescore.files import read_json
from rescore.formats.calibration_files import read_calibration
from rescore.formats.open import read_dataset, read_detections
from tests.rescore import own_data as own

ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32")
VOC = """<annotation><object><name>car</name>
<bndbox><xmin>11</xmin><ymin>21</ymin><xmax>40</xmax><ymax>44</ymax></bndbox></object></annotation>"""


def write(path: Path, text: str, encoding: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    return path


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_json(tmp_path: Path, encoding: str) -> None:
    own.own_folder(tmp_path)
    write(tmp_path / "annotations.json", json.dumps(own.annotations()), encoding)
    data = read_dataset(tmp_path)
    assert data.truth[1].xyxy_px.tolist() == [[10, 20, 40, 44]]
    found = [{"image_id": 1, "bbox": [10, 20, 30, 24], "score": 0.5}]
    path = write(tmp_path / "found.json", json.dumps(found), encoding)
    assert read_detections(path, data).table.score.tolist() == [0.5]
    assert read_json(path, "detections") == found


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_text(tmp_path: Path, encoding: str) -> None:
    own.pair_folder(tmp_path)
    calibration = (tmp_path / "calib.yaml").read_text()
    expected = read_calibration(tmp_path / "calib.yaml")
    assert read_calibration(write(tmp_path / "calib.yaml", calibration, encoding)) == expected
    write(tmp_path / "data.yaml", "names: [dog, car]\n", encoding)
    write(tmp_path / "labels" / "a.txt", "1 0.25 0.5 0.25 0.25\n", encoding)
    write(tmp_path / "ImageSets" / "val.txt", "a\n", encoding)
    data = read_dataset(tmp_path)
    assert [f.split for f in data.frames] == ["validation"]
    assert data.truth[1].xyxy_px.tolist() == [[12, 24, 36, 40]]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_xml(tmp_path: Path, encoding: str) -> None:
    own.pair_folder(tmp_path)
    write(tmp_path / "Annotations" / "a.xml", VOC, encoding)
    assert read_dataset(tmp_path).truth[1].xyxy_px.tolist() == [[10, 20, 40, 44]]
