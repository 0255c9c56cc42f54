from dataclasses import replace

import numpy as np
import pytest

from datasets_synth.presets import RIGS, AlongConfig
from datasets_synth.street.along.heads import Head, ground_of, plane_through, sample_head
from datasets_synth.street.along.road import Road, sample_road
from recon.camera import GroundPlane
from tests.datasets_synth.small_streets import SMALL, frame

PLANE = AlongConfig(bend=0.0, crossfall=0.0)


def _heads(config: AlongConfig, count: int) -> list[tuple[Road, Head]]:
    out = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        road = sample_road(config, rng)
        out.append((road, sample_head(RIGS[seed % len(RIGS)], config, road, rng)))
    return out


def test_a_plane_is_found_again_from_its_points() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        ground = GroundPlane(*(float(v) for v in rng.uniform([1.2, -0.1, -0.05], [1.8, 0.1, 0.05])))
        rays = np.stack([rng.uniform(-0.5, 0.5, 50), rng.uniform(0.2, 0.6, 50), np.ones(50)], axis=1)
        found = plane_through(ground.intersect(rays))
        assert found.height_m == pytest.approx(ground.height_m, abs=1e-9)
        assert found.pitch_rad == pytest.approx(ground.pitch_rad, abs=1e-9)
        assert found.roll_rad == pytest.approx(ground.roll_rad, abs=1e-9)


def test_on_an_even_road_the_ground_has_the_angles_of_the_camera() -> None:
    config = replace(PLANE, pitch_deg=(1.5, 1.5))
    grounds = [ground_of(head, road) for road, head in _heads(config, 30)]
    # the slope of the road is no pitch: the car stands on it
    assert np.allclose([g.pitch_rad for g in grounds], np.radians(1.5), atol=1e-9)
    rolls = np.degrees([g.roll_rad for g in grounds])
    assert np.abs(rolls).max() <= config.roll_deg
    assert rolls.min() < -1
    assert rolls.max() > 1


def test_heights_and_pictures_are_those_of_the_rigs() -> None:
    names = set()
    for road, head in _heads(PLANE, 30):
        names.add(head.rig.name)
        assert head.rig in RIGS
        ground = ground_of(head, road)
        assert head.rig.height_m[0] - 1e-9 <= ground.height_m <= head.rig.height_m[1] + 1e-9
        assert (head.camera.left.width_px, head.camera.left.height_px) == (
            head.rig.width_px,
            head.rig.height_px,
        )
        assert head.rig.baseline_m[0] <= head.camera.baseline_m <= head.rig.baseline_m[1]
        assert road.band_at(head.x_m).role == "road"
        assert head.x_m > 0
        assert np.linalg.det(head.left_from_world[:3, :3]) == pytest.approx(1)
    assert names == {"kitti", "report", "consumer"}


def test_a_camera_that_leans_to_its_right_sees_the_ground_nearer_there() -> None:
    for road, head in _heads(PLANE, 12):
        ground = ground_of(head, road)
        eye = np.linalg.inv(head.left_from_world)[:3, 3]
        right = np.linalg.inv(head.left_from_world)[:3, 0]
        nearer = (eye + right)[2] - road.height_m(*(eye + right)[:2]) < eye[2] - road.height_m(*eye[:2])
        assert nearer == (ground.roll_rad > 0)


@pytest.mark.parametrize("index", range(3))
def test_the_rendered_road_lies_in_the_plane_that_truth_names(index: int) -> None:
    shown = frame(index, replace(SMALL.along, bend=0.0, crossfall=0.0))
    camera, truth = shown.scene.camera, shown.along
    assert truth is not None
    roads = [i + 1 for i, item in enumerate(shown.scene.items) if item.kind == "road"]
    disparity = camera.disparity_px(shown.render.depth_m)
    v, u = np.nonzero(np.isin(shown.render.instance, roads) & (disparity > 0))
    depth = camera.depth_m(disparity[v, u])
    near = depth < 25
    xyz = camera.left.rays(np.stack([u, v], axis=1)[near].astype(float)) * depth[near, None]
    # rails and lawn between them stand out by up to 3 cm
    middle = np.abs(xyz @ truth.ground.up + truth.ground.height_m) < 0.05
    assert middle.mean() > 0.95
    found = plane_through(xyz[middle])
    assert np.degrees(found.pitch_rad - truth.ground.pitch_rad) == pytest.approx(0, abs=0.1)
    assert np.degrees(found.roll_rad - truth.ground.roll_rad) == pytest.approx(0, abs=0.15)
    assert found.height_m == pytest.approx(truth.ground.height_m, abs=0.02)
