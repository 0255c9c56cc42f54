"""Sheets of the gallery: sizes, what they show, and the table."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.errors import Failure, Reason
from reports.objects.popup import close_camera
from reports.studies.reconstructions import (
    _cut,
    accuracy_table,
    popup_sheet,
    similarity,
    steps_strip,
    write_small_png,
)
from rescore.library.single_picture import FoundObject, Photo, find_object
from rescore.studies.instance_accuracy import InstanceErrors
from rescore.studies.reconstructions import Exhibit
from tests.single_car import CarPicture, car_from, quick_car_model

LOST = Failure(Reason.NO_OUTLINE, "none")


@pytest.fixture(scope="module")
def exhibit() -> Exhibit:
    car: CarPicture = car_from(60, seed=3, width_px=320)
    photo = Photo(car.rgb, car.seen_from)
    found = find_object(photo, car.box_px, 2, quick_car_model())
    assert isinstance(found, FoundObject)
    return Exhibit("car", "a_car", 2, photo, found)


def test_a_strip_has_four_panels_that_start_with_the_photograph(exhibit: Exhibit) -> None:
    strip = steps_strip(exhibit)
    assert strip is not None
    assert strip.shape == (180, 4 * 240 + 3 * 6, 3)
    panels = [strip[:, i * 246 : i * 246 + 240].astype(int) for i in range(4)]
    # the outline changes few pixels of the photograph, the other side nearly all
    changed = [float((np.abs(p - panels[0]).max(axis=2) > 30).mean()) for p in panels]
    assert changed[1] < 0.15 < changed[3]
    assert (strip[:, 240:246] == 255).all()


def test_a_cut_picture_is_the_photograph_closer(exhibit: Exhibit) -> None:
    assert isinstance(exhibit.found, FoundObject)
    camera = close_camera(exhibit.photo, [exhibit.found], 240, 180)
    cut = _cut(exhibit.photo.rgb, exhibit.photo.seen_from.camera, camera)
    # a pixel of the photograph inside the cut keeps its colour
    uv = np.round(exhibit.found.picture.outline_px.mean(axis=0)).astype(int)
    at = np.round(camera.project(exhibit.photo.seen_from.camera.rays(uv[None].astype(float))))[0].astype(int)
    assert np.abs(cut[at[1], at[0]].astype(int) - exhibit.photo.rgb[uv[1], uv[0]]).max() < 40
    # all of the outline is in the cut
    seen = camera.project(exhibit.photo.seen_from.camera.rays(exhibit.found.picture.outline_px))
    assert (seen > 0).all()
    assert (seen < [240, 180]).all()


def test_sheets_leave_out_failures(exhibit: Exhibit, tmp_path: Path) -> None:
    failed = Exhibit("car", "lost", 3, exhibit.photo, LOST)
    sheet = popup_sheet([exhibit, failed])
    assert sheet is not None
    assert sheet.shape == (3 * 180 + 2 * 6, 240, 3)
    assert popup_sheet([failed]) is None
    assert steps_strip(failed) is None
    assert similarity(failed) is None
    likeness = similarity(exhibit)
    assert likeness is not None
    assert likeness > 0.9
    write_small_png(tmp_path / "sheet.png", sheet)
    assert (tmp_path / "sheet.png").stat().st_size < 150_000
    back = cv2.imread(str(tmp_path / "sheet.png"))
    assert np.abs(back[..., ::-1].astype(int) - sheet).mean() < 6


def test_table_counts_failures() -> None:
    good = InstanceErrors(0.1, np.array([0.1, -0.2, 0.3]), 4.0)
    better = InstanceErrors(0.2, np.array([-0.1, 0.0, 0.1]), 2.0)
    surface = InstanceErrors(0.4, None, 30.0)
    table = accuracy_table({"car": [(good, surface), (better, LOST), (LOST, LOST)], "chair": [(LOST, LOST)]})
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in table.splitlines()]
    # means: (10 + 20) / 2 %; |0.1|, |-0.1|; |-0.2|, 0; 0.3, 0.1; (4 + 2) / 2
    assert rows[2] == ["car", "3 (1 failed)", "15.0%", "10%", "10%", "20%", "3.0°", "40.0%", "30.0°"]
    assert rows[3] == ["chair", "1 (1 failed)", *["-"] * 7]
