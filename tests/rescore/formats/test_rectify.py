"""Rectification on request: pictures as two cameras took them become pairs with the right depth."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.arrays import FloatArray, UInt8Array
from recon.errors import RescoreError
from recon.stereo.sgbm import SgbmConfig
from rescore.cli import main
from rescore.data.frames import DataSet, load_frame
from rescore.data.pictures import read_rgb
from rescore.doctor.pairs import examine_pairs
from rescore.formats.calibrations.rectify import rectified_dataset
from rescore.formats.labels import ClassMap
from rescore.formats.open import read_dataset
from tests.rescore import own_data as own
from tests.rescore.formats.test_tools import BENT as TOOLS_BENT
from tests.rescore.formats.test_tools import MOVE as TOOLS_MOVE
from tests.rescore.formats.test_tools import euroc

SIZE = (320, 240)
K1 = np.array([[260.0, 0, 158], [0, 261, 121], [0, 0, 1]])
K2 = np.array([[264.0, 0, 163], [0, 263, 117], [0, 0, 1]])
TURN = cv2.Rodrigues(np.array([0.02, -0.03, 0.015]))[0]
MOVE = np.array([-0.12, 0.004, -0.003])
BENT = np.array([-0.25, 0.08, 0.001, -0.0015])
PLANE_M = 2.616
"""Depth of a wall across the left camera's axis: 12 px of disparity, as matchers prefer whole pixels."""
CAR = (80.0, 60.0, 200.0, 160.0)


def seen(k: FloatArray, turn: FloatArray, move: FloatArray, fisheye: bool) -> UInt8Array:
    """The wall with noise on it, as a camera with a bent lens sees it, which takes x to turn x + move."""
    columns, rows = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2)
    undo = cv2.fisheye.undistortPoints if fisheye else cv2.undistortPoints
    rays = np.column_stack([undo(pixels, k, BENT)[:, 0], np.ones(len(pixels))]) @ turn
    centre = -turn.T @ move
    points = centre + rays * ((PLANE_M - centre[2]) / rays[:, 2])[:, None]
    noise = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (900, 900), np.uint8), (0, 0), 1.2)
    at = (points[:, :2] * 110 + 450).astype(np.float32).reshape(*SIZE[::-1], 2)
    return np.asarray(cv2.remap(noise, at[..., 0], at[..., 1], cv2.INTER_LINEAR), np.uint8)


def taken(root: Path, fisheye: bool = False) -> Path:
    """A folder of one pair as the cameras took it, with a box in COCO's place of YOLO's."""
    own.write_png(root / "left" / "a.png", seen(K1, np.eye(3), np.zeros(3), fisheye))
    own.write_png(root / "right" / "a.png", seen(K2, TURN, MOVE, fisheye))
    x0, y0, x1, y1 = CAR
    shares = ((x0 + x1) / 2 / SIZE[0], (y0 + y1) / 2 / SIZE[1], (x1 - x0) / SIZE[0], (y1 - y0) / SIZE[1])
    own.write_text(root / "labels" / "a.txt", f"0 {' '.join(map(str, shares))}\n")
    own.write_text(root / "data.yaml", "names: [car]\n")
    blocks = "".join(
        f"cam{i}:\n  camera_model: pinhole\n  resolution: [{SIZE[0]}, {SIZE[1]}]\n"
        f"  intrinsics: {k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()}\n  distortion_coeffs: {BENT.tolist()}\n"
        f"  distortion_model: {'equidistant' if fisheye else 'radtan'}\n"
        for i, k in enumerate((K1, K2))
    )
    move = np.vstack([np.column_stack([TURN, MOVE]), [0, 0, 0, 1]])
    own.write_text(root / "camchain.yaml", f"{blocks}  T_cn_cnm1: {move.tolist()}\n")
    return root


def stated_wall_m(data: DataSet, turn: FloatArray) -> FloatArray:
    """Depth of the wall at each pixel of the rectified left camera, which takes x to turn x."""
    camera = data.frames[0].camera
    assert camera is not None
    columns, rows = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    rays = camera.left.rays(np.stack([columns, rows], axis=-1))
    return np.asarray(PLANE_M / (rays @ turn[:, 2]))


@pytest.mark.parametrize(("fisheye", "most_px"), [(False, 0.03), (True, 0.35)])
def test_rectified_pairs_have_the_depth_of_the_scene(tmp_path: Path, fisheye: bool, most_px: float) -> None:
    data = rectified_dataset(taken(tmp_path / "src", fisheye), ClassMap("car"), tmp_path / "out")
    frame = load_frame(data.frames[0], SgbmConfig(num_disparities=32))
    assert frame.camera is not None
    assert frame.camera.baseline_m == pytest.approx(np.linalg.norm(MOVE))
    if fisheye:
        found = cv2.fisheye.stereoRectify(
            K1, BENT, K2, BENT, SIZE, TURN, MOVE, cv2.fisheye.CALIB_ZERO_DISPARITY
        )
    else:
        found = cv2.stereoRectify(
            K1, BENT, K2, BENT, SIZE, TURN, MOVE, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
        )
    wall = stated_wall_m(data, np.asarray(found[0], float))
    off_px = frame.disparity_px - frame.camera.focal_baseline / wall
    assert np.isfinite(off_px).mean() > 0.7
    assert abs(float(np.nanmedian(off_px))) < most_px
    assert float(np.nanpercentile(np.abs(off_px), 90)) < 0.1 + most_px


def test_boxes_lie_around_the_same_things(tmp_path: Path) -> None:
    data = rectified_dataset(taken(tmp_path / "src"), ClassMap("car"), tmp_path / "out")
    (box,) = data.truth[1].xyxy_px
    # where the picture shows a square of white the box is around it
    marked = np.zeros((*SIZE[::-1], 3), np.uint8)
    x0, y0, x1, y1 = map(int, CAR)
    marked[y0:y1, x0:x1] = 255
    again = taken(tmp_path / "marked")
    own.write_png(again / "left" / "a.png", marked)
    shown = rectified_dataset(again, ClassMap("car"), tmp_path / "shown").frames[0]
    rows, columns = np.nonzero(read_rgb(shown.left_path, *SIZE)[..., 0] > 127)
    white = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    np.testing.assert_allclose(box, white, atol=1.0)
    assert np.abs(box - CAR).max() > 5


def test_a_box_that_leaves_the_picture_is_counted(tmp_path: Path) -> None:
    source = taken(tmp_path / "src")
    own.write_text(source / "labels" / "a.txt", "0 0.004 0.004 0.008 0.008\n0 0.5 0.5 0.25 0.25\n")
    data = rectified_dataset(source, ClassMap("car"), tmp_path / "out")
    assert data.truth[1].annotation_id.tolist() == [2]
    assert f"{source}: left out 1 box that rectification moves out of the picture" in data.notes


def test_what_the_file_states_is_used(tmp_path: Path) -> None:
    source = taken(tmp_path / "src")
    r1, r2, p1, p2, *_ = cv2.stereoRectify(K1, BENT, K2, BENT, SIZE, TURN, MOVE, flags=0, alpha=0.5)
    values = {"K1": K1, "D1": BENT, "K2": K2, "D2": BENT, "R1": r1, "P1": p1, "R2": r2, "P2": p2}
    (source / "camchain.yaml").unlink()
    own.write_text(source / "calib.yaml", own.opencv_yaml(values))
    frame = rectified_dataset(source, ClassMap("car"), tmp_path / "out").frames[0]
    assert frame.camera is not None
    assert frame.camera.left.fx_px == p1[0, 0]
    assert frame.disparity_offset_px == pytest.approx(p2[0, 2] - p1[0, 2])


def test_euroc_as_it_comes(tmp_path: Path) -> None:
    data = rectified_dataset(euroc(tmp_path / "src", TOOLS_BENT), ClassMap("car"), tmp_path / "out")
    assert [f.left_path.name for f in data.frames] == ["1403636579763555584.png", "1403636579813555456.png"]
    assert all(
        f.camera and f.camera.baseline_m == pytest.approx(np.linalg.norm(TOOLS_MOVE)) for f in data.frames
    )


def test_import_rectifies_and_the_doctor_agrees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*arguments: object) -> int:
        monkeypatch.setattr(sys, "argv", ["rescore", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0)

    source, out = taken(tmp_path / "src"), tmp_path / "out"
    assert run("import", source, "--out", tmp_path / "no") == 1
    assert "camchain.yaml: expected the cameras of rectified pictures" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()
    assert run("import", source, "--rectify", "--out", out) == 0
    value = json.loads((out / "annotations.json").read_text())
    assert value["images"][0]["file_name"] == "left/a.png"
    data = read_dataset(out)
    assert len(data.truth[1].annotation_id) == 1
    rows = next(f for f in examine_pairs(data, data.frames) if f.what.startswith("rows of"))
    assert rows.level == "ok"
    assert run("import", source, "--rectify", "--out", out) == 1
    assert "annotations.json: expected no data set here yet" in capsys.readouterr().err
    (out / "annotations.json").unlink()
    assert run("import", source, "--rectify", "--out", out) == 1
    assert "left: expected no pictures here yet" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("move", "problem"),
    [
        ([0.12, 0, 0], "expected the right camera to the right of the left one, got it on the left"),
        ([0, 0.12, 0], "expected the right camera to the right of the left one, got it above or below"),
    ],
)
def test_cameras_that_do_not_stand_side_by_side_are_refused(
    tmp_path: Path, move: list[float], problem: str
) -> None:
    source = taken(tmp_path / "src")
    text = (source / "camchain.yaml").read_text()
    turned = np.vstack([np.column_stack([np.eye(3), move]), [0, 0, 0, 1]])
    own.write_text(
        source / "camchain.yaml", f"{text[: text.index('  T_cn')]}  T_cn_cnm1: {turned.tolist()}\n"
    )
    with pytest.raises(RescoreError, match=f"camchain.yaml: {problem}"):
        rectified_dataset(source, ClassMap("car"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_damaged_picture_leaves_nothing(tmp_path: Path) -> None:
    source = taken(tmp_path / "src")
    own.write_png(source / "left" / "b.png", seen(K1, np.eye(3), np.zeros(3), False))
    data = (source / "left" / "b.png").read_bytes()
    (source / "right" / "b.png").write_bytes(data[: len(data) // 2])
    with pytest.raises(RescoreError, match=r"right/b.png: expected a picture that OpenCV reads"):
        rectified_dataset(source, ClassMap("car"), tmp_path / "out")
    assert [p for p in (tmp_path / "out").rglob("*") if p.is_file()] == []
    assert not (tmp_path / "out" / "left").exists()


def test_a_calibration_of_another_size_is_refused(tmp_path: Path) -> None:
    source = taken(tmp_path / "src")
    text = (source / "camchain.yaml").read_text().replace("[320, 240]", "[640, 480]")
    own.write_text(source / "camchain.yaml", text)
    with pytest.raises(
        RescoreError, match="calibration of pictures of 320 x 240 pixels, got that of 640 x 480"
    ):
        rectified_dataset(source, ClassMap("car"), tmp_path / "out")


def test_annotations_are_not_passed_over(tmp_path: Path) -> None:
    own.own_folder(taken(tmp_path / "src"))
    with pytest.raises(RescoreError, match="expected folders of left and right pictures alone to rectify"):
        rectified_dataset(tmp_path / "src", ClassMap("car"), tmp_path / "out")


def test_what_cannot_be_rectified_is_told(tmp_path: Path) -> None:
    with pytest.raises(
        RescoreError, match=r"calib.yaml: expected two cameras as they stand .K1, D1, K2, D2, R, T."
    ):
        rectified_dataset(own.pair_folder(tmp_path / "a"), ClassMap("car"), tmp_path / "out")
    with pytest.raises(RescoreError, match="expected folders of left and right pictures alone to rectify"):
        rectified_dataset(own.depth_folder(tmp_path / "b", ".npy"), ClassMap("car"), tmp_path / "out")
    own.write_png(taken(tmp_path / "c") / "left" / "b.png", own.pair()[0])
    own.write_png(tmp_path / "c" / "right" / "b.png", own.pair()[1])
    with pytest.raises(
        RescoreError, match="expected pictures of one size, that of their calibration, got 2 sizes"
    ):
        rectified_dataset(tmp_path / "c", ClassMap("car"), tmp_path / "out")
