"""3D boxes and fitted cars of a recording of mode instance, read back."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from reports.recording.crop import Crop
from reports.recording.entities import OUTCOME_CLASSES, class_colour
from reports.recording.frame import DEPTH_UNIT
from reports.recording.log import write_recording
from reports.recording.story import Story, choose_frames
from reports.run.fitted_cars import shown_area
from reports.run.frame_view import FrameView, frame_views
from rescore.results.run_folder import Run
from tests.reports.instance_run import FRAMED_PX, NO_FIT, SEEN_PX, SIZE_M, TRUE_BOX
from tests.reports.recording_reader import read

STRIDE = 10
CROP = "/world/camera/hog_candidate"


@pytest.fixture(scope="module")
def recording(instance_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(instance_run.root, tmp_path_factory.mktemp("rrd") / "recording.rrd", show=False)


@pytest.fixture(scope="module")
def views(instance_run: Run) -> list[FrameView]:
    return list(frame_views(instance_run, "instance", choose_frames(Story.of(instance_run))))


def colours(row: dict[str, list[int]], of: str) -> list[tuple[int, ...]]:
    return [tuple(v.to_bytes(4, "big")[:3]) for v in row[f"{of}:colors"]]


def test_every_candidate_with_a_car_has_a_box_coloured_by_its_outcome(
    instance_run: Run, recording: Path, views: list[FrameView]
) -> None:
    story = Story.of(instance_run)
    parts = {name: read(recording, f"/world/hog/boxes3d/{name}/box") for name in ("accepted", "rejected")}
    noses = {name: read(recording, f"/world/hog/boxes3d/{name}/nose") for name in parts}
    checked = 0
    for frame, view in enumerate(views):
        accepted = story.accepted("hog", "instance")
        for name, rows in parts.items():
            some = [
                c
                for c in view.candidates["hog"]
                if c.rank != NO_FIT and accepted[c.row] == (name == "accepted")
            ]
            row = rows[frame]
            halves = np.array(row["Boxes3D:half_sizes"]).reshape(-1, 3)
            assert len(halves) == len(some)
            np.testing.assert_allclose(halves, np.tile(np.array(SIZE_M) / 2, (len(some), 1)), rtol=1e-6)
            assert len(noses[name][frame]["LineStrips3D:strips"]) == len(some)
            suffix = "" if name == "accepted" else ", below the threshold"
            expected = [
                class_colour(OUTCOME_CLASSES[OUTCOME_CLASSES.index(c.outcome + suffix)]) for c in some
            ]
            if some:
                assert colours(row, "Boxes3D") == expected
                np.testing.assert_allclose(row["rotation_y_rad"], [0.5 * c.rank for c in some])
            checked += len(some)
    assert checked == sum(c.rank != NO_FIT for view in views for c in view.candidates["hog"])


def test_true_boxes_are_drawn_where_the_data_set_has_them(recording: Path, views: list[FrameView]) -> None:
    cars = read(recording, "/world/hog/boxes3d/cars/box")
    for frame, view in enumerate(views):
        halves = np.array(cars[frame]["Boxes3D:half_sizes"]).reshape(-1, 3)
        known = view.truth.boxes3d is not None
        assert len(halves) == known
        if known:
            np.testing.assert_allclose(halves[0], np.array(TRUE_BOX[3:6]) / 2, rtol=1e-6)
            (colour,) = colours(cars[frame], "Boxes3D")
            assert colour in (class_colour("found"), class_colour("missed"))
    assert sum(view.truth.boxes3d is not None for view in views) == 1


def test_candidates_show_measured_depth_beside_both_cars(recording: Path, views: list[FrameView]) -> None:
    dashes = read(recording, f"{CROP}/car", "candidate rank")
    words = read(recording, "/why/hog/text", "candidate rank")
    solid = read(recording, "/world/hog/candidate/fit/seen/box", "candidate rank")
    for name, disparity in (("seen_depth", SEEN_PX), ("framed_depth", FRAMED_PX)):
        pictures = read(recording, f"{CROP}/{name}/depth", "candidate rank")
        for frame, view in enumerate(views):
            depth_m = view.seen_from.camera.fx_px * view.baseline / disparity
            for c in view.candidates["hog"]:
                time = frame * STRIDE + c.rank + 1
                (blob,) = pictures[time]["EncodedDepthImage:blob"]
                shown = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_UNCHANGED)
                (told,) = words[time]["TextDocument:text"]
                if c.rank == NO_FIT:
                    assert (shown == 0).all()
                    assert not dashes[time]["LineStrips2D:strips"]
                    assert "No car was placed here" in told
                    assert "Seen from" not in told
                    continue
                assert "Seen from its left front (75 %), else from its rear." in told
                np.testing.assert_allclose(shown[shown > 0] / DEPTH_UNIT, depth_m, atol=0.6 / DEPTH_UNIT)
                assert c.fit is not None
                silhouette = (c.fit.seen if disparity == SEEN_PX else c.fit.framed).silhouette_px
                h, w = view.measured.shape
                x0, y0, x1, y1 = np.clip(silhouette, 0, [w, h, w, h])
                area = (x1 - x0) * (y1 - y0) * Crop.around(shown_area(c)).zoom ** 2
                assert (shown > 0).sum() == pytest.approx(area, rel=0.2)
                assert len(dashes[time]["LineStrips2D:strips"]) > 8
                assert len(solid[time]["Boxes3D:half_sizes"]) == 1
                assert "No car was placed here" not in told
    (guide,) = read(recording, "/guide")[-1]["TextDocument:text"]
    assert "White dashes" in guide
