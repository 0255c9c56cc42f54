"""Calibrations in every form of YAML that other tools and hands write, and what is refused in one line."""

import re
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from recon.camera import GroundPlane
from recon.errors import RescoreError
from rescore.formats.calibration_files import Calibration, read_calibration
from rescore.formats.open import read_dataset
from tests.rescore import own_data as own

PAIR = Calibration(700.0, 701.0, 320.0, 240.0, 0.12, 0.0, 640, 480)
ONE = Calibration(700.0, 701.0, 320.0, 240.0, None, 0.0, 640, 480)
P1 = "[700, 0, 320, 0, 0, 701, 240, 0, 0, 0, 1, 0]"
P2 = "[700, 0, 320, -84, 0, 701, 240, 0, 0, 0, 1, 0]"
SIZE = "width: 640\nheight: 480\n"


def read(tmp_path: Path, text: str) -> Calibration:
    return read_calibration(own.write_text(tmp_path / "calib.yaml", text))


def check(found: Calibration, expected: Calibration) -> None:
    assert astuple(found)[6:8] == astuple(expected)[6:8]
    assert (found.baseline_m is None) == (expected.baseline_m is None)
    for mine, right in zip(astuple(found)[:6], astuple(expected)[:6], strict=True):
        assert mine == pytest.approx(right, abs=1e-12)


def opencv(name: str, data: str, between: str = "") -> str:
    return f"{name}: !!opencv-matrix\n   rows: 3\n   cols: 4\n{between}   dt: d\n   data: {data}\n"


ROWS = """
P1:
  - [700, 0, 320, 0]
  - [0, 701, 240, 0]
  - [0, 0, 1, 0]
P2:
- - 700
  - 0
  - 320
  - -84
- [0, 701, 240, 0]
- [0, 0, 1, 0]
"""


@pytest.mark.parametrize(
    "text",
    [
        "%YAML:1.0\n---\n" + opencv("P1", P1) + opencv("P2", P2) + "imageSize: [ 640, 480 ]\n",
        # OpenCV 2 wrote no line after its head
        "%YAML:1.0\n" + opencv("P1", P1) + opencv("P2", P2) + SIZE,
        # comments between the keys, and behind values
        "# by hand\n" + opencv("P1", P1, "# left\n") + opencv("P2", P2, "\n   # right\n") + SIZE + "# end",
        "P1: {rows: 3, cols: 4, data: "
        + P1
        + "}  # left\nP2: {data: "
        + P2
        + "}\nwidth: 640 # px\nheight: 480\n",
        "{P1: " + P1 + ", P2: " + P2 + ", width: 640, height: 480}",
        ROWS + SIZE,
        # lists over lines, quoted numbers, keys in another order
        "P2:\n  data: " + P2.replace(", 0", ",\n   0") + "\n  cols: 4\n  rows: '3'\nP1: " + P1 + "\n" + SIZE,
        f'P1: {P1}\nP2: {P2}\n"width": "640"\n"height": "480"\n'.replace("700", "'7e2'").replace(
            "-84", '"-84.0"'
        ),
        # OpenCV appends further documents
        "%YAML:1.0\n---\n" + opencv("P1", P1) + "...\n---\n" + opencv("P2", P2) + SIZE,
        # what is not read may be anything
        f"P1: {P1}\nP2: {P2}\n{SIZE}t: never\nnotes: {{P1: none, a: [[b]]}}\nV1: !!opencv-matrix {{a: x}}\n",
    ],
)
def test_forms_of_a_pair(tmp_path: Path, text: str) -> None:
    check(read(tmp_path, text), PAIR)


CAMERA_INFO = f"""header:
  seq: 1
  frame_id: left
height: 480
width: 640
distortion_model: plumb_bob
D: [0.1, 0, 0, 0, 0]
K: [1, 0, 1, 0, 1, 1, 0, 0, 1]
R: [1, 0, 0, 0, 1, 0, 0, 0, 1]
P: {P1}
roi:
  height: 0
  width: 0
---
"""


def small(text: str) -> str:
    """As ROS 2 writes it: small names, a number a line."""
    lines = text.replace("P:", "p:").replace("K:", "k:").replace("D:", "d:").replace("R:", "r:").split("\n")
    return "\n".join(
        line.replace(": [", ":\n- ").replace(", ", "\n- ").rstrip("]") if "[" in line else line
        for line in lines
    )


@pytest.mark.parametrize("form", [str, small])
def test_camera_info_of_ros(tmp_path: Path, form: type[str]) -> None:
    left = own.write_text(tmp_path / "left.yaml", form(CAMERA_INFO))
    right = own.write_text(tmp_path / "right.yaml", form(CAMERA_INFO.replace(P1, P2)))
    check(read_calibration(left, right), PAIR)
    # the rectified camera, not K
    check(read_calibration(left), ONE)
    # a message after the other, with other heads
    messages = form(CAMERA_INFO) + form(CAMERA_INFO).replace("seq: 1", "seq: 2")
    check(read(tmp_path, messages), ONE)
    with pytest.raises(
        RescoreError, match=r"calib.yaml: width: expected one value, got another in a further doc"
    ):
        read(tmp_path, form(CAMERA_INFO) + form(CAMERA_INFO).replace("width: 640", "width: 320"))


def kalibr(*cameras: str) -> str:
    return "".join(f"cam{i}:\n  camera_model: pinhole\n{text}" for i, text in enumerate(cameras))


INSIDE = "  intrinsics: [700, 701, 320, 240]\n  resolution: [640, 480]\n  distortion_coeffs: [0, 0, 0, 0]\n"
MOVED = "  T_cn_cnm1:\n  - [1, 0, 0, {}]\n  - [0, 1, 0, {}]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n"
SECOND = INSIDE + MOVED.format(-0.12, 0)


def test_blocks_of_kalibr(tmp_path: Path) -> None:
    check(read(tmp_path, kalibr(INSIDE, SECOND)), PAIR)
    check(read(tmp_path, kalibr(INSIDE)), ONE)
    check(read(tmp_path, kalibr(INSIDE) + "baseline_m: 0.12\n"), PAIR)
    # a point at (1, 0, 10) m is seen 8.4 px farther left by the right camera, whose middle is 5 px on
    shifted = read(tmp_path, kalibr(INSIDE, SECOND.replace("320", "325")))
    assert shifted.disparity_offset_px == 5
    assert shifted.baseline_m == pytest.approx(0.12)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            kalibr(INSIDE.replace("[0, 0, 0, 0]", "[-0.2, 0.1, 0, 0]"), SECOND),
            r"expected the cameras of rectified .* got lens distortion \(D1 up to 0.2\); .*--rectify",
        ),
        (
            kalibr(INSIDE, SECOND.replace("_coeffs: [0", "_coeffs: [1")),
            r".* got lens distortion \(D2 up to 1\)",
        ),
        (kalibr(INSIDE).replace("pinhole", "omni"), "cam0: .* got the camera model 'omni' with 'radtan'"),
        (kalibr(INSIDE, SECOND.replace("240]", "243]")), ".* got rows that are about 3.0 px apart"),
        (
            kalibr(INSIDE, SECOND.replace("[0, 1, 0", "[0, 1, 0.01")),
            ".* got rows that are about 7.0 px apart",
        ),
        (
            kalibr(INSIDE, INSIDE + MOVED.format(-0.12, 0.01)),
            ".* got a camera that is 0.01 m above, below",
        ),
        (kalibr(INSIDE, SECOND.replace("640", "320")), "cam1: expected pictures of one size, got two"),
        (
            kalibr(INSIDE, INSIDE + MOVED.format(0.12, 0)),
            ".* got a baseline of -0.12; left and right may be swapped",
        ),
        (kalibr(INSIDE, INSIDE), "cam1: T_cn_cnm1: expected 4 x 4 numbers, got no such entry"),
        (kalibr(INSIDE.replace("700, 701, ", "")), "cam0: intrinsics: expected 1 x 4 numbers, got 2 numbers"),
        (kalibr(INSIDE).replace("cam0", "cam1"), "expected Kalibr's block cam0, got cam1 alone"),
        (f"P1: {P1}\nP1: {P2}\n", r"expected YAML, got a mistake in line 1 \(a name that occurs twice\)"),
        (f"P1: {P1}\n---\nP1: {P2}\n", "P1: expected one value, got another in a further document"),
        (f"P1: &p {P1}\nP2: *p\n", r"expected YAML, got a mistake in line 2 \(an alias, which is not read\)"),
        (
            "P1: [700, 0, 320, 0, 0, 701\nP2: 3\n",
            r"expected YAML, got a mistake in line 2 \(expected ',' or '\]'",
        ),
        (
            "K: [[1, 0], [0]]\n",
            r"K: expected numbers, got .*'1', '0'\], \['0'\]",
        ),
        ("K: [1, 0, x]\n", "K: expected numbers"),
        ("K: {a: 1}\n", "K: expected numbers, got \"{'a': '1'}\""),
        ("K: [1, 0, .NaN]\n", "K: expected finite numbers"),
        ("K: 1e999\n", "K: expected finite numbers, got '1e999'"),
        ("K:\n", "K: expected finite numbers, got ''"),
        ("K: {rows: 3, cols: 3, data: [1, 2]}\n", "K: expected 3 x 3 numbers, got 2; mend rows and cols"),
        (
            "P1: [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]]\nP2: 1\n",
            "P1: expected 3 x 4 numbers, got 4 x 3 numbers",
        ),
        (f"P1: {P1}\nP2: {P2}\nwidth: [640, 480]\n", "width: expected 1 x 1 numbers, got 2 numbers"),
        ("- 1\n", "expected a calibration .* got none of them"),
    ],
)
def test_what_is_refused_in_one_line(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(RescoreError, match=f"calib.yaml: {problem}") as refused:
        read(tmp_path, text)
    assert "\n" not in str(refused.value)


def test_three_numbers_at_one_place(tmp_path: Path) -> None:
    t = 'T: !!opencv-matrix\n   rows: 1\n   cols: 1\n   dt: "3d"\n   data: [ -0.12, 0., 0. ]\n'
    k = "K1: [[700, 0, 320], [0, 701, 240], [0, 0, 1]]\n"
    check(read(tmp_path, t + k + SIZE), PAIR)


def test_what_opencv_writes_comes_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    k = np.array([[rng.uniform(500, 900), 0, 1 / 3], [0, rng.uniform(500, 900), 1e-7], [0, 0, 1]])
    found = read(tmp_path, own.opencv_yaml({"cameraMatrix": k, "baseline_m": 1 / 7}))
    assert (found.fx_px, found.fy_px, found.cx_px, found.cy_px) == (k[0, 0], k[1, 1], k[0, 2], k[1, 2])
    assert found.baseline_m == 1 / 7


BY_HAND = "fx: 80\nfy: 80\ncx: 48\ncy: 32\nbaseline_m: 0.5\n"


def test_a_calibration_states_the_ground(tmp_path: Path) -> None:
    """What the doctor asks for where stereo measures no ground; before, it was read past."""
    own.write_text(own.pair_folder(tmp_path) / "calib.yaml", f"{BY_HAND}height_m: 1.6\npitch_rad: 0.02\n")
    assert {f.ground for f in read_dataset(tmp_path).frames} == {GroundPlane(1.6, 0.02, 0.0)}
    assert read(tmp_path, BY_HAND).ground is None


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "height_m: 1.6\npitch_rad: 5\n",
            "expected pitch_rad below a right angle (1.57), got 5; write radians",
        ),
        ("height_m: -1.6\n", "the camera must be above the ground, got height_m=-1.6"),
        ("pitch_rad: 0.1\n", "expected height_m beside pitch_rad and roll_rad, got none; add it"),
    ],
)
def test_a_stated_ground_that_is_none(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(RescoreError, match=rf"^{re.escape(str(tmp_path))}\S+: .*{re.escape(problem)}"):
        read(tmp_path, BY_HAND + text)
