"""Cars in looks as other people's models have them, from which front and rear are learned."""

import numpy as np

from datasets_synth.cars.models import ImportedModel, ParametricCar, cars_of_splits, repainted
from datasets_synth.cars.paint import Finish, car_materials, unusual_materials


def test_every_finish_may_lose_its_own_look_and_keeps_it_now_and_then() -> None:
    drawn = [unusual_materials(np.random.default_rng(k)) for k in range(60)]
    for finish in (Finish.TAIL_LAMP, Finish.LAMP, Finish.SEAL, Finish.GLASS):
        names = {materials[finish].name for materials in drawn}
        assert len(names) > 1
        assert car_materials(np.random.default_rng(0))[finish].name in names
    red = [m[Finish.TAIL_LAMP].rgb[0] > 3 * m[Finish.TAIL_LAMP].rgb[1] + 0.1 for m in drawn]
    assert 0.2 < np.mean(red) < 0.7
    glass = np.array([np.mean(m[Finish.GLASS].rgb) for m in drawn])
    assert glass.min() < 0.03
    assert glass.max() > 0.25
    values = np.array([[m.rgb for m in materials] for materials in drawn])
    assert ((values > 0) & (values < 1)).all()
    again = unusual_materials(np.random.default_rng(3))
    assert [m.rgb for m in again] == [m.rgb for m in drawn[3]]


def test_a_repainted_car_keeps_its_shape_and_a_users_mesh_its_looks() -> None:
    car = cars_of_splits()["calibration"][0]
    assert isinstance(car, ParametricCar)
    other = repainted(car)
    assert (other.shape_id, other.size_m) == (car.shape_id, car.size_m)
    mesh, painted = car.build(np.random.default_rng(5)), other.build(np.random.default_rng(5))
    assert np.array_equal(mesh.vertices_m, painted.vertices_m)
    assert [m.rgb for m in mesh.materials] != [m.rgb for m in painted.materials]
    own = ImportedModel("mine", car.size_m, mesh)
    assert repainted(own) is own
