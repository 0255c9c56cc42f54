"""Three real stereo pairs with boxes of a detector, rescored as a newcomer does, by the shipped rescorer.

Nothing is fitted to these frames: the shipped rescorer has not seen them, nor their camera.
"""

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import load_frame
from rescore.evidence.settings import RescoreConfig, with_stereo_for
from rescore.formats.open import read_dataset
from tests.conftest import REAL_STREET, readme_commands, run_rescore

MOST_BYTES = 1_500_000
SUN, SNOW, RAIN = 1, 2, 3
"""Image ids in the order of names."""
CAR_M = np.array([[3.4, 1.4, 1.2], [5.4, 2.15, 2.1]])
"""Least and largest length, width and height of passenger cars and pickup trucks."""


@pytest.fixture(scope="module")
def rows(real_street_run: Path) -> list[dict[str, Any]]:
    """The rescored boxes with what they show, best detector score first."""
    shows = {box_of(r): r["shows"] for r in json.loads((REAL_STREET / "detections.json").read_text())}
    found = [
        r | {"shows": shows[box_of(r)]} for r in json.loads((real_street_run / "rescored.json").read_text())
    ]
    assert len(found) == len(shows) == 21
    return sorted(found, key=lambda r: -r["detector_score"])


def box_of(row: dict[str, Any]) -> tuple[int, ...]:
    return (row["image_id"], *(round(v) for v in row["bbox"]))


def of(rows: list[dict[str, Any]], image_id: int) -> list[dict[str, Any]]:
    return [r for r in rows if r["image_id"] == image_id]


def place(rows: list[dict[str, Any]], row: dict[str, Any], key: str) -> int:
    """Place of a box among all, 1 is best."""
    return 1 + sum(r[key] > row[key] for r in rows)


def test_the_doctor_has_no_fault_to_find() -> None:
    done = run_rescore("doctor", REAL_STREET, "--json")
    assert done.returncode == 0, done.stderr
    findings = json.loads(done.stdout)
    assert any("3 frames" in str(f) for f in findings)
    assert not [f for f in findings if f["level"] == "error"]


def test_the_boxes_lie_in_three_pictures_of_one_size() -> None:
    data = read_dataset(REAL_STREET, "car")
    assert [r.image_id for r in data.frames] == [SUN, SNOW, RAIN]
    assert {(r.width_px, r.height_px) for r in data.frames} == {(1280, 720)}
    for record in data.frames:
        assert record.right_path is not None
        assert record.right_path.name == record.left_path.name
        assert record.right_path.is_file()


def test_it_is_small_and_names_its_source_and_changes() -> None:
    files = [f for f in REAL_STREET.rglob("*") if f.is_file()]
    assert sum(f.stat().st_size for f in files) < MOST_BYTES
    text = re.sub(r"\s+", " ", (REAL_STREET / "README.md").read_text())
    for needed in ("CC BY 4.0", "arXiv 2407.04908", "University of Michigan-Dearborn", "Changes: "):
        assert needed in text
    for folder in ("left", "right"):
        for picture in (REAL_STREET / folder).iterdir():
            assert f"`{picture.stem}`" in text


def test_the_bare_road_falls(rows: list[dict[str, Any]]) -> None:
    road = next(r for r in rows if r["shows"] == "bare road with a white line")
    assert road["status"] == "ok"
    # depth speaks against it, more than where it says nothing
    assert road["depth_difference"] > silent_difference(rows)
    assert place(rows, road, "score") > place(rows, road, "detector_score")
    assert road["score"] == min(r["score"] for r in of(rows, SUN))


def silent_difference(rows: list[dict[str, Any]]) -> float:
    """D of the boxes without evidence."""
    found = {r["depth_difference"] for r in rows if r["status"] == "no_ground"}
    assert len(found) == 1
    return float(found.pop())


def test_the_boxes_in_the_rain_keep_their_order(rows: list[dict[str, Any]]) -> None:
    rain = of(rows, RAIN)
    assert len(rain) == 14
    assert {r["status"] for r in rain} == {"no_ground"}
    assert all(a["score"] > b["score"] for a, b in pairwise(rain))
    assert not any("bbox3d" in r for r in rain)


@pytest.mark.parametrize("image_id", [SUN, SNOW])
def test_the_nearest_car_stays_first_and_its_3d_box_stands_on_the_ground(
    rows: list[dict[str, Any]], image_id: int
) -> None:
    first = of(rows, image_id)[0]
    assert first["shows"].startswith("car")
    assert first["score"] == max(r["score"] for r in of(rows, image_id))
    assert first["depth_difference"] < silent_difference(rows)
    box = Boxes3D.of_values(np.array([first["bbox3d"]]))
    assert (box.size_m[0] > CAR_M[0]).all()
    assert (box.size_m[0] < CAR_M[1]).all()
    data = read_dataset(REAL_STREET, "car")
    record = next(r for r in data.frames if r.image_id == image_id)
    frame = load_frame(record, with_stereo_for(RescoreConfig(), data, None).stereo)
    assert frame.seen_from is not None
    ground = frame.seen_from.ground
    foot = box.kitti_location_m(ground.up)[0] @ ground.up + ground.height_m
    assert foot == pytest.approx(0, abs=0.05)
    # the picture shows it where the box is: the middle of the 3D box lies in the 2D box
    left, top, width, height = first["bbox"]
    u, v = frame.seen_from.stereo.left.project(box.centre_cam_m)[0]
    assert left < u < left + width
    assert top < v < top + height
    # about 9 m away by the length of the car in the picture, which is 4.7 to 5.1 m long
    assert box.distance_m[0] == pytest.approx(11.0, abs=2.0)


def test_the_cars_face_as_they_do_in_the_pictures(rows: list[dict[str, Any]]) -> None:
    """The silver car drives to the right; the one under snow is parked with its nose towards the camera."""
    noses = [
        Boxes3D.of_values(np.array([of(rows, image_id)[0]["bbox3d"]])).nose_cam[0] for image_id in (SUN, SNOW)
    ]
    across, towards = np.array([1.0, 0, 0]), np.array([0, 0, -1.0])
    assert noses[0] @ across > np.cos(np.radians(25))
    assert noses[1] @ towards > np.cos(np.radians(25))


def test_the_commands_of_the_readme_leave_what_they_promise(real_street_run: Path) -> None:
    assert [words[0] for words in readme_commands("A real street in one minute")] == [
        "apply",
        "evaluate",
        "inspect",
        "log",
    ]
    for name in ("rescored.json", "report.html", "recording.rrd"):
        assert (real_street_run / name).stat().st_size > 10_000
