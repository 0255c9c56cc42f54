"""Sheets of the gallery: sizes, what they show, and the table."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from datasets_synth.photos.single_object import ViewBeside
from recon.errors import Failure, Reason
from reports.objects.mesh_files import MeshView, turned_about
from reports.objects.object_mesh import object_layers
from reports.objects.popup import close_camera
from reports.studies.reconstructions import (
    _caption,
    _cut,
    accuracy_table,
    around_sheet,
    beside_sheet,
    beside_table,
    likeness_beside,
    popup_sheet,
    steps_strip,
    write_popup,
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


def test_around_an_object_its_own_view_is_in_the_middle(exhibit: Exhibit) -> None:
    box = np.array([60.0, 40.0, 260.0, 160.0])
    sheet = around_sheet([(exhibit.photo, exhibit.found, box), (exhibit.photo, LOST, box)])
    assert sheet.shape == (2 * 180 + 6, 6 * 240 + 5 * 6, 3)
    photo, *made = (sheet[:180, i * 246 : i * 246 + 240].astype(int) for i in range(6))
    off = [float(np.abs(p - photo).mean()) for p in made]
    assert int(np.argmin(off)) == 2
    # a failure has its photograph alone
    assert (sheet[186:, 240:] == 255).all()
    assert (sheet[186:, :240] != 255).any()


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


def test_from_beside_counts_overlap_and_failures(exhibit: Exhibit) -> None:
    assert isinstance(exhibit.found, FoundObject)
    camera = exhibit.photo.seen_from.camera
    layers = object_layers(exhibit.photo.rgb, exhibit.found, camera)
    centre, up = exhibit.found.instance.centroid_m, exhibit.photo.seen_from.ground.up
    views = []
    for turn_rad in np.deg2rad([-20.0, 20.0]):
        turn = turned_about(centre, up, float(turn_rad))
        views.append(ViewBeside(float(turn_rad), turn, *MeshView(layers).picture(camera, turn)))
    own = replace(exhibit, beside=tuple(views))
    # the truth is what the pop-up shows
    assert [(v.overlap, v.similarity) for v in likeness_beside(own)[20]] == [(1.0, 1.0)] * 2
    assert _caption(own, likeness_beside(own)) == f"{own.title} (overlap 100% at 20°)"
    # half of it is missing in the truth
    half = [replace(v, mask=v.mask & (np.arange(v.mask.shape[1]) % 2 == 0)) for v in views]
    found = likeness_beside(replace(exhibit, beside=tuple(half)))[20]
    assert [v.overlap for v in found] == pytest.approx([0.5, 0.5], abs=0.02)
    assert max(v.similarity for v in found) < 0.9
    failed = Exhibit("car", "lost", 3, exhibit.photo, LOST)
    assert likeness_beside(failed) == {}
    assert _caption(failed, {}) == ""
    row = beside_table([(e, likeness_beside(e)) for e in (own, failed)]).splitlines()[2]
    assert [c.strip() for c in row.strip("|").split("|")] == ["car", "2 (1 failed)", "100.0%", "1.000"]
    sheet = beside_sheet(own)
    assert sheet is not None
    assert sheet.shape == (2 * 180 + 6, 3 * 240 + 2 * 6, 3)
    assert beside_sheet(failed) is None


def test_a_pop_up_is_kept_as_a_file_that_loads(exhibit: Exhibit, tmp_path: Path) -> None:
    write_popup(tmp_path / "car.glb", exhibit)
    write_popup(tmp_path / "lost.glb", Exhibit("car", "lost", 3, exhibit.photo, LOST))
    assert [f.name for f in tmp_path.iterdir()] == ["car.glb"]
    assert (tmp_path / "car.glb").stat().st_size < 2_000_000
    scene = trimesh.load(tmp_path / "car.glb")
    assert {"car_1_0", "ground", "backdrop"} <= set(scene.geometry)
    # it stands on the ground, metres before the camera
    low, high = scene.geometry["car_1_0"].bounds
    assert abs(low[1]) < 0.2
    assert 1.0 < high[1] < 2.0
    assert low[2] < -5
