"""The doctor finds what is wrong, says it in one line a finding, and ends with 1 or 0."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from recon.camera import GroundPlane, PinholeCamera, StereoCamera
from recon.stereo.sgbm import write_disparity
from rescore.doctor import examine_dataset, examine_installation
from rescore.doctor.findings import Finding, Level
from tests.rescore import own_data as own
from tests.rescore.spoiling import Run

Json = dict[str, Any]


def findings(folder: Path) -> list[Finding]:
    return examine_dataset(folder, "car", 5)


def wrong(found: list[Finding]) -> list[str]:
    return [str(f) for f in found if f.level is Level.ERROR]


def test_this_installation_is_good() -> None:
    found = examine_installation()
    assert not wrong(found)
    assert any("SGBM measures 6.00 px of 6" in f.what for f in found)


@pytest.mark.parametrize("make", [own.kitti_folder, own.pair_folder, own.own_folder])
def test_a_good_data_set_has_no_errors(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    found = findings(make(tmp_path))
    assert not wrong(found)
    assert all("\n" not in str(f) for f in found)
    assert any(re.search(r"disparity (5\.[89]|6\.0) to 6\.[0-2] px", f.what) for f in found), found
    assert any(f.what.startswith("rows of ") and f.level is Level.OK for f in found)


def moved_down(path: Path) -> None:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    own.write_png(path, np.roll(picture, 3, axis=0))


def swap(root: Path) -> None:
    for i in (1, 2):
        own.write_pair(root / "right" / f"{i}.png", root / "left" / f"{i}.png", i)


def edit(change: Callable[[Json], object]) -> Callable[[Path], None]:
    def apply(root: Path) -> None:
        value = own.annotations()
        change(value)
        (root / "annotations.json").write_text(json.dumps(value))

    return apply


def camera(**changes: float) -> Callable[[Path], None]:
    return edit(lambda d: [i["camera"].update(changes) for i in d["images"]])


def box(bbox: list[float]) -> Callable[[Path], None]:
    return edit(lambda d: d["annotations"][0].update(bbox=bbox))


def same_picture(root: Path) -> None:
    (root / "left" / "2.png").write_bytes((root / "left" / "1.png").read_bytes())
    edit(lambda d: d["images"][0].update(split="train"))(root)


def cut_off(root: Path) -> None:
    path = root / "right" / "1.png"
    path.write_bytes(path.read_bytes()[:1500])


ERRORS: list[tuple[Callable[[Path], object], str]] = [
    (swap, "left and right are swapped: exchange them"),
    (
        lambda root: moved_down(root / "right" / "1.png"),
        "image 1: rows of .* differ by 3.0.*rectify the pair",
    ),
    (lambda root: (root / "right" / "2.png").unlink(), "image 2: no file .*2.png; add it"),
    (cut_off, "image 1: .*1.png: expected a picture that OpenCV reads"),
    (camera(baseline_m=50), "baseline of 50 m .* in centimetres, write 0.5"),
    (camera(baseline_m=500), "baseline of 500 m .* in millimetres, write 0.5"),
    (camera(fx=8), "fx of 8 px is outside 0.3 to 4 picture widths"),
    (box([200, 20, 30, 24]), "1 box outside the picture, as"),
    (edit(lambda d: d["images"][1].update(width=90)), "has 96 x 64 pixels, the data set says 90 x 64"),
    (edit(lambda d: d["images"][1].pop("right_file_name")), "image 2: neither right picture nor measured"),
    (edit(lambda d: d["annotations"].append(d["annotations"][0])), "expected each annotation id once, got 1"),
    (edit(lambda d: d["images"][1].update(id=1)), "expected each image id once, got 1 twice"),
    (edit(lambda d: d.update(images=[], annotations=[])), "no frames; add some"),
    (same_picture, "image 2: in split test, the same picture as image 1 in train"),
    (
        edit(lambda d: (d["images"][0].update(split="train"), d["images"][1].update(file_name="left/1.png"))),
        "train and test must share no image",
    ),
]


@pytest.mark.parametrize(("spoil", "message"), ERRORS)
def test_what_is_wrong_is_an_error(tmp_path: Path, spoil: Callable[[Path], object], message: str) -> None:
    own.own_folder(tmp_path)
    spoil(tmp_path)
    found = wrong(findings(tmp_path))
    assert len(found) >= 1
    assert any(re.search(message, text) for text in found), found


WARNINGS: list[tuple[Callable[[Path], object], str]] = [
    (camera(cx=2), r"principal point \(2, 32\) is outside the middle half"),
    (box([-9, 20, 30, 24]), "1 box beyond the edge of the picture"),
    (edit(lambda d: d["annotations"].append(d["annotations"][0] | {"id": 2})), "is there more than once"),
    (edit(lambda d: d.update(annotations=[])), "no boxes of 'car'"),
    (edit(lambda d: [i.pop("camera") for i in d["images"]]), "2 of 2 frames: no calibration"),
    (
        lambda root: own.write_png(root / "right" / "1.png", own.pair(9)[1]),
        "features of the left picture found",
    ),
]


@pytest.mark.parametrize(("spoil", "message"), WARNINGS)
def test_what_is_doubtful_is_a_warning(tmp_path: Path, spoil: Callable[[Path], object], message: str) -> None:
    own.own_folder(tmp_path)
    spoil(tmp_path)
    found = [str(f) for f in findings(tmp_path) if f.level is Level.WARNING]
    assert any(re.search(message, text) for text in found), found


@pytest.mark.parametrize(
    ("top_px", "bottom_px", "level", "message"),
    [
        # far things above are off by 5 px, so that most features lie farther right: no reason to exchange
        (-5, 3, Level.WARNING, r"[56]\d% of .*, far things by [45].\d px; check principal points"),
        # the same with the pictures exchanged: what is low and near has the smaller disparity
        (5, -3, Level.WARNING, "most of them low in it; left and right may be swapped"),
        (2, -6, Level.ERROR, "left and right are swapped: exchange them"),
        # all of it on the wrong side, whatever the trend
        (-9, -3, Level.ERROR, "100% of .*left and right are swapped: exchange them"),
    ],
)
def test_a_pair_that_is_off_is_told_from_a_swapped_one(
    tmp_path: Path, top_px: int, bottom_px: int, level: Level, message: str
) -> None:
    own.own_folder(tmp_path)
    shifts = np.linspace(top_px, bottom_px, own.HEIGHT)
    for i in (1, 2):
        left = own.pair(i)[0]
        u, v = np.meshgrid(np.arange(own.WIDTH), np.arange(own.HEIGHT))
        from_left = (u + shifts[:, None]).astype(np.float32)
        right = cv2.remap(left, from_left, v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        own.write_png(tmp_path / "right" / f"{i}.png", right)
    found = [f for f in findings(tmp_path) if "farther right" in str(f)]
    assert len(found) == 2
    for finding in found:
        assert finding.level is level
        assert re.search(message, str(finding)), finding


def street(root: Path, true_m: float, **stated: float) -> list[str]:
    """What the doctor says of the ground in a frame with a bare street at a height, looking level."""
    left = PinholeCamera(own.FX, own.FX, 48, 32, own.WIDTH, own.HEIGHT)
    v, u = np.mgrid[: own.HEIGHT, : own.WIDTH].astype(float)
    depth = GroundPlane(true_m).intersect(left.rays(np.stack([u, v], axis=-1)))[..., 2]
    own.own_folder(root)
    write_disparity(root / "d.png", StereoCamera(left, own.BASELINE_M).disparity_px(depth))

    def change(data: Json) -> None:
        del data["images"][1]
        image = data["images"][0]
        image["disparity_file_name"] = "d.png"
        del image["camera"]["height_m"]
        image["camera"] |= stated

    edit(change)(root)
    return [str(f) for f in findings(root) if "ground" in f.what]


def test_the_ground_of_stereo_is_told_beside_the_stated_one(tmp_path: Path) -> None:
    agreed = "ok      image 1: ground from stereo: height 1.80 m, pitch 0.0, roll 0.0 degrees, "
    (told,) = street(tmp_path / "same", 1.8, height_m=1.7)
    assert told == agreed + "stated 1.70 m, 0.0 degrees: they agree"
    (told,) = street(tmp_path / "none", 1.8)
    assert told == agreed + "none is stated"
    (told,) = street(tmp_path / "other", 1.8, height_m=1.2, pitch_rad=0.05)
    assert told.startswith("warning image 1: ground from stereo: height 1.80 m")
    # 1.8 / 1.2 - 1 = 50 per cent; 0.05 rad = 2.9 degrees
    assert (
        "stated 1.20 m, 2.9 degrees: height differs +50%, pitch -2.9, roll +0.0; a slope where it is this"
        in told
    )
    assert "check height_m, pitch_rad, roll_rad and the baseline" in told


def test_the_doctor_says_why_the_ground_is_the_default(tmp_path: Path) -> None:
    # pairs with one disparity everywhere: walls
    for told in wall(tmp_path / "none"):
        assert re.match(r"warning image \d: no ground is stated, and that of stereo is not trusted", told)
        assert "(nothing like a ground plane: " in told
        assert told.endswith(
            "): 1.5 m and level are assumed; state height_m and pitch_rad of the camera where they are known"
        )
    for told in wall(tmp_path / "stated", height_m=1.6):
        assert re.match(
            r"ok      image \d: ground stated 1.60 m, 0.0 degrees; stereo cannot tell \(noth", told
        )


def wall(root: Path, **stated: float) -> list[str]:
    own.own_folder(root)

    def change(data: Json) -> None:
        for image in data["images"]:
            image["camera"] = {k: v for k, v in image["camera"].items() if k != "height_m"} | stated

    edit(change)(root)
    told = [str(f) for f in findings(root) if "ground" in f.what]
    assert len(told) == 2
    return told


def test_the_real_frames_are_in_order(kitti: Path) -> None:
    found = examine_dataset(kitti, "car", 2)
    assert {f.level for f in found} == {Level.OK}


def test_a_path_does_not_steer_the_terminal(tmp_path: Path, run: Run) -> None:
    code, out, _ = run("doctor", tmp_path / "\x1b[31mnone")
    assert code == 1
    assert "\\x1b[31mnone" in out
    assert "\x1b" not in out
