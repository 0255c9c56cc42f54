"""What is kept of fitted instances: the file gives it back, and it shows the whole car beyond the box."""

from pathlib import Path

import numpy as np
import pytest

from recon.arrays import FloatArray
from recon.errors import Failure, Reason, RescoreError
from recon.localization.depth_views import DepthViews
from recon.localization.disparity_fit import BoxFit, DisparityFit, DisparityFitConfig
from recon.localization.standing_box import StandingBox
from recon.view_bins import ViewBins
from rescore.data.frames import Frame
from rescore.evidence.files import read_evidence, read_fits, write_evidence
from rescore.evidence.fit_summaries import FitSummary, area_of_fit, summarise_fits
from rescore.evidence.instance_fits import boxes_of_fits, views_of_space
from rescore.evidence.views import NO_BIN, views_of_fits
from tests.recon.localization import stepped_car as car

CONFIG = DisparityFitConfig(views=car.VIEWS_CONFIG)
WHERE = StandingBox(np.array([-1.0, 12.0]), np.radians(15.0), car.SIZE_M)
NOWHERE = StandingBox(np.array([0.0, 400.0]), 0.0, car.SIZE_M)


@pytest.fixture(scope="module")
def views() -> DepthViews:
    return views_of_space(car.space(), car.RIG.ground.height_m, CONFIG.views)


@pytest.fixture(scope="module")
def frame() -> Frame:
    disparity = car.disparity_of(WHERE, noise_px=0.3)
    picture = np.zeros((*disparity.shape, 3), np.uint8)
    return Frame(1, picture, disparity, car.RIG.stereo, car.RIG.ground)


@pytest.fixture(scope="module")
def boxes() -> FloatArray:
    """The car whole, and its left half."""
    whole = car.silhouette_of(car.disparity_of(WHERE), car.disparity_of(NOWHERE))
    half = whole.copy()
    half[2] = half[[0, 2]].mean()
    return np.stack([whole, half])


@pytest.fixture(scope="module")
def fits(frame: Frame, boxes: FloatArray, views: DepthViews) -> tuple[BoxFit | None, ...]:
    fit = DisparityFit(frame.disparity_px, car.RIG, views, CONFIG)
    return (*fit.fit(boxes), None)


@pytest.fixture(scope="module")
def summaries(
    frame: Frame, boxes: FloatArray, fits: tuple[BoxFit | None, ...]
) -> tuple[FitSummary | None, ...]:
    return summarise_fits(fits, np.concatenate([boxes, boxes[:1]]), frame, car.space(), CONFIG)


def test_boxes_and_ends_are_those_of_the_fits(
    frame: Frame, fits: tuple[BoxFit | None, ...], summaries: tuple[FitSummary | None, ...]
) -> None:
    assert summaries[2] is None
    framed = boxes_of_fits(fits, frame)
    assert framed is not None
    for i in range(2):
        fit, kept = fits[i], summaries[i]
        assert fit is not None
        assert kept is not None
        np.testing.assert_array_equal(kept.framed.box.values[0], framed.values[i])
        np.testing.assert_array_equal(kept.seen.silhouette_px, fit.seen.silhouette_px)
        assert kept.overlap == fit.overlap
        assert kept.seen.box.centre_cam_m[0, 2] == pytest.approx(12, abs=0.4)


def test_the_depth_of_a_car_is_kept_beyond_a_box_on_its_half(
    frame: Frame, boxes: FloatArray, summaries: tuple[FitSummary | None, ...]
) -> None:
    kept = summaries[1]
    assert kept is not None
    known = np.isfinite(kept.seen.disparity_px)
    columns = kept.column_px[known.any(axis=0)]
    assert columns.min() == pytest.approx(boxes[0, 0], abs=12)
    assert columns.max() == pytest.approx(boxes[0, 2], abs=12)
    # it is what is measured there
    row, column = np.meshgrid(kept.row_px.astype(int), kept.column_px.astype(int), indexing="ij")
    inner = known & (column > boxes[0, 0] + 15) & (column < boxes[0, 2] - 15)
    off = np.abs(kept.seen.disparity_px - frame.disparity_px[row, column])[inner]
    assert np.median(off) < 0.7


def test_a_file_gives_fits_back_beside_what_else_it_holds(
    tmp_path: Path, summaries: tuple[FitSummary | None, ...]
) -> None:
    found = [Failure(Reason.NO_OUTLINE, "none")] * 3
    write_evidence(tmp_path / "1.npz", found, summaries)
    assert read_evidence(tmp_path / "1.npz") == tuple(found)
    back = read_fits(tmp_path / "1.npz")
    assert back[2] is None
    for one, other in zip(summaries[:2], back[:2], strict=True):
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.column_px, other.column_px)
        np.testing.assert_array_equal(one.row_px, other.row_px)
        for a, b in ((one.framed, other.framed), (one.seen, other.seen)):
            np.testing.assert_array_equal(a.box.values, b.box.values)
            np.testing.assert_array_equal(a.box.deviations, b.box.deviations)
            np.testing.assert_allclose(a.silhouette_px, b.silhouette_px)
            np.testing.assert_allclose(a.disparity_px, b.disparity_px, rtol=5e-4)


def test_a_file_without_fits_is_as_it_was(tmp_path: Path) -> None:
    found = [Failure(Reason.NO_OUTLINE, "none")]
    write_evidence(tmp_path / "1.npz", found)
    write_evidence(tmp_path / "2.npz", found, (None,))
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "2.npz").read_bytes()
    assert read_fits(tmp_path / "1.npz") == (None,)
    with pytest.raises(RescoreError, match="expected an evidence file, found none"):
        read_fits(tmp_path / "none.npz")


def test_what_is_shown_reaches_to_the_end_of_the_car_but_not_far_beyond_the_box() -> None:
    box = np.array([100.0, 100, 200, 150])
    near = area_of_fit(box, np.array([90.0, 110, 260, 160]))
    np.testing.assert_array_equal(near, [90, 100, 260, 160])
    far = area_of_fit(box, np.array([-90.0, 110, 900, 140]))
    np.testing.assert_array_equal(far, [-50, 100, 350, 150])


def test_the_view_is_that_of_the_framed_instance(fits: tuple[BoxFit | None, ...]) -> None:
    bins = ViewBins()
    found = views_of_fits(fits, bins)
    whole = fits[0]
    assert whole is not None
    # the car's nose points 15 degrees away from the picture's right: its right side is seen
    assert found.view_bin[0] == bins.containing(float(whole.framed.pose.azimuth_rad[0])) == 9
    assert 1 / bins.count < found.probability[0] <= 1
    assert found.second_bin[0] != found.view_bin[0]
    assert (found.view_bin[2], found.second_bin[2]) == (NO_BIN, NO_BIN)
    columns = found.columns(bins)
    assert columns["view_bin"].tolist()[::2] == ["right", ""]
    np.testing.assert_array_equal(np.isnan(columns["view_probability"]), [False, False, True])


def test_tempering_flattens_the_probability_and_keeps_the_bins(fits: tuple[BoxFit | None, ...]) -> None:
    sure, unsure = (views_of_fits(fits[:2], ViewBins(), temper) for temper in (1.0, 0.01))
    np.testing.assert_array_equal(sure.view_bin, unsure.view_bin)
    np.testing.assert_array_equal(sure.second_bin, unsure.second_bin)
    assert (sure.probability > unsure.probability).all()
