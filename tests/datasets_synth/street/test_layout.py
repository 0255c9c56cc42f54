from dataclasses import replace

import numpy as np
import pytest

from datasets_synth.cars.models import ParametricCar, cars_of_splits
from datasets_synth.cars.shapes import car_shapes
from datasets_synth.meshes.mesh import Placed, Scene
from datasets_synth.presets import MAX_CARS, SplitSize, synth_preset
from datasets_synth.render.truth import azimuth_deg
from datasets_synth.street.distractors import PROPS
from datasets_synth.street.footprints import Footprint, footprint
from datasets_synth.street.layout import MOST_COVERED, sample_scene
from recon.errors import RescoreError
from rescore.data.frames import SPLITS
from rescore.data.rendered_kinds import GROUND_KINDS, PICTURE_KINDS

CONFIG = synth_preset("paper")
CARS = tuple(ParametricCar(s) for s in car_shapes()[::25])
BOX_KINDS = {"kiosk", "stall", "shelter", "container", "skip", "cart"}
PICTURES = (np.full((60, 100, 3), 128, np.uint8),)


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return [sample_scene(CONFIG, CARS, np.random.default_rng(s), s % 3, PICTURES) for s in range(14)]


def test_footprints_meet_where_rectangles_overlap() -> None:
    square = Footprint(0, 0, 1, 1)
    assert square.meets(Footprint(1.9, 0, 1, 1))
    assert not square.meets(Footprint(2.1, 0, 1, 1))
    # turned by 45 degrees a unit square reaches sqrt(2) = 1.414 along x, so 2.3 < 2.414 overlaps ...
    assert square.meets(Footprint(2.3, 0, 1, 1, np.pi / 4))
    # ... while past the corner their bounding boxes overlap and they do not
    assert not square.meets(Footprint(1.9, 1.9, 1, 1, np.pi / 4))


def test_nothing_solid_intersects(scenes: list[Scene]) -> None:
    pairs = 0
    for scene in scenes:
        solid = [footprint(i) for i in scene.items if i.kind not in GROUND_KINDS | {"facade"}]
        # beyond the last strip trees and hedges of an open far side may touch; all others keep their distance
        last_strip_ends = min(
            i.mesh.vertices_m[:, 1].min() for i in scene.items if i.mesh.vertices_m[:, 1].max() > 100
        )
        front = [f for f in solid if f.y_m < last_strip_ends]
        for i, a in enumerate(front):
            for b in front[i + 1 :]:
                pairs += 1
                assert not a.meets(b)
    assert pairs > 100


def test_everything_stands_on_its_ground(scenes: list[Scene]) -> None:
    for scene in scenes:
        tops = [
            (
                i.mesh.vertices_m[:, 1].min(),
                i.mesh.vertices_m[:, 1].max(),
                round(float(i.mesh.vertices_m[:, 2].min()), 3),
            )
            for i in scene.items
            if i.kind in GROUND_KINDS - {"kerb"}
        ]
        for item in scene.items:
            if item.kind in GROUND_KINDS:
                continue
            y, z = item.world_from_object[1, 3], item.world_from_object[2, 3]
            under = {top for low, high, top in tops if low - 0.5 <= y <= high + 0.5}
            assert round(float(z), 3) in under


def test_cars_are_seen_from_their_left_side_on_the_road(scenes: list[Scene]) -> None:
    seen = 0
    for scene in scenes:
        for item in scene.items:
            if item.kind != "car":
                continue
            azimuth = azimuth_deg(scene.left_from_world @ item.world_from_object)
            # the car across the street is seen from its nose or its tail instead
            if 60 < azimuth < 120:
                seen += 1
                assert 75 <= azimuth <= 105
                assert item.world_from_object[2, 3] == 0.0
                assert 7.0 <= item.world_from_object[1, 3] <= 46.0
                assert item.shape_id in {c.shape_id for c in CARS}
    assert seen >= 10


def test_every_kind_of_picture_is_a_prop_but_the_mural() -> None:
    # murals belong to house fronts
    assert {p.kind for p in PROPS} >= PICTURE_KINDS - {"mural"}
    assert "mural" in PICTURE_KINDS


def test_kinds_are_known_and_the_camera_stands_over_the_street(scenes: list[Scene]) -> None:
    # the ground of single photographs is no part of a street
    known = (GROUND_KINDS - {"ground"}) | {"facade", "mural", "car"} | {p.kind for p in PROPS}
    for scene in scenes:
        assert {i.kind for i in scene.items} <= known
        eye = np.linalg.inv(scene.left_from_world)[:3, 3]
        assert np.allclose(eye[:2], 0)
        assert 1.2 <= eye[2] <= 1.7
        assert np.allclose(scene.left_from_world[:3, :3] @ scene.left_from_world[:3, :3].T, np.eye(3))
        assert np.linalg.det(scene.left_from_world[:3, :3]) == pytest.approx(1)


def test_murals_hang_on_the_houses_before_their_walls(scenes: list[Scene]) -> None:
    murals = [(scene, item) for scene in scenes for item in scene.items if item.kind == "mural"]
    assert len(murals) >= 5
    for scene, mural in murals:
        x, y, z = mural.world_from_object[:3, 3]
        low, high = x + mural.mesh.vertices_m[:, 0].min(), x + mural.mesh.vertices_m[:, 0].max()
        walls = [i for i in scene.items if i.kind == "facade"]
        ends = [(i.world_from_object[:3, 3], i.mesh.vertices_m[:, 0].max()) for i in walls]
        # sills of windows reach 12 cm out of a wall
        assert any(
            at[0] <= low + 0.1 and high - 0.1 <= at[0] + width and 0.12 < at[1] - y < 0.2 and at[2] == z
            for at, width in ends
        )


def test_no_street_holds_more_than_the_next_whole_number_of_a_group(scenes: list[Scene]) -> None:
    clutter = CONFIG.clutter
    pictures = {p.kind for p in PROPS if p.needs_pictures}
    for kinds, mean in ((pictures, clutter.pictures), (BOX_KINDS, clutter.boxes)):
        counts = [sum(i.kind in kinds for i in scene.items) for scene in scenes]
        assert max(counts) == np.ceil(mean)
        assert np.mean(counts) >= mean / 2


def test_large_things_hide_little_of_the_cars(scenes: list[Scene]) -> None:
    small = {p.kind for p in PROPS if p.hides}
    hidden = [0.0]
    for scene in scenes:
        solid = [i for i in scene.items if i.kind not in GROUND_KINDS | small | {"facade", "mural", "car"}]
        for car in (i for i in scene.items if i.kind == "car"):
            y, (left, right) = car.world_from_object[1, 3], _tangents(car)
            for thing in (i for i in solid if i.world_from_object[1, 3] < y):
                low, high = _tangents(thing)
                hidden.append((min(right, high) - max(left, low)) / (right - left))
    assert 0 < max(hidden) <= MOST_COVERED + 0.05


def _tangents(item: Placed) -> tuple[float, float]:
    """Tangents of the bearings of the two ends of a thing, at the distance of its middle."""
    place = item.world_from_object
    x = (item.mesh.vertices_m @ place[:3, :3].T + place[:3, 3])[:, 0] / place[1, 3]
    return float(x.min()), float(x.max())


def test_the_same_seed_gives_the_same_street() -> None:
    a, b = (sample_scene(CONFIG, CARS, np.random.default_rng(5), 1, PICTURES) for _ in range(2))
    assert [i.kind for i in a.items] == [i.kind for i in b.items]
    assert all(
        np.array_equal(x.world_from_object, y.world_from_object)
        for x, y in zip(a.items, b.items, strict=True)
    )
    assert all(
        np.array_equal(x.mesh.vertices_m, y.mesh.vertices_m) for x, y in zip(a.items, b.items, strict=True)
    )


def test_without_pictures_there_are_no_posters() -> None:
    needing = {p.kind for p in PROPS if p.needs_pictures}
    for seed in range(6):
        scene = sample_scene(CONFIG, CARS, np.random.default_rng(seed), 0)
        assert not needing & {i.kind for i in scene.items}


def test_no_two_splits_share_a_shape_and_all_have_every_body_type() -> None:
    cars = cars_of_splits()
    ids = {split: {c.shape_id for c in cars[split]} for split in SPLITS}
    for a in SPLITS:
        for b in SPLITS:
            assert a == b or not ids[a] & ids[b]
    assert set.union(*ids.values()) == {s.shape_id for s in car_shapes()}
    kinds = {split: {c.shape.body_type for c in cars[split]} for split in SPLITS}  # type: ignore[attr-defined]
    assert all(kinds[split] == kinds["train"] for split in SPLITS)


def test_the_paper_preset_has_the_sizes_of_the_report() -> None:
    assert CONFIG.splits["test"] == SplitSize(109, 127)
    assert CONFIG.splits["validation"].n_images == 20
    assert set(CONFIG.splits) == set(SPLITS)


def test_the_streets_preset_plans_no_numbers_of_cars() -> None:
    streets = synth_preset("streets")
    assert {s: size.n_images for s, size in streets.splits.items()} == {
        "train": 80,
        "calibration": 40,
        "validation": 20,
        "test": 60,
    }
    assert {size.n_cars for size in streets.splits.values()} == {None}
    assert {rig.name for rig in streets.along.rigs} == {"kitti", "report", "consumer"}
    assert streets.camera == CONFIG.camera
    with pytest.raises(RescoreError, match=r"split test: expected no number of cars .* got 3; mend"):
        replace(streets, splits={"test": SplitSize(2, 3)})
    with pytest.raises(RescoreError, match=r"split test: expected a number of cars .* got None; mend"):
        replace(CONFIG, splits={"test": SplitSize(2)})


def test_an_unknown_preset_and_an_impossible_size_are_refused() -> None:
    known = "demo, paper, streets, tiny, weight-study"
    with pytest.raises(RescoreError, match=f"preset: expected one of {known}, got 'papre'"):
        synth_preset("papre")
    with pytest.raises(RescoreError, match=f"at most {MAX_CARS} cars an image"):
        SplitSize(2, 2 * MAX_CARS + 1)
