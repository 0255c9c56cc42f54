"""Meshes as bodies: what is closed, and what convex pieces fill."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from datasets_synth.cars.models import cars_of_splits, table_cars
from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.filled import filled
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft
from rescore.grasping import cars
from rescore.grasping.cars import TableCar, experiment_cars, solid_of
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.solids import Solid, convex_pieces, filled_solid, is_closed, volumes_m3

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


def test_pieces_fill_a_body_of_large_triangles_as_one_of_small_ones() -> None:
    draft = MeshDraft()
    draft.box((0.0, 0.0, 0.6), (4.2, 1.7, 0.9), GREY)
    coarse = draft.mesh()
    for mesh in (coarse, split(split(split(coarse)))):
        pieces = convex_pieces(mesh, 1.0)
        volumes = [ConvexHull(p).volume for p in pieces]
        assert len(pieces) == 18
        assert sum(volumes) == pytest.approx(4.2 * 1.7 * 0.9, rel=1e-4)


def split(mesh: Mesh) -> Mesh:
    """The surface with four triangles for each."""
    corners = mesh.vertices_m[mesh.faces]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    four = [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    fine = np.concatenate(four).reshape(-1, 3)
    faces = np.arange(len(fine), dtype=np.int32).reshape(-1, 3)
    # nothing but the shape is looked at
    return replace(mesh, vertices_m=fine, faces=faces)


def test_a_car_without_its_upper_half_is_refused_with_its_reason() -> None:
    car, mesh = sedan()
    above = mesh.vertices_m[mesh.faces][:, :, 2].min(axis=1) > 0.5 * car.size_m[2]
    refusal = solid_of(TableCar(Holed("holed", car.size_m, cut(mesh, ~above))))
    assert isinstance(refusal, Refusal)
    assert refusal.cause is Cause.NOT_CLOSED
    assert "holed" in refusal.detail


@lru_cache(maxsize=1)
def sedan() -> tuple[CarModel, Mesh]:
    car = next(c for c in cars_of_splits()["train"] if c.shape_id.startswith("sedan"))
    return car, car.build(np.random.default_rng(0))


def test_a_car_that_is_not_closed_is_filled_as_the_closed_one() -> None:
    car, mesh = sedan()
    rng = np.random.default_rng(1)
    turned = rng.random(len(mesh.faces)) < 0.5
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    # some faces are missing, others have their inner side outside
    torn = cut(replace(mesh, faces=faces), rng.random(len(faces)) < 0.98)
    assert not is_closed(torn)
    exact, solid = (solid_of(TableCar(Holed(car.shape_id, car.size_m, m))) for m in (mesh, torn))
    assert isinstance(exact, Solid)
    assert isinstance(solid, Solid)
    assert (exact.from_outside, solid.from_outside) == (False, True)
    assert filled(torn).volume_m3 == pytest.approx(float(volumes_m3(mesh).mean()), rel=0.03)
    ends = [np.concatenate(s.hulls_m) for s in (exact, solid)]
    for axis in (0, 2):
        np.testing.assert_allclose(ends[0][:, axis].min(), ends[1][:, axis].min(), atol=1e-3)
        np.testing.assert_allclose(ends[0][:, axis].max(), ends[1][:, axis].max(), atol=1e-3)
    assert len(solid.hulls_m) <= 36
    assert solid.mass_kg == exact.mass_kg
    # a filled box has more of its weight far outside
    assert (solid.inertia_kg_m2 < exact.inertia_kg_m2).all()
    assert (solid.inertia_kg_m2 > 0.5 * exact.inertia_kg_m2).all()


def test_a_closed_car_of_very_many_pieces_is_filled_too(monkeypatch: pytest.MonkeyPatch) -> None:
    car, mesh = sedan()
    monkeypatch.setattr(cars, "_MOST_PIECES", 5)
    solid = solid_of(TableCar(Holed(car.shape_id, car.size_m, mesh)))
    assert isinstance(solid, Solid)
    assert solid.from_outside


def test_a_box_with_a_slit_is_filled_and_one_without_a_face_bounds_nothing() -> None:
    whole = filled(box_without())
    assert whole.volume_m3 == pytest.approx(12.0, rel=0.02)
    np.testing.assert_allclose(whole.middle_m, [3.0, -2.0, 5.0], atol=0.02)
    np.testing.assert_allclose(whole.variance_m2, np.square([4.0, 2.0, 1.5]) / 12, rtol=0.03)
    for gap, volume in ((0.1, 12.0), (1.2, 0.0)):
        slit = MeshDraft()
        # the lid ends before the edge
        slit.box((3.0, -2.0, 5.0), (4.0, 2.0, 1.5), GREY, skip=("+z",))
        slit.panel([(1, -3, 5.75), (5 - gap, -3, 5.75), (5 - gap, -1, 5.75), (1, -1, 5.75)], GREY)
        assert filled(slit.mesh()).volume_m3 == pytest.approx(volume, abs=0.4)
    for mesh in (box_without("+x"), box_without("+z")):
        assert filled_solid("open", mesh, 1.0, np.array([4.0, 2.0, 1.5]), 1.0) is None
        assert filled(mesh).volume_m3 < 0.4


@pytest.mark.parametrize("rise", [0.0, 0.3])
def test_a_sheet_bounds_nothing(rise: float) -> None:
    sheet = MeshDraft()
    sheet.panel([(0, 0, 0), (4, 0, 0), (4, 2, rise), (0, 2, rise)], GREY)
    assert filled_solid("sheet", sheet.mesh(), 1.0, np.array([4.0, 2.0, 1.0]), 1.0) is None


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
    car, mesh = sedan()
    pieces = convex_pieces(mesh, 0.1)
    every = np.concatenate(pieces)
    np.testing.assert_allclose(np.ptp(every, axis=0)[[0, 2]], 0.1 * np.array(car.size_m)[[0, 2]], atol=1e-3)
    assert len(pieces) <= 30
    # where the bonnet is, nothing stands as high as the roof
    nose = every[every[:, 0] > 0.1 * 0.4 * car.size_m[0]]
    assert nose[:, 2].max() < 0.1 * 0.7 * car.size_m[2]
    filled = sum(ConvexHull(p).volume for p in pieces)
    assert filled < 0.8 * 0.001 * np.prod(car.size_m)


def test_among_twenty_cars_are_thin_ones_and_one_fragile() -> None:
    twenty = experiment_cars(20)
    assert len({c.name for c in twenty}) == 20
    thin = [c for c in twenty if c.name.endswith("_thin")]
    assert len(thin) >= 3
    assert max(c.size_m[1] for c in thin) < 0.085
    (fragile,) = [c for c in twenty if c.fragile]
    assert fragile.name.startswith("formula")
    trained = {c.shape_id for c in table_cars()["train"]}
    assert not trained & {c.name.split(" ")[0].removesuffix("_thin") for c in twenty}
