"""Values of measured files for one metre or pixel: as the calibration says, in every form of both."""

from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.data.frames import load_frame
from rescore.doctor import examine_dataset
from rescore.doctor.findings import Level
from rescore.formats.open import read_dataset
from tests.rescore import own_data as own
from tests.rescore.formats.test_tools import FILES

SHAPE = (own.HEIGHT, own.WIDTH)


def write(path: Path, value: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".png":
        own.write_png(path, np.rint(value).astype(np.uint16))
    elif path.suffix == ".pfm":
        own.write_pfm(path, value)
    else:
        np.save(path, value)


@pytest.mark.parametrize("suffix", [".png", ".npy", ".pfm"])
def test_depth_in_millimetres(tmp_path: Path, suffix: str) -> None:
    own.write_png(tmp_path / "left" / "1.png", own.pair()[0])
    write(tmp_path / "depth" / f"1{suffix}", own.DEPTH_M * 1000)
    own.write_text(tmp_path / "calib.yaml", own.opencv_yaml({"cameraMatrix": own.K, "depth_factor": 1000.0}))
    frame = load_frame(read_dataset(tmp_path).frames[0], own.STEREO)
    assert frame.camera is not None
    np.testing.assert_allclose(frame.camera.depth_m(frame.disparity_px), own.DEPTH_M, atol=6e-4)


FACTOR = {
    "P1 and P2": {"calib.yaml": own.opencv_yaml({"P1": own.projection(0), "P2": own.projection(-40)})},
    "Q": {
        "calib.yaml": own.opencv_yaml(
            {
                "Q": np.array(
                    [[1, 0, 0, -48.0], [0, 1, 0, -32], [0, 0, 0, own.FX], [0, 0, 1 / own.BASELINE_M, 0]]
                )
            }
        )
    },
    "calib.txt": {"calib.txt": own.kitti_calib()},
    "a ROS pair": FILES["ROS messages"],
    "JSON": FILES["JSON of numbers"],
    "XML": FILES["OpenCV's XML"],
}
PLACE = {
    "JSON": ('"fx"', '"depth_factor": 1000, '),
    "XML": ("<P1", "<depth_factor>1000.</depth_factor>\n"),
    "a ROS pair": ("height", "depth_factor: 1000\n"),
}


@pytest.mark.parametrize("form", FACTOR)
def test_a_factor_beside_every_calibration(tmp_path: Path, form: str) -> None:
    own.write_png(tmp_path / "left" / "1.png", own.pair()[0])
    write(tmp_path / "depth" / "1.png", own.DEPTH_M * 1000)
    old, new = PLACE.get(form, ("", "depth_factor: 1000\n"))
    for name, text in FACTOR[form].items():
        own.write_text(tmp_path / name, text.replace(old, new + old, 1) if old else text + new)
    frame = load_frame(read_dataset(tmp_path).frames[0], own.STEREO)
    assert frame.camera is not None
    assert frame.camera.baseline_m == pytest.approx(own.BASELINE_M)
    np.testing.assert_allclose(frame.camera.depth_m(frame.disparity_px), own.DEPTH_M, atol=6e-4)


@pytest.mark.parametrize(("suffix", "without"), [(".png", 256), (".npy", 1), (".pfm", 1)])
@pytest.mark.parametrize("stated", [None, 16])
def test_disparity_and_its_factor(tmp_path: Path, suffix: str, without: int, stated: int | None) -> None:
    own.write_png(tmp_path / "left" / "1.png", own.pair()[0])
    write(tmp_path / "disparity" / f"1{suffix}", np.full(SHAPE, 2.5 * (stated or without)))
    if stated:
        # a folder without a camera can say it too
        own.write_text(tmp_path / "calib.yaml", f"disparity_factor: {stated}\n")
    data = read_dataset(tmp_path)
    assert (load_frame(data.frames[0], own.STEREO).disparity_px == 2.5).all()
    assert data.frames[0].camera is None


def test_whole_numbers_of_depth_need_their_unit_in_every_form(tmp_path: Path) -> None:
    own.write_png(tmp_path / "left" / "1.png", own.pair()[0])
    own.write_text(tmp_path / "calib.yaml", own.opencv_yaml({"cameraMatrix": own.K}))
    write(tmp_path / "depth" / "1.npy", (own.DEPTH_M * 1000).astype(np.uint16))
    with pytest.raises(
        RescoreError, match=r"depth: expected to be told the value of one metre.*depth_factor: 5000"
    ):
        read_dataset(tmp_path)
    write(tmp_path / "depth" / "1.npy", own.DEPTH_M)
    assert read_dataset(tmp_path).frames[0].measured is not None


@pytest.mark.parametrize("factor", [0, -1])
def test_a_factor_that_is_none(tmp_path: Path, factor: int) -> None:
    own.depth_folder(tmp_path, ".npy")
    own.write_text(
        tmp_path / "calib.yaml", own.opencv_yaml({"cameraMatrix": own.K}) + f"depth_factor: {factor}\n"
    )
    with pytest.raises(
        RescoreError, match=f"depth_factor: expected a positive number, got {factor}; KITTI has 256"
    ):
        read_dataset(tmp_path)


def test_the_doctor_sees_depth_in_another_unit(tmp_path: Path) -> None:
    own.write_png(tmp_path / "left" / "1.png", own.pair()[0])
    write(tmp_path / "depth" / "1.npy", own.DEPTH_M * 1000)
    own.write_text(tmp_path / "calib.yaml", own.opencv_yaml({"cameraMatrix": own.K}))
    errors = [f for f in examine_dataset(tmp_path, "car", 1) if f.level is Level.ERROR]
    assert len(errors) == 1
    assert "all that is measured is farther than 100 m (nearest 2560 m)" in str(errors[0])
    assert "depth_factor" in errors[0].advice


def test_the_doctor_sees_disparity_below_a_pixel(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    for name in ("a", "b"):
        write(tmp_path / "disparity" / f"{name}.npy", np.full(SHAPE, 0.5))
    errors = [f for f in examine_dataset(tmp_path, "car", 1) if f.level is Level.ERROR]
    assert len(errors) == 1
    assert "disparity is below a pixel everywhere" in str(errors[0])
    assert "disparity_factor" in errors[0].advice
