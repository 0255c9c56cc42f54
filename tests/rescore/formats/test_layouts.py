"""Well-known layouts of stereo and depth data: each gives its frames and cameras, or one line."""

import json
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.camera import GroundPlane
from recon.errors import RescoreError
from rescore.data.frames import DataSet, frame_names, load_frame
from rescore.formats.coco_write import write_dataset
from rescore.formats.open import read_dataset, read_detections
from rescore.formats.pairs import sequences
from rescore.formats.parts.frames import write_frame_parts
from tests.rescore import own_data as own

PLAIN = json.dumps({"fx": own.FX, "fy": own.FX, "cx": 48, "cy": 32, "baseline_m": own.BASELINE_M})
RAW = own.kitti_calib().replace("P0", "P_rect_00").replace("P1", "P_rect_01")
RAW = "calib_time: 09-Jan-2012 13:57:47\n" + RAW.replace("P2", "P_rect_02").replace("P3", "P_rect_03")


def pairs(root: Path, left: str, right: str, n: int = 2) -> None:
    """Pictures of both sides, with the number in place of {}."""
    for i in range(n):
        own.write_pair(root / left.format(i), root / right.format(i), i)


def depth(path: Path, factor: float = 1000) -> None:
    own.write_png(path, np.full((own.HEIGHT, own.WIDTH), 8 * factor, np.uint16))


def cityscapes_camera(pitch: float = 0.04, roll: float = 0.03) -> str:
    outside = {
        "baseline": own.BASELINE_M,
        "pitch": pitch,
        "roll": roll,
        "x": 1.7,
        "y": 0.1,
        "yaw": -0.02,
        "z": 1.2,
    }
    return json.dumps({"extrinsic": outside, "intrinsic": {"fx": own.FX, "fy": own.FX, "u0": 48, "v0": 32}})


def cityscapes(root: Path) -> None:
    for place in ("train/ulm", "val/lindau"):
        stem = f"{place}/{place[-3:]}_00000{{}}_000019"
        pairs(root, f"leftImg8bit/{stem}_leftImg8bit.png", f"rightImg8bit/{stem}_rightImg8bit.png")
        for i in range(2):
            own.write_text(root / "camera" / f"{stem.format(i)}_camera.json", cityscapes_camera())


def kitti_raw(root: Path) -> None:
    for drive in ("0001", "0002"):
        folder = f"2011_09_26/2011_09_26_drive_{drive}_sync"
        for gray in (0, 2):
            left, right = (f"{folder}/image_0{gray + i}/data/000000000{{}}.png" for i in (0, 1))
            pairs(root, left, right)
    own.write_text(root / "2011_09_26/calib_cam_to_cam.txt", RAW)
    for other in ("calib_imu_to_velo.txt", "calib_velo_to_cam.txt"):
        own.write_text(root / "2011_09_26" / other, "R: 1 0 0 0 1 0 0 0 1\nT: 0 0 0\n")


def odometry(root: Path) -> None:
    for name in ("00", "01"):
        pairs(root, f"sequences/{name}/image_0/00000{{}}.png", f"sequences/{name}/image_1/00000{{}}.png")
        own.write_text(root / "sequences" / name / "calib.txt", own.kitti_calib(baseline_m=0.5))


def tracking(root: Path) -> None:
    for name in ("0000", "0001"):
        pairs(root, f"training/image_02/{name}/00000{{}}.png", f"training/image_03/{name}/00000{{}}.png")
        own.write_text(root / "training/calib" / f"{name}.txt", own.kitti_calib())


def kitti_2015(root: Path) -> None:
    pairs(root, "training/image_2/00000{}_10.png", "training/image_3/00000{}_10.png")
    pairs(root, "training/image_2/00000{}_11.png", "training/image_3/00000{}_11.png")
    for i in range(2):
        own.write_text(root / f"training/calib_cam_to_cam/00000{i}.txt", RAW)


def driving_stereo(root: Path) -> None:
    for date in ("2018-07-09", "2018-07-10"):
        pairs(
            root,
            f"left-image-half-size/{date}/{date}-{{}}.jpg",
            f"right-image-half-size/{date}/{date}-{{}}.jpg",
        )
        one = "1 0 0 0 1 0 0 0 1"
        for half, size in (("half", "96 64"), ("full", "192 128")):
            p1, p2 = (" ".join(map(str, own.projection(x).ravel())) for x in (0, -own.FX * own.BASELINE_M))
            text = f"R_101: {one}\nT_101: 0 0 0\nS_rect_101: {size}\nP_rect_101: {p1}\n"
            text += f"R_103: {one}\nT_103: {-own.BASELINE_M} 0 0\nP_rect_103: {p2}\n"
            own.write_text(root / f"calib/{half}-image-calib/{date}.txt", text)


def virtual_kitti(root: Path) -> None:
    for weather in ("15-deg-left", "15-deg-right"):
        for kind in ("rgb", "classSegmentation"):
            place = f"Scene01/{weather}/frames/{kind}/Camera_{{}}/{kind}_0000{{{{}}}}.png"
            pairs(root, place.format(0), place.format(1))
        head = "frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]"
        rows = [f"{i} {c} {own.FX} {own.FX} 48 32" for i in (0, 1) for c in (0, 1)]
        own.write_text(root / f"Scene01/{weather}/intrinsic.txt", "\n".join([head, *rows]))
        head = "frame cameraID r1,1 r1,2 r1,3 t1 r2,1 r2,2 r2,3 t2 r3,1 r3,2 r3,3 t3 0 0 0 1"
        rows = [
            f"{i} {c} 1 0 0 {7.5 + i - own.BASELINE_M * c} 0 1 0 2 0 0 1 3 0 0 0 1"
            for i in (0, 1)
            for c in (0, 1)
        ]
        own.write_text(root / f"Scene01/{weather}/extrinsic.txt", "\n".join([head, *rows]))
        own.write_text(root / f"Scene01/{weather}/bbox.txt", "frame cameraID trackID left right top bottom\n")


def zed(root: Path) -> None:
    pairs(root, "left00000{}.png", "right00000{}.png")
    own.write_text(root / "calib.json", PLAIN)


def zed_in_capitals(root: Path) -> None:
    pairs(root, "Left_{}.png", "Right_{}.png")
    own.write_text(root / "calib.json", PLAIN)


def in_stereo_2k(root: Path) -> None:
    for part in ("part1/000000", "part1/000001", "part2/000000"):
        pairs(root, f"{part}/left.png", f"{part}/right.png", 1)
        for side in ("left", "right"):
            depth(root / part / f"{side}_disp.png", 100)
    own.write_text(root / "calib.json", PLAIN)


def eth3d(root: Path) -> None:
    own.middlebury(root / "two_view_training", 0, 6)
    for scene in ("Adirondack", "Motorcycle"):
        own.write_text(root / "two_view_training" / scene / "cameras.txt", "# 0 PINHOLE 96 64 80 80 48 32\n")


def scene_flow(root: Path) -> None:
    for scene in ("fast", "slow"):
        place = f"frames_cleanpass/35mm/scene_forwards/{scene}/{{}}/000{{{{}}}}.png"
        pairs(root, place.format("left"), place.format("right"))
    own.write_text(root / "calib.json", PLAIN)


def tartan_air(root: Path) -> None:
    for trip in ("P000", "P001"):
        place = f"town/Easy/{trip}/{{0}}_{{1}}/00000{{{{}}}}_{{1}}.png"
        pairs(root, place.format("image", "left"), place.format("image", "right"))
        pairs(root, place.format("seg", "left"), place.format("seg", "right"))
    own.write_text(root / "calib.json", PLAIN)


def argoverse(root: Path) -> None:
    for camera in ("stereo_front", "ring_front", "ring_rear"):
        name = f"log1/{camera}_{{0}}/{camera}_{{0}}_31{{{{}}}}.jpg"
        pairs(root, name.format("left"), name.format("right"))
    own.write_text(root / "calib.json", PLAIN)


def under_left(root: Path) -> None:
    for trip in ("a", "b"):
        pairs(root, f"left/{trip}/{{}}.png", f"right/{trip}/{{}}.png")
    own.write_text(root / "calib.json", PLAIN)


def several_plain(root: Path) -> None:
    for trip in ("a", "b"):
        own.pair_folder(root / trip)
    own.write_text(root / "a/labels/a.txt", f"{own.KITTI_CAR}\n")
    own.write_text(root / "b/labels/b.txt", f"{own.KITTI_CAR}\n{own.KITTI_CAR}\n")


GROUND = GroundPlane(
    1.2,
    float(np.arctan2(np.sin(0.04), np.cos(0.04) * np.cos(0.03))),
    float(np.arcsin(np.cos(0.04) * np.sin(0.03))),
)
STEREO: dict[str, tuple[Callable[[Path], None], list[str], GroundPlane | None]] = {
    "Cityscapes": (
        cityscapes,
        [f"{c}_00000{i}_000019_leftImg8bit" for c in ("ulm", "dau") for i in (0, 1)],
        GROUND,
    ),
    "KITTI raw": (
        kitti_raw,
        [f"2011_09_26-2011_09_26_drive_{d}_sync-000000000{i}" for d in ("0001", "0002") for i in (0, 1)],
        None,
    ),
    "KITTI odometry": (odometry, [f"sequences-0{s}-00000{i}" for s in (0, 1) for i in (0, 1)], None),
    "KITTI tracking": (tracking, [f"000{s}-00000{i}" for s in (0, 1) for i in (0, 1)], None),
    "KITTI 2015": (kitti_2015, [f"00000{i}_1{j}" for i in (0, 1) for j in (0, 1)], None),
    "DrivingStereo": (driving_stereo, [f"2018-07-{d}-{i}" for d in ("09", "10") for i in (0, 1)], None),
    "Virtual KITTI 2": (
        virtual_kitti,
        [f"Scene01-15-deg-{s}-frames-rgb-rgb_0000{i}" for s in ("left", "right") for i in (0, 1)],
        None,
    ),
    "ZED": (zed, ["left000000", "left000001"], None),
    "ZED, capitals": (zed_in_capitals, ["Left_0", "Left_1"], None),
    "InStereo2K": (in_stereo_2k, ["part1-000000-left", "part1-000001-left", "part2-000000-left"], None),
    "ETH3D": (eth3d, ["Adirondack", "Motorcycle"], None),
    "SceneFlow": (
        scene_flow,
        [f"frames_cleanpass-35mm-scene_forwards-{s}-000{i}" for s in ("fast", "slow") for i in (0, 1)],
        None,
    ),
    "TartanAir": (tartan_air, [f"town-Easy-P00{s}-00000{i}_left" for s in (0, 1) for i in (0, 1)], None),
    "Argoverse": (argoverse, ["stereo_front_left_310", "stereo_front_left_311"], None),
    "left and right of trips": (under_left, ["a-0", "a-1", "b-0", "b-1"], None),
    "several plain folders": (several_plain, ["a-a", "a-b", "b-a", "b-b"], None),
}  # fmt: skip


def check(data: DataSet, names: list[str], ground: GroundPlane | None) -> None:
    assert list(frame_names(data).values()) == names
    for frame in data.frames:
        assert frame.pair is not None
        assert (*astuple(frame.pair.left)[:4], frame.pair.baseline_m) == pytest.approx(
            (own.FX, own.FX, 48, 32, own.BASELINE_M)
        )
        assert frame.ground == ground


@pytest.mark.parametrize("layout", STEREO)
def test_pairs_of_a_layout_are_read(tmp_path: Path, layout: str) -> None:
    make, names, ground = STEREO[layout]
    make(tmp_path)
    data = read_dataset(tmp_path)
    check(data, names, ground)
    assert np.nanmedian(load_frame(data.frames[-1], own.STEREO).disparity_px) == pytest.approx(
        own.SHIFT, abs=0.1
    )
    # what is written refers to the same frames
    again = read_dataset(write_dataset(tmp_path / "out", data, copy=False))
    assert frame_names(again) == frame_names(data)
    in_parts = read_dataset(write_frame_parts(tmp_path / "parts", data).root)
    assert frame_names(in_parts) == frame_names(data)


def color_and_depth(root: Path, camera: dict[str, object], name: str = "intrinsics.json") -> Path:
    own.write_png(root / "color" / "0001.png", own.pair()[0])
    depth(root / "depth" / "0001.png")
    own.write_text(root / name, json.dumps(camera))
    return root


REALSENSE = {
    "width": 96,
    "height": 64,
    "fx": own.FX,
    "fy": own.FX,
    "ppx": 48.0,
    "ppy": 32.0,
    "coeffs": [0] * 5,
}
COLUMNS = [own.FX, 0, 0, 0, own.FX, 0, 48, 32, 1]


@pytest.mark.parametrize(
    ("camera", "noted"),
    [
        (REALSENSE | {"depth_scale": 0.001}, ""),
        (REALSENSE | {"depth_factor": 1000}, ""),
        ({"intrinsic_matrix": COLUMNS, "depth_scale": 1000}, ""),
        ({"intrinsic_matrix": COLUMNS}, "so 1000 is taken for one metre, as Open3D documents"),
        ({"intrinsic_matrix": own.K.tolist()}, "so 1000 is taken for one metre, as Open3D documents"),
    ],
)
def test_color_and_depth(tmp_path: Path, camera: dict[str, object], noted: str) -> None:
    data = read_dataset(color_and_depth(tmp_path, camera, "camera_intrinsic.json"))
    (frame,) = data.frames
    assert frame.measured is not None
    assert frame.measured.factor == pytest.approx(1000)
    assert frame.camera is not None
    assert astuple(frame.camera.left) == (own.FX, own.FX, 48, 32, 96, 64)
    assert sum("taken for one" in n for n in data.notes) == bool(noted)
    assert any(noted in n for n in data.notes)


def tartan_depth(root: Path) -> None:
    tartan_air(root)
    for trip in ("P000", "P001"):
        (root / f"town/Easy/{trip}/depth_left").mkdir()
        for i in (0, 1):
            np.save(
                root / f"town/Easy/{trip}/depth_left/00000{i}_left_depth.npy",
                np.full((own.HEIGHT, own.WIDTH), 8, np.float32),
            )


def virtual_kitti_depth(root: Path) -> None:
    virtual_kitti(root)
    for weather in ("15-deg-left", "15-deg-right"):
        for camera in (0, 1):
            for i in (0, 1):
                depth(root / f"Scene01/{weather}/frames/depth/Camera_{camera}/depth_0000{i}.png", 100)


def cityscapes_disparity(root: Path) -> None:
    """Without the right pictures, which are many to fetch; a pixel of p is (p - 1) / 256."""
    cityscapes(root)
    (root / "rightImg8bit").rename(root / "elsewhere")
    for path in sorted(root.glob("leftImg8bit/*/*/*.png")):
        place = "/".join(path.parts[-3:]).replace("leftImg8bit", "disparity")
        own.write_png(root / "disparity" / place, np.full((own.HEIGHT, own.WIDTH), 5 * 256 + 1, np.uint16))


@pytest.mark.parametrize(
    ("make", "disparity_px", "factor"),
    [(tartan_depth, 5, 1), (virtual_kitti_depth, 5, 100), (cityscapes_disparity, 5, 256)],
)
def test_measured_files_of_a_layout(
    tmp_path: Path, make: Callable[[Path], None], disparity_px: float, factor: float
) -> None:
    make(tmp_path)
    data = read_dataset(tmp_path)
    assert len(data.frames) == 4
    for frame in data.frames:
        assert frame.measured is not None
        assert frame.measured.factor == factor
    found = load_frame(data.frames[-1], own.STEREO).disparity_px
    assert found == pytest.approx(disparity_px, abs=1e-5)


def polygons(*labels: str, width: int = 96) -> str:
    objects = [{"label": label, "polygon": [[10, 20], [39, 22], [20, 43]]} for label in labels]
    return json.dumps({"imgHeight": 64, "imgWidth": width, "objects": objects})


def test_boxes_around_the_polygons_of_cityscapes(tmp_path: Path) -> None:
    cityscapes(tmp_path)
    names = [
        f"gtFine/{p}_000019_gtFine_polygons.json" for p in ("train/ulm/ulm_000000", "val/lindau/dau_000001")
    ]
    own.write_text(tmp_path / names[0], polygons("car", "road", "cargroup"))
    own.write_text(tmp_path / names[1], polygons("road"))
    data = read_dataset(tmp_path)
    assert [len(data.truth[f.image_id].ignore) for f in data.frames] == [2, 0, 0, 0]
    assert data.truth[1].xyxy_px.tolist() == [[10, 20, 40, 44]] * 2
    assert data.truth[1].ignore.tolist() == [False, True]
    assert f"{tmp_path / 'gtFine'}: 2 of 4 frames have no polygons and count as empty" in data.notes
    own.write_text(tmp_path / names[1], polygons("road", width=192))
    with pytest.raises(
        RescoreError, match=r"dau_000001.*: expected polygons in a picture of 96 x 64 pixels, got"
    ):
        read_dataset(tmp_path)


def argoverse_camera(side: str, y: float, rect: str = "_rect") -> dict[str, object]:
    value: dict[str, object] = {
        "focal_length_x_px_": own.FX,
        "focal_length_y_px_": own.FX,
        "focal_center_x_px_": 48,
    }
    place = {"rotation": {"coefficients": [0.5, -0.5, 0.5, -0.5]}, "translation": [1.6, y, 1.4]}
    value |= {"focal_center_y_px_": 32, "vehicle_SE3_camera_": place}
    return {"key": f"image_raw_stereo_front_{side}{rect}", "value": value}


def test_the_calibration_of_argoverse(tmp_path: Path) -> None:
    argoverse(tmp_path)
    both = [argoverse_camera("left", 0.25), argoverse_camera("right", 0.25 - own.BASELINE_M)]
    file = own.write_text(tmp_path / "log1/vehicle_calibration_info.json", json.dumps({"camera_data_": both}))
    check(read_dataset(tmp_path), STEREO["Argoverse"][1], None)
    own.write_text(file, json.dumps({"camera_data_": [argoverse_camera("left", 0.25)]}))
    with pytest.raises(
        RescoreError, match="expected the cameras stereo_front_left_rect and stereo_front_right"
    ):
        read_dataset(tmp_path)


def test_a_part_of_kittis_raw_data(tmp_path: Path) -> None:
    kitti_raw(tmp_path)
    date = tmp_path / "2011_09_26"
    check(read_dataset(date / "2011_09_26_drive_0001_sync"), ["0000000000", "0000000001"], None)
    shorter = [n.removeprefix("2011_09_26-") for n in STEREO["KITTI raw"][1]]
    check(read_dataset(date), shorter, None)


def test_frames_of_sequences_have_ids_and_names_for_detections(tmp_path: Path) -> None:
    several_plain(tmp_path)
    data = read_dataset(tmp_path)
    assert [f.image_id for f in data.frames] == [1, 2, 3, 4]
    assert [t.annotation_id.tolist() for t in data.truth.values()] == [[1], [], [], [2, 3]]
    own.write_text(tmp_path / "found" / "b-a.txt", f"{own.KITTI_CAR} 0.7\n")
    assert read_detections(tmp_path / "found", data).table.image_id.tolist() == [3]
    file = own.write_text(
        tmp_path / "found.json", json.dumps([{"image_id": 7, "bbox": [1, 2, 30, 40], "score": 0.5}])
    )
    with pytest.raises(
        RescoreError, match=r"got image_id 7; .*`rescore import DATA --out NEW` writes the id of"
    ):
        read_detections(file, data)


def test_what_the_readers_of_sequences_say_is_said_once(tmp_path: Path) -> None:
    under = [tmp_path / name for name in ("a", "b", "c")]
    for folder in under:
        own.pair_folder(folder)
    notes = [n for n in read_dataset(tmp_path).notes if "no boxes" in n]
    assert len(notes) == 1
    assert notes[0].endswith("(so in 3 of 3 sequences)")


def nuscenes(root: Path) -> None:
    for side in ("CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "CAM_BACK_LEFT", "CAM_BACK_RIGHT"):
        own.write_png(root / "samples" / side / f"n015__{side}__1532.jpg", own.pair()[0])
    own.write_text(root / "v1.0-mini" / "sensor.json", "[]")


def two_calibrations(root: Path) -> None:
    pairs(root, "a/left/{}.png", "a/right/{}.png")
    for name in ("camera_1.json", "camera_2.json"):
        own.write_text(root / name, PLAIN)


def without_right(root: Path) -> None:
    pairs(root, "leftImg8bit/val/ulm/ulm_{}_leftImg8bit.png", "x/ulm_{}_rightImg8bit.png")
    (root / "rightImg8bit").mkdir()


def views_of_a_turn(root: Path) -> None:
    pairs(root, "frames/turn_left_{}.png", "frames/turn_right_{}.png")
    own.write_png(root / "frames" / "straight_0.png", own.pair()[0])


REFUSED: dict[str, tuple[Callable[[Path], object], str]] = {
    "nuScenes": (nuscenes, "samples: expected one pair of folders .*got CAM_BACK_LEFT and CAM_BACK_RIGHT;"),
    "depth without its unit": (
        lambda root: color_and_depth(root, REALSENSE),
        "depth: expected to be told the value of one metre, found nothing; add .*1000",
    ),
    "calibration of which camera": (two_calibrations, "expected one calibration.*found camera_1.json"),
    "no right pictures": (without_right, "leftImg8bit/val/ulm: expected a folder of its name for right"),
    "sides that are no views": (views_of_a_turn, "looked for annotations.json; .*found frames"),
    "measured for a camera alone": (
        lambda root: color_and_depth(root, {"intrinsic_matrix": [1] * 9}),
        "intrinsic_matrix: expected fx, 0, 0, 0, fy, 0, cx, cy, 1",
    ),
}  # fmt: skip


@pytest.mark.parametrize("layout", REFUSED)
def test_what_is_ambiguous_is_refused_in_one_line(tmp_path: Path, layout: str) -> None:
    make, problem = REFUSED[layout]
    make(tmp_path)
    with pytest.raises(RescoreError, match=problem) as refused:
        read_dataset(tmp_path)
    assert "\n" not in str(refused.value)


def test_a_search_for_sequences_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for i in range(5):
        (tmp_path / f"{i}").mkdir()
    own.pair_folder(tmp_path / "9")
    assert len(read_dataset(tmp_path).frames) == 2
    monkeypatch.setattr(sequences, "MOST_FOLDERS", 4)
    with pytest.raises(RescoreError, match="expected a data set"):
        read_dataset(tmp_path)
    (tmp_path / "9").rename(tmp_path / "0" / "9")
    own.pair_folder(tmp_path / "1")
    monkeypatch.setattr(sequences, "MOST_FOLDERS", 3)
    with pytest.raises(RescoreError, match="expected sequences in at most 3 other folders, got more"):
        read_dataset(tmp_path)


def test_a_data_set_of_its_own_is_no_sequence(tmp_path: Path) -> None:
    own.pair_folder(tmp_path / "a")
    own.own_folder(tmp_path / "b")
    data = read_dataset(tmp_path)
    assert [f.left_path.parent.parent.name for f in data.frames] == ["a", "a"]
    assert data.notes[0] == f"{tmp_path}: left out b, data sets of their own; give each alone"


def test_a_folder_of_both_sides_has_pictures_of_both(tmp_path: Path) -> None:
    own.write_png(tmp_path / "right.png", own.pair()[0])
    (tmp_path / "left.png").mkdir()
    with pytest.raises(RescoreError, match="expected pictures called left or l, found none"):
        read_dataset(tmp_path)


def test_the_ground_of_cityscapes_is_turned_in_its_order(tmp_path: Path) -> None:
    """Up in the camera frame is the third row of R_pitch R_roll of the vehicle, in axes ahead, left, up."""
    cityscapes(tmp_path)
    ground = read_dataset(tmp_path).frames[0].ground
    assert ground is not None
    about_left = cv2.Rodrigues(np.array([0, 0.04, 0.0]))[0]
    about_ahead = cv2.Rodrigues(np.array([0.03, 0, 0.0]))[0]
    ahead, left, up = (about_left @ about_ahead)[2]
    assert ground.up == pytest.approx([-left, -up, ahead])
