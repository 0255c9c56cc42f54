from dataclasses import replace

import numpy as np
import pytest

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.presets import AlongConfig
from datasets_synth.render.truth import VisibleObject
from datasets_synth.street.along.truth import annotation, box3d, camera_record, is_counted, occlusion
from datasets_synth.street.along.vehicles import OTHER_VEHICLES
from recon.arrays import FloatArray
from recon.camera import GroundPlane
from tests.datasets_synth.small_streets import SMALL, frame

FRAMES = range(4)
SIZES = {m.shape_id: m.size_m for m in cars_of_splits()["train"]}


def corners_of(box: FloatArray) -> FloatArray:
    """Corners (8, 3) of a 3D box as KITTI defines it, camera frame."""
    x, y, z, length, width, height, turn = box
    local = np.array([(a, b, c) for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-0.5, 0.5)])
    local = local * (length, height, width)
    c, s = np.cos(turn), np.sin(turn)
    # about the camera's y, which points down
    about_y = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    return np.asarray(local @ about_y.T + (x, y, z))


@pytest.mark.parametrize("index", FRAMES)
def test_3d_boxes_project_onto_the_boxes(index: int) -> None:
    shown = frame(index)
    camera = shown.scene.camera.left
    whole = [v for v in shown.cars if v.truncated_share == 0]
    for vehicle in whole:
        box = box3d(shown.scene.items[vehicle.item], shown.scene, SIZES)
        uv = camera.project(corners_of(box)) + 0.5
        projected = np.concatenate([uv.min(axis=0), uv.max(axis=0)])
        # the body in its box: mirrors stand out, round corners do not fill it, and KITTI's boxes do not lean
        size = vehicle.xyxy_px[2:] - vehicle.xyxy_px[:2]
        assert np.abs((projected - vehicle.xyxy_px) / np.tile(size, 2)).max() < 0.22


def test_some_vehicles_are_whole() -> None:
    assert sum(v.truncated_share == 0 for i in FRAMES for v in frame(i).cars) > 12


@pytest.mark.parametrize("index", FRAMES)
def test_azimuths_agree_with_3d_boxes(index: int) -> None:
    shown = frame(index)
    for vehicle in shown.cars:
        x, _, z, *_, turn = box3d(shown.scene.items[vehicle.item], shown.scene, SIZES)
        # direction to the camera less direction of the nose, both counter-clockwise from above
        wanted = np.degrees(np.arctan2(-z, -x) + turn)
        away = (vehicle.azimuth_deg - wanted + 180) % 360 - 180
        assert abs(away) < 2.5
        assert (turn + vehicle.yaw_rad + np.pi) % (2 * np.pi) - np.pi == pytest.approx(0, abs=0.01)


def test_the_middle_of_a_box_stands_half_its_height_above_the_ground() -> None:
    for index in FRAMES:
        shown = frame(index)
        assert shown.along is not None
        for vehicle in shown.cars:
            placed = shown.scene.items[vehicle.item]
            box = box3d(placed, shown.scene, SIZES)
            foot = vehicle.position_cam_m
            assert np.linalg.norm(box[:3] - foot) == pytest.approx(box[5] / 2, abs=0.2)
            assert box[1] < foot[1]


def test_sizes_are_those_of_the_body_without_mirrors() -> None:
    for shown in map(frame, FRAMES):
        for vehicle in shown.cars:
            placed = shown.scene.items[vehicle.item]
            _, _, _, length, width, height, _ = box3d(placed, shown.scene, SIZES)
            measured = box3d(placed, shown.scene, {})
            assert (length, width, height) == pytest.approx(measured[3:6], abs=0.02)
            assert np.linalg.norm(box3d(placed, shown.scene, SIZES)[:3] - measured[:3]) < 0.02
            if placed.kind == "car":
                assert vehicle.size_m[1] - 0.5 < width < vehicle.size_m[1] - 0.1


def _seen(**changes: object) -> VisibleObject:
    first = next(v for index in FRAMES for v in frame(index).cars)
    fair = replace(
        first,
        xyxy_px=np.array([10.0, 10.0, 60.0, 40.0]),
        visible_share=0.9,
        truncated_share=0.0,
        azimuth_deg=0.0,
    )
    return replace(fair, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("azimuth", [0.0, 45.0, 90.0, 180.0, 300.0])
def test_cars_are_counted_in_every_view(azimuth: float) -> None:
    assert is_counted(_seen(azimuth_deg=azimuth), "car", AlongConfig())


@pytest.mark.parametrize(
    ("changes", "counted"),
    [
        ({"visible_share": 0.31}, True),
        ({"visible_share": 0.29}, False),
        ({"truncated_share": 0.49}, True),
        ({"truncated_share": 0.51}, False),
        ({"xyxy_px": np.array([10.0, 10.0, 40.0, 28.0])}, True),
        ({"xyxy_px": np.array([10.0, 10.0, 40.0, 27.9])}, False),
    ],
)
def test_hidden_cut_and_small_cars_are_ignored(changes: dict[str, object], counted: bool) -> None:
    assert is_counted(_seen(**changes), "car", AlongConfig()) is counted


@pytest.mark.parametrize("kind", OTHER_VEHICLES)
def test_other_vehicles_are_never_counted(kind: str) -> None:
    assert not is_counted(_seen(), kind, AlongConfig())


def test_levels_of_occlusion_are_kittis() -> None:
    assert [occlusion(s) for s in (1.0, 0.9, 0.89, 0.5, 0.49, 0.01)] == [0, 0, 1, 1, 2, 2]


def test_annotations_say_what_is_seen() -> None:
    kinds = set()
    for index in FRAMES:
        shown = frame(index)
        for vehicle in shown.cars:
            record = annotation(vehicle, shown.scene, SIZES, SMALL.along)
            kinds.add(record["kind"])
            assert record["kind"] == shown.scene.items[vehicle.item].kind
            assert len(record["bbox3d"]) == 7
            assert record["ignore"] in (0, 1)
            assert record["kind"] == "car" or record["ignore"] == 1
            assert record["visibility"] > 0
            if not record["ignore"]:
                assert record["bbox"][3] >= SMALL.along.min_height_px - 0.01
    assert "car" in kinds
    assert kinds & set(OTHER_VEHICLES)


def test_a_camera_record_states_the_ground_it_is_given() -> None:
    scene = frame(0).scene
    without = camera_record(scene, None)
    assert not {"height_m", "pitch_rad", "roll_rad"} & set(without)
    stated = camera_record(scene, GroundPlane(1.5, 0.02, -0.01))
    assert stated == {**without, "height_m": 1.5, "pitch_rad": 0.02, "roll_rad": -0.01}
