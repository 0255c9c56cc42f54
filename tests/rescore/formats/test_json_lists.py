"""Lists of detections in pieces: every piece gives what the whole gives; what is no such list is one line."""

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.formats import json_lists
from rescore.formats.coco import read_detections
from rescore.formats.open import read_dataset
from tests.rescore import own_data as own
from tests.rescore.spoiling import Json


@pytest.fixture
def data(tmp_path: Path) -> DataSet:
    return read_dataset(own.own_folder(tmp_path / "data"))


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces of some detections, so that small files have many."""
    monkeypatch.setattr(json_lists, "PIECE_BYTES", 1600)
    monkeypatch.setattr(json_lists, "MAX_OBJECT_BYTES", 6400)


def rows(n: int) -> list[Json]:
    rng = np.random.default_rng(0)
    made = []
    for i in range(n):
        box = [*rng.uniform(0, 40, 2).round(2).tolist(), 20, 20]
        row: Json = {"image_id": 1 + i % 2, "category_id": 1, "bbox": box, "score": round(rng.random(), 3)}
        # objects in objects, texts with brackets, and rows with and without keys
        row |= {"cues": {"valid": 0.5}, "reason_detail": "a }, { b"} if i % 3 == 0 else {}
        row |= {"more": [{"x": 1}, {"y": [{}, {}]}]} if i % 5 == 0 else {}
        made.append(row)
    return made


@pytest.mark.parametrize("indent", [None, 1])
@pytest.mark.usefixtures("small")
def test_pieces_give_the_whole(
    tmp_path: Path, data: DataSet, monkeypatch: pytest.MonkeyPatch, indent: int | None
) -> None:
    found = rows(300)
    file = own.write_text(tmp_path / "f.json", json.dumps(found, indent=indent))
    pieces = read_detections(file, data, None)
    monkeypatch.setattr(json_lists, "PIECE_BYTES", 10**9)
    whole = read_detections(file, data, None)
    best = sorted(range(300), key=lambda i: (found[i]["image_id"], -found[i]["score"]))
    assert pieces.table.score.tolist() == [found[i]["score"] for i in best]
    for name in ("image_id", "rank", "xyxy_px", "score", "likelihood", "cues", "status", "reason_detail"):
        np.testing.assert_array_equal(getattr(pieces.table, name), getattr(whole.table, name), err_msg=name)


@pytest.mark.usefixtures("small")
def test_the_best_of_each_image_are_found_across_pieces(tmp_path: Path, data: DataSet) -> None:
    found = rows(300)
    file = read_detections(own.write_text(tmp_path / "f.json", json.dumps(found)), data, 15)
    best = [sorted((-d["score"] for d in found if d["image_id"] == i), key=float)[:15] for i in (1, 2)]
    assert file.table.score.tolist() == [-s for own_best in best for s in own_best]
    assert file.n_beyond_max == 270


@pytest.mark.usefixtures("small")
def test_a_fault_far_on_is_named_by_its_place(tmp_path: Path, data: DataSet) -> None:
    found = rows(300)
    found[257]["score"] = "high"
    file = own.write_text(tmp_path / "f.json", json.dumps(found))
    with pytest.raises(RescoreError, match=r"\[257\].score: input should be a valid number.*'high'"):
        read_detections(file, data)
    found[257] = rows(1)[0] | {"image_id": 99}
    own.write_text(file, json.dumps(found))
    with pytest.raises(RescoreError, match=r"detection 257: .*got image_id 99"):
        read_detections(file, data)
    cut = json.dumps(rows(300))[:-20]
    with pytest.raises(RescoreError, match=r"got after item 2..: invalid JSON: EOF"):
        read_detections(own.write_text(file, cut), data)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
@pytest.mark.usefixtures("small")
def test_other_encodings_in_pieces(tmp_path: Path, data: DataSet, encoding: str) -> None:
    file = tmp_path / "f.json"
    file.write_bytes(json.dumps(rows(100)).encode(encoding))
    assert len(read_detections(file, data, None).table) == 100


def peak_mb(file: Path, data: DataSet, message: str) -> float:
    tracemalloc.start()
    try:
        with pytest.raises(RescoreError, match=message):
            read_detections(file, data)
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def test_bare_numbers_take_no_memory(tmp_path: Path, data: DataSet) -> None:
    """Ten million numbers are refused from the first 16 MB; fewer by the first of them alone."""
    file = own.write_text(tmp_path / "f.json", "[" + ",".join(["1"] * 10_000_000) + "]")
    assert peak_mb(file, data, "expected detections as a list .* without the end of one") < 120
    own.write_text(file, "[" + ",".join(["1"] * 1_000_000) + "]")
    assert peak_mb(file, data, r"\[0\]: input should be .*object.* \(1\); mend the file") < 60


def test_bare_numbers_in_a_data_set_are_told_by_the_first(tmp_path: Path) -> None:
    numbers = "[" + ",".join(["1"] * 1_000_000) + "]"
    text = f'{{"images": [], "annotations": {numbers}, "categories": []}}'
    file = own.write_text(tmp_path / "annotations.json", text)
    tracemalloc.start()
    with pytest.raises(RescoreError, match=r"annotations\[0\]: input should be .* \(1\); mend the file"):
        read_dataset(file)
    peak = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    assert peak < 60


def test_a_hundred_thousand_detections_are_cheap(tmp_path: Path, data: DataSet) -> None:
    """Under 60 MB at the peak: what nothing fills takes none, and of each piece the best alone are kept."""
    row = json.dumps({"image_id": 1, "category_id": 1, "bbox": [1, 2, 30, 40], "score": 0.5})
    file = own.write_text(tmp_path / "f.json", "[" + ", ".join([row] * 100_000) + "]")
    tracemalloc.start()
    found = read_detections(file, data)
    peak = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    assert (len(found.table), found.n_beyond_max) == (15, 99_985)
    assert peak < 60
