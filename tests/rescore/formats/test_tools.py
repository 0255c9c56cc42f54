"""Calibration files of many tools: each gives the camera that it says, or one line that says why not."""

import json
from dataclasses import astuple
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.arrays import FloatArray
from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.formats.calibration_files import read_calibration
from rescore.formats.calibrations.raw_pair import RawPair
from rescore.formats.calibrations.values import calibration_values
from rescore.formats.open import read_dataset
from tests.rescore import own_data as own

P1, P2 = own.projection(0), own.projection(-own.FX * own.BASELINE_M)
EXPECTED = (own.FX, own.FX, 48.0, 32.0, own.BASELINE_M)
TURN = cv2.Rodrigues(np.array([0.01, -0.02, 0.005]))[0]
MOVE = np.array([-0.12, 0.001, -0.002])
BENT = np.array([-0.3, 0.1, 0.001, -0.002])
K2 = own.K + np.array([[1.0, 0, 2], [0, 1, -1], [0, 0, 0]])


def opencv_xml(values: dict[str, FloatArray]) -> str:
    file = cv2.FileStorage(".xml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in values.items():
        file.write(name, value)
    return str(file.releaseAndGetString())


def opencv_json(values: dict[str, FloatArray]) -> str:
    file = cv2.FileStorage(".json", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in values.items():
        file.write(name, value)
    return str(file.releaseAndGetString())


def info(p: FloatArray, small: bool = False, d: str = "[]") -> str:
    """A camera_info as ROS prints it."""
    text = (
        "header:\n  frame_id: left\nheight: 64\nwidth: 96\ndistortion_model: plumb_bob\n"
        f"D: {d}\nK: {own.K.ravel().tolist()}\nR: {np.eye(3).ravel().tolist()}\n"
        f"P: {p.ravel().tolist()}\n---\n"
    )
    if not small:
        return text
    for name in "DKRP":
        text = text.replace(f"\n{name}: [", f"\n{name.lower()}: [")
    return text


DRIVING = (
    "calib_time: 09-Jan-2018\nS_101: 96 64\nK_101: 1 0 0 0 1 0 0 0 1\nD_101: 0.1 0 0 0 0\n"
    "R_101: 1 0 0 0 1 0 0 0 1\nT_101: 0 0 0\nS_rect_101: 96 64\nR_rect_101: 1 0 0 0 1 0 0 0 1\n"
    f"P_rect_101: {' '.join(map(str, P1.ravel()))}\n"
    f"R_103: 1 0 0 0 1 0 0 0 1\nT_103: {-own.BASELINE_M} 0 0\nS_rect_103: 96 64\n"
)
FLAT = {"fx": own.FX, "fy": own.FX, "cx": 48, "cy": 32, "baseline_m": own.BASELINE_M}
ORB_CAMERA = f"Camera.fx: {own.FX}\nCamera.fy: {own.FX}\nCamera.cx: 48\nCamera.cy: 32\n"
ORB = f"%YAML:1.0\nCamera.type: PinHole\n{ORB_CAMERA}"
ORB_3 = ORB_CAMERA.replace("Camera", "Camera1") + ORB_CAMERA.replace("Camera", "Camera2")
FILES: dict[str, dict[str, str]] = {
    "OpenCV's XML": {"calib.xml": opencv_xml({"P1": P1, "P2": P2})},
    "OpenCV's JSON": {"calib.json": opencv_json({"P1": P1, "P2": P2})},
    "OpenCV's YAML in capitals": {"calib.YML": own.opencv_yaml({"P1": P1, "P2": P2})},
    "JSON by hand": {"calibration.json": json.dumps({"P1": P1.tolist(), "P2": P2.ravel().tolist()})},
    "JSON of numbers": {"camera.json": json.dumps(FLAT)},
    "YAML of numbers": {"calib.yaml": "".join(f"{k}: {v}\n" for k, v in FLAT.items())},
    "OpenCV's two files": {
        "intrinsics.yml": own.opencv_yaml({"M1": own.K, "D1": np.zeros(5), "M2": own.K, "D2": np.zeros(5)}),
        "extrinsics.yml": own.opencv_yaml({"R": np.eye(3), "T": MOVE, "P1": P1, "P2": P2}),
    },
    "ROS messages": {"left.yaml": info(P1), "right.yaml": info(P2)},
    "ROS 2 messages": {"left_camera_info.txt": info(P1, True), "right_camera_info.txt": info(P2, True)},
    "DrivingStereo": {"calib.txt": f"{DRIVING}P_rect_103: {' '.join(map(str, P2.ravel()))}\n"},
    # pictures of half the size come with the last column of the full size
    "DrivingStereo in half": {
        "calib.txt": f"{DRIVING}P_rect_103: {' '.join(map(str, (P2 * [[1, 1, 1, 2]]).ravel()))}\n"
    },
    "ORB-SLAM 2": {"stereo.yaml": f"{ORB}Camera.k1: 0.0\nCamera.bf: {own.FX * own.BASELINE_M}\n"},
    "ORB-SLAM 2 of two": {
        "EuRoC.yaml": own.opencv_yaml({"P1": P1, "P2": P2}).replace("P1", "LEFT.P").replace("P2", "RIGHT.P")
    },
    "ORB-SLAM 3": {"stereo.yaml": f"%YAML:1.0\nCamera.type: PinHole\n{ORB_3}"
                   + "Stereo.T_c1_c2: !!opencv-matrix\n  rows: 4\n  cols: 4\n  dt: f\n"
                   f"  data: [1,0,0,{own.BASELINE_M}, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n"},
}  # fmt: skip


def with_files(root: Path, files: dict[str, str]) -> Path:
    own.pair_folder(root)
    (root / "calib.yaml").unlink()
    for name, text in files.items():
        own.write_text(root / name, text)
    return root


def camera_of(data: DataSet) -> tuple[float, ...]:
    camera = data.frames[0].camera
    assert camera is not None
    pair = data.frames[0].pair
    return (*astuple(camera.left)[:4], *([] if pair is None else [pair.baseline_m]))


@pytest.mark.parametrize("form", FILES)
def test_forms_that_are_read(tmp_path: Path, form: str) -> None:
    data = read_dataset(with_files(tmp_path, FILES[form]))
    assert camera_of(data) == pytest.approx(EXPECTED)
    assert not any("calib" in n for n in data.notes)


def sensor(k: FloatArray, place: FloatArray, bent: FloatArray) -> str:
    return (
        "%YAML:1.0\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
        f"  data: {place.ravel().tolist()}\nrate_hz: 20\nresolution: [96, 64]\ncamera_model: pinhole\n"
        f"intrinsics: {k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()}\ndistortion_model: radial-tangential\n"
        f"distortion_coefficients: {bent.tolist()}\n"
    )


def placed(turn: FloatArray, move: FloatArray) -> FloatArray:
    """The 4 x 4 matrix of x to turn x + move."""
    return np.vstack([np.column_stack([turn, move]), [0, 0, 0, 1]])


BODY = placed(cv2.Rodrigues(np.array([0.3, 1.2, -0.4]))[0], np.array([0.1, 0.2, 0.3]))
RIGHT_OF_LEFT = placed(TURN, MOVE)


def euroc(root: Path, bent: FloatArray) -> Path:
    for i, (k, place) in enumerate(((own.K, BODY), (K2, BODY @ np.linalg.inv(RIGHT_OF_LEFT)))):
        for name in ("1403636579763555584", "1403636579813555456"):
            own.write_png(root / "mav0" / f"cam{i}" / "data" / f"{name}.png", own.pair()[i])
        own.write_text(root / "mav0" / f"cam{i}" / "sensor.yaml", sensor(k, place, bent))
    return root


def camchain(bent: FloatArray, model: str = "radtan") -> str:
    blocks = ""
    for i, k in enumerate((own.K, K2)):
        blocks += (
            f"cam{i}:\n  camera_model: pinhole\n  intrinsics: {k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()}\n"
            f"  distortion_model: {model}\n  distortion_coeffs: {bent.tolist()}\n  resolution: [96, 64]\n"
            f"  rostopic: /cam{i}/image_raw\n" + (f"  T_cn_cnm1: {RIGHT_OF_LEFT.tolist()}\n" if i else "")
        )
    return blocks


def zed(turn: FloatArray) -> str:
    rx, cv, rz = turn
    cameras = "".join(
        f"[{side}_CAM_{size}]\nfx={k[0, 0] * s}\nfy={k[1, 1] * s}\ncx={k[0, 2] * s}\ncy={k[1, 2] * s}\n"
        "k1=-0.3\nk2=0.1\np1=0.001\np2=-0.002\nk3=0\n\n"
        for size, s in (("HD", 1), ("VGA", 0.5))
        for side, k in (("LEFT", own.K), ("RIGHT", K2))
    )
    stereo = f"[STEREO]\nBaseline=120\nTY=-1\nTZ=2\nCV_HD={cv}\nRX_HD={rx}\nRZ_HD={rz}\n"
    return f"{cameras}{stereo}[MISC]\nSensor_ID=0\n"


OPENCV = {"K1": own.K, "D1": BENT, "K2": K2, "D2": BENT, "R": TURN, "T": MOVE}


def raw_of(path: Path, right: Path | None = None, size_px: tuple[int, int] | None = None) -> RawPair:
    pair = RawPair.of(path, calibration_values(path, right, size_px))
    assert pair is not None
    return pair


@pytest.mark.parametrize("tool", ["OpenCV", "kalibr", "EuRoC", "ZED"])
def test_cameras_as_they_stand(tmp_path: Path, tool: str) -> None:
    if tool == "OpenCV":
        pair = raw_of(own.write_text(tmp_path / "calib.yaml", own.opencv_yaml(OPENCV)))
    elif tool == "kalibr":
        pair = raw_of(own.write_text(tmp_path / "camchain.yaml", camchain(BENT)))
    elif tool == "EuRoC":
        root = euroc(tmp_path, BENT) / "mav0"
        pair = raw_of(root / "cam0" / "sensor.yaml", root / "cam1" / "sensor.yaml")
    else:
        text = zed(cv2.Rodrigues(TURN)[0].ravel())
        pair = raw_of(own.write_text(tmp_path / "SN123.conf", text), None, (1280, 720))
    for camera, k in ((pair.left, own.K), (pair.right, K2)):
        np.testing.assert_allclose(camera.matrix, k, atol=1e-9)
        np.testing.assert_allclose(camera.distortion[:4], BENT)
        assert not camera.fisheye
    assert pair.move is not None
    np.testing.assert_allclose(pair.move[0], TURN, atol=1e-9)
    np.testing.assert_allclose(pair.move[1], MOVE, atol=1e-9)
    assert pair.doubt == "lens distortion (D1 up to 0.3, D2 up to 0.3)"


def test_ros_states_the_rectified_cameras(tmp_path: Path) -> None:
    bent = str([0.1, 0.0, 0.0, 0.0, 0.0])
    left, right = (
        own.write_text(tmp_path / f"{n}.yaml", info(p, d=bent)) for n, p in (("left", P1), ("right", P2))
    )
    pair = raw_of(left, right)
    assert pair.stated is not None
    np.testing.assert_array_equal(pair.stated[3], P2)
    assert pair.doubt == "lens distortion (D1 up to 0.1, D2 up to 0.1)"


def test_a_place_on_the_body_that_is_none(tmp_path: Path) -> None:
    root = euroc(tmp_path, BENT) / "mav0"
    own.write_text(root / "cam1" / "sensor.yaml", sensor(K2, np.zeros((4, 4)), BENT))
    with pytest.raises(
        RescoreError, match=r"cam1/sensor.yaml: T_BS: expected a rotation, got another matrix"
    ):
        read_dataset(tmp_path)


def test_fisheye_cameras(tmp_path: Path) -> None:
    pair = raw_of(own.write_text(tmp_path / "camchain.yaml", camchain(BENT, "equidistant")))
    assert pair.left.fisheye
    assert pair.right.fisheye


@pytest.mark.parametrize("form", ["OpenCV", "EuRoC"])
def test_pictures_that_are_not_rectified_are_told(tmp_path: Path, form: str) -> None:
    if form == "OpenCV":
        with_files(tmp_path, {"calib.yaml": own.opencv_yaml(OPENCV)})
    else:
        euroc(tmp_path, BENT)
    with pytest.raises(
        RescoreError,
        match=r"(calib|sensor).yaml: expected the cameras of rectified pictures, got lens distortion "
        r"\(D1 up to 0.3, D2 up to 0.3\); rectify by `rescore import FOLDER --rectify --out NEW`, or",
    ) as refused:
        read_dataset(tmp_path)
    assert "\n" not in str(refused.value)


def test_a_rotation_alone_is_told_too(tmp_path: Path) -> None:
    values = {"K1": own.K, "K2": own.K, "R": TURN, "T": MOVE}
    with_files(tmp_path, {"calib.yaml": own.opencv_yaml(values)})
    with pytest.raises(RescoreError, match=r"got rows that are about 1.6 px apart; rectify by"):
        read_dataset(tmp_path)


def test_projections_beside_distortion_are_taken_with_a_note(tmp_path: Path) -> None:
    with_files(tmp_path, {"calib.yaml": own.opencv_yaml(OPENCV | {"P1": P1, "P2": P2})})
    data = read_dataset(tmp_path)
    assert camera_of(data) == pytest.approx(EXPECTED)
    assert any("its pair is of rectified pictures, and it has lens distortion" in n for n in data.notes)


def test_the_distortion_of_one_camera_is_told(tmp_path: Path) -> None:
    values = {"cameraMatrix": own.K, "distCoeffs": BENT, "baseline_m": own.BASELINE_M}
    data = read_dataset(with_files(tmp_path, {"calib.yaml": own.opencv_yaml(values)}))
    assert (
        f"{tmp_path / 'calib.yaml'}: lens distortion (up to 0.3) is not undone; give undistorted pictures"
        in data.notes
    )


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("SN1.conf", zed(np.zeros(3)), "SN1.conf: expected pictures of 1280 x 720, 672 x 376 .*, got 96"),
        ("SN1.conf", "fx=3\n", "expected sections of name=value, could not read it .MissingSection"),
        ("calib.xml", "<opencv_storage><P1>", "expected OpenCV's XML, could not read it .ParseError"),
        ("calib.xml", f"<opencv_storage>{'<a>' * 5000}{'</a>' * 5000}</opencv_storage>", "XML, .*Recursion"),
        ("calib.json", "[" * 100_000, "expected a calibration as JSON, could not read it .Recursion"),
        ("calib.yaml", own.opencv_yaml(OPENCV | {"R": np.ones((3, 3))}), "yaml: R: expected a rotation"),
        ("calib.xml", "<calibration/>", "calib.xml: expected OpenCV's XML .*, got 'calibration'"),
        ("calib.json", "[1, 2]", "calib.json: expected a calibration as a JSON object"),
        ("calib.json", '{"P1": ', "expected a calibration as JSON, could not read it .JSONDecode"),
        ("calib.json", '{"P1": true, "P2": 3}', "calib.json: P1: expected numbers, got 'True'"),
        ("camchain.yaml", camchain(BENT, "fov"), "cam0: .* got the camera model 'pinhole' with 'fov'"),
        ("calib.yaml", own.opencv_yaml(OPENCV | {"D2": np.ones(3)}), "D2: expected 4 or 5 .*, got 3"),
        ("calib.yaml", own.opencv_yaml({"P1": P1, "P2": P1}),
         r"expected the right camera beside .* P1 and P2 with one last column \(0\); calibrate them as"),
        ("calib.yaml", own.opencv_yaml({"P1": P1, "P2": 0 * P1}), "got P2 of zeros alone; calibrate both"),
    ],
)  # fmt: skip
def test_what_is_refused_in_one_line(tmp_path: Path, name: str, text: str, problem: str) -> None:
    with pytest.raises(RescoreError, match=problem) as refused:
        read_dataset(with_files(tmp_path, {name: text}))
    assert "\n" not in str(refused.value)


def test_empty_projections_of_ros_get_their_own_line(tmp_path: Path) -> None:
    with_files(tmp_path, {"left.yaml": info(0 * P1), "right.yaml": info(0 * P1)})
    with pytest.raises(
        RescoreError, match=r"left.yaml: .* got P1 of zeros alone; calibrate both cameras as a pair"
    ):
        read_dataset(tmp_path)


def test_a_single_camera_of_ros_without_a_projection(tmp_path: Path) -> None:
    own.depth_folder(tmp_path, ".npy")
    (tmp_path / "calib.yaml").unlink()
    own.write_text(tmp_path / "camera_info.yaml", info(0 * P1))
    assert camera_of(read_dataset(tmp_path)) == EXPECTED[:4]
    own.write_text(tmp_path / "camera_info.yaml", info(0 * P1).replace("80.0", "0").replace("48.0", "0"))
    with pytest.raises(RescoreError, match="expected positive focal lengths, got 0 and 0"):
        read_dataset(tmp_path)
    zeros = str([0.0] * 9)
    own.write_text(tmp_path / "camera_info.yaml", info(0 * P1).replace(str(own.K.ravel().tolist()), zeros))
    with pytest.raises(
        RescoreError, match="expected a calibrated camera, got P of zeros alone; calibrate it"
    ):
        read_dataset(tmp_path)


def test_sizes_of_older_opencv(tmp_path: Path) -> None:
    text = own.opencv_yaml({"P1": P1, "P2": P2}) + "image_Width: 640\nimage_Height: 480\n"
    with pytest.raises(
        RescoreError, match="expected the calibration of pictures of 96 x 64 pixels, got that of 640 x"
    ):
        read_dataset(with_files(tmp_path, {"calib.yaml": text}))


def test_two_calibrations_of_different_forms_are_refused(tmp_path: Path) -> None:
    with_files(tmp_path, {"calib.txt": own.kitti_calib(), "calib.json": json.dumps(FLAT)})
    with pytest.raises(RescoreError, match=r"expected one calibration.*found calib.json, calib.txt"):
        read_dataset(tmp_path)


@pytest.mark.parametrize("name", ["calib.npz", "calibration.mat", "camera_info.ini", "stereoParams.toml"])
def test_forms_that_are_not_read_are_named(tmp_path: Path, name: str) -> None:
    data = read_dataset(with_files(tmp_path, {name: "x"}))
    assert any(f"{name} may be a calibration, and is not read (.yaml, .yml, .txt," in n for n in data.notes)
    assert data.frames[0].camera is None


def test_a_calibration_of_its_own_form_keeps_its_numbers(tmp_path: Path) -> None:
    path = own.write_text(tmp_path / "calib.xml", opencv_xml({"P1": P1 * 1.0000001, "P2": P2 * 1.0000001}))
    assert read_calibration(path).fx_px == own.FX * 1.0000001
