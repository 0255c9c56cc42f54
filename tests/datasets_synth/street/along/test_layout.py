import numpy as np
import pytest

from datasets_synth.cars.models import ParametricCar, cars_of_splits
from datasets_synth.cars.shapes import car_shapes
from datasets_synth.meshes.mesh import Placed
from datasets_synth.presets import synth_preset
from datasets_synth.render.truth import azimuth_deg
from datasets_synth.street.along.layout import AlongStreet, sample_along
from datasets_synth.street.along.road import sample_road
from datasets_synth.street.along.stage import AWAY_RAD, Stage, kind_of
from datasets_synth.street.along.vehicles import OTHER_VEHICLES
from datasets_synth.street.distractors import PROPS
from datasets_synth.street.footprints import footprint
from rescore.data.rendered_kinds import GROUND_KINDS
from tests.datasets_synth.small_streets import PICTURES

CONFIG = synth_preset("streets")
CARS = cars_of_splits()["test"]
VEHICLES = {"car", *OTHER_VEHICLES}


@pytest.fixture(scope="module")
def streets() -> list[AlongStreet]:
    return [sample_along(CONFIG, CARS, np.random.default_rng(s), PICTURES) for s in range(12)]


def _vehicles(street: AlongStreet) -> list[Placed]:
    return [i for i in street.scene.items if i.kind in VEHICLES]


def test_vehicles_do_not_run_into_anything_solid(streets: list[AlongStreet]) -> None:
    loose = GROUND_KINDS | {"facade"}
    pairs = 0
    for street in streets:
        solid = [i for i in street.scene.items if i.kind not in loose]
        spots = [footprint(i) for i in solid]
        for k, item in enumerate(solid):
            if item.kind not in VEHICLES:
                continue
            for other in spots[k + 1 :]:
                pairs += 1
                assert not spots[k].meets(other)
    assert pairs > 500


def test_cars_are_seen_in_all_views_and_at_all_distances(streets: list[AlongStreet]) -> None:
    views, depths = [], []
    for street in streets:
        for item in _vehicles(street):
            pose = street.scene.left_from_world @ item.world_from_object
            views.append(azimuth_deg(pose))
            depths.append(pose[2, 3])
    assert len(views) > 60
    quarters = np.histogram((np.array(views) + 45) % 360, bins=4, range=(0, 360))[0]
    assert quarters.min() >= 3
    assert np.percentile(depths, 10) < 15
    assert np.percentile(depths, 90) > 35
    assert max(depths) < CONFIG.along.far_m + 10


def test_vehicles_stand_on_the_ground_with_all_wheels(streets: list[AlongStreet]) -> None:
    for street in streets:
        grade = street.scene.grade
        assert grade is not None
        for item in _vehicles(street):
            world = item.world_from_object
            assert np.allclose(world[:3, :3] @ world[:3, :3].T, np.eye(3), atol=1e-9)
            _, y, z = world[:3, 3]
            # crossfall and a kerb at most
            assert abs(z - float(grade.height_m(float(y)))) < 0.7
            nose = world[:3, :3] @ np.array([1.0, 0, 0])
            ahead = z + 2 * nose[2] - float(grade.height_m(float(y + 2 * nose[1])))
            assert abs(ahead - (z - float(grade.height_m(float(y))))) < 0.12


def test_nothing_stands_in_the_way_of_the_camera(streets: list[AlongStreet]) -> None:
    for street in streets:
        eye = np.linalg.inv(street.scene.left_from_world)[:2, 3]
        for item in street.scene.items:
            if item.kind in GROUND_KINDS | {"facade", "tree"}:
                continue
            spot = footprint(item)
            gap = np.linalg.norm(spot.corners() - eye, axis=1).min()
            assert gap > 1.0


def test_rigs_take_turns_and_half_of_each_state_their_ground() -> None:
    streets = [sample_along(CONFIG, CARS, np.random.default_rng(100 + n), number=n) for n in range(12)]
    for rig in CONFIG.along.rigs:
        assert [s.states_ground for s in streets if s.rig == rig.name] == [False, True, False, True]


def test_kinds_are_known(streets: list[AlongStreet]) -> None:
    beside = {"facade", "wall", "fence", "hedge", "bush", "tree", "lights"}
    known = GROUND_KINDS | VEHICLES | beside | {p.kind for p in PROPS}
    assert {i.kind for street in streets for i in street.scene.items} <= known


def test_vans_are_vans_and_minivans_are_cars() -> None:
    kinds = {s.body_type: kind_of(ParametricCar(s)) for s in car_shapes()}
    assert kinds.pop("van") == "van"
    assert set(kinds.values()) == {"car"}


def test_the_same_seed_gives_the_same_street() -> None:
    a, b = (sample_along(CONFIG, CARS, np.random.default_rng(5), PICTURES) for _ in range(2))
    assert [i.kind for i in a.scene.items] == [i.kind for i in b.scene.items]
    for x, y in zip(a.scene.items, b.scene.items, strict=True):
        assert np.array_equal(x.world_from_object, y.world_from_object)
        assert np.array_equal(x.mesh.vertices_m, y.mesh.vertices_m)
    assert a.ground == b.ground


def test_a_place_is_taken_once() -> None:
    rng = np.random.default_rng(3)
    stage = Stage(sample_road(CONFIG.along, rng), rng)
    x = stage.road.lanes_m[-1]
    assert stage.put_car(CARS[0], x, 20.0, AWAY_RAD)
    assert not stage.put_car(CARS[1], x, 22.0, AWAY_RAD)
    assert stage.put_car(CARS[1], x, 28.0, AWAY_RAD)
    assert [i.shape_id for i in stage.items] == [CARS[0].shape_id, CARS[1].shape_id]
    assert np.allclose(stage.items[0].world_from_object[:3, :3] @ [0, 0, 1.0], stage.road.axes(x, 20.0)[:, 2])
