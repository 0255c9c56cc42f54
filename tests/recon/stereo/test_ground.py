"""The ground plane is found among walls, cars, noise and holes; and where it is not seen, that is said."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recon.camera import GroundPlane, StereoCamera, default_camera
from recon.stereo.ground import GroundDoubt, GroundEstimate, estimate_ground
from rescore.data.frames import load_frame
from rescore.evidence.settings import automatic_stereo
from rescore.formats.open import read_dataset

CAMERA = StereoCamera(default_camera(640, 480), 0.35)
GROUND = GroundPlane(1.5, np.radians(2))
V, U = np.mgrid[:480, :640].astype(float)
RAYS = CAMERA.left.rays(np.stack([U, V], axis=-1))
Disparity = np.ndarray[tuple[int, int], np.dtype[np.float32]]


def plane(ground: GroundPlane = GROUND) -> np.ndarray:
    """Depth of a plane, infinite above the horizon."""
    slope = RAYS @ ground.up
    return np.where(slope < -1e-6, -ground.height_m / np.minimum(slope, -1e-6), np.inf)


def street(depth_m: np.ndarray, wall_m: float = 30.0) -> Disparity:
    return CAMERA.disparity_px(np.minimum(depth_m, wall_m))


def found(disparity: Disparity, seed: int = 0) -> GroundEstimate:
    return estimate_ground(disparity, CAMERA, np.random.default_rng(seed))


def assert_is(estimate: GroundEstimate, ground: GroundPlane, height_m: float, pitch_deg: float) -> None:
    assert estimate.trusted, (estimate.doubt, estimate.detail)
    assert estimate.detail == ""
    assert estimate.ground is not None
    assert estimate.ground.height_m == pytest.approx(ground.height_m, abs=height_m)
    assert np.degrees(estimate.ground.pitch_rad - ground.pitch_rad) == pytest.approx(0, abs=pitch_deg)


@pytest.mark.parametrize("height_m", [0.6, 1.5, 3.5])
@pytest.mark.parametrize("pitch_deg", [-4.0, 0.0, 2.0, 20.0])
def test_a_bare_plane_is_found_exactly(height_m: float, pitch_deg: float) -> None:
    ground = GroundPlane(height_m, np.radians(pitch_deg))
    estimate = found(street(plane(ground), np.inf))
    assert_is(estimate, ground, 1e-4, 1e-3)
    assert np.degrees(estimate.ground.roll_rad) == pytest.approx(0, abs=1e-3)
    assert estimate.support is not None
    assert estimate.support.residual_px < 1e-3
    assert estimate.support.below == 0


def test_support_is_what_is_seen() -> None:
    support = found(street(plane())).support
    assert support is not None
    # at 30 m the wall begins: y = fy (height - 30 sin(2 deg)) / (30 cos(2 deg)) = 672 * 0.0151 = 10.2 rows
    # below the principal point, of 480; its foot has nearly the disparity of the ground that it hides
    assert support.area == pytest.approx((240 - 10.2) / 480, abs=0.04)
    assert support.on == pytest.approx(1.0, abs=0.02)
    # 90 per cent of the columns lie between the 5th and the 95th percentile
    assert support.width == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize("roll_deg", [-3.0, 1.0, 3.0])
def test_roll_is_found(roll_deg: float) -> None:
    ground = replace(GROUND, roll_rad=np.radians(roll_deg))
    estimate = found(street(plane(ground), np.inf))
    assert_is(estimate, ground, 1e-3, 1e-2)
    assert np.degrees(estimate.ground.roll_rad) == pytest.approx(roll_deg, abs=1e-2)


def test_much_roll_is_not_trusted() -> None:
    estimate = found(street(plane(replace(GROUND, roll_rad=np.radians(8.0)))))
    assert (estimate.doubt, estimate.detail) == (
        GroundDoubt.IMPLAUSIBLE,
        "roll 8.0 degrees, expected -6.0 degrees to 6.0 degrees",
    )


def cluttered(rng: np.random.Generator) -> Disparity:
    """The street between two walls, with three cars, noise, wild matches and holes of 40 per cent."""
    depth = plane()
    x = RAYS[..., 0]
    depth = np.minimum(depth, np.where(np.abs(x) > 1e-9, 6.0 / np.maximum(np.abs(x), 1e-9), np.inf))
    for left, right, near in ((-4.0, -2.2, 9.0), (1.5, 3.3, 7.0), (-0.5, 1.3, 16.0)):
        height = depth_height = near * (RAYS @ GROUND.up) + GROUND.height_m
        front = (x * near > left) & (x * near < right) & (height > 0) & (depth_height < 1.5)
        depth = np.where(front, np.minimum(depth, near), depth)
    disparity = street(depth) + rng.normal(0, 0.4, depth.shape).astype(np.float32)
    wild = rng.random(depth.shape) < 0.05
    disparity = np.where(wild, rng.uniform(1, 64, depth.shape), disparity).astype(np.float32)
    return np.where(rng.random(depth.shape) < 0.4, np.float32(np.nan), disparity)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_found_among_walls_cars_noise_and_holes(seed: int) -> None:
    estimate = found(cluttered(np.random.default_rng(seed)), seed)
    assert_is(estimate, GROUND, 0.02, 0.15)
    assert estimate.support is not None
    assert 0 < estimate.support.height_sd_m < 0.02
    assert 0 < np.degrees(estimate.support.pitch_sd_rad) < 0.15


def test_standard_errors_are_those_of_repeated_noise() -> None:
    rng = np.random.default_rng(5)
    clean = street(plane())
    estimates = [found(clean + rng.normal(0, 0.4, clean.shape).astype(np.float32)) for _ in range(20)]
    heights = [e.ground.height_m for e in estimates if e.ground]
    pitches = [e.ground.pitch_rad for e in estimates if e.ground]
    supports = [e.support for e in estimates if e.support]
    assert len(heights) == len(supports) == 20
    # of 20 draws the standard deviation itself is known to 1 / sqrt(38) = 16 per cent; 2.5 times that
    assert np.std(heights) == pytest.approx(np.mean([s.height_sd_m for s in supports]), rel=0.4)
    assert np.std(pitches) == pytest.approx(np.mean([s.pitch_sd_rad for s in supports]), rel=0.4)


def test_noise_that_is_alike_over_an_area_makes_larger_errors() -> None:
    rng = np.random.default_rng(0)
    fine = rng.normal(0, 0.3, (480, 640))
    coarse = np.kron(rng.normal(0, 0.3, (15, 20)), np.ones((32, 32)))
    a, b = (found((street(plane()) + noise).astype(np.float32)).support for noise in (fine, coarse))
    assert a is not None
    assert b is not None
    assert b.height_sd_m > 2 * a.height_sd_m


@pytest.mark.parametrize("kerb_m", [0.12, -0.12])
def test_of_two_levels_the_larger_is_found(kerb_m: float) -> None:
    other = GroundPlane(GROUND.height_m - kerb_m, GROUND.pitch_rad)
    # right of the middle the ground is a kerb higher or lower
    depth = np.where(U > 420, plane(other), plane())
    assert_is(found(street(depth)), GROUND, 0.02, 0.2)


def test_a_table_before_the_floor_is_not_the_ground() -> None:
    floor = GroundPlane(2.2, GROUND.pitch_rad)
    table = np.where(
        (U > 60) & (U < 580) & (V > 400), plane(GroundPlane(0.6, GROUND.pitch_rad)), plane(floor)
    )
    estimate = found(street(table))
    assert_is(estimate, floor, 0.02, 0.1)


def far_wall() -> Disparity:
    return np.full((480, 640), CAMERA.disparity_px(np.array(6.0)), np.float32)


def only(part: np.ndarray) -> Disparity:
    return np.where(part, street(plane()), np.float32(np.nan))


UNSEEN: list[tuple[Disparity, set[GroundDoubt]]] = [
    (np.full((480, 640), np.nan, np.float32), {GroundDoubt.FEW_MEASUREMENTS}),
    (np.full((480, 640), np.inf, np.float32), {GroundDoubt.FEW_MEASUREMENTS}),
    (far_wall(), {GroundDoubt.NO_PLANE}),
    # nothing but what stands 60 m off and more, or the sky
    (np.full((480, 640), 1.0, np.float32), {GroundDoubt.FEW_MEASUREMENTS}),
    # a strip, first across and then along the view
    (only((V > 400) & (V < 440)), {GroundDoubt.SMALL_SPREAD}),
    (only((U > 300) & (U < 400)), {GroundDoubt.SMALL_SPREAD}),
    (only((U > 300) & (U < 340)), {GroundDoubt.FEW_MEASUREMENTS, GroundDoubt.LITTLE_SUPPORT}),
    (street(plane(GroundPlane(0.42, 0.0))), {GroundDoubt.IMPLAUSIBLE}),
    (street(plane(GroundPlane(4.5, 0.2))), {GroundDoubt.IMPLAUSIBLE}),
    (street(plane(GroundPlane(1.5, np.radians(-12))), 60.0), {GroundDoubt.IMPLAUSIBLE}),
]


@pytest.mark.parametrize(("disparity", "doubts"), UNSEEN)
def test_where_no_ground_is_seen_it_is_not_trusted(disparity: Disparity, doubts: set[GroundDoubt]) -> None:
    estimate = found(disparity)
    assert not estimate.trusted
    assert estimate.doubt in doubts
    assert estimate.detail


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_no_ground(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fine = rng.uniform(1, 64, (480, 640)).astype(np.float32)
    coarse = np.kron(rng.uniform(1, 64, (30, 40)), np.ones((16, 16))).astype(np.float32)
    assert not found(fine).trusted
    assert not found(coarse).trusted


def test_a_wall_behind_a_window_lies_below() -> None:
    # mirrored in water, the wall seems to be as far below the ground as it stands above
    depth = np.where((V > 300) & (U > 120) & (U < 520), 30.0, plane())
    estimate = found(street(depth))
    assert estimate.doubt is GroundDoubt.MUCH_BELOW


def test_a_rough_field_is_not_even() -> None:
    rng = np.random.default_rng(0)
    rough = street(plane()) + rng.normal(0, 1.5, (480, 640)).astype(np.float32)
    assert found(rough).doubt is GroundDoubt.UNEVEN


def test_the_same_seed_gives_the_same_plane() -> None:
    disparity = cluttered(np.random.default_rng(0))
    assert found(disparity, 3) == found(disparity, 3)
    a, b = found(disparity, 3).ground, found(disparity, 4).ground
    assert a is not None
    assert b is not None
    assert a.height_m == pytest.approx(b.height_m, abs=2e-3)


def test_nothing_depends_on_the_size_of_the_picture() -> None:
    small = StereoCamera(default_camera(160, 120), 0.35)
    # a quarter as many pixels in each direction: a quarter of the disparity
    disparity = street(plane(), np.inf)[2::4, 2::4] / 4
    camera = replace(small, left=replace(small.left, fx_px=168, fy_px=168, cx_px=79.375, cy_px=59.375))
    estimate = estimate_ground(disparity, camera, np.random.default_rng(0))
    assert_is(estimate, GROUND, 1e-3, 1e-2)


def test_real_streets(kitti: Path) -> None:
    data = read_dataset(kitti)
    stereo = automatic_stereo(data)
    heights, pitches = {}, {}
    for record in (r for r in data.frames if r.image_id in (1558, 7322, 107)):
        frame = load_frame(record, stereo)
        assert frame.camera is not None
        estimate = estimate_ground(frame.disparity_px, frame.camera, np.random.default_rng(0))
        assert estimate.trusted, (record.image_id, estimate)
        assert estimate.ground is not None
        heights[record.image_id] = estimate.ground.height_m
        pitches[record.image_id] = np.degrees(estimate.ground.pitch_rad)
    # the place of 1558 rises before the camera
    assert pitches.pop(1558) == pytest.approx(3.5, abs=0.5)
    assert heights.pop(1558) == pytest.approx(1.87, abs=0.1)
    # 1.65 m above the road, says KITTI; cars lean and load
    assert max(abs(h - 1.65) for h in heights.values()) < 0.08
    assert max(abs(p) for p in pitches.values()) < 1.0
