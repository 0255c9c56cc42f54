"""The further cars of the table: racers and other kinds, beside the family that streets show."""

from dataclasses import replace

import numpy as np
import pytest

from datasets_synth.cars.add_ons import add_ons
from datasets_synth.cars.body import BodyLines
from datasets_synth.cars.body_extent import body_extent
from datasets_synth.cars.cars import car_mesh
from datasets_synth.cars.models import cars_of_splits, table_cars
from datasets_synth.cars.parts import CAR_PARTS, PART_LABEL
from datasets_synth.cars.shapes import AddOns, BodyForm, CarShape, car_shapes
from datasets_synth.cars.table_shapes import KINDS, table_shapes
from datasets_synth.meshes.mesh import Mesh
from rescore.data.frames import SPLITS

SHAPES = table_shapes()
FIRST = tuple(next(s for s in SHAPES if s.shape_id.startswith(kind)) for kind in KINDS)


def mesh_of(shape: CarShape) -> Mesh:
    return car_mesh(shape, np.random.default_rng(1))


def corners_of(mesh: Mesh, part: str) -> np.ndarray:
    return np.asarray(mesh.vertices_m[mesh.faces[mesh.face_part == PART_LABEL[part]]])


def test_every_kind_is_learned_from_and_tested_on_and_no_shape_twice() -> None:
    cars = table_cars()
    names = [c.shape_id for split in SPLITS for c in cars[split]]
    assert len(names) == len(set(names)) == len(SHAPES) + len(car_shapes())
    for split in ("train", "test", "validation"):
        found = {c.shape_id[:-3] for c in cars[split]}
        assert set(KINDS) < found


def test_cars_of_streets_stay_as_they_are_and_come_first() -> None:
    for split, models in cars_of_splits().items():
        assert [c.shape_id for c in table_cars()[split][: len(models)]] == [c.shape_id for c in models]
        assert not {c.shape_id for c in models} & {s.shape_id for s in SHAPES}


@pytest.mark.parametrize("shape", FIRST, ids=lambda s: s.shape_id)
def test_body_measures_what_the_shape_says_and_stands_in_the_middle(shape: CarShape) -> None:
    mesh = mesh_of(shape)
    low, high = body_extent(mesh.vertices_m[mesh.faces].astype(float))
    assert high - low == pytest.approx(shape.size_m, abs=0.02)
    assert (low + high)[:2] == pytest.approx(0.0, abs=0.02)
    assert low[2] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("shape", FIRST, ids=lambda s: s.shape_id)
def test_both_halves_are_alike_and_wheels_reach_the_ground(shape: CarShape) -> None:
    mesh = mesh_of(shape)
    left, right = corners_of(mesh, "left_body"), corners_of(mesh, "right_body")
    assert left[..., 1].max() == pytest.approx(-right[..., 1].min(), abs=1e-5)
    wheels = [p for p in CAR_PARTS if p.endswith("wheel")]
    assert all(corners_of(mesh, p)[..., 2].min() == pytest.approx(0.0, abs=1e-3) for p in wheels)


@pytest.mark.parametrize("shape", [s for s in FIRST if s.add_ons != AddOns()], ids=lambda s: s.shape_id)
def test_what_is_added_is_closed_with_its_outer_side_outside(shape: CarShape) -> None:
    for piece in add_ons(BodyLines(shape)):
        assert piece.part.all()
        c = piece.corners_m
        area = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) / 2
        # open in the middle plane, where the other half joins
        assert np.abs(area.sum(axis=0)[[0, 2]]).max() < 1e-6
        assert (area * c.mean(axis=1)).sum(axis=0) == pytest.approx(
            np.full(3, (area * c.mean(axis=1)).sum() / 3)
        )
        assert (area * c.mean(axis=1)).sum() > 0


def test_wings_stand_over_the_tail_and_free_wheels_beside_the_body() -> None:
    by_kind = dict(zip(KINDS, FIRST, strict=True))
    racer, formula = by_kind["racer"], by_kind["formula"]
    rear = corners_of(mesh_of(racer), "rear").reshape(-1, 3)
    assert rear[:, 2].max() == pytest.approx(racer.add_ons.wing_z, abs=1e-3)
    assert racer.add_ons.wing_z > racer.tail_z + 0.1
    mesh = mesh_of(formula)
    wheel = corners_of(mesh, "front_left_wheel").reshape(-1, 3)
    assert wheel[:, 1].max() == pytest.approx(0.5 * formula.add_ons.track, abs=0.02)
    assert wheel[:, 1].min() > 0.5 * formula.width - 0.05


def test_a_spare_wheel_lengthens_the_car_behind() -> None:
    shape = next(s for s in FIRST if s.add_ons.spare)
    mesh = mesh_of(shape)
    wheels = np.concatenate([corners_of(mesh, p) for p in CAR_PARTS if p.startswith("front_left_w")])
    assert shape.size_m[0] == pytest.approx(shape.length + shape.add_ons.spare)
    assert wheels[..., 0].mean() == pytest.approx(0.5 * shape.size_m[0] - shape.axles_t[0], abs=0.02)


def test_only_shapes_to_learn_from_have_forms_of_their_own() -> None:
    learned = {c.shape_id for c in table_cars()["train"]}
    assert {s.shape_id for s in SHAPES if s.form != BodyForm()} == {s.shape_id for s in SHAPES} & learned
    assert all(s.form == BodyForm() for s in car_shapes())


def test_a_form_moves_sill_ends_and_crown_by_what_it_says() -> None:
    shape = FIRST[0]
    usual = BodyLines(replace(shape, form=BodyForm()))
    other = BodyLines(replace(shape, form=BodyForm(sill_tuck=0.015, end_tuck=0.03, crown=1.5)))
    t, z = np.array([0.5 * shape.length]), np.array([shape.clearance])
    # at the height of the underside all of the tuck counts: 0.075 - 0.015
    assert other.half_width(t, z) - usual.half_width(t, z) == pytest.approx(0.06)
    # the lowest point of the nose in the middle: 0.10 - 0.03 less far back
    nose, middle = np.array([0.0]), np.array([0.0])
    assert usual.end_shift(nose, middle, z) - other.end_shift(nose, middle, z) == pytest.approx(0.07)
    assert other.top_z(t) - other.edge_z(t) == pytest.approx(1.5 * (usual.top_z(t) - usual.edge_z(t)))
