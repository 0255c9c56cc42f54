import cv2
import numpy as np
import pytest

from recon.boxes import iou_matrix
from recon.errors import RescoreError
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.detectors.base import Detections
from rescore.detectors.mining import (
    CropStyle,
    MiningConfig,
    ScanRange,
    car_crops,
    hard_crops,
    hard_negatives,
    street_crops,
)
from rescore.detectors.windows import WindowGeometry, crop_windows

WINDOW = WindowGeometry(40, 16, 4, 4)


def style(**mining):
    return CropStyle(WINDOW, cv2.INTER_LINEAR, ScanRange(40, 120, 1.2), MiningConfig(**mining))


def dataset(root, boxes, ignore=None, visibility=None, picture=None):
    picture = (
        np.random.default_rng(0).integers(0, 255, (120, 200), dtype=np.uint8) if picture is None else picture
    )
    path = root / "0.png"
    cv2.imwrite(str(path), picture)
    n = len(boxes)
    truth = Truth(
        np.arange(n),
        np.array(boxes, float).reshape(-1, 4),
        np.array(ignore or [False] * n, bool),
        np.array(visibility or [1.0] * n, float),
        ("",) * n,
    )
    record = FrameRecord(0, path, None, None, "train", picture.shape[1], picture.shape[0], None, None)
    return DataSet(root, 1, "car", (record,), {0: truth}), picture


def test_scan_range_covers_its_sizes():
    widths = ScanRange(50, 100, 1.25).car_sizes_px()
    # 50, 62.5, 78.1, 97.7, 122: the first at or beyond 100 is the last
    assert widths == pytest.approx([50, 62.5, 78.125, 97.65625, 122.0703125])
    assert ScanRange(50, 50, 1.25).car_sizes_px().tolist() == [50]
    with pytest.raises(RescoreError, match="expected 0 < smallest <= largest"):
        ScanRange(50, 40, 1.2)


def test_a_car_of_canonical_size_is_cut_pixel_by_pixel(tmp_path):
    data, picture = dataset(tmp_path, [[60, 50, 100, 66]])
    crops = car_crops(data, style(jitter_copies=0), np.random.default_rng(0))
    assert crops.shape == (1, 24, 48)
    assert (crops[0] == picture[46:70, 56:104]).all()


def test_jitter_makes_copies_near_the_car(tmp_path):
    yy, xx = np.mgrid[:120, :200]
    data, _ = dataset(tmp_path, [[60, 50, 100, 66]], picture=(xx + 0 * yy).astype(np.uint8))
    crops = car_crops(data, style(jitter_copies=5), np.random.default_rng(0)).astype(float)
    assert len(crops) == 6
    # the picture is a ramp of 1 a column: the mean tells the shift, at most 4 % of 40 px and half a pixel
    shift = crops.mean(axis=(1, 2)) - crops[0].mean()
    assert 0 < np.abs(shift).max() <= 0.04 * 40 + 1


def test_cars_that_are_hardly_seen_or_ignored_teach_nothing(tmp_path):
    boxes = [[10, 50, 50, 66], [60, 50, 100, 66], [110, 50, 150, 66]]
    data, picture = dataset(tmp_path, boxes, [False, True, False], [0.4, 1.0, 0.9])
    crops = car_crops(data, style(jitter_copies=0), np.random.default_rng(0))
    assert len(crops) == 1
    assert (crops[0] == picture[46:70, 106:154]).all()


def test_no_car_at_all_is_an_error(tmp_path):
    data, _ = dataset(tmp_path, [[10, 50, 50, 66]], visibility=[0.2])
    with pytest.raises(RescoreError, match="expected cars at least 60% visible in 1 frames, got none"):
        car_crops(data, style(), np.random.default_rng(0))


def test_street_crops_never_show_a_car(tmp_path):
    # cars, also an ignored and a hidden one, are the only bright things
    boxes = [[20, 20, 80, 44], [100, 20, 160, 44], [60, 80, 120, 104]]
    picture = np.zeros((120, 200), np.uint8)
    for x0, y0, x1, y1 in boxes:
        picture[y0:y1, x0:x1] = 255
    data, _ = dataset(tmp_path, boxes, [False, True, False], [1.0, 1.0, 0.1], picture)
    crops = street_crops(data, style(random_per_frame=200), np.random.default_rng(0))
    assert len(crops) > 100
    # at an IoU of 0.35 at most about half of the object is bright (2 * 0.35 / 1.35 of equal boxes), less
    # its margin; a window on a car would be all bright
    inner = crops[:, 4:-4, 4:-4].mean(axis=(1, 2)) / 255
    assert inner.max() < 0.9


def test_hard_negatives_are_away_from_cars_and_best_first():
    truth = Truth(np.array([0]), np.array([[0.0, 0, 40, 16]]), np.array([True]), np.array([0.1]), ("",))
    boxes = np.array(
        [[0.0, 0, 40, 16], [60, 0, 100, 16], [62, 0, 102, 16], [10, 0, 50, 16], [120, 0, 160, 16]]
    )
    found = Detections(boxes, np.array([9.0, 1, 3, 8, 2]))
    # 0 is the car; 3 overlaps it by 30 / 50 = 0.6; 1 is a near-copy of 2
    assert hard_negatives(found, truth, MiningConfig(), 10).tolist() == [2, 4]
    assert hard_negatives(found, truth, MiningConfig(), 1).tolist() == [2]


def test_hard_negatives_are_found_however_many_windows_score_better() -> None:
    rng = np.random.default_rng(0)
    corner = np.concatenate([rng.uniform(100, 103, (900, 2)), rng.uniform(200, 600, (600, 2))])
    boxes = np.concatenate([corner, corner + rng.uniform(38, 42, (1500, 2))], axis=1)
    # the windows on the car are the best ones; scores that are equal keep their order
    score = np.round(np.concatenate([rng.uniform(1, 2, 900), rng.uniform(-1, 1, 600)]), 1)
    car = np.array([[100.0, 100.0, 140.0, 140.0]])
    truth = Truth(np.arange(1), car, np.zeros(1, bool), np.ones(1), ("",))
    wanted: list[int] = []
    for i in np.argsort(-score, kind="stable").tolist():
        apart = iou_matrix(boxes[[i]], np.concatenate([car, boxes[wanted]]))[0]
        if apart[0] <= 0.35 and (apart[1:] <= 0.6).all():
            wanted.append(i)
    found = Detections(boxes, score)
    assert len(wanted) > 100
    for count in (1, 7, 100):
        assert hard_negatives(found, truth, MiningConfig(), count).tolist() == wanted[:count]
    assert hard_negatives(found, truth, MiningConfig(), 2000).tolist() == wanted


class FixedDetector:
    """Finds the same boxes in any picture."""

    name = "fixed"

    def __init__(self, boxes):
        self.found = Detections(np.array(boxes, float), np.arange(len(boxes), 0, -1.0))

    def scan(self, rgb):
        return self.found

    detect = scan


def test_mined_crops_are_the_detectors_windows(tmp_path):
    data, picture = dataset(tmp_path, [[10, 10, 50, 26]])
    detector = FixedDetector([[10, 10, 50, 26], [100, 60, 140, 76]])
    crops = hard_crops(detector, data, style(), np.random.default_rng(0))
    assert len(crops) == 1
    assert (crops[0] == picture[56:80, 96:144]).all()


def test_negatives_are_limited_in_number(tmp_path):
    data, _ = dataset(tmp_path, [[10, 10, 50, 26]])
    assert (
        len(street_crops(data, style(random_per_frame=50, max_negatives=20), np.random.default_rng(0))) == 10
    )


def test_windows_outside_the_picture_are_mirrored():
    picture = np.arange(48, dtype=np.uint8)[None].repeat(24, axis=0)
    left = crop_windows(picture, np.array([[-10.0, 0, 38, 24]]), WINDOW, cv2.INTER_LINEAR)[0]
    assert left[0, :12].tolist() == [10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 1]
    with pytest.raises(RescoreError, match="lies outside the 48 x 24 picture"):
        crop_windows(picture, np.array([[100.0, 0, 148, 24]]), WINDOW, cv2.INTER_LINEAR)


def test_random_windows_lie_in_the_picture(tmp_path):
    data, _ = dataset(tmp_path, [[10, 10, 50, 26]])
    wide = CropStyle(WINDOW, cv2.INTER_LINEAR, ScanRange(40, 5000, 1.2), MiningConfig(random_per_frame=30))
    assert len(street_crops(data, wide, np.random.default_rng(0))) > 5
    assert iou_matrix(np.zeros((1, 4)), np.zeros((1, 4)))[0, 0] == 0
