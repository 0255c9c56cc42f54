"""Malformed input: one line that says what is wrong and where and exit code 1; or a count where work goes on.

Never a traceback: an exception that is no SystemExit fails the test. Never a silent skip: what is left out is
counted on standard error.
"""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from tests.rescore import own_data as own
from tests.rescore.malformed_layouts import KITTI, OWN, PLAIN
from tests.rescore.malformed_pixels import PIXELS
from tests.rescore.malformed_predictions import PREDICTIONS, RELATIVE, described, predictions
from tests.rescore.spoiling import INF, NAN, Done, Json, Run


def refused(done: Done, message: str) -> None:
    """The command ended with one line of error that a message matches."""
    code, out, err = done
    assert (code, out) == (1, "")
    lines = [line for line in err.splitlines() if not line.startswith("note: ")]
    assert len(lines) == 1, err
    assert lines[0].startswith("rescore: ")
    assert re.search(message, lines[0]), lines[0]


@pytest.mark.parametrize("name", OWN)
def test_our_own_layout(tmp_path: Path, run: Run, name: str) -> None:
    spoil, message = OWN[name]
    own.own_folder(tmp_path)
    spoil(tmp_path)
    refused(run("convert", tmp_path, "--out", tmp_path / "out"), message)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", KITTI)
def test_kitti_layout(tmp_path: Path, run: Run, name: str) -> None:
    spoil, message = KITTI[name]
    own.kitti_folder(tmp_path)
    spoil(tmp_path)
    refused(run("import", tmp_path, "--out", tmp_path / "out"), message)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", PLAIN)
def test_plain_folders(tmp_path: Path, run: Run, name: str) -> None:
    spoil, message = PLAIN[name]
    own.pair_folder(tmp_path)
    spoil(tmp_path)
    refused(run("import", tmp_path, "--out", tmp_path / "out"), message)
    assert not (tmp_path / "out").exists()


def detection(**changes: object) -> Json:
    return {"image_id": 1, "category_id": 1, "bbox": [1.5, 2, 30, 40], "score": 0.5} | changes


DETECTIONS: dict[str, tuple[object, str]] = {
    "no such image": ([detection(), detection(image_id=6)], "detection 1: .*got image_id 6"),
    "score NaN": ([detection(score=NAN)], r"\[0\].score: .*finite"),
    "score infinite": ([detection(score=-INF)], r"\[0\].score: .*finite"),
    "score a word": ([detection(score="high")], r"\[0\].score: .*'high'"),
    "box inside out": ([detection(bbox=[1, 2, 3, -4])], "detection 0: .*positive sizes"),
    "box infinite": ([detection(bbox=[1, 2, INF, 4])], r"\[0\].bbox\[2\]: .*finite"),
    "likelihood 1.5": (
        [detection(likelihood=1.5)],
        r"detection 0: expected a likelihood in \[0, 1\], got 1.5",
    ),
    "other class": ([detection(category_id=4)], "expected detections of category_id 1 .'car'., got only 4"),
    "a data set": (own.annotations(), "expected detections as a list"),
    "no box": ([{"image_id": 1, "score": 1}], r"\[0\].bbox: field required"),
    "a list of lists": ([[1, 2, 3, 4]], r"\[0\]: input should be"),
    "number too long": ([detection(image_id=10**30)], r"\[0\].image_id: input should be"),
}


@pytest.mark.parametrize("name", DETECTIONS)
def test_detections(tmp_path: Path, run: Run, name: str) -> None:
    value, message = DETECTIONS[name]
    own.own_folder(tmp_path)
    file = own.write_text(tmp_path / "found.json", json.dumps(value))
    done = run("evaluate", tmp_path, file, "--no-report", "--out", tmp_path / "out")
    refused(done, f"found.json: .*{message}")
    assert not (tmp_path / "out").exists()


FOLDERS: dict[str, tuple[str, str, str]] = {
    "nothing": ("readme.md", "", "expected detections, a .txt a frame, found none"),
    "no score": ("1.txt", own.KITTI_CAR, "image 1: expected a score in the last column"),
    "score NaN": ("1.txt", f"{own.KITTI_CAR} nan", "1.txt:1: expected a finite number for the score"),
    "a stranger": ("000009.txt", f"{own.KITTI_CAR} 1", "000009.txt: expected the name of a frame, as '1'"),
}


@pytest.mark.parametrize("name", FOLDERS)
def test_folders_of_detections(tmp_path: Path, run: Run, name: str) -> None:
    file, content, message = FOLDERS[name]
    own.own_folder(tmp_path)
    own.write_text(tmp_path / "found" / file, content)
    out = tmp_path / "out.json"
    refused(run("convert", tmp_path, tmp_path / "found", "--out", out), message)
    assert not out.exists()


def test_scores_that_are_no_likelihoods(tmp_path: Path, run: Run) -> None:
    own.own_folder(tmp_path)
    file = own.write_text(tmp_path / "svm.json", json.dumps([detection(score=-1.5), detection(score=2)]))
    arguments = ("--model", tmp_path / "none.json", "--w", 0.5, "--out", tmp_path / "out.json")
    done = run("apply", tmp_path, file, *arguments)
    refused(done, r"detections of svm: .*got scores from -1.5 to 2; map them to likelihoods")


@pytest.mark.parametrize("name", PIXELS)
def test_pixels(tmp_path: Path, run: Run, name: str) -> None:
    spoil, message = PIXELS[name]
    own.own_folder(tmp_path)
    spoil(tmp_path)
    code, out, err = run("doctor", tmp_path)
    assert code == 1
    wrong = [line for line in out.splitlines() if line.startswith("error ")]
    assert any(re.search(message, line) for line in wrong), out
    assert re.fullmatch(r"\d+ errors?, \d+ warnings?\n", err)
    assert all(line.startswith(("ok ", "warning ", "error ")) for line in out.splitlines()), out


@pytest.mark.parametrize("name", PREDICTIONS)
def test_predictions_of_depth(tmp_path: Path, run: Run, name: str) -> None:
    spoil, description, message = PREDICTIONS[name]
    data = own.own_folder(tmp_path)
    predictions(tmp_path)
    spoil(tmp_path)
    net = described(tmp_path / "net.json", description)
    file = own.write_text(tmp_path / "f.json", json.dumps([detection(), detection(image_id=2)]))
    out = tmp_path / "out.json"
    refused(run("apply", data, file, "--predicted", net, "--w", 0.5, "--jobs", 1, "--out", out), message)
    assert not out.exists()


def test_one_of_model_and_predictions(tmp_path: Path, run: Run) -> None:
    data = own.own_folder(tmp_path)
    file = own.write_text(tmp_path / "f.json", json.dumps([detection()]))
    rest = ("--w", 0.5, "--out", tmp_path / "out.json")
    refused(run("apply", data, file, *rest), "--model, --predicted: expected one of the two, got neither")
    both = ("--model", tmp_path / "car.json", "--predicted", tmp_path / "net.json")
    refused(run("apply", data, file, *both, *rest), "--model, --predicted: expected one of the two, got both")
    missing = ("--predicted", tmp_path / "net.json")
    refused(run("apply", data, file, *missing, *rest), "net.json: expected a description .*, found no file")


def test_relative_predictions_in_modes_that_bound_the_scale(tmp_path: Path, run: Run) -> None:
    data = own.own_folder(tmp_path)
    predictions(tmp_path)
    net = described(tmp_path / "net.json", RELATIVE)
    file = own.write_text(tmp_path / "f.json", json.dumps([detection()]))
    options = ("--predicted", net, "--out", tmp_path / "out.json")
    refused(run("fit-evidence", data, file, *options), "registration guarded: expected metric predictions")


def test_what_is_no_data_set(tmp_path: Path, run: Run) -> None:
    def convert(path: Path) -> Done:
        return run("convert", path, "--out", tmp_path / "out")

    refused(convert(tmp_path / "nowhere"), "nowhere.*: expected a data set .*, found no file")
    (tmp_path / "empty").mkdir()
    refused(convert(tmp_path / "empty"), "looked for annotations.json; .*found nothing")
    refused(
        convert(own.write_png(tmp_path / "x.png", own.pair()[0])), "x.png: expected a data set .*invalid JSON"
    )
    (tmp_path / "odd" / "annotations.json").mkdir(parents=True)
    refused(convert(tmp_path / "odd"), "looked for annotations.json; .*found annotations.json")


@pytest.mark.parametrize(
    ("maps", "message"),
    [
        (["van"], "--map: expected OLD=NEW, as van=car, got 'van'"),
        (["=car"], "--map: expected OLD=NEW"),
        (["van=car", "VAN=bus"], "--map: expected each class once, got 'VAN' twice"),
        (["lorry=car"], "--map names class 'lorry', the labels have"),
    ],
)
def test_maps_of_classes(
    tmp_path: Path,
    run: Run,
    maps: list[str],
    message: str,
) -> None:
    own.kitti_folder(tmp_path)
    options = [word for one in maps for word in ("--map", one)]
    refused(run("import", tmp_path, "--out", tmp_path / "out", *options), message)


def test_places_that_cannot_be_written(tmp_path: Path, run: Run) -> None:
    data = own.own_folder(tmp_path / "data")
    file = own.write_text(tmp_path / "file", "x")
    found = own.write_text(tmp_path / "found.json", json.dumps([detection()]))
    advice = "choose another place|check the path and its permissions"
    refused(run("convert", data, "--out", file / "out"), advice)
    refused(run("convert", data, found, "--out", file / "out.json"), advice)
    refused(run("import", data, "--out", file / "out", "--copy"), advice)
    refused(run("import", data, "--out", data), "expected no data set here yet")
    (tmp_path / "folder.json").mkdir()
    refused(run("convert", data, found, "--out", tmp_path / "folder.json"), advice)
    refused(run("convert", data, "--out", tmp_path / "x.json"), "expected a folder for KITTI")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only to the superuser")
def test_a_read_only_folder(tmp_path: Path, run: Run) -> None:
    data = own.own_folder(tmp_path / "data")
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    refused(run("convert", data, "--out", locked / "out"), "mend the permissions")


def test_what_must_work_works(tmp_path: Path, run: Run) -> None:
    """Blanks and any letters in paths; suffixes in capitals; CRLF and a byte order mark; no boxes."""
    data = own.kitti_folder(tmp_path / "mes données 車 #1")
    for folder in ("image_2", "image_3"):
        (data / folder / "000007.png").rename(data / folder / "000007.PNG")
    lines = own.KITTI_LABEL.replace("\n", "\r\n")
    (data / "label_2" / "000003.txt").write_bytes(b"\xef\xbb\xbf" + lines.encode())
    out = tmp_path / "aus gabe ü"
    code, _, err = run("import", data, "--out", out, "--copy")
    assert code == 0, err
    assert "2 frames, 4 boxes" in err
    code, shown, err = run("doctor", out)
    assert code == 0, shown
    empty = own.write_text(tmp_path / "leer é.json", "[]")
    code, _, err = run("evaluate", out, empty, "--no-report", "--out", tmp_path / "run é")
    assert code == 0, err
    metrics = json.loads((tmp_path / "run é" / "metrics.json").read_text())
    assert (metrics["n_images"], metrics["n_cars"], metrics["n_candidates"]) == (2, 2, 0)


def test_a_hundred_thousand_boxes_in_one_image(tmp_path: Path, run: Run) -> None:
    n = 100_000
    corner = np.random.default_rng(0).uniform(0, 40, (n, 2)).round(2).tolist()
    value = own.annotations()
    value["annotations"] = [
        {"id": i, "image_id": 1, "category_id": 1, "bbox": [*xy, 20, 20]} for i, xy in enumerate(corner)
    ]
    own.own_folder(tmp_path, value)
    found = [detection(bbox=[*xy, 20, 20], score=i / n) for i, xy in enumerate(corner)]
    file = own.write_text(tmp_path / "found.json", json.dumps(found))
    # what grows with the square of n would take minutes here
    code, _, err = run("evaluate", tmp_path, file, "--no-report", "--out", tmp_path / "run")
    assert code == 0, err
    assert "left out 99985 detections beyond the 15 best of their image" in err
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["n_cars"] == n


def test_frames_that_lack_files_are_counted(tmp_path: Path, run: Run) -> None:
    own.kitti_folder(tmp_path)
    (tmp_path / "label_2" / "000007.txt").unlink()
    code, _, err = run("import", tmp_path, "--out", tmp_path / "out")
    assert code == 0
    assert "note: " in err
    assert "000007.txt: 1 of 2 frames have no label file and count as empty" in err
    assert "left out boxes of other classes: 1 Pedestrian" in err
