from dataclasses import replace

import cv2
import numpy as np
import pytest

from recon.boxes import iou_matrix
from recon.errors import RescoreError
from rescore.detectors.hog_svm import (
    HogConfig,
    HogDetector,
    descriptor_length,
    descriptors,
    hog_descriptor,
    train_hog,
    train_hog_on_descriptors,
)
from rescore.detectors.mining import MiningConfig, ScanRange
from rescore.detectors.windows import WindowGeometry
from tests.rescore.toy_street import random_car, toy_dataset, toy_picture

SMALL = HogConfig(
    scan=ScanRange(60, 200, 1.12), mining=MiningConfig(random_per_frame=15, hard_per_frame=8, rounds=2)
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return train_hog(toy_dataset(tmp_path_factory.mktemp("hog"), 24, 0), SMALL, np.random.default_rng(0))


def random_detector(config, seed=0):
    weight = np.random.default_rng(seed).normal(0, 0.02, descriptor_length(config)).astype(np.float32)
    return HogDetector(weight, 0.25, config)


def test_a_window_of_the_scan_scores_weight_times_descriptor_plus_bias():
    # smallest car = object width: the picture is scanned at its own size, and only at that
    config = HogConfig(scan=ScanRange(88, 88, 1.1), floor=-100, padding_px=(0, 0), stride_px=8)
    detector = random_detector(config)
    picture = np.random.default_rng(1).integers(0, 255, (96, 168), dtype=np.uint8)
    found = detector.scan(picture)
    # (168 - 104) / 8 + 1 = 9 columns, (96 - 48) / 8 + 1 = 7 rows
    assert len(found) == 63
    corners = (found.xyxy_px[:, :2] - 8).round().astype(int)
    hog = hog_descriptor(config)
    for corner, score in zip(corners[::7], found.score[::7], strict=True):
        values = np.ravel(hog.compute(picture, locations=[tuple(int(c) for c in corner)]))
        assert score == pytest.approx(values @ detector.weight + 0.25, abs=1e-4)
    assert np.ptp(found.xyxy_px[:, 2:] - found.xyxy_px[:, :2], axis=0).tolist() == [0, 0]


def test_windows_that_are_dropped_early_would_be_dropped_anyway(monkeypatch):
    detector = random_detector(HogConfig(scan=ScanRange(60, 120, 1.1), floor=-100))
    picture = np.random.default_rng(1).integers(0, 255, (200, 320), dtype=np.uint8)
    kept = detector.scan(picture)
    monkeypatch.setattr("rescore.detectors.hog_svm.MOST_WINDOWS", 10**9)
    of_all = detector.scan(picture)
    assert len(kept) == len(of_all) == 2000
    np.testing.assert_array_equal(kept.xyxy_px, of_all.xyxy_px)
    np.testing.assert_array_equal(kept.score, of_all.score)


def test_boxes_are_windows_less_their_margin():
    window = WindowGeometry(80, 32, 8, 4)
    boxes = window.boxes(np.array([[10.0, 20.0]]), 1.5)
    # corner + 1.5 * (8, 4); size 1.5 * (80, 32)
    assert boxes.tolist() == [[22, 26, 142, 74]]
    assert window.windows(boxes).tolist() == [[10, 20, 10 + 1.5 * 96, 20 + 1.5 * 40]]


def test_window_of_a_box_keeps_width_and_ground_line():
    window = WindowGeometry(80, 32, 8, 4)
    tall = np.array([[100.0, 50, 180, 110]])
    assert window.windows(tall).tolist() == [[92, 110 + 4 - 40, 188, 114]]


def test_finds_the_planted_pattern_at_its_place_and_size(trained):
    rng = np.random.default_rng(7)
    for _ in range(8):
        picture, boxes = toy_picture(rng, [random_car(rng)])
        found = trained.detect(picture)
        assert iou_matrix(found.xyxy_px[:1], boxes)[0, 0] > 0.7


def test_candidates_are_few_sorted_apart_and_inside(trained):
    rng = np.random.default_rng(8)
    picture, _ = toy_picture(rng, [(-30.0, 50.0, 120.0), random_car(rng)])
    found = trained.detect(picture)
    assert 0 < len(found) <= 15
    assert (np.diff(found.score) <= 0).all()
    overlap = iou_matrix(found.xyxy_px, found.xyxy_px) - np.eye(len(found))
    assert overlap.max() <= trained.config.suppression.max_iou
    assert (found.xyxy_px >= 0).all()
    assert (found.xyxy_px <= [320, 240, 320, 240]).all()


def test_colour_and_grey_pictures_agree(trained):
    picture, _ = toy_picture(np.random.default_rng(9), [(100.0, 100.0, 90.0)])
    colour = trained.detect(np.repeat(picture[..., None], 3, axis=2))
    assert colour.score.tolist() == trained.detect(picture).score.tolist()


def test_no_candidate_is_legal(trained):
    strict = replace(trained, config=replace(trained.config, floor=50.0))
    assert len(strict.detect(np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8))) == 0
    assert len(trained.detect(np.zeros((20, 3, 3), np.uint8))) == 0


def test_scanned_boxes_have_the_sizes_of_the_levels_also_at_the_edge():
    config = HogConfig(scan=ScanRange(60, 200, 1.12), floor=-100)
    found = random_detector(config).scan(np.zeros((100, 150), np.uint8))
    widths = found.xyxy_px[:, 2] - found.xyxy_px[:, 0]
    heights = found.xyxy_px[:, 3] - found.xyxy_px[:, 1]
    level = np.log(widths / 60) / np.log(1.12)
    assert level == pytest.approx(level.round(), abs=1e-6)
    # 284 x 179 px hold windows of 104 x 48 up to 2.73 times their size, and 1.12^8 = 2.48
    assert level.max() == pytest.approx(8)
    assert heights == pytest.approx(widths * 32 / 88)
    # the border of 32 px at a zoom of 88 / 60, less the margin of the first level's windows: 8 - 32 = -24 px
    assert found.xyxy_px[:, 0].min() == pytest.approx((8 - 32) * 60 / 88)


def test_threads_do_not_change_the_result(trained):
    picture, _ = toy_picture(np.random.default_rng(10), [(100.0, 100.0, 90.0)])
    several = trained.scan(picture)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        one = trained.scan(picture)
    finally:
        cv2.setNumThreads(threads)
    assert one.xyxy_px.tobytes() == several.xyxy_px.tobytes()
    assert one.score.tobytes() == several.score.tobytes()


def test_same_seed_same_weights_whatever_the_jobs(tmp_path):
    data = toy_dataset(tmp_path, 4, 1)
    config = HogConfig(scan=SMALL.scan, mining=MiningConfig(random_per_frame=5, hard_per_frame=3, rounds=1))
    one, again, two = (train_hog(data, config, np.random.default_rng(3), jobs) for jobs in (1, 1, 2))
    assert one.weight.tobytes() == again.weight.tobytes() == two.weight.tobytes()
    assert one.bias == two.bias


def test_a_window_of_broken_cells_is_refused():
    with pytest.raises(RescoreError, match="expected a window of whole cells of 8 px, got 100 x 48"):
        HogConfig(window=WindowGeometry(84, 32, 8, 8))


def test_training_without_crops_is_refused():
    crops = descriptors(np.zeros((3, 48, 104), np.uint8), HogConfig())
    with pytest.raises(RescoreError, match="got 3 and 0"):
        train_hog_on_descriptors(crops, crops[:0], HogConfig(), np.random.default_rng(0))


def test_floating_point_pictures_are_refused(trained):
    with pytest.raises(RescoreError, match="expected \\(h, w, 3\\) uint8 RGB"):
        trained.detect(np.zeros((240, 320, 3)))


def test_windows_keep_their_own_scores(trained, monkeypatch):
    threads = []
    descriptor = trained.descriptor()

    class Watched:
        def detectMultiScale(self, *args, **kwargs):  # noqa: N802 (OpenCV's name)
            threads.append(cv2.getNumThreads())
            return descriptor.detectMultiScale(*args, **kwargs)

    monkeypatch.setattr(type(trained), "descriptor", lambda _: Watched())
    before = cv2.getNumThreads()
    trained.detect(np.full((120, 320, 3), 90, np.uint8))
    # with more threads OpenCV may hand the scores of one level to the windows of another
    assert threads == [1]
    assert cv2.getNumThreads() == before
