from itertools import pairwise

import numpy as np
import pytest

from datasets_synth.meshes.mesh import Mesh
from datasets_synth.street.facades import DEPTH_M, DOOR_HEIGHT_M, facade
from datasets_synth.street.street import KERB_HEIGHT_M, ground_height_m, ground_items, sample_strips


@pytest.mark.parametrize("seed", range(25))
def test_strips_join_without_gaps_and_carry_the_lane_asked_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted = float(rng.uniform(8, 44))
    strips = sample_strips(wanted, rng)
    assert strips[0].y0_m < 0  # the camera stands on ground
    for a, b in pairwise(strips):
        assert a.y1_m == pytest.approx(b.y0_m)
        assert a.y1_m > a.y0_m
    lanes = [y for s in strips if s.role == "road" for y in s.lanes_m]
    assert min(abs(y - wanted) for y in lanes) < 1e-9
    for strip in strips:
        assert strip.z_m in (0.0, KERB_HEIGHT_M)
        assert strip.z_m == 0.0 or not strip.lanes_m  # cars stand on the ground plane of the camera
        for lane in strip.lanes_m:
            assert strip.y0_m + 0.9 < lane < strip.y1_m - 0.9


def test_the_kerb_is_a_real_step_and_the_ground_lies_where_the_strips_say() -> None:
    rng = np.random.default_rng(2)
    strips = sample_strips(12.0, rng)
    road = next(s for s in strips if s.role == "road")
    assert ground_height_m(strips, road.y0_m + 0.1) == 0.0
    assert ground_height_m(strips, road.y0_m - 0.1) == KERB_HEIGHT_M
    items = ground_items(strips, 30.0, 100.0, rng)
    kerb = next(i for i in items if i.kind == "kerb")
    assert kerb.mesh.vertices_m[:, 2].max() == pytest.approx(KERB_HEIGHT_M, abs=0.01)
    assert {i.kind for i in items} <= {"road", "pavement", "verge", "square", "kerb"}


@pytest.mark.parametrize("seed", range(8))
def test_a_house_has_storeys_of_three_metres_and_nothing_reaches_far_into_the_street(seed: int) -> None:
    mesh = facade(10.0, 3, np.random.default_rng(seed)).mesh()
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    # ground floor of 3.2 to 3.9 m, two storeys of 3 m, an eave of 0.6 m, a roof of at most 0.9 x 4 m
    assert 3.2 + 6 + 0.6 - 0.01 <= high[2] <= 3.9 + 6 + 0.6 + 3.7
    assert low[2] >= -0.2
    assert low[1] >= -1.1
    assert DOOR_HEIGHT_M == 2.1


def _crossing_side(mesh: Mesh, x_m: float, materials: str) -> int:
    """Faces of a house whose corners lie within 5 cm of a side wall and whose material has a name."""
    corners = mesh.vertices_m[mesh.faces]
    at_side = (np.abs(corners[..., 0] - x_m) < 0.05).all(axis=1)
    named = np.array([materials in m.name for m in mesh.materials])[mesh.face_material]
    return int((at_side & named).sum())


@pytest.mark.parametrize("seed", range(6))
def test_houses_that_are_seen_obliquely_have_windows_in_their_sides_and_closed_gables(seed: int) -> None:
    front, whole = (
        facade(9.0, 3, np.random.default_rng(seed), is_seen_obliquely=s).mesh() for s in (False, True)
    )
    for x in (0.0, 9.0):
        assert _crossing_side(front, x, "pane") == 0
    assert sum(_crossing_side(whole, x, "pane") for x in (0.0, 9.0)) > 0
    # the triangle between the wall and the ridge, which runs along the middle of the house
    for mesh, closed in ((front, False), (whole, True)):
        corners = mesh.vertices_m[mesh.faces].astype(float)
        top = corners[..., 2] > mesh.vertices_m[:, 2].max() - 0.01
        ridge = (top & (np.abs(corners[..., 1] - DEPTH_M / 2) < 0.01)).any(axis=1)
        gable = ridge & (np.ptp(corners[..., 0], axis=1) < 0.05)
        assert bool(gable.any()) == (closed and bool(ridge.any()))


def test_some_roofs_are_pitched_and_some_are_flat() -> None:
    tops = [facade(9.0, 3, np.random.default_rng(s)).mesh().vertices_m for s in range(6)]
    pitched = [abs(v[v[:, 2].argmax(), 1] - DEPTH_M / 2) < 0.01 for v in tops]
    assert 0 < sum(pitched) < 6
