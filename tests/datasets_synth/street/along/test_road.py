from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from datasets_synth.meshes.grade import Grade
from datasets_synth.presets import AlongConfig
from datasets_synth.street.along.ground import MARK_LIFT_M, ground_items
from datasets_synth.street.along.road import WIDE_M, Curve, Road, sample_road
from datasets_synth.street.street import KERB_HEIGHT_M

CONFIG = AlongConfig()


@pytest.fixture(scope="module")
def roads() -> list[Road]:
    return [sample_road(CONFIG, np.random.default_rng(s)) for s in range(60)]


def test_a_grade_has_its_two_slopes_and_goes_through_the_camera() -> None:
    grade = Grade(slope=0.03, bend=-0.05, at_m=20.0, length_m=2.0)
    assert grade.height_m(0.0) == 0
    assert grade.slope_at(-30.0) == pytest.approx(0.03)
    assert grade.slope_at(90.0) == pytest.approx(-0.02)
    assert grade.slope_at(20.0) == pytest.approx(0.005)  # half of the bend
    # far behind the bend the road is 0.03 y - 0.05 (y - 20)
    assert float(grade.height_m(100.0)) == pytest.approx(3.0 - 0.05 * 80.0, abs=1e-4)
    y = np.linspace(-5, 60, 40)
    steps = (grade.height_m(y + 1e-4) - grade.height_m(y - 1e-4)) / 2e-4
    assert np.allclose(steps, [grade.slope_at(float(v)) for v in y], atol=1e-7)


def test_a_curve_is_an_arc_between_two_straight_parts() -> None:
    curve = Curve(start_m=10.0, radius_m=-200.0, turn=0.3)
    assert curve.end_m == 70.0  # 200 m * 0.3 further on
    assert curve.shift_m(10.0) == 0
    assert float(curve.shift_m(50.0)) == pytest.approx(-(40.0**2) / 400)
    assert float(curve.shift_m(100.0)) == pytest.approx(-(60.0**2) / 400 - 0.3 * 30)
    for y in (5.0, 40.0, 69.0, 90.0):
        step = (curve.shift_m(y + 1e-4) - curve.shift_m(y - 1e-4)) / 2e-4
        assert float(step) == pytest.approx(curve.slope_at(y), abs=1e-6)
    assert Curve(0.0, 1.0, 0.0).shift_m(80.0) == 0


def test_what_looks_along_a_curved_street_follows_it(roads: list[Road]) -> None:
    curved = [r for r in roads if r.curve.turn]
    assert 10 < len(curved) < 40
    for road in curved:
        x, y = road.lanes_m[-1], 45.0
        ahead = road.world_m(x, y + 0.01) - road.world_m(x, y)
        assert road.heading_rad(np.pi / 2, y) == pytest.approx(np.arctan2(ahead[1], ahead[0]), abs=1e-4)
        assert road.heading_rad(0.0, y) == 0  # the side street stays level with the picture
        assert np.array_equal(road.world_m(x, 0.0)[:2], [x, 0.0])


def test_bands_join_without_gaps_from_edge_to_edge(roads: list[Road]) -> None:
    for road in roads:
        assert road.bands[0].x0_m == pytest.approx(-WIDE_M)
        assert road.bands[-1].x1_m == pytest.approx(WIDE_M)
        for a, b in pairwise(road.bands):
            assert a.x1_m == pytest.approx(b.x0_m)
            assert a.x1_m > a.x0_m
            step = abs(a.z1_m - b.z0_m)
            # level, but for one kerb at each side
            assert step == pytest.approx(0, abs=1e-9) or step == pytest.approx(KERB_HEIGHT_M)
        assert len(road.kerbs()) == 2
        for lane in road.lanes_m:
            assert road.band_at(lane).role == "road"


def test_crossfall_stays_within_its_range_and_both_kinds_occur(roads: list[Road]) -> None:
    falls = []
    for road in roads:
        own = [b for b in road.bands if b.role == "road"]
        falls.append([(b.z1_m - b.z0_m) / (b.x1_m - b.x0_m) for b in own])
    assert np.abs(np.concatenate(falls)).max() <= CONFIG.crossfall + 1e-9
    crowned = [f for f in falls if f[0] * f[-1] < 0]
    assert 5 < len(crowned) < 40


def test_a_crossing_has_no_kerbs_on_its_carriageway(roads: list[Road]) -> None:
    seen = 0
    for road in roads:
        if road.crossing is None:
            continue
        seen += 1
        edge = road.edge_m[1]
        inside = road.profile_m(edge + 12.0, road.crossing.y_m)
        beside = road.profile_m(edge + 12.0, road.crossing.gap_m[0] - 1.0)
        assert inside == pytest.approx(road.profile_m(edge - 1e-6, road.crossing.y_m), abs=1e-5)
        assert beside > inside + 0.5 * KERB_HEIGHT_M
    assert seen > 15


def test_the_axes_of_the_ground_are_those_of_its_surface(roads: list[Road]) -> None:
    for road in roads[:20]:
        x, y = road.lanes_m[-1], 32.0
        axes = road.axes(x, y)
        assert np.allclose(axes.T @ axes, np.eye(3), atol=1e-12)
        here = road.world_m(x, y)
        for dx, dy in ((0.2, 0.0), (0.0, 0.2)):
            there = road.world_m(x + dx, y + dy)
            assert abs((there - here) @ axes[:, 2]) < 2e-4


def test_the_meshes_of_the_ground_lie_where_the_plan_says() -> None:
    bent = replace(CONFIG, bend=1.5 * CONFIG.bend)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        road = sample_road(bent, rng)
        items = ground_items(road, rng)
        for item, band in zip(items, road.bands, strict=False):
            vertices = item.mesh.vertices_m.astype(float)
            vertices[:, 0] -= road.curve.shift_m(vertices[:, 1])
            own = vertices[np.abs(vertices[:, 0] - band.x0_m) < 1e-4]
            assert np.allclose(own[:, 2], band.z0_m + road.grade.height_m(own[:, 1]), atol=1e-4)
            # pieces of a bent road are straight, and marks must stay above them
            faces = vertices[item.mesh.faces]
            middle = faces.mean(axis=1).tolist()
            if band.role == "road":
                wanted = [
                    road.profile_m(float(x), -5.0) + float(road.grade.height_m(y)) for x, y, _ in middle
                ]
                assert np.abs(np.array(middle)[:, 2] - wanted).max() < MARK_LIFT_M
