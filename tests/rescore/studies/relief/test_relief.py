"""The study on a small rendered street, from the command to the page and back."""

import json
from pathlib import Path

import numpy as np
import pytest

from datasets_synth.build import build_dataset
from recon.camera import GroundPlane
from reports.studies.relief import relief_page
from rescore.experiment.config import run_preset
from rescore.formats.coco_dataset import read_dataset
from rescore.results.run_config_file import write_run_config
from rescore.results.run_folder import RunFolder
from rescore.studies.relief.relief_file import (
    SURFACES,
    MatcherErrors,
    ReliefCar,
    View,
    read_relief,
    relief_cell,
    target_cell,
)
from rescore.studies.relief.shown_cars import RenderedTruth, ShownCar, shown_cars
from tests.datasets_synth.small_streets import SMALL
from tests.rescore import shipped
from tests.rescore.spoiling import Run


@pytest.fixture(scope="module")
def street_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with the parts that the study reads."""
    root = tmp_path_factory.mktemp("relief") / "run"
    folder = RunFolder(root)
    build_dataset(SMALL, folder.data, seed=7)
    folder.class_model.parent.mkdir()
    shipped.class_model().save(folder.class_model)
    config = run_preset("streets").model_copy(update={"synth": SMALL})
    write_run_config(folder.config, "reproduce", config.as_json(), 0, stereo=SMALL.sgbm)
    return root


def cars_of(root: Path, split: str) -> list[tuple[ShownCar, np.ndarray, GroundPlane]]:
    """The cars of a split with their true disparity and ground."""
    data = read_dataset(root / "data").split(split)
    truth = RenderedTruth.of(root / "data")
    found = []
    for record in data.frames:
        known = truth.of_frame(record)
        for one in shown_cars(record, data.truth[record.image_id], known.ground):
            found.append((one, known.disparity_px, known.ground))
    return found


def test_cars_are_where_their_pixels_are(street_run: Path) -> None:
    data = read_dataset(street_run / "data")
    found = cars_of(street_run, "train")
    assert found
    for one, disparity, ground in found:
        (record,) = (
            f for f in data.frames if one.annotation_id in data.truth[f.image_id].annotation_id.tolist()
        )
        assert record.camera is not None
        rows, columns = np.nonzero(one.seen)
        x0, y0, x1, y1 = one.xyxy_px
        assert columns.min() >= x0 - 2
        assert columns.max() <= x1 + 2
        assert rows.min() >= y0 - 2
        assert rows.max() <= y1 + 2
        # the surface is nearer than the middle by no more than half the length
        depth = record.camera.depth_m(np.median(disparity[one.seen]))
        assert 0 < one.cam_from_object[2, 3] - depth < 0.6 * one.size_m[0]
        assert one.cam_from_object[:3, :3] @ one.cam_from_object[:3, :3].T == pytest.approx(np.eye(3))
        assert one.cam_from_object[:3, 2] == pytest.approx(ground.up)
        # the side from which the camera sees it, from its pose
        x, y = (np.linalg.inv(one.cam_from_object)[:3, 3])[:2]
        turn = np.degrees(np.arctan2(y, x)) - one.azimuth_deg
        assert abs((turn + 180) % 360 - 180) < 2
        assert 0 < one.inner.sum() < one.seen.sum()


def test_the_command_writes_a_page_and_a_file_that_reads_back(
    street_run: Path, tmp_path: Path, run: Run
) -> None:
    out = tmp_path / "relief"
    done = run("study-relief", street_run, "--out", out, "--split", "train", "--jobs", 1, "--json")
    assert done[0] == 0
    result = read_relief(out / "relief.json")
    assert json.loads(done[1]) == json.loads((out / "relief.json").read_text()) == result.as_json()
    known = {one.annotation_id for one, *_ in cars_of(street_run, "train")}
    # those that are too small to judge are left out
    assert {car.annotation_id for car in result.cars} <= known
    assert len(result.cars) >= len(known) / 2
    assert sum(cell.n_cars for cell in result.cells) == len(result.cars)
    assert set(result.rigs) == {car.rig for car in result.cars} <= {"wide", "narrow"}
    assert (out / "README.md").read_text() == relief_page(result)
    assert (out / "relief.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("split", "expected"),
    [("validation", "expected a car that is whole"), ("tset", "--split: expected train, ")],
)
def test_a_split_without_cars_and_one_that_is_none(
    street_run: Path, tmp_path: Path, run: Run, split: str, expected: str
) -> None:
    code, _, error = run("study-relief", street_run, "--out", tmp_path, "--split", split, "--jobs", 1)
    assert code == 1
    assert expected in error


def a_car(image_id: int, true: float, framed: float | None, azimuth_deg: float = 30.0) -> ReliefCar:
    errors = MatcherErrors(n_pixels=10, measured_share=1.0, bias_px=0.0, low_share=0.0, high_share=0.0)
    ratio = dict.fromkeys(SURFACES, 1.0) | {"true": true}
    if framed is None:
        ratio = {name: r for name, r in ratio.items() if not name.startswith(("framed", "seen"))}
    else:
        ratio["framed"] = framed
    return ReliefCar(
        image_id=image_id,
        rig="wide",
        annotation_id=image_id,
        distance_m=10.0,
        azimuth_deg=azimuth_deg,
        view=View.of(azimuth_deg),
        n_pixels=100,
        measured_share=1.0,
        textured_share=0.5,
        textured=errors,
        blank=errors,
        ratio=ratio,
        place_error_m=0.1,
        heading_error_deg=1.0,
        covered_share=1.0,
    )


def test_medians_and_shares_are_those_of_the_cars() -> None:
    cars = [a_car(i, 10.0 + i, 5.0 + i) for i in range(9)]
    cell = target_cell([*cars, a_car(9, 1e6, 1e6, azimuth_deg=90.0)], np.random.default_rng(0))
    assert (cell.n_cars, cell.n_images) == (9, 9)
    assert cell.median["true"].value == 14
    assert cell.share_of_true.value == pytest.approx(9 / 14)
    assert 10 <= cell.median["true"].low < 14 < cell.median["true"].high <= 18
    assert cell.share_of_true.low < 9 / 14 < cell.share_of_true.high


def test_cars_without_a_fit_are_counted_and_not_in_shares() -> None:
    fitted = [a_car(0, 5.0, 4.0), a_car(1, 5.0, 2.0), a_car(2, 5.0, -1.0)]
    cars = [*fitted, a_car(3, 99.0, None), a_car(4, 99.0, None)]
    cell = target_cell(cars, np.random.default_rng(0))
    assert (cell.n_cars, cell.n_fitted) == (5, 3)
    assert cell.median["framed"].value == 2
    assert cell.above_plane["framed"] == pytest.approx(2 / 3)
    # the true shape of the fitted cars alone
    assert cell.share_of_true.value == pytest.approx(2 / 5)


def test_there_is_no_share_of_what_does_not_beat_the_plane() -> None:
    rng = np.random.default_rng(0)
    below = relief_cell([a_car(i, -3.0, 2.0) for i in range(4)], (View.END,), (0, 12), rng)
    assert np.isnan(below.share_of_true.value)
    # in some resamples the true shape does not beat the plane: the share may be anything
    mixed = [a_car(0, -3.0, 2.0), *(a_car(i, 4.0, 2.0) for i in range(1, 4))]
    cell = relief_cell(mixed, (View.END,), (0, 12), rng)
    assert cell.share_of_true.value == pytest.approx(0.5)
    assert cell.share_of_true.high == np.inf
    few = relief_cell(mixed[:2], (View.END,), (0, 12), rng)
    assert np.isnan(few.median["true"].low)
    assert few.median["true"].value == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("view", "azimuths_deg"),
    [(View.END, (0, 14, 346, 180)), (View.THREE_QUARTER, (16, 74, 225)), (View.SIDE, (75, 270))],
)
def test_views_follow_the_bins(view: View, azimuths_deg: tuple[float, ...]) -> None:
    assert {View.of(azimuth) for azimuth in azimuths_deg} == {view}
