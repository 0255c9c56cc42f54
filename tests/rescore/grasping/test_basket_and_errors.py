"""The basket whose handle is hidden, and the grid of errors that a grasp bears."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from datasets_synth.photos.table_scene import SCALE, project_ground
from recon.class_model import ClassModel
from recon.localization.standing_box import StandingBox
from reports.studies.grasping import draw_errors
from rescore.grasping.act import execute
from rescore.grasping.basket import (
    OTHER,
    TAUGHT,
    VIEW_BINS,
    BasketResult,
    BasketRow,
    FoundHandle,
    HiddenHandle,
    basket_of,
    basket_table,
    find_handle,
    handle_motion,
    hidden_handle,
    read_baskets,
    two_view_model,
    write_baskets,
)
from rescore.grasping.cars import experiment_cars
from rescore.grasping.error_grid import (
    LEVELS,
    ErrorGrid,
    GridPoint,
    _point,
    error_table,
    read_errors,
    with_error,
    write_errors,
)
from rescore.grasping.hands import HANDS
from rescore.grasping.judge import Ending, Verdict, judge
from rescore.grasping.plan import Motion

pytest.importorskip("mujoco")


@lru_cache(maxsize=1)
def model() -> ClassModel:
    return two_view_model()


@lru_cache(maxsize=1)
def shot() -> HiddenHandle:
    return hidden_handle(basket_of(OTHER), 2, 77)


def test_two_views_of_one_basket_teach_a_handle() -> None:
    assert [v.view_bin for v in model().views] == list(VIEW_BINS)
    assert {v.instance_id for v in model().views} == {TAUGHT}
    handle = model().part(6)
    assert handle.outline[:, 2].max() == max(p.outline[:, 2].max() for p in model().parts)


def test_the_card_hides_every_pixel_of_the_handle() -> None:
    one = shot()
    corners = one.mesh.vertices_m[np.unique(one.mesh.faces[one.mesh.face_part == 6])].astype(float) * SCALE
    c, s = np.cos(one.placement.yaw_rad), np.sin(one.placement.yaw_rad)
    corners[:, :2] = corners[:, :2] @ np.array([[c, s], [-s, c]]) + one.placement.xy_m
    uv = np.rint(project_ground(corners)).astype(int)
    assert one.card[uv[:, 1], uv[:, 0]].all()
    assert (one.rgb[one.card] == one.rgb[one.card][0]).all()
    assert one.card.mean() < 0.05


def test_a_basket_that_taught_nothing_is_taken_by_its_hidden_handle() -> None:
    found = find_handle(shot(), model())
    assert isinstance(found, FoundHandle)
    truth = shot().placement.box
    assert np.linalg.norm(found.top_m[:2] - truth.xy_m) < 0.03
    assert abs(found.top_m[2] - truth.size_m[2]) < 0.05
    hand = HANDS["parallel_jaw"]
    motion = handle_motion(found, hand, 0)
    assert isinstance(motion, Motion)
    solid = basket_of(OTHER).solid()
    verdict = judge(execute(motion, hand, solid, truth), solid)
    assert verdict.ending is Ending.GENTLE


def test_results_of_baskets_are_read_as_they_were_written(tmp_path: Path) -> None:
    held, hung = Verdict(Ending.GENTLE, lifted_m=0.19), Verdict(Ending.FAILED, lifted_m=0.2)
    rows = [
        BasketRow(
            basket=b, placement=0, handle_off_mm=off, verdicts={"three_fingers": hung, "parallel_jaw": held}
        )
        for b, off in ((TAUGHT, 12.0), (OTHER, None))
    ]
    result = BasketResult(seed=0, placements=1, rows=tuple(rows))
    write_baskets(tmp_path / "basket.json", result)
    assert read_baskets(tmp_path / "basket.json") == result
    lines = basket_table(result).splitlines()
    assert "| three fingers | 12 | 1 of 1 | 0 of 1 |" in lines[2]
    assert "| parallel jaw |  | 1 of 1 | 1 of 1 |" in lines[5]


def test_an_error_is_put_on_one_measure_alone() -> None:
    truth = StandingBox(np.array([0.1, 1.2]), np.pi / 2, np.array([0.25, 0.1, 0.08]))
    # the car points along y, so that across it is -x
    np.testing.assert_allclose(with_error(truth, "lateral", 10).box.xy_m, [0.09, 1.2])
    np.testing.assert_allclose(with_error(truth, "lengthwise", 10).box.xy_m, [0.1, 1.21])
    assert with_error(truth, "heading", 10).box.yaw_rad == pytest.approx(np.pi / 2 + np.deg2rad(10))
    np.testing.assert_allclose(with_error(truth, "height", -20).box.size_m, [0.25, 0.1, 0.06])
    assert with_error(truth, "height", -200).box.size_m[2] > 0
    for kind in LEVELS:
        same = with_error(truth, kind, 0.0).box
        assert (same.xy_m == truth.xy_m).all()
        assert (same.size_m == truth.size_m).all()


def test_a_small_error_is_borne_and_a_large_one_is_not() -> None:
    cars = experiment_cars(8, "validation")[:2]
    points = [_point(("lateral", level, "parallel_jaw"), (cars, 1, 0)) for level in (5.0, 60.0)]
    assert [p.trials for p in points] == [2, 2]
    assert points[0].gentle == 2
    assert points[1].gentle == 0


def test_the_grid_is_told_drawn_and_read(tmp_path: Path) -> None:
    points = [
        GridPoint(kind=k, level=level, hand=h, trials=4, held=3, gentle=2)
        for k, levels in LEVELS.items()
        for level in levels
        for h in HANDS
    ]
    grid = ErrorGrid(seed=0, points=tuple(points))
    write_errors(tmp_path / "errors.json", grid)
    assert read_errors(tmp_path / "errors.json") == grid
    levels = [p.level for p in grid.points_of("height", "parallel_jaw")]
    assert levels == sorted({0.0, *LEVELS["height"]})
    lines = error_table(grid).splitlines()
    assert len(lines) == 2 + sum(len(set(levels) | {0.0}) for levels in LEVELS.values())
    assert "75 % (30 to 95)" in lines[2]
    assert len(draw_errors(grid).axes) == len(LEVELS)
