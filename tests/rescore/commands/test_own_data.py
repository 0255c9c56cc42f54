"""Data sets as they come: every layout and calibration gives the same frames as our own."""

import os
import shutil
import subprocess
import sys
from dataclasses import astuple
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.camera import PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.stereo.depth_noise import MATCHER_NOISE_PX
from rescore.data.depth_files import MeasuredFile, Quantity, read_measured
from rescore.data.frames import DataSet, load_frame
from rescore.doctor import examine_dataset
from rescore.formats.calibration_files import read_calibration
from rescore.formats.coco_write import write_dataset
from rescore.formats.labels import ClassMap
from rescore.formats.open import read_dataset
from rescore.library.inputs import Camera, StereoFrame
from tests.rescore import own_data as own


def check_cameras(data: DataSet) -> None:
    """All frames have the camera of tests/rescore/own_data.py."""
    for frame in data.frames:
        assert frame.pair is not None
        c = frame.pair.left
        got = (c.fx_px, c.fy_px, c.cx_px, c.cy_px, frame.pair.baseline_m, c.width_px, c.height_px)
        assert got == pytest.approx((own.FX, own.FX, 48, 32, own.BASELINE_M, own.WIDTH, own.HEIGHT))


def median_disparity(data: DataSet) -> float:
    return float(np.nanmedian(load_frame(data.frames[0], own.STEREO).disparity_px))


@pytest.mark.parametrize("half", [".", "training"])
def test_kitti_as_it_comes(tmp_path: Path, half: str) -> None:
    own.kitti_folder(tmp_path / half)
    data = read_dataset(tmp_path)
    assert [f.image_id for f in data.frames] == [3, 7]
    assert all(f.ground is None and f.split == "test" for f in data.frames)
    check_cameras(data)
    truth = data.truth[3]
    assert truth.xyxy_px.tolist() == [[10, 20, 40.5, 44], [50, 20, 90, 44], [60, 5, 80, 20], [70, 1, 90, 9]]
    assert truth.ignore.tolist() == [False, False, True, True]  # cars, a van, DontCare
    np.testing.assert_array_equal(truth.visibility, [1, np.nan, 1, np.nan])
    np.testing.assert_allclose(truth.azimuth_deg, [np.degrees(1.65) - 90, np.nan, 270, np.nan])
    np.testing.assert_array_equal(truth.truncated, [0, 0.25, 0, np.nan])
    assert truth.occluded.tolist() == [0, 2, 0, 3]
    assert len(data.truth[7].annotation_id) == 0
    labels = tmp_path / half / "label_2"
    assert data.notes == (
        f"{labels}: ignore regions: 1 DontCare, 1 Van",
        f"{labels}: left out boxes of other classes: 1 Pedestrian",
    )
    assert median_disparity(data) == pytest.approx(own.SHIFT, abs=0.1)


def test_classes_are_mapped_by_name(tmp_path: Path) -> None:
    own.kitti_folder(tmp_path)
    data = read_dataset(tmp_path, "car", ClassMap.of("car", ["van=car", "Pedestrian=person"]))
    assert data.truth[3].ignore.tolist() == [False, False, False, True]
    assert any("took boxes of 1 Pedestrian as person, 1 Van as car" in n for n in data.notes)
    with pytest.raises(RescoreError, match=r"--map names class 'lorry', the labels have .*2 Car"):
        read_dataset(tmp_path, "car", ClassMap.of("car", ["lorry=car"]))


def test_the_real_frames_have_the_cameras_of_their_calib_files(kitti: Path, tmp_path: Path) -> None:
    for name in ("image_2", "image_3", "calib"):
        os.symlink(kitti / name, tmp_path / name)
    ours, official = read_dataset(kitti), read_dataset(tmp_path)
    cameras = {f.image_id: f.camera for f in ours.frames}
    assert {f.image_id: f.camera for f in official.frames} == cameras
    assert any("no labels, so no frame has a car" in n for n in official.notes)


@pytest.mark.parametrize(("left", "right"), [("left", "right"), ("image_0", "image_1")])
def test_folders_of_pairs(tmp_path: Path, left: str, right: str) -> None:
    data = read_dataset(own.pair_folder(tmp_path, left, right))
    assert [f.image_id for f in data.frames] == [1, 2]
    check_cameras(data)
    assert median_disparity(data) == pytest.approx(own.SHIFT, abs=0.1)


def test_pairs_are_found_by_names_with_sides(tmp_path: Path) -> None:
    for name in ("left_07", "left_08"):
        right = name.replace("left", "right")
        own.write_pair(tmp_path / "left" / f"{name}.png", tmp_path / "right" / f"{right}.png")
    own.write_png(tmp_path / "left" / "left_09.png", own.pair()[0])
    data = read_dataset(tmp_path)
    assert [f.right_path.stem for f in data.frames if f.right_path] == ["right_07", "right_08"]
    assert any("left out 1 of 3 left pictures without a partner" in n for n in data.notes)
    assert any("no calibration" in n for n in data.notes)
    assert data.frames[0].camera is None


Q = np.array([[1, 0, 0, -48], [0, 1, 0, -32], [0, 0, 0, own.FX], [0, 0, 1 / own.BASELINE_M, 0]], dtype=float)
T = np.array([-own.BASELINE_M, 0, 0])


@pytest.mark.parametrize(
    "values",
    [
        {"Q": Q},
        {"K1": own.K, "K2": own.K, "T": T},
        {"cameraMatrix": own.K, "baseline_m": own.BASELINE_M},
        {"P1": own.projection(0), "P2": own.projection(-own.FX * own.BASELINE_M), "Q": Q},
    ],
)
def test_calibrations_of_opencv(tmp_path: Path, values: dict[str, object]) -> None:
    own.pair_folder(tmp_path)
    own.write_text(tmp_path / "calib.yaml", own.opencv_yaml(values))
    check_cameras(read_dataset(tmp_path))


def ros_yaml(x: float, block: bool) -> str:
    numbers = [own.FX, 0, 48, x, 0, own.FX, 32, 0, 0, 0, 1, 0]
    data = "\n" + "\n".join(f"  - {v}" for v in numbers) if block else f" {numbers}"
    return (
        "image_width: 96\nimage_height: 64\ncamera_name: narrow_stereo/left\ncamera_matrix:\n  rows: 3\n"
        "  cols: 3\n  data: [90, 0, 50, 0, 90, 30, 0, 0, 1]\ndistortion_model: plumb_bob\n"
        f"projection_matrix:\n  rows: 3\n  cols: 4\n  data:{data}\n"
    )


@pytest.mark.parametrize("block", [False, True])
def test_calibrations_of_ros(tmp_path: Path, block: bool) -> None:
    own.pair_folder(tmp_path)
    (tmp_path / "calib.yaml").unlink()
    own.write_text(tmp_path / "left.yaml", ros_yaml(0, block))
    own.write_text(tmp_path / "right.yaml", ros_yaml(-own.FX * own.BASELINE_M, block))
    check_cameras(read_dataset(tmp_path))


def test_kitti_odometry_has_its_own_pair(tmp_path: Path) -> None:
    own.pair_folder(tmp_path, "image_0", "image_1")
    (tmp_path / "calib.yaml").unlink()
    own.write_text(tmp_path / "calib.txt", own.kitti_calib())
    check_cameras(read_dataset(tmp_path))


@pytest.mark.parametrize(("doffs", "shift"), [(0, 6), (3.25, 6), (-3.25, 12), (8, -4)])
def test_middlebury_and_its_disparity_offset(tmp_path: Path, doffs: float, shift: int) -> None:
    data = read_dataset(own.middlebury(tmp_path, doffs, shift))
    assert [f.left_path.parent.name for f in data.frames] == ["Adirondack", "Motorcycle"]
    check_cameras(data)
    # depth is fx baseline / (matched disparity + doffs), also where the matched disparity is negative
    frame = load_frame(data.frames[0], own.STEREO)
    assert frame.camera is not None
    expected = own.FX * own.BASELINE_M / (shift + doffs)
    measured = frame.camera.depth_m(frame.disparity_px)
    assert float(np.nanmedian(measured)) == pytest.approx(expected, rel=0.02)
    assert np.isfinite(measured).mean() > 0.5


def test_middlebury_with_a_measured_disparity(tmp_path: Path) -> None:
    own.middlebury(tmp_path, 2.5, 6)
    for folder in tmp_path.iterdir():
        (folder / "im1.png").unlink()
        truth = np.full((own.HEIGHT, own.WIDTH), 7.0)
        truth[:10] = np.inf
        own.write_pfm(folder / "disp0.pfm", truth)
    disparity = load_frame(read_dataset(tmp_path / "Motorcycle").frames[0], own.STEREO).disparity_px
    assert np.isnan(disparity[:10]).all()
    assert (disparity[10:] == 9.5).all()


@pytest.mark.parametrize(
    ("suffix", "factor"),
    [(".png", 256.0), (".png", 1000.0), (".png", 2000.0), (".npy", None), (".pfm", None)],
)
def test_measured_depth_in_place_of_a_right_picture(
    tmp_path: Path, suffix: str, factor: float | None
) -> None:
    data = read_dataset(own.depth_folder(tmp_path, suffix, factor))
    frame = load_frame(data.frames[0], own.STEREO)
    assert frame.camera is not None
    tolerance = 0.5 / factor + 1e-4 if factor else 1e-4
    np.testing.assert_allclose(frame.camera.depth_m(frame.disparity_px), own.DEPTH_M, atol=tolerance)


def test_depth_without_a_baseline_is_that_of_a_pair_as_fine(tmp_path: Path) -> None:
    """One baseline in folders, in their annotations and in the library, and the doctor says it."""
    depth = np.broadcast_to(np.linspace(20.0, 4.0, own.HEIGHT)[:, None], (own.HEIGHT, own.WIDTH))
    disparity = 40 / depth + np.random.default_rng(0).normal(0, MATCHER_NOISE_PX / 1.26, depth.shape)
    depth = (40 / disparity).astype(np.float32)
    np.save(own.depth_folder(tmp_path / "in", ".npy") / "depth" / "1.npy", depth)
    folder = read_dataset(tmp_path / "in")
    frame = load_frame(folder.frames[0], own.STEREO)
    assert frame.camera is not None
    assert frame.camera.baseline_m == pytest.approx(0.5, rel=0.1)
    write_dataset(tmp_path / "out", folder, copy=True)
    again = load_frame(read_dataset(tmp_path / "out").frames[0], own.STEREO)
    assert again.camera == frame.camera
    np.testing.assert_array_equal(again.disparity_px, frame.disparity_px)
    given = StereoFrame(frame.left_rgb, depth_m=depth, camera=Camera(80, 80, 48, 32))
    assert given.loaded(own.STEREO, 2.0).camera == StereoCamera(
        PinholeCamera(80, 80, 48, 32, own.WIDTH, own.HEIGHT), frame.camera.baseline_m
    )
    said = [str(f) for f in examine_dataset(tmp_path / "in", "car", 1)]
    assert any(f"as fine as that of a pair with {frame.camera.baseline_m:.2f} m" in line for line in said)


def test_a_pair_needs_its_baseline(tmp_path: Path) -> None:
    value = own.annotations()
    del value["images"][0]["camera"]["baseline_m"]
    with pytest.raises(RescoreError, match=r"image 1: expected baseline_m in the camera of a pair, got none"):
        read_dataset(own.own_folder(tmp_path, value))


def test_depth_pictures_need_their_unit(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match=r"expected to be told the value of one metre.*depth_factor: 5000"):
        read_dataset(own.depth_folder(tmp_path, ".png"))


def test_tum_pictures_are_paired_by_time(tmp_path: Path) -> None:
    for time, depth_time in ((1305031102.175304, 1305031102.160407), (1305031103.5, 1305031109.1)):
        own.write_png(tmp_path / "rgb" / f"{time:.6f}.png", own.pair()[0])
        own.write_png(tmp_path / "depth" / f"{depth_time:.6f}.png", (own.DEPTH_M * 2000).astype(np.uint16))
    for name in ("rgb.txt", "depth.txt"):
        own.write_text(tmp_path / name, "# timestamp filename\n")
    own.write_text(tmp_path / "calib.yaml", own.opencv_yaml({"cameraMatrix": own.K}))
    data = read_dataset(tmp_path)
    assert [f.left_path.stem for f in data.frames] == ["1305031102.175304"]
    assert data.frames[0].measured is not None
    assert data.frames[0].measured.factor == 5000
    assert any("left out 1 of 2" in n for n in data.notes)


def test_exr_where_opencv_reads_it(tmp_path: Path) -> None:
    """In a process of its own, since OpenCV looks at the variable once."""
    code = (
        "import sys, cv2, numpy as np; from pathlib import Path\n"
        "from rescore.data.depth_files import *\n"
        "p = Path(sys.argv[1]); cv2.imwrite(str(p), np.full((4, 6), 2.5, np.float32))\n"
        "print(read_measured(MeasuredFile(p, Quantity.DISPARITY), 6, 4)[0, 0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "d.exr")],
        env={**os.environ, "OPENCV_IO_ENABLE_OPENEXR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "2.5\n", done.stderr
    if "OPENCV_IO_ENABLE_OPENEXR" not in os.environ:
        with pytest.raises(RescoreError, match="set OPENCV_IO_ENABLE_OPENEXR=1 or write PFM"):
            read_measured(MeasuredFile(tmp_path / "d.exr", Quantity.DISPARITY), 6, 4)


def test_disparity_goes_before_the_right_picture(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    for name in ("a", "b"):
        own.write_png(
            tmp_path / "disparity" / f"{name}.png", np.full((own.HEIGHT, own.WIDTH), 640, np.uint16)
        )
    data = read_dataset(tmp_path)
    assert median_disparity(data) == 2.5
    assert any("taken in place of matching" in n for n in data.notes)


def test_splits_come_from_image_sets(tmp_path: Path) -> None:
    own.kitti_folder(tmp_path, ("000001", "000002", "000003"))
    own.write_text(tmp_path / "ImageSets" / "train.txt", "000001\n")
    own.write_text(tmp_path / "ImageSets" / "val.txt", "000003\n")
    data = read_dataset(tmp_path)
    assert {f.image_id: f.split for f in data.frames} == {1: "train", 3: "validation"}
    assert any("left out 1 frame of no split" in n for n in data.notes)
    own.write_text(tmp_path / "ImageSets" / "test.txt", "000003\n")
    with pytest.raises(
        RescoreError, match=r"'000003' is in split test and in|'000003' is in split validation"
    ):
        read_dataset(tmp_path)


@pytest.mark.parametrize("folder", ["ImageSets", "ImageSets/Main"])
def test_splits_of_voc(tmp_path: Path, folder: str) -> None:
    own.kitti_folder(tmp_path, ("000001", "000002", "000003"))
    own.write_text(tmp_path / folder / "train.txt", "000001  1\n")
    own.write_text(tmp_path / folder / "val.txt", "000002.png\n")
    own.write_text(tmp_path / folder / "trainval.txt", "000001\n000002\n")
    own.write_text(tmp_path / folder / "test.txt", "000003 -1\n")
    own.write_text(tmp_path / folder / "car_train.txt", "000001  1\n")
    frames = read_dataset(tmp_path).frames
    assert {f.image_id: f.split for f in frames} == {1: "train", 2: "validation", 3: "test"}


def test_a_split_of_both_is_for_training(tmp_path: Path) -> None:
    own.kitti_folder(tmp_path)
    own.write_text(tmp_path / "ImageSets" / "Main" / "trainval.txt", "000003\n")
    own.write_text(tmp_path / "ImageSets" / "Main" / "test.txt", "000007\n")
    assert [f.split for f in read_dataset(tmp_path).frames] == ["train", "test"]


def test_names_with_blanks_in_a_split(tmp_path: Path) -> None:
    for name in ("my  street 1", "my"):
        own.write_pair(tmp_path / "left" / f"{name}.png", tmp_path / "right" / f"{name}.png")
    own.write_text(tmp_path / "ImageSets" / "train.txt", "my  street 1\n")
    own.write_text(tmp_path / "ImageSets" / "val.txt", "my\n")
    splits = {f.left_path.stem: f.split for f in read_dataset(tmp_path).frames}
    assert splits == {"my": "validation", "my  street 1": "train"}


def test_an_unlikely_calibration_is_told(tmp_path: Path) -> None:
    own.kitti_folder(tmp_path)
    for path in (tmp_path / "calib").iterdir():
        own.write_text(path, own.kitti_calib(baseline_m=500))
    assert any(
        "2 of 2 frames: baseline of 500 m" in n and "write 0.5" in n for n in read_dataset(tmp_path).notes
    )


def test_a_folder_of_nothing_known_says_what_was_looked_for(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    with pytest.raises(RescoreError, match=r"looked for annotations.json; .*; image_2, .*found pictures"):
        read_dataset(tmp_path)
    shutil.rmtree(tmp_path / "pictures")
    with pytest.raises(RescoreError, match="found nothing"):
        read_dataset(tmp_path)


@pytest.mark.parametrize("flags", [0, cv2.CALIB_ZERO_DISPARITY])
def test_what_opencv_rectifies_is_read_alike_from_p_and_q(tmp_path: Path, flags: int) -> None:
    other = own.K + np.array([[0, 0, 7], [0, 0, 2], [0, 0, 0]])
    turn = cv2.Rodrigues(np.array([0.01, 0.02, -0.01]))[0]
    shift = np.array([-own.BASELINE_M, 0.01, 0.02])
    none = np.zeros(5)
    size = (own.WIDTH, own.HEIGHT)
    _, _, p1, p2, q, *_ = cv2.stereoRectify(own.K, none, other, none, size, turn, shift, flags=flags)
    calibrations = []
    for name, values in (("p", {"P1": p1, "P2": p2}), ("q", {"Q": q})):
        calibrations.append(
            read_calibration(own.write_text(tmp_path / f"{name}.yaml", own.opencv_yaml(values)))
        )
    from_p, from_q = (np.array(astuple(c)[:6], dtype=float) for c in calibrations)
    np.testing.assert_allclose(from_p, from_q, atol=1e-9)
    assert from_p[4] == pytest.approx(np.linalg.norm(shift))
    # the two principal points are one, or the disparity has an offset
    assert (abs(from_p[5]) < 1e-9) == (flags == cv2.CALIB_ZERO_DISPARITY)
