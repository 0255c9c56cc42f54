from collections.abc import Callable

import numpy as np
import pytest

from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.street.distractors import PROPS, Prop
from datasets_synth.street.prop_parts import printed
from datasets_synth.street.prop_prints import billboard, mural
from datasets_synth.street.prop_vehicles import trailer_picture

PICTURE = np.zeros((60, 100, 3), np.uint8)
PICTURE[:, :50] = (200, 30, 30)  # its left half is red, so a mirrored print would show
PICTURE[:10] = (250, 250, 250)  # and its top is white, so would one upside down


@pytest.mark.parametrize("prop", PROPS, ids=lambda p: p.kind)
@pytest.mark.parametrize("seed", range(4))
def test_every_prop_is_a_sound_mesh_of_a_sensible_size_on_the_ground(prop: Prop, seed: int) -> None:
    mesh = prop.build(np.random.default_rng(seed), (PICTURE,)).mesh()
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    assert np.isfinite(mesh.vertices_m).all()
    assert np.isfinite(mesh.corner_normals).all()
    assert mesh.faces.max() < len(mesh.vertices_m)
    assert mesh.face_material.max() < len(mesh.materials)
    assert -0.35 <= low[2] <= 0.12  # stands on the ground, does not float
    assert 0.4 <= high[2] <= 10
    assert high[0] - low[0] <= 13
    if prop.kind not in ("tree", "trunk"):
        assert high[1] - low[1] <= 3.0
    assert not mesh.face_part.any()


@pytest.mark.parametrize("kind", [p.kind for p in PROPS if p.needs_pictures])
def test_props_with_pictures_show_one(kind: str) -> None:
    prop = next(p for p in PROPS if p.kind == kind)
    shown = [
        any(m.name == "print" for m in prop.build(np.random.default_rng(s), (PICTURE,)).mesh().materials)
        for s in range(8)
    ]
    assert sum(shown) >= 6


@pytest.mark.parametrize("make", [billboard, mural, trailer_picture], ids=lambda m: m.__name__)
def test_a_print_shows_its_picture_upright_and_not_mirrored(make: Callable[..., MeshDraft]) -> None:
    mesh = make(np.random.default_rng(0), (PICTURE,)).mesh()
    face = np.flatnonzero([mesh.materials[i].name == "print" for i in mesh.face_material])
    corner, uv = mesh.vertices_m[mesh.faces[face]], mesh.corner_uv[face]
    # seen from the camera (looking along +y) x runs to the right and z up: so must u and v
    assert np.all(mesh.corner_normals[face][..., 1] < -0.99)
    assert np.corrcoef(corner[..., 0].ravel(), uv[..., 0].ravel())[0, 1] > 0.999
    assert np.corrcoef(corner[..., 2].ravel(), uv[..., 1].ravel())[0, 1] > 0.999


def test_prints_keep_the_picture_the_right_way_round() -> None:
    for seed in range(6):
        out = printed(PICTURE, np.random.default_rng(seed)).astype(int)
        h, w = out.shape[:2]
        middle = out[int(0.45 * h) : int(0.6 * h)]
        left, right = middle[:, int(0.2 * w)], middle[:, int(0.8 * w)]
        assert (left[:, 0] > right[:, 0] + 40).all()
