"""Meshes as bodies: what is closed, and what convex pieces fill."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from datasets_synth.cars.models import cars_of_splits, table_cars
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft
from rescore.grasping.cars import TableCar, experiment_cars, solid_of
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.solids import Solid, convex_pieces, is_closed, volumes_m3

GREY = Material("grey", (0.5, 0.5, 0.5))


def box_without(*faces: str) -> Mesh:
    draft = MeshDraft()
    # not around the origin, where an open box could measure as a closed one
    draft.box((3.0, -2.0, 5.0), (4.0, 2.0, 1.5), GREY, skip=faces)
    return draft.mesh()


def test_a_closed_box_has_its_volume_along_every_axis() -> None:
    assert volumes_m3(box_without()) == pytest.approx([12.0, 12.0, 12.0], rel=1e-5)
    assert is_closed(box_without())


def test_a_box_without_a_face_and_a_tube_are_not_closed() -> None:
    for face in ("+z", "+x"):
        assert len(box_without(face).faces) == 10
        assert not is_closed(box_without(face))
    # the holes of a tube cancel in the sum of its faces, but not in its volumes
    assert not is_closed(box_without("+x", "-x"))


def test_a_car_with_a_hole_is_refused_with_its_reason() -> None:
    model = cars_of_splits()["train"][0]
    mesh = model.build(np.random.default_rng(0))
    above = mesh.vertices_m[mesh.faces][:, :, 2].min(axis=1) > 0.5 * model.size_m[2]
    whole = TableCar(Holed(model.shape_id, model.size_m, mesh))
    holed = TableCar(Holed("holed", model.size_m, cut(mesh, ~above)))
    assert isinstance(solid_of(whole), Solid)
    refusal = solid_of(holed)
    assert isinstance(refusal, Refusal)
    assert refusal.cause is Cause.NOT_CLOSED
    assert "holed" in refusal.detail


class Holed:
    def __init__(self, shape_id: str, size_m: tuple[float, float, float], mesh: Mesh) -> None:
        self.shape_id, self.size_m, self.mesh = shape_id, size_m, mesh

    def build(self, rng: np.random.Generator) -> Mesh:
        return self.mesh


def cut(mesh: Mesh, keep: np.ndarray) -> Mesh:
    return replace(
        mesh,
        faces=mesh.faces[keep],
        corner_normals=mesh.corner_normals[keep],
        corner_uv=mesh.corner_uv[keep],
        face_material=mesh.face_material[keep],
        face_part=mesh.face_part[keep],
    )


def test_the_pieces_of_a_car_are_as_large_as_the_car_and_follow_its_roof() -> None:
    sedan = next(c for c in cars_of_splits()["train"] if c.shape_id.startswith("sedan"))
    mesh = sedan.build(np.random.default_rng(0))
    pieces = convex_pieces(mesh, 0.1)
    every = np.concatenate(pieces)
    np.testing.assert_allclose(np.ptp(every, axis=0)[[0, 2]], 0.1 * np.array(sedan.size_m)[[0, 2]], atol=1e-3)
    assert len(pieces) <= 30
    # where the bonnet is, nothing stands as high as the roof
    nose = every[every[:, 0] > 0.1 * 0.4 * sedan.size_m[0]]
    assert nose[:, 2].max() < 0.1 * 0.7 * sedan.size_m[2]
    filled = sum(ConvexHull(p).volume for p in pieces)
    assert filled < 0.8 * 0.001 * np.prod(sedan.size_m)


def test_among_twenty_cars_are_thin_ones_and_one_fragile() -> None:
    cars = experiment_cars(20)
    assert len({c.name for c in cars}) == 20
    thin = [c for c in cars if c.name.endswith("_thin")]
    assert len(thin) >= 3
    assert max(c.size_m[1] for c in thin) < 0.085
    (fragile,) = [c for c in cars if c.fragile]
    assert fragile.name.startswith("formula")
    trained = {c.shape_id for c in table_cars()["train"]}
    assert not trained & {c.name.split(" ")[0].removesuffix("_thin") for c in cars}
