"""Depth of another system in place of the class model's: closed forms on a small scene; rendered frames."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from recon.camera import PinholeCamera, StereoCamera
from recon.errors import Failure, Reason
from recon.stereo.sgbm import SgbmConfig
from rescore import Boxes, Camera, PredictedDepth, RescoreError, Rescorer, StereoFrame
from rescore.data.frames import Frame, load_frame
from rescore.evidence.align_depth import AlignConfig, DepthAlignment
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.cues import cue_column, cues_of
from rescore.evidence.files import read_evidence, write_evidence
from rescore.evidence.predicted_depth import (
    BoxPrediction,
    another_system,
    check_mode,
    cut_to_boxes,
    prediction_doubts,
)
from rescore.evidence.registration import LEARNED, Registration
from rescore.evidence.settings import RescoreConfig
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.rescore_frame import RescoredFrame, Rescoring, rescore_frame
from tests.bank_judge import stored_judge

WIDTH, HEIGHT = 96, 64
PAIR = StereoCamera(PinholeCamera(80.0, 80.0, 47.5, 31.5, WIDTH, HEIGHT), 0.5)
BOX = np.array([20.0, 10.0, 70.0, 50.0])
UNCLIPPED = RescoreConfig(align=AlignConfig(percentiles=(0.0, 100.0)))
"""Minimum and maximum become 0 and 1, so that nothing is clipped and D is exact."""


def scene() -> np.ndarray:
    """Depth (h, w) in metres: an object with a round front before a slanted wall."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    bump = np.hypot((x - 45) / 20, (y - 30) / 15)
    return np.where(bump < 1, 10 - np.sqrt(np.maximum(1 - bump**2, 0)), 15 + 0.05 * x)


ON_OBJECT = scene() < 12


def frame_of(depth_m: np.ndarray, camera: StereoCamera | None = PAIR) -> Frame:
    disparity = (80.0 * 0.5 / depth_m).astype(np.float32)
    return Frame(1, np.zeros((HEIGHT, WIDTH, 3), np.uint8), disparity, camera, None)


def candidates_in(*boxes: np.ndarray) -> Candidates:
    n = len(boxes)
    return Candidates(1, np.array(boxes, float), np.ones(n), np.full(n, 0.5))


def compared(
    predicted: PredictedDepth,
    frame: Frame | None = None,
    config: RescoreConfig = UNCLIPPED,
    box: np.ndarray = BOX,
) -> RescoredFrame:
    return rescore_frame(frame or frame_of(scene()), candidates_in(box), predicted, Rescoring(config))


def alignment(*given: Any, **options: Any) -> DepthAlignment:
    (found,) = compared(*given, **options).alignments
    assert isinstance(found, DepthAlignment)
    return found


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (0.03, -7.0), (250.0, 1000.0), (-2.0, 5.0)])
@pytest.mark.parametrize("camera", [PAIR, None])
@pytest.mark.parametrize("kind", ["depth", "inverse"])
def test_a_prediction_right_up_to_scale_and_offset_has_difference_zero(
    kind: str, camera: StereoCamera | None, scale: float, offset: float
) -> None:
    """Zi = s z + t: Zs = (z - low) / span = Zi / (s span) - (t / s + low) / span, so a1 = 1 / (s span)."""
    true = scene() if kind == "depth" else 1 / scene()
    found = alignment(PredictedDepth(scale * true + offset, kind), frame_of(scene(), camera))
    # float32 of an offset of 1000 beside a spread of 250 x 0.1 leaves some 1e-5
    assert found.difference < 1e-4
    # without a camera measured depth is 1 / disparity, 80 x 0.5 = 40 times smaller
    unit = 1 if camera else 1 / 40 if kind == "depth" else 40
    assert found.scale == pytest.approx(unit / (scale * found.stereo_span), rel=1e-3)
    in_box = true[10:50, 20:70] * unit
    assert found.stereo_low == pytest.approx(in_box.min(), rel=1e-5)
    assert found.stereo_span == pytest.approx(np.ptp(in_box), rel=1e-4)


def test_inverse_depth_is_not_taken_for_depth() -> None:
    inverse = 3 / scene() + 0.2
    assert alignment(PredictedDepth(inverse, "inverse")).difference < 1e-4
    mistaken = alignment(PredictedDepth(inverse, "depth"))
    assert mistaken.difference > 0.005
    assert mistaken.scale < 0


def test_percentiles_leave_what_they_clip() -> None:
    """The default normalisation clips 2 % at either end, which leaves a little of an exact prediction."""
    found = alignment(PredictedDepth(scene(), "depth"), config=RescoreConfig())
    assert 1e-5 < found.difference < 0.06


def test_metric_inverse_depth_is_metric_depth() -> None:
    depth = alignment(PredictedDepth(scene(), "depth", "metric"))
    inverse = alignment(PredictedDepth(1 / scene(), "inverse", "metric"))
    assert inverse.difference < 1e-5
    assert inverse.scale == pytest.approx(depth.scale, rel=1e-5)


def test_metric_predictions_give_the_cues_that_need_a_scale() -> None:
    """Measured depth of 1.25 times the predicted: the logarithm of the ratio is log 1.25."""
    cues = compared(PredictedDepth(scene() / 1.25, "depth", "metric")).candidates.cues
    assert cues[0, cue_column("depth_ratio")] == pytest.approx(np.log(1.25), abs=1e-4)
    assert cues[0, cue_column("relief_scale")] == pytest.approx(0, abs=0.2)
    assert cues[0, cue_column("relief_residual")] < 0.02
    free = compared(PredictedDepth(scene() / 1.25, "depth")).candidates.cues
    assert np.isnan(free[0, [cue_column(n) for n in (*cues_of(Registration.GUARDED), "depth_ratio")]]).all()
    assert np.isfinite(free[0, cue_column("measured")])


def test_pixels_without_prediction_are_left_out() -> None:
    """Where NaN covers all that is wrong, D is 0; metric numbers of 0 and less are none as well."""
    wrong = scene()
    wrong[:30] = 99
    assert alignment(PredictedDepth(wrong, "depth")).difference > 0.1
    for hole, unit in ((np.nan, "relative"), (np.inf, "relative"), (0.0, "metric"), (-1.0, "metric")):
        holes = np.where(wrong == 99, hole, wrong)
        assert alignment(PredictedDepth(holes, "depth", unit)).difference < 1e-5


def test_a_relative_number_may_be_zero() -> None:
    """The farthest point of a network's inverse depth is often 0."""
    inverse = 1 / scene()
    inverse -= inverse.min()
    assert (inverse == 0).any()
    everything = np.array([0.0, 0, WIDTH, HEIGHT])
    found = cut_to_boxes(PredictedDepth(inverse, "inverse"), everything[None], (WIDTH, HEIGHT), 0.5)[0]
    assert isinstance(found, BoxPrediction)
    assert np.isfinite(found.depth.depth).all()


def test_a_mask_restricts_the_pixels() -> None:
    """Background that is predicted wrongly counts without a mask, and does not with one."""
    wrong = np.where(ON_OBJECT, scene(), 8.0)
    assert alignment(PredictedDepth(wrong, "depth")).difference > 0.1
    for mask in (ON_OBJECT, ON_OBJECT.astype(np.uint8) * 255):
        assert alignment(PredictedDepth(wrong, "depth", mask=mask)).difference < 1e-4


def test_of_numbered_objects_the_one_with_most_pixels_in_the_box_counts() -> None:
    numbers = np.where(ON_OBJECT, 40_000, 0)
    numbers[:, 60:] = 7
    predicted = PredictedDepth(scene(), "depth", mask=numbers)
    beside = np.array([60.0, 10, 90, 40])
    found = cut_to_boxes(predicted, np.array([BOX, beside]), (WIDTH, HEIGHT), 0.5)
    for one, number, box in zip(found, (40_000, 7), ((10, 50, 20, 70), (10, 40, 60, 90)), strict=True):
        assert isinstance(one, BoxPrediction)
        y0, y1, x0, x1 = box
        np.testing.assert_array_equal(np.isfinite(one.depth.depth), numbers[y0:y1, x0:x1] == number)


def test_what_is_not_there_is_a_reason() -> None:
    nothing = PredictedDepth(np.full((HEIGHT, WIDTH), np.nan), "depth")
    empty = PredictedDepth(scene(), "depth", mask=np.zeros((HEIGHT, WIDTH), np.uint8))
    outside = np.array([90.0, 10, 150, 40])
    for given, box, reason, detail in (
        (nothing, BOX, Reason.NO_PREDICTION, "predicted depth in the box expected"),
        (empty, BOX, Reason.NO_PREDICTION, "on an object of the mask expected"),
        (PredictedDepth(scene(), "depth"), outside, Reason.BOX_OUTSIDE_IMAGE, "got 10%"),
    ):
        (found,) = compared(given, box=box).alignments
        assert isinstance(found, Failure)
        assert found.reason is reason
        assert detail in found.detail


def test_boxes_on_the_edge_are_cut_to_the_picture() -> None:
    box = np.array([-10.0, 30.4, 40.6, 80.0])
    (found,) = cut_to_boxes(PredictedDepth(scene(), "depth"), box[None], (WIDTH, HEIGHT), 0.5)
    assert isinstance(found, BoxPrediction)
    # middles of pixels in the box: columns 0.5 to 40.5, rows from 30.5
    assert found.depth.window == (slice(30, HEIGHT), slice(0, 41))


def test_the_side_that_a_box_shows_needs_no_class_model() -> None:
    given = replace(candidates_in(BOX, BOX), azimuth_deg=np.array([10.0, np.nan]))
    predicted = PredictedDepth(scene(), "depth")
    views = rescore_frame(frame_of(scene()), given, predicted, Rescoring()).views
    np.testing.assert_allclose(np.rad2deg(views.azimuth_rad), [10, 90])
    assert views.view_bin.tolist() == [-1, -1]


def test_evidence_files_hold_predictions(tmp_path: Path) -> None:
    boxes = np.array([BOX, [200.0, 0, 250, 30]])
    found = cut_to_boxes(PredictedDepth(1e6 / scene(), "inverse"), boxes, (WIDTH, HEIGHT), 0.5)
    write_evidence(tmp_path / "1.npz", found)
    first, second = read_evidence(tmp_path / "1.npz")
    assert isinstance(first, BoxPrediction)
    assert (first.inverse, first.metric) == (True, False)
    np.testing.assert_array_equal(first.depth.depth, found[0].depth.depth)
    assert first.depth.window == found[0].depth.window
    assert second == found[1]


def table_of(predicted: PredictedDepth, n: int = 6) -> CandidateTable:
    return rescore_frame(frame_of(scene()), candidates_in(*[BOX] * n), predicted, Rescoring()).candidates


def test_unlikely_kinds_of_prediction_are_told() -> None:
    assert prediction_doubts(table_of(PredictedDepth(scene(), "depth", "metric"))) == ()
    assert prediction_doubts(table_of(PredictedDepth(5 / scene(), "inverse"))) == ()
    (falling,) = prediction_doubts(table_of(PredictedDepth(5 / scene(), "depth")))
    assert falling.startswith("100% of the predictions in boxes fall where measured depth rises")
    (unit,) = prediction_doubts(table_of(PredictedDepth(4 * scene(), "depth", "metric")))
    assert "measured depth is smaller than the predicted depth by a factor of 4 or more" in unit
    (millimetres,) = prediction_doubts(table_of(PredictedDepth(1000 * scene(), "depth", "metric")))
    assert "measured depth is smaller than the predicted depth by a factor of 1000 or more" in millimetres
    (kilometres,) = prediction_doubts(table_of(PredictedDepth(scene() / 1000, "depth", "metric")))
    assert "measured depth is larger than the predicted depth by a factor of 1000 or more" in kilometres
    assert prediction_doubts(table_of(PredictedDepth(5 / scene(), "depth"), n=4)) == ()


@pytest.mark.parametrize("mode", list(Registration))
def test_modes_past_eq_6_take_no_relative_predictions(mode: Registration) -> None:
    check_mode("metric", mode)
    if mode not in LEARNED:
        check_mode("relative", mode)
        return
    with pytest.raises(RescoreError, match=f"registration {mode}: expected metric predictions, got relative"):
        check_mode("relative", mode)


MAP = scene()
BAD: list[tuple[Callable[[], object], str]] = [
    (lambda: PredictedDepth(MAP, "disparity"), "predicted_as: expected depth or inverse, got 'disparity'"),
    (lambda: PredictedDepth(MAP, "depth", "cm"), "unit: expected relative or metric, got 'cm'"),
    (
        lambda: PredictedDepth(MAP[None], "depth"),
        "expected an array (h, w) of relative numbers, got shape (1,",
    ),
    (lambda: PredictedDepth(MAP.tolist(), "depth"), "relative numbers, got list; convert the prediction"),
    (lambda: PredictedDepth(MAP[:0], "depth"), "got shape (0, 96) of float64"),
    (
        lambda: PredictedDepth(MAP.astype(str), "depth"),
        "predicted depth: expected an array (h, w) of relative",
    ),
    (
        lambda: PredictedDepth(MAP.astype(np.uint16), "depth", "metric"),
        "expected an array (h, w) of metric numbers, floats, got shape (64, 96) of uint16",
    ),
    (
        lambda: PredictedDepth(MAP, "depth", mask=MAP),
        "mask: expected an array (h, w) of whole numbers or truth",
    ),
    (
        lambda: PredictedDepth(MAP, "depth", mask=ON_OBJECT[1:]),
        "mask: expected shape (64, 96) as the prediction has, got (63, 96)",
    ),
    (
        lambda: compared(PredictedDepth(MAP[::2, ::2], "depth")),
        "predicted depth: expected shape (64, 96) as the left picture has, got (32, 48); scale",
    ),
]


@pytest.mark.parametrize(("make", "message"), BAD)
def test_bad_predictions_say_what_was_expected(make: Callable[[], object], message: str) -> None:
    with pytest.raises(RescoreError, match=re.escape(message)) as raised:
        make()
    assert "\n" not in str(raised.value)


def test_the_library_needs_no_class_model() -> None:
    frame = StereoFrame(
        np.zeros((HEIGHT, WIDTH, 3), np.uint8), depth_m=scene(), camera=Camera(80, 80, 47.5, 31.5)
    )
    boxes = Boxes(BOX[None], likelihood=np.array([0.25]))
    rescorer = Rescorer(None, 0.5, config=UNCLIPPED)
    given = PredictedDepth(100 / scene() - 3, "inverse")
    before = given.values.copy()
    found = rescorer.rescore(frame, boxes, predicted=given, instances=True)
    assert found.status == ("ok",)
    assert found.depth_difference[0] < 1e-4
    # eq. 7 with D = 0 and w = 0.5: the root of the likelihood
    assert found.posterior[0] == pytest.approx(0.5, abs=1e-4)
    assert found.instances is not None
    assert isinstance(found.instances[0], BoxPrediction)
    np.testing.assert_array_equal(given.values, before)
    with pytest.raises(RescoreError, match="expected a class model or a prediction, got neither"):
        rescorer.rescore(frame, boxes)


def test_an_evidence_model_of_the_class_model_takes_no_predictions(tmp_path: Path) -> None:
    frame = StereoFrame(
        np.zeros((HEIGHT, WIDTH, 3), np.uint8), depth_m=scene(), camera=Camera(80, 80, 47.5, 31.5)
    )
    boxes = Boxes(BOX[None], likelihood=np.array([0.25]))
    judge = stored_judge(tmp_path)
    fitted = judge.models[Registration.METRIC]
    given = PredictedDepth(scene(), "depth", "metric")
    with pytest.raises(RescoreError, match="got what was fitted with depth of the class model; fit it again"):
        Rescorer(None, 0.5, fitted).rescore(frame, boxes, predicted=given)
    own = replace(fitted, depth_of=another_system("depth", "metric"))
    assert Rescorer(None, 0.5, own).rescore(frame, boxes, predicted=given).has_evidence.shape == (1,)
    with pytest.raises(RescoreError, match="expected what was fitted with depth of the class model"):
        Rescorer(judge.class_model, 0.5, own).rescore(frame, boxes)
    with pytest.raises(RescoreError, match="registration metric: expected metric predictions"):
        Rescorer(None, 0.5, own).rescore(frame, boxes, predicted=PredictedDepth(scene(), "depth"))


def test_on_rendered_frames_a_right_prediction_fits_cars_better_than_a_wrong_one(tiny_run: Path) -> None:
    """True disparity with an unknown scale and offset a frame stands in for a network.

    D depends on neither. Every box whose prediction is right has a low D, whatever it shows; here it is asked
    of the cars alone, beside the prediction of the same frame seen in a mirror.
    """
    data = read_dataset(tiny_run / "data")
    rng = np.random.default_rng(0)
    right, wrong = [], []
    for record in data.frames:
        boxes = data.truth[record.image_id].xyxy_px
        if not len(boxes):
            continue
        frame = load_frame(record, SgbmConfig())
        name = record.left_path.name
        truth = cv2.imread(str(tiny_run / "data" / "truth" / name), cv2.IMREAD_UNCHANGED) / np.float32(256)

        def differences(values: np.ndarray, frame: Frame = frame, boxes: np.ndarray = boxes) -> np.ndarray:
            predicted = PredictedDepth(values, "inverse")
            given = candidates_in(*boxes)
            return rescore_frame(frame, given, predicted, Rescoring()).candidates.depth_difference

        as_is = differences(truth)
        scaled = differences(rng.uniform(0.2, 5) * truth + rng.uniform(-20, 20))
        np.testing.assert_allclose(scaled, as_is, atol=1e-4)
        right += as_is.tolist()
        wrong += differences(truth[:, ::-1]).tolist()
    both = np.isfinite(right) & np.isfinite(wrong)
    assert both.sum() >= 5
    # stereo's noise on far cars makes up most of either
    assert np.mean(np.array(right)[both] < np.array(wrong)[both]) > 0.8
