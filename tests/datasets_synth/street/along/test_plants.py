import numpy as np
import pytest

from datasets_synth.street.along.plants import PLANTS, coarseness, hedge, plant


@pytest.mark.parametrize("kind", PLANTS)
def test_plants_stand_on_the_ground_and_far_ones_are_coarser(kind: str) -> None:
    near, far = plant(kind, 1), plant(kind, 1, coarse=4)
    assert len(far.faces) < 0.6 * len(near.faces)
    for mesh in (near, far):
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        assert -0.3 < low[2] < 0.25
        assert (low[:2] < 0.05).all()
        assert (high[:2] > -0.05).all()
    # both are about as large as each other
    size, coarse = np.ptp(near.vertices_m, axis=0), np.ptp(far.vertices_m, axis=0)
    assert np.allclose(size, coarse, rtol=0.3)


def test_crowns_leave_gaps_and_no_two_trees_are_the_same() -> None:
    shapes = [plant("broadleaf", v) for v in range(3)]
    assert len({m.vertices_m.tobytes() for m in shapes}) == 3
    for mesh in shapes:
        # clumps are small against the crown: 95 % of the faces are below a thousandth of its outline
        corner = mesh.vertices_m[mesh.faces].astype(float)
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2
        width, _, height = np.ptp(mesh.vertices_m, axis=0)
        assert np.percentile(area, 95) < 0.005 * width * height


def test_hedges_are_as_long_and_as_high_as_asked_for() -> None:
    mesh = hedge(5, 12, 0)
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    assert high[0] - low[0] == pytest.approx(5.0, abs=0.4)
    assert high[2] == pytest.approx(1.2, abs=0.25)
    assert len(hedge(5, 12, 0, coarse=4).faces) < len(mesh.faces)


def test_plants_are_coarser_the_farther_they_stand() -> None:
    steps = [coarseness(y) for y in (3.0, 20.0, 50.0, 120.0)]
    assert steps == sorted(steps)
    assert steps[0] == 1
    assert steps[-1] > steps[1] > 1
