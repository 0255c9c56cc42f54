"""The whole chain on one car, tiny: resumed, drawn, recorded, told in a table."""

import json
import re
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from datasets_synth.cars.models import ParametricCar, cars_of_splits
from recon.errors import Failure, RescoreError
from recon.localization.learn_shapes import ShapeSpaceConfig
from recon.localization.standing_box import StandingBox
from recon.view_bins import ViewBins
from reports.recording.grasp import write_grasp_recording
from reports.studies.grasping import publish, show_trial, write_grasping
from rescore.grasping import experiment as module
from rescore.grasping import trial
from rescore.grasping.act import Record
from rescore.grasping.basket import BasketResult, write_baskets
from rescore.grasping.cars import TableCar, experiment_cars
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.error_grid import LEVELS, ErrorGrid, GridPoint, write_errors
from rescore.grasping.experiment import Experiment
from rescore.grasping.hands import HANDS
from rescore.grasping.perception import METHODS
from rescore.grasping.result_file import (
    GraspResult,
    GraspRow,
    by_car_table,
    grasp_table,
    read_grasps,
    write_grasps,
)
from rescore.grasping.scene import MOUNT, OBJECT, require_robot, world
from rescore.grasping.solids import Solid
from rescore.grasping.trial import REACH_M, Replay, placed_car
from rescore.studies.localization.learned import TableClass, TableClassConfig, learn_class
from tests.exact_primitives import exact_library
from tests.reports.recording_reader import every_row

pytest.importorskip("mujoco")


@lru_cache(maxsize=1)
def small_class() -> TableClass:
    """Learned from four sedans and estates in one ring of views."""
    config = TableClassConfig(
        elevations_rad=(float(np.deg2rad(35)),),
        view_px=120,
        class_model_cars=1,
        refine_rounds=0,
        space=ShapeSpaceConfig(cells=(56, 20, 24), modes=2),
        heading_pictures=0,
    )
    sedans = [c for c in cars_of_splits()["train"] if c.shape_id.startswith(("sedan", "estate"))]
    return learn_class(sedans[:4], config, 1, exact_library(ViewBins(12, config.elevations_rad[0])))


SEDANS = tuple(c for c in experiment_cars(8, "calibration") if c.name.startswith(("sedan", "estate")))[:1]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Experiment, GraspResult, Path]:
    out = tmp_path_factory.mktemp("grasp")
    experiment = Experiment(SEDANS, 2, seed=0)
    return experiment, experiment.run(out, 1, small_class()), out


def test_a_car_is_grasped_from_its_picture_alone(run: tuple[Experiment, GraspResult, Path]) -> None:
    _, result, out = run
    assert read_grasps(out / "grasp.json") == result
    assert [(r.index, r.placement) for r in result.rows] == [(0, 0), (0, 1)]
    for row in result.rows:
        distance = np.linalg.norm(np.array(row.truth.xy_m) - MOUNT.xy_m)
        assert REACH_M[0] <= distance <= REACH_M[1]
        assert set(row.verdicts) == set(METHODS)
        for hand in HANDS:
            assert row.verdicts["3dp"][hand].held
            assert row.verdicts["truth"][hand].ending == "gentle"
        own = row.estimates["3dp"]
        assert not isinstance(own, Failure)
        assert np.linalg.norm(own.box.xy_m - row.truth.box.xy_m) < 0.02
    lines = grasp_table(result).splitlines()
    assert len(lines) == 2 + len(METHODS) * len(HANDS)
    assert "| 3DP, joint fit | three fingers | 2 of 2 |" in lines[2]
    assert lines[2].endswith("| 57 of 60 |")


def test_a_stopped_run_goes_on_and_other_settings_start_anew(
    run: tuple[Experiment, GraspResult, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    experiment, result, out = run
    whole = (out / "grasp.json").read_bytes()
    (out / "trials" / "000_001.json").unlink()
    assert experiment.run(out, 1, small_class()) == result
    assert (out / "grasp.json").read_bytes() == whole
    # all trials are there, so that nothing is tried
    monkeypatch.setattr(module, "run_trial", None)
    monkeypatch.setattr(module, "kept_table_class", None)
    assert experiment.run(out, 1) == result
    settings = json.loads((out / "trials" / "settings.json").read_text())
    assert settings["seed"] == 0
    kept = module._Kept(tmp_path / "trials", experiment)
    kept.add(result.rows[0])
    again = module._Kept(tmp_path / "trials", experiment)
    assert again.row(0, 0, METHODS) == result.rows[0]
    fit_alone = again.row(0, 0, METHODS[:1])
    assert fit_alone is not None
    assert list(fit_alone.verdicts) == list(fit_alone.estimates) == ["3dp"]
    # a trial of one method is not one of all of them
    again.add(fit_alone)
    assert again.row(0, 0, METHODS) is None
    assert module._Kept(tmp_path / "trials", Experiment(SEDANS, 2, seed=1)).row(0, 0, METHODS) is None


def test_more_placements_of_the_joint_fit_alone(
    run: tuple[Experiment, GraspResult, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, result, out = run
    tried: list[tuple[int, tuple[str, ...]]] = []

    def noted(
        car: TableCar, i: int, k: int, known: TableClass, seed: int, methods: tuple[str, ...]
    ) -> GraspRow:
        tried.append((k, methods))
        return result.rows[0].only(methods).model_copy(update={"placement": k})

    monkeypatch.setattr(module, "run_trial", noted)
    more = replace(experiment, fit_placements=5)
    found = more.run(out, 1, small_class())
    assert tried == [(k, ("3dp",)) for k in (2, 3, 4)]
    assert found.rows[:2] == result.rows
    more.require_trial(4)
    table = grasp_table(found)
    assert "| 3DP, joint fit | three fingers | 5 of 5 | 5 of 5 | 56.6 to 100.0 % |" in table
    assert "| true box | three fingers | 2 of 2 |" in table
    assert "| 5 / 5 of 5 | 2 / 2 of 2 |" in by_car_table(found, "three_fingers")
    # back to what was asked first, nothing is left of it
    assert experiment.run(out, 1) == result


def test_pictures_recording_and_page(run: tuple[Experiment, GraspResult, Path], tmp_path: Path) -> None:
    experiment, result, out = run
    write_grasping(experiment, result, out)
    assert (out / "grasp.md").read_text().count("\n") > 10
    strips = sorted(out.glob("strip_*.png"))
    assert strips
    picture = cv2.imread(str(strips[0]))
    assert picture.shape[1] > 6 * picture.shape[0]
    assert picture.std() > 20
    assert_all_is_recorded(show_trial(experiment, result, 1), out / "trial_1.rrd")
    with pytest.raises(RescoreError, match="--show: expected a trial from 0 to 1, got 2"):
        show_trial(experiment, result, 2)
    row = GridPoint(kind="lateral", level=0.0, hand="three_fingers", trials=1, held=1, gentle=1)
    points = [
        row.model_copy(update={"kind": k, "level": level, "hand": h})
        for k, levels in LEVELS.items()
        for level in levels
        for h in HANDS
    ]
    write_errors(out / "errors.json", ErrorGrid(seed=0, points=tuple(points)))
    write_baskets(out / "basket.json", BasketResult(seed=0, placements=0, rows=()))
    page = publish(out, tmp_path / "page", "make published-grasping").read_text()
    assert "3DP, joint fit" in page
    assert "57 of 60" in page
    assert (tmp_path / "page" / "strip_grasp.jpg").is_file()
    for name in re.findall(r"\]\(([\w.]+)\)", page):
        assert (tmp_path / "page" / name).is_file()


def test_meshes_that_are_filled_are_named_and_those_that_cannot_be_are_counted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sheet = Refusal(Cause.NOT_CLOSED, "a surface around a body expected, got a sheet")
    whole = trial.solid_of(SEDANS[0])
    assert isinstance(whole, Solid)
    solids = {"sheet": sheet, "torn": replace(whole, from_outside=True), "whole": whole}
    monkeypatch.setattr(trial, "solid_of", lambda car: solids[car.name])
    seen, model = placed_car(SEDANS[0], 0, 0, 0), SEDANS[0].model
    assert isinstance(model, ParametricCar)
    monkeypatch.setattr(trial, "placed_car", lambda *_: seen)
    # the true box needs no picture
    monkeypatch.setattr(trial, "perceive", lambda *_: {})
    named = [TableCar(ParametricCar(replace(model.shape, shape_id=name))) for name in solids]
    rows = [trial.run_trial(car, k, 0, small_class(), 0, ("truth",)) for k, car in enumerate(named)]
    result = GraspResult(seed=0, placements=1, cars=tuple(solids), rows=tuple(rows))
    write_grasps(tmp_path / "grasp.json", result)
    table = grasp_table(read_grasps(tmp_path / "grasp.json"))
    assert table.count("| 2 of 3 | 2 of 3 |") == len(HANDS)
    assert table.count("| mesh_not_closed 1 |") == len(HANDS)
    assert table.endswith("in very many pieces: torn.\n")


def assert_all_is_recorded(shown: Replay, file: Path) -> None:
    """Both boxes, plan, picture, arm and hand, the car's way up, contact forces, verdict."""
    logged: dict[str, list[dict[str, Any]]] = {}
    for entity, row in every_row(write_grasp_recording(shown, file)):
        logged.setdefault(entity.lstrip("/"), []).append(row)
    estimate = shown.row.estimates["3dp"]
    assert not isinstance(estimate, Failure)
    for name, box in (("true_box", shown.row.truth), ("estimated_box", estimate)):
        (row,) = logged[f"world/{name}"]
        np.testing.assert_allclose(np.ravel(row["Boxes3D:half_sizes"]), np.array(box.size_m) / 2, atol=1e-6)
    assert len(logged["world/plan"][0]["LineStrips3D:strips"][0]) > 50
    assert any(key.endswith((":blob", ":buffer")) for row in logged["world/camera/image"] for key in row)
    assert shown.row.car in str(logged["verdict"][0])
    moments = len(shown.record.qpos)
    robot = [e for e in logged if e.startswith("world/robot/")]
    assert len(robot) == sum(not n for n in in_scene(shown))
    for entity in (*robot, "world/car", "world/contacts", "forces/left", "forces/right", "height/car"):
        assert sum("time" in row and row["time"] is not None for row in logged[entity]) == moments
    heights = [v for row in logged["height/car"] for v in row.get("Scalars:scalars") or []]
    assert max(heights) == pytest.approx(0.19, abs=0.02)
    pressed = [v for row in logged["forces/left"] for v in row.get("Scalars:scalars") or []]
    assert max(pressed) > 5
    arrows = [len(row.get("Arrows3D:vectors") or []) for row in logged["world/contacts"]]
    assert max(arrows) >= 2
    assert arrows[0] == 0


def in_scene(shown: Replay) -> list[bool]:
    """Of every geom of the scene whether it is the table or the car."""
    model = world(HANDS[shown.hand], shown.solid)
    return [model.body(model.geom_bodyid[g]).name in ("world", OBJECT) for g in range(model.ngeom)]


def test_changing_the_truth_behind_a_picture_changes_no_command(monkeypatch: pytest.MonkeyPatch) -> None:
    methods = ("3dp", "single_plane")
    given: list[bytes] = []
    really_execute = trial.execute

    def noted(*arguments: Any) -> Record:
        record = really_execute(*arguments)
        given.append(record.commands.tobytes())
        return record

    monkeypatch.setattr(trial, "execute", noted)
    here = trial.run_trial(SEDANS[0], 0, 0, small_class(), 0, methods)
    seen = placed_car(SEDANS[0], 0, 0, 0)
    moved = replace(seen.placement, xy_m=seen.placement.xy_m + 0.03, yaw_rad=seen.placement.yaw_rad + 0.5)
    monkeypatch.setattr(trial, "placed_car", lambda *_: replace(seen, placement=moved))
    there = trial.run_trial(SEDANS[0], 0, 0, small_class(), 0, methods)
    assert here.truth != there.truth
    assert here.estimates == there.estimates
    assert len(given) == 2 * len(methods) * len(HANDS)
    assert given[: len(given) // 2] == given[len(given) // 2 :]
    # the verdicts are about the truth
    assert here.verdicts["3dp"]["three_fingers"].held
    assert here.verdicts != there.verdicts


def test_the_photograph_and_the_car_have_one_paint() -> None:
    placed = placed_car(SEDANS[0], 0, 0, 0)
    again = placed_car(SEDANS[0], 0, 0, 0)
    assert placed.rgb.tobytes() == again.rgb.tobytes()
    paint = np.array(placed.mesh.materials[0].rgb)
    middle = pixel_of_roof(placed.placement.box, placed.rgb)
    # hues agree: the paint's strongest channel is the picture's
    if np.ptp(paint) > 0.1:
        assert int(np.argmax(paint)) == int(np.argmax(middle))


def pixel_of_roof(box: StandingBox, rgb: np.ndarray) -> np.ndarray:
    from datasets_synth.photos.table_scene import project_ground  # noqa: PLC0415

    u, v = project_ground(np.array([[*box.xy_m, box.size_m[2]]]))[0].astype(int)
    return np.asarray(rgb[v - 2 : v + 3, u - 2 : u + 3].mean(axis=(0, 1)))


def test_without_the_extra_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RescoreError, match=r"pip install 'rescore\[robot\]'") as caught:
        require_robot()
    assert "\n" not in str(caught.value)
