"""Which right picture or measured file goes with which left picture."""

from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.formats.open import read_dataset
from rescore.formats.pairs.names import Side, paired
from tests.rescore import own_data as own


def pairs(lefts: str, others: str, side: Side = Side.RIGHT) -> dict[str, str]:
    left, right = (
        [Path(folder) / f"{n}.png" for n in names.split()]
        for folder, names in (("left", lefts), ("other", others))
    )
    return {a.stem: b.stem for a, b in paired(left, right, side)}


@pytest.mark.parametrize(
    ("lefts", "others", "expected"),
    [
        # a street that turns left has the same name on both sides
        ("turn_left_01 turn_right_01", "turn_left_01 turn_right_01", "turn_left_01 turn_right_01"),
        ("turn_left_01_left turn_right_01_left", "turn_left_01_right turn_right_01_right",
         "turn_left_01_right turn_right_01_right"),
        ("front_left_1 rear_left_1", "front_right_1 rear_right_1", "front_right_1 rear_right_1"),
        ("rear1 real1", "rear1 real1", "rear1 real1"),
        ("rear1_l real1_l", "rear1_r real1_r", "rear1_r real1_r"),
        ("left_07 left_08", "right_07 right_08", "right_07 right_08"),
        ("07_left", "07", "07"),
        ("07", "07_right", "07_right"),
        ("L001", "R001", "R001"),
        ("imL imL2", "imR imR2", "imR imR2"),
        ("0001l", "0001r", "0001r"),
        ("a_000019_leftImg8bit", "a_000019_rightImg8bit", "a_000019_rightImg8bit"),
        ("leftcam_left_01", "rightcam_right_01", "rightcam_right_01"),
        ("Left-3", "Right-3", "Right-3"),
        ("IMGL_0001 IMGL_0002", "IMGR_0001 IMGR_0002", "IMGR_0001 IMGR_0002"),
        ("cam0_10 cam0_11", "cam1_10 cam1_11", "cam1_10 cam1_11"),
        ("7_camera_0", "7_camera_1", "7_camera_1"),
        ("cam0_TUNNEL_1", "cam1_TUNNEL_1", "cam1_TUNNEL_1"),
    ],
)  # fmt: skip
def test_right_pictures(lefts: str, others: str, expected: str) -> None:
    assert pairs(lefts, others) == dict(zip(lefts.split(), expected.split(), strict=True))


def test_a_picture_without_a_partner_has_none() -> None:
    assert pairs("left_1 left_2", "right_1") == {"left_1": "right_1"}
    # the sides are exchanged: these are no names of a left picture
    assert pairs("a_right", "a_left") == {}


def test_measured_files_are_those_of_the_left_picture() -> None:
    assert pairs("01", "01_left 01_right", Side.LEFT) == {"01": "01_left"}
    assert pairs("01_left", "01_right", Side.LEFT) == {}


@pytest.mark.parametrize(
    ("lefts", "others", "problem"),
    [
        ("a_left a_right", "a_right",
         "other/a_right.png: expected one left picture of its name, got a_left.png and another in left"),
        ("a_left a", "a_right", "other/a_right.png: expected one left picture of its name, got a.png and"),
        ("a_left", "a_r a_right",
         "left/a_left.png: expected one file of its name, got a_r.png and a_right.png"),
    ],
)  # fmt: skip
def test_two_files_of_one_name_are_refused(lefts: str, others: str, problem: str) -> None:
    with pytest.raises(RescoreError, match=problem):
        pairs(lefts, others)


def test_a_time_goes_with_the_nearest_and_each_file_once() -> None:
    found = pairs("10.000 10.015 11.0 12.0", "10.005 11.0 12.3", Side.LEFT)
    assert found == {"10.000": "10.005", "11.0": "11.0"}
    many = [f"{1e9 + i / 30:.6f}" for i in range(20_000)]
    assert len(pairs(" ".join(many), " ".join(f"{float(t) + 0.01:.6f}" for t in many), Side.LEFT)) == 20_000


def test_pictures_of_one_name_in_both_folders_go_together(tmp_path: Path) -> None:
    for i, name in enumerate(("turn_left_01", "turn_right_01")):
        own.write_pair(tmp_path / "left" / f"{name}.png", tmp_path / "right" / f"{name}.png", i)
    frames = read_dataset(tmp_path).frames
    assert [f.right_path and f.right_path.stem for f in frames] == ["turn_left_01", "turn_right_01"]


def test_both_views_in_both_folders_are_refused(tmp_path: Path) -> None:
    for folder in ("left", "right"):
        own.write_pair(tmp_path / folder / "1_left.png", tmp_path / folder / "1_right.png")
    with pytest.raises(
        RescoreError, match=r"right/1_left.png: expected the right picture of .*, got the same picture"
    ):
        read_dataset(tmp_path)


@pytest.mark.parametrize("folder", ["left", "right", "disparity"])
def test_two_files_of_one_name_in_a_folder_are_refused(tmp_path: Path, folder: str) -> None:
    own.pair_folder(tmp_path)
    own.write_png(tmp_path / folder / "a.png", np.zeros((own.HEIGHT, own.WIDTH), np.uint16))
    second = tmp_path / folder / ("a.npy" if folder == "disparity" else "a.jpg")
    np.save(second, own.DEPTH_M) if folder == "disparity" else own.write_png(second, own.pair()[0])
    with pytest.raises(
        RescoreError, match=rf"{folder}: expected one file of the name 'a', got {second.name} and a.png"
    ):
        read_dataset(tmp_path)


@pytest.mark.parametrize(("stem", "ends"), [("im0", (".jpg", ".png")), ("disp0", (".npy", ".pfm"))])
def test_two_files_of_one_name_in_a_scene_are_refused(
    tmp_path: Path, stem: str, ends: tuple[str, str]
) -> None:
    own.middlebury(tmp_path, 0, 6)
    for end in ends if stem == "disp0" else ends[:1]:
        (tmp_path / "Motorcycle" / f"{stem}{end}").write_bytes(b"x")
    (tmp_path / "Motorcycle" / "im1.png").unlink()
    with pytest.raises(
        RescoreError, match=f"expected one file of the name '{stem}', got {stem}{ends[0]} and {stem}{ends[1]}"
    ):
        read_dataset(tmp_path)


def test_of_two_kinds_of_measurement_the_reader_says_which_it_takes(tmp_path: Path) -> None:
    own.pair_folder(tmp_path)
    for folder in ("disparity", "depth"):
        for name in ("a", "b"):
            own.write_png(tmp_path / folder / f"{name}.png", np.full((own.HEIGHT, own.WIDTH), 640, np.uint16))
    assert f"{tmp_path / 'disparity'}: taken in place of depth" in read_dataset(tmp_path).notes


def test_the_end_of_a_name_may_be_in_capitals(tmp_path: Path) -> None:
    own.middlebury(tmp_path, 0, 6)
    for path in sorted(tmp_path.rglob("*.png")):
        path.rename(path.with_suffix(".PNG"))
    assert [f.right_path and f.right_path.name for f in read_dataset(tmp_path).frames] == ["im1.PNG"] * 2
