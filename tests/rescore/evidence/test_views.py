"""Candidates of one frame that are seen from different sides."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from recon.camera import StereoCamera
from recon.class_model import ClassModel
from recon.errors import Failure, Reason, RescoreError
from recon.reconstruction.reconstruct import Reconstruction, reconstruct
from recon.reconstruction.view_selection import ViewChoice, best_view_bin
from rescore.data.frames import Frame
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.cues import cue_column
from rescore.evidence.settings import RescoreConfig
from rescore.evidence.views import NO_BIN, UNSEEN, FittedViews, reconstruct_views, views_of
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from tests.bank_judge import stored_judge
from tests.single_car import CarPicture, car_from

CONFIG = RescoreConfig()


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> ClassModel:
    scratch: Path = tmp_path_factory.mktemp("model")
    return stored_judge(scratch).class_model


@pytest.fixture(scope="module")
def car() -> CarPicture:
    return car_from(0.0, distance_m=8.0)


@pytest.fixture(scope="module")
def frame(car: CarPicture) -> Frame:
    camera = StereoCamera(car.seen_from.camera, 0.4)
    return Frame(1, car.rgb, camera.disparity_px(car.depth_m), camera, car.seen_from.ground)


def boxes(car: CarPicture, azimuth_deg: list[float] | None, n: int | None = None) -> Candidates:
    n = len(azimuth_deg) if azimuth_deg is not None else n or 1
    said = None if azimuth_deg is None else np.array(azimuth_deg)
    return Candidates(1, np.tile(car.box_px, (n, 1)), np.arange(n, 0, -1.0), np.full(n, 0.5), said)


def same(a: Reconstruction | Failure, b: Reconstruction | Failure) -> bool:
    if isinstance(a, Failure) or isinstance(b, Failure):
        return a == b
    return np.array_equal(a.outline_px, b.outline_px) and np.array_equal(
        a.depth.depth, b.depth.depth, equal_nan=True
    )


def test_the_azimuth_of_a_candidate_picks_its_bin(car: CarPicture, frame: Frame, model: ClassModel) -> None:
    given = boxes(car, [0.0, 50.0, np.nan, 355.0, 180.0])
    found = rescore_frame(frame, given, model, Rescoring(CONFIG))
    bins = [0, 2, UNSEEN, 0, 6]
    assert found.views.view_bin.tolist() == bins
    np.testing.assert_allclose(np.rad2deg(found.views.azimuth_rad), [0, 50, 90, 355, 180])
    for instance, view_bin in zip(found.instances, bins, strict=True):
        (alone,) = reconstruct(frame.left_rgb, car.box_px, view_bin, model, car.seen_from)
        assert same(instance, alone)
    # a car seen from its front is there from the front, and its box has no car's side
    assert isinstance(found.instances[0], Reconstruction)
    assert isinstance(found.instances[2], Failure)


def test_the_expected_size_follows_each_azimuth(car: CarPicture, frame: Frame, model: ClassModel) -> None:
    cues = rescore_frame(frame, boxes(car, [0.0, 20.0, np.nan]), model, Rescoring(CONFIG)).candidates.cues
    width = np.exp(cues[:, cue_column("width")])
    length, wide, _ = CONFIG.cues.surroundings.size_m
    turned = length * np.sin(np.deg2rad(20)) + wide * np.cos(np.deg2rad(20))
    # of its own azimuth, not of the middle of its bin, which is 30 degrees
    assert width[0] / width[1] == pytest.approx(turned / wide, rel=0.02)
    assert width[0] == pytest.approx(1, abs=0.15)
    assert width[2] < 0.5


def test_without_azimuths_all_have_the_one_bin(car: CarPicture, frame: Frame, model: ClassModel) -> None:
    none, unknown = boxes(car, None, 2), boxes(car, [np.nan, np.nan])
    plain, same_again = (rescore_frame(frame, c, model, Rescoring(CONFIG)) for c in (none, unknown))
    assert plain.views.view_bin.tolist() == [3, 3]
    np.testing.assert_array_equal(plain.candidates.cues, same_again.candidates.cues)


def test_the_class_model_chooses(car: CarPicture, frame: Frame, model: ClassModel) -> None:
    given = boxes(car, [np.nan, 180.0])
    outside = np.array([[5000.0, 10, 5100, 50]])
    given = Candidates(
        1,
        np.concatenate([given.xyxy_px, outside]),
        np.array([3.0, 2, 1]),
        np.full(3, 0.5),
        np.array([np.nan, 180, np.nan]),
    )
    found = rescore_frame(frame, given, model, Rescoring(replace(CONFIG, view_bin="model")))
    choice = best_view_bin(frame.left_rgb, car.box_px, model)
    assert isinstance(choice, ViewChoice)
    # a detector that says it is believed; where no bin will do there is a reason and no expected width
    assert found.views.view_bin.tolist() == [choice.view_bin, 6, NO_BIN]
    last = found.instances[2]
    assert isinstance(last, Failure)
    assert last.reason is Reason.BOX_OUTSIDE_IMAGE
    assert np.isnan(found.candidates.cues[2, cue_column("width")])
    # of the front or the rear, which look alike, with what stands between them and the sides
    assert choice.view_bin in {0, 1, 5, 6, 7, 11}


def test_a_fit_says_the_view_where_no_detector_does(car: CarPicture, frame: Frame, model: ClassModel) -> None:
    given = boxes(car, [180.0, np.nan, np.nan])
    fitted = FittedViews(np.array([1, 11, NO_BIN]), np.array([0.9, 0.6, np.nan]), np.array([0, 5, NO_BIN]))
    look = partial(views_of, frame.left_rgb, given, model=model, config=CONFIG.reconstruct, fitted=fitted)
    assert look(view_bin="fit").view_bin.tolist() == [6, 11, UNSEEN]
    np.testing.assert_allclose(np.rad2deg(look(view_bin="fit").azimuth_rad), [180, 330, 90])
    # a bin that is asked for by number is that of all
    assert look(view_bin=4).view_bin.tolist() == [6, 4, 4]
    few = look(view_bin="fit", model=replace(model, views=(model.view(3), model.view(6))))
    assert few.view_bin.tolist() == [6, NO_BIN, 3]
    assert few.failures[1].detail.startswith("a labelled view of bin 11 expected for azimuth 330 degrees")


def test_a_bin_that_the_model_does_not_have(car: CarPicture, frame: Frame, model: ClassModel) -> None:
    one_bin = replace(model, views=(model.view(3),))
    found = rescore_frame(frame, boxes(car, [180.0, np.nan]), one_bin, Rescoring(CONFIG))
    first = found.instances[0]
    assert isinstance(first, Failure)
    assert first.reason is Reason.REGISTRATION_FAILED
    assert first.detail == (
        "a labelled view of bin 6 expected for azimuth 180 degrees, the class model has bins 3"
    )
    assert found.views.view_bin.tolist() == [NO_BIN, 3]
    with pytest.raises(RescoreError, match="view bin: expected 0 to 11, got 12"):
        rescore_frame(frame, boxes(car, None), model, Rescoring(replace(CONFIG, view_bin=12)))


def test_a_table_keeps_the_azimuths(car: CarPicture) -> None:
    table = CandidateTable.of_candidates([boxes(car, [10.0, np.nan])])
    back = table.by_image([1])[1]
    np.testing.assert_array_equal(back.azimuth_deg, [10.0, np.nan])


def test_what_the_choice_of_a_bin_registered_is_what_the_reconstruction_finds(
    car: CarPicture, model: ClassModel
) -> None:
    shifts = np.array([[0, 0, 0, 0], [-3, 2, 3, 0], [4, 0, 9, 3]], float)
    given = replace(boxes(car, None, 3), xyxy_px=car.box_px + shifts)
    views = views_of(car.rgb, given, "model", model, CONFIG.reconstruct)
    assert len(views.registered) == 3
    told, afresh = (
        reconstruct_views(car.rgb, given.xyxy_px, v, model, car.seen_from, CONFIG.reconstruct)
        for v in (views, replace(views, registered={}))
    )
    assert any(isinstance(one, Reconstruction) for one in told)
    assert all(same(a, b) for a, b in zip(told, afresh, strict=True))
