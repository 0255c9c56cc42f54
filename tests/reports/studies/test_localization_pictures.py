from pathlib import Path

import cv2
import numpy as np

from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.localization.standing_box import StandingBox
from reports.studies.localization_pictures import (
    ESTIMATE_RGB,
    TILE_PX,
    TRUTH_RGB,
    Instance3DView,
    TableCamera,
    draw,
    save_reconstruction,
    sheet,
    tile,
)

CAMERA = TableCamera(
    GroundedCamera(
        PinholeCamera(600.0, 600.0, 159.5, 119.5, 320, 240), GroundPlane(0.8, float(np.deg2rad(35)))
    )
)
BOX = StandingBox(np.array([0.0, 1.15]), 0.4, np.array([0.25, 0.1, 0.08]))


def view(estimate: StandingBox | None) -> Instance3DView:
    roof = BOX.corners_m[4:][None]
    return Instance3DView(BOX, estimate, (4,), roof, "a car")


def test_boxes_are_drawn_where_their_corners_project() -> None:
    black = np.zeros((240, 320, 3), np.uint8)
    shown = draw(black, (0, 0), [view(None)], CAMERA, 1.0)
    for u, v in np.round(CAMERA(BOX.corners_m)).astype(int):
        near = shown[v - 2 : v + 3, u - 2 : u + 3].astype(int)
        assert (np.abs(near - TRUTH_RGB).sum(axis=2) < 120).any()
    # a crop from column 40 and row 30 on shows the same, moved
    crop = draw(black[30:, 40:], (40, 30), [view(None)], CAMERA, 1.0)
    assert np.array_equal(crop, shown[30:, 40:])


def test_parts_that_face_away_are_not_drawn() -> None:
    roof = BOX.corners_m[4:]
    assert CAMERA.faces(roof)
    assert not CAMERA.faces(roof[::-1])


def test_tiles_have_one_size_and_lost_cars_no_estimate() -> None:
    crop = np.full((90, 150, 3), 40, np.uint8)
    tiles = [tile(crop, (80, 60), view(e), CAMERA) for e in (BOX, None)]
    assert {t.shape for t in tiles} == {(TILE_PX[1], TILE_PX[0], 3)}
    orange = [bool((np.abs(t.astype(int) - ESTIMATE_RGB).sum(axis=2) < 60).any()) for t in tiles]
    assert orange == [True, False]
    assert sheet([*tiles, tiles[0]], 2).shape == (2 * TILE_PX[1], 2 * TILE_PX[0], 3)


def test_reconstruction_beside_its_picture(tmp_path: Path) -> None:
    path = tmp_path / "reconstruction.png"
    save_reconstruction(path, np.full((60, 90, 3), 99, np.uint8), view(BOX), "a car")
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape[1] > picture.shape[0] > 300
