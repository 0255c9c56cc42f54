"""The body of a car without what stands out from it."""

import numpy as np
import pytest
import trimesh

from datasets_synth.cars.body_extent import body_extent
from datasets_synth.cars.cars import car_mesh
from datasets_synth.cars.shapes import car_shapes


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    """Triangles (12, 3, 3) of a box."""
    solid = trimesh.creation.box(bounds=[low, high])
    return np.asarray(solid.vertices[solid.faces], float)


def test_mirrors_aerial_and_exhaust_are_no_body() -> None:
    body = box((-2.0, -0.9, 0.0), (2.0, 0.9, 1.4))
    mirrors = [box((0.5, y, 0.9), (0.75, y + 0.2, 1.1)) for y in (-1.1, 0.9)]
    aerial, exhaust = box((-1.0, 0.0, 1.4), (-0.98, 0.02, 1.8)), box((-2.1, 0.5, 0.2), (-2.0, 0.6, 0.3))
    low, high = body_extent(np.concatenate([body, *mirrors, aerial, exhaust]))
    assert low == pytest.approx([-2.0, -0.9, 0.0])
    assert high == pytest.approx([2.0, 0.9, 1.4])


def test_an_open_car_is_as_high_as_the_frame_of_its_windscreen() -> None:
    tub, frame = box((-2.0, -0.9, 0.0), (2.0, 0.9, 0.9)), box((0.2, -0.6, 0.9), (0.3, 0.6, 1.3))
    assert body_extent(np.concatenate([tub, frame]))[1][2] == pytest.approx(1.3)


@pytest.mark.parametrize("index", [0, 9, 18, 27, 36, 45, 54, 63])
def test_parametric_cars_measure_what_their_shape_says(index: int) -> None:
    shape = car_shapes()[index]
    mesh = car_mesh(shape, np.random.default_rng(0))
    low, high = body_extent(mesh.vertices_m[mesh.faces].astype(float))
    assert high - low == pytest.approx(np.array(shape.size_m), abs=0.02)
