"""Section 5.1 end to end, tiny: learn from a few cars, place one of another shape, localise it."""

import json
import shutil
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.meshes.mesh import Mesh
from datasets_synth.photos.table_scene import (
    CAMERA,
    GROUND,
    SEEN_FROM,
    TABLE_M,
    TABLE_MIDDLE_M,
    Placement,
    photograph,
    place_at_random,
)
from recon.errors import Failure, Reason, RescoreError
from recon.localization.heading import CUES, Heading
from recon.localization.learn_shapes import ShapeSpaceConfig
from recon.localization.localize import FitLocalization, PartsConfig, localize_by_parts
from recon.localization.standing_box import angle_between, cam_from_ground
from recon.view_bins import ViewBins
from reports.studies.localization_sheets import write_localization
from rescore.studies.localization import kept_class
from rescore.studies.localization import study as study_module
from rescore.studies.localization.kept_class import kept_table_class
from rescore.studies.localization.learned import (
    TableClass,
    TableClassConfig,
    _most_usual,
    learn_class,
    learn_front_and_rear,
)
from rescore.studies.localization.result_file import read_localization
from rescore.studies.localization.scores import METHODS, Score, markdown_table, summary
from rescore.studies.localization.segment import empty_table, segment_table
from rescore.studies.localization.study import LocalizationStudy, Tally, learned_study
from rescore.studies.localization.trials import TrialConfig, localize_placement
from tests.exact_primitives import exact_library

CARS = cars_of_splits()
SEDANS = [c for c in CARS["train"] if c.shape_id.startswith(("sedan", "estate"))][:4]
SMALL = TableClassConfig(
    elevations_rad=(float(np.deg2rad(35)),),
    view_px=120,
    class_model_cars=1,
    refine_rounds=0,
    space=ShapeSpaceConfig(cells=(56, 20, 24), modes=2),
    heading_pictures=3,
    cue_pictures=2,
)


@lru_cache(maxsize=1)
def small_class() -> TableClass:
    library = exact_library(ViewBins(12, SMALL.elevations_rad[0]))
    known = learn_class(SEDANS, SMALL, 1, library)
    return replace(known, heading=learn_front_and_rear(known.space, SEDANS, [sedan().car], SMALL, 1))


@dataclass(frozen=True)
class SizedCar:
    length_m: float
    shape_id: str = "car"

    @property
    def size_m(self) -> tuple[float, float, float]:
        return (self.length_m, 1.8, 1.5)

    def build(self, rng: np.random.Generator) -> Mesh:
        raise AssertionError("its size is enough")


def sedan() -> Placement:
    car = next(c for c in CARS["calibration"] if c.shape_id.startswith("sedan"))
    return Placement(car, TABLE_MIDDLE_M + np.array([0.1, -0.1]), 0.6)


def test_placements_stand_on_the_table() -> None:
    rng = np.random.default_rng(0)
    for car in CARS["test"]:
        corners = place_at_random(car, rng).box.footprint_m - TABLE_MIDDLE_M
        assert (np.abs(corners) <= np.array(TABLE_M) / 2 + 1e-9).all()


def test_the_whole_table_is_in_view() -> None:
    pose = cam_from_ground(GROUND)
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(TABLE_M) / 2
    corners = np.insert(half + TABLE_MIDDLE_M, 2, 0, axis=1)
    uv = CAMERA.project(corners @ pose[:3, :3].T + pose[:3, 3])
    assert ((uv > 0) & (uv < [CAMERA.width_px, CAMERA.height_px])).all()


def test_a_car_of_another_shape_is_localised() -> None:
    placement = sedan()
    rgb = photograph([placement], np.random.default_rng(3))
    trial = localize_placement(placement, rgb, 0, small_class(), TrialConfig())
    own, parts, surface = (trial.scores[m] for m in METHODS)
    assert isinstance(own, Score)
    assert isinstance(parts, Score)
    assert parts.overlap is not None
    assert parts.overlap > 0.5
    assert parts.orientation_deg < 15
    assert isinstance(surface, Score)
    assert own.overlap is not None
    assert own.overlap > 0.7
    assert own.centroid_mm < 15
    assert own.orientation_deg < 3
    assert surface.centroid_mm > 2 * own.centroid_mm
    assert isinstance(trial.fit, FitLocalization)
    assert trial.fit.box.size_m == pytest.approx(placement.box.size_m, rel=0.15)
    # the construction faces as it is told, whatever the picture says
    assert trial.ring_px is not None
    told = (rgb, trial.ring_px, small_class().model, SEEN_FROM, PartsConfig(), placement.yaw_rad + np.pi)
    back = localize_by_parts(*told)
    assert not isinstance(back, Failure)
    assert angle_between(back.box.yaw_rad, placement.yaw_rad) > np.pi / 2


def test_the_class_model_is_of_the_most_usual_car() -> None:
    # 4.2 m is nearest the mean of the logarithms, between the shortest and the longest
    cars = [SizedCar(length) for length in (2.5, 6.0, 4.2, 4.9)]
    assert _most_usual(cars) == [2, 3, 1, 0]


def test_the_mask_is_where_the_car_is_drawn() -> None:
    placement = sedan()
    rgb = photograph([placement], np.random.default_rng(3))
    regions = segment_table(rgb, empty_table(TrialConfig().segment))
    assert not isinstance(regions, Failure)
    pose = cam_from_ground(GROUND)
    uv = CAMERA.project(placement.box.corners_m @ pose[:3, :3].T + pose[:3, 3])
    ring = regions[0].ring_px
    assert (ring.min(axis=0) > uv.min(axis=0) - 6).all()
    assert (ring.max(axis=0) < uv.max(axis=0) + 6).all()
    middle = CAMERA.project(pose[:3, :3] @ placement.box.centroid_m + pose[:3, 3])
    assert regions[0].mask[int(middle[1]), int(middle[0])]


def test_an_empty_picture_is_lost_by_every_method_with_its_reason() -> None:
    rgb = photograph([], np.random.default_rng(0))
    trial = localize_placement(sedan(), rgb, 0, small_class(), TrialConfig())
    for result in trial.scores.values():
        assert isinstance(result, Failure)
        assert result.reason is Reason.NO_OUTLINE


@pytest.fixture(scope="module")
def study() -> LocalizationStudy:
    cars = tuple(c for c in CARS["test"] if c.shape_id.startswith(("sedan", "estate")))[:2]
    return LocalizationStudy(cars, 2, small_class(), seed=0)


@pytest.fixture(scope="module")
def done(study: LocalizationStudy, tmp_path_factory: pytest.TempPathFactory) -> tuple[Tally, Path]:
    out = tmp_path_factory.mktemp("localize")
    return write_localization(study, out, jobs=1), out


def test_the_study_counts_what_its_trials_found_and_draws_it(
    study: LocalizationStudy, done: tuple[Tally, Path]
) -> None:
    tally, out = done
    tally.save(out, study, None)
    value = read_localization(out / "localization.json")
    assert value == tally.result
    assert [row.car for row in value.placements] == [car.shape_id for car in study.cars]
    for method in METHODS:
        assert value.methods[method] == summary([row.methods[method] for row in value.placements])
    for row in value.placements:
        assert row.nose is not None
        assert 0.5 <= row.nose.probability <= 1
        assert tuple(row.nose.log_odds) == CUES
    text = (out / "localization.md").read_text()
    assert text.startswith(markdown_table(tally.by_car))
    assert "takes 0 of 2 for shapes outside what was learned" in text
    for name in ("placements", "worst", "table", "reconstruction"):
        assert cv2.imread(str(out / f"{name}.png")).std() > 10
    settings = json.loads((out / "localization.json.config.json").read_text())["config"]
    assert settings == {"cars": 2, "placements": 2, "meshes": None}


def test_a_stopped_run_goes_on_and_another_study_starts_anew(
    study: LocalizationStudy, done: tuple[Tally, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tally, out = done
    shutil.copytree(out / "placements", tmp_path / "placements")
    assert study.kept(tmp_path).missing(3) == [2]
    (tmp_path / "placements" / "0001.json").unlink()
    assert study.kept(tmp_path).missing(2) == [1]
    tried = []

    def run_one(cars: object, numbers: list[int], *rest: object) -> list[object]:
        tried.extend(numbers)
        return []

    monkeypatch.setattr(study_module, "run_trials", run_one)
    assert list(study.trials(study.kept(tmp_path).missing(2), 1)) == []
    assert tried == [1]
    shutil.copy(out / "placements" / "0001.json", tmp_path / "placements")
    assert study.kept(tmp_path).rows(2) == list(tally.placements)
    assert replace(study, seed=1).kept(tmp_path).missing(2) == [0, 1]


@dataclass
class Steps:
    """What is learned: the class as ``small_class`` has it, front and rear anew unless that is stopped."""

    done: list[str]
    stop: bool = False

    def learn_class(self, *arguments: object) -> TableClass:
        self.done.append("class")
        return replace(small_class(), heading=None)

    def learn_front_and_rear(self, *arguments: Any) -> Heading:
        if self.stop:
            raise KeyboardInterrupt
        self.done.append("front and rear")
        return learn_front_and_rear(*arguments)


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> Steps:
    found = Steps([])
    for name in ("learn_class", "learn_front_and_rear"):
        monkeypatch.setattr(kept_class, name, getattr(found, name))
    return found


def test_what_was_learned_is_kept_and_read_again(tmp_path: Path, steps: Steps) -> None:
    folder, others = tmp_path / "out" / "learned", [sedan().car]
    both = ["class", "front and rear"]
    steps.stop = True
    with pytest.raises(KeyboardInterrupt):
        kept_table_class(folder, SEDANS, SMALL, 1, others)
    steps.stop = False
    first = kept_table_class(folder, SEDANS, SMALL, 1, others)
    again = kept_table_class(folder, SEDANS, SMALL, 1, others)
    assert steps.done == both
    # the first call too takes what the files hold
    assert again.digest == first.digest
    assert np.allclose(first.space.mean, small_class().space.mean, atol=2e-3)
    # a run that was stopped learns the same as one that was not
    assert first.heading is not None
    assert first.heading.as_json == small_class().heading.as_json
    assert sorted(f.name for f in folder.iterdir()) == ["class_model.json", "heading.json", "settings.json"]


def test_what_was_learned_otherwise_or_is_damaged_is_learned_anew(
    tmp_path: Path, steps: Steps, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = replace(SMALL, heading_pictures=1)
    monkeypatch.setattr(kept_class, "learn_front_and_rear", lambda *_: small_class().heading)
    kept_table_class(tmp_path, SEDANS, SMALL, 1)
    kept_table_class(tmp_path, SEDANS, SMALL, 1)
    assert steps.done == ["class"]
    kept_table_class(tmp_path, SEDANS, config, 1)
    assert len(steps.done) == 2
    for file, content in (("heading.json", ""), ("class_model.json", "{")):
        (tmp_path / file).write_text(content)
        before = len(steps.done)
        kept_table_class(tmp_path, SEDANS, config, 1)
        assert len(steps.done) == before + 1


def test_a_folder_is_there_from_the_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*arguments: object) -> TableClass:
        assert (tmp_path / "out" / "learned").is_dir()
        raise KeyboardInterrupt

    monkeypatch.setattr(kept_class, "learn_class", stop)
    with pytest.raises(KeyboardInterrupt):
        kept_table_class(tmp_path / "out" / "learned", SEDANS, SMALL, 1)


def test_fewer_placements_than_cars_are_refused_before_anything_is_learned(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match="--placements: expected at least one for each of 5 cars, got 4"):
        learned_study(cars=5, placements=4, meshes=None, seed=0, jobs=1, out=tmp_path)
    assert not list(tmp_path.iterdir())
