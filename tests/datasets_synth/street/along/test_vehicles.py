import numpy as np
import pytest

from datasets_synth.street.along.vehicles import LAMP, OTHER_VEHICLES, TAIL_LAMP, VEHICLES
from tests.datasets_synth.small_streets import PICTURES


@pytest.mark.parametrize("name", VEHICLES)
def test_vehicles_have_lamps_at_their_noses_and_red_ones_behind(name: str) -> None:
    kind, build = VEHICLES[name]
    assert kind in OTHER_VEHICLES
    mesh = build(np.random.default_rng(4), PICTURES).mesh()
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    assert -0.2 < low[2] < 0.4
    assert abs(low[0] + high[0]) < 0.3
    assert abs(low[1] + high[1]) < 0.3
    length, width, height = high - low
    assert 4 < length < 35
    assert 1.6 < width < 3.0
    assert 1.7 < height < 5.0
    middle = mesh.vertices_m[mesh.faces].mean(axis=1)
    for rgb, sign in ((LAMP, 1), (TAIL_LAMP, -1)):
        skins = [i for i, m in enumerate(mesh.materials) if m.rgb == rgb]
        lamps = middle[np.isin(mesh.face_material, skins)]
        # a pair on both sides, at the end
        assert (sign * lamps[:, 0] > 0.4 * length).all()
        assert lamps[:, 1].min() < -0.4
        assert lamps[:, 1].max() > 0.4
