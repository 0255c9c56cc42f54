import cv2
import numpy as np
import pytest

from recon.boxes import iou_matrix
from recon.errors import RescoreError
from rescore.detectors.boosted import BoostedConfig, train_boosted
from rescore.detectors.boosting import BoostConfig
from rescore.detectors.fragments import (
    FragmentConfig,
    correlations,
    crop_features,
    cut_dictionary,
    filter_responses,
    level_features,
)
from rescore.detectors.mining import MiningConfig, ScanRange
from rescore.detectors.windows import WindowGeometry
from tests.rescore.toy_street import random_car, toy_dataset, toy_picture

WINDOW = WindowGeometry(64, 24, 8, 8)
SMALL = BoostedConfig(
    scan=ScanRange(60, 200, 1.15),
    fragments=FragmentConfig(count=150),
    boosting=BoostConfig(rounds=50, features_per_round=80),
    mining=MiningConfig(random_per_frame=15, hard_per_frame=8, rounds=2),
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    data = toy_dataset(tmp_path_factory.mktemp("boosted"), 24, 0)
    return train_boosted(data, SMALL, np.random.default_rng(0))


def noisy_crops(n=4, seed=0):
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 255, (n, 10, 20), dtype=np.uint8)
    return np.stack(
        [cv2.resize(c, (WINDOW.width_px, WINDOW.height_px), interpolation=cv2.INTER_CUBIC) for c in coarse]
    )


def test_correlations_are_those_of_match_template():
    rng = np.random.default_rng(0)
    picture = rng.normal(0, 20, (40, 50)).astype(np.float32)
    patches = rng.normal(size=(3, 7, 7)).astype(np.float32)
    patches -= patches.mean(axis=(1, 2), keepdims=True)
    patches /= np.linalg.norm(patches, axis=(1, 2), keepdims=True)
    found = correlations(picture, patches, 2, noise_floor=0.0)
    for patch, values in zip(patches, found.transpose(1, 0, 2), strict=True):
        expected = np.abs(cv2.matchTemplate(picture, patch, cv2.TM_CCOEFF_NORMED))[::2, ::2]
        assert values == pytest.approx(expected, abs=1e-4)


def test_noise_floor_silences_flat_ground():
    flat = np.random.default_rng(0).normal(100, 1.0, (20, 20)).astype(np.float32)
    patch = np.zeros((1, 7, 7), np.float32)
    patch[0, :, :3], patch[0, :, 4:] = -1, 1
    patch /= np.linalg.norm(patch)
    loud, quiet = (correlations(flat, patch, 1, floor).max() for floor in (0.0, 10.0))
    assert loud > 0.2
    assert quiet < 0.05


def test_filters_by_hand():
    # a vertical step of 40 grey levels: Sobel gives (1 + 2 + 1) * 40 = 160, / 4 = 40
    picture = np.full((9, 9), 100, np.uint8)
    picture[:, 5:] = 140
    identity, x, y, laplacian = filter_responses(picture)
    assert identity.shape == (7, 7)
    assert identity[0].tolist() == [-28.0] * 4 + [12.0] * 3
    assert x[3].tolist() == [0, 0, 0, 40, 40, 0, 0]
    assert not y.any()
    # kernel [2 0 2; 0 -8 0; 2 0 2]: on either side of the step 2 * 2 * 40 / 8 = 20
    assert laplacian[3].tolist() == [0, 0, 0, 20, 20, 0, 0]


def test_features_of_a_scan_equal_those_of_its_crops():
    config = FragmentConfig(count=60)
    dictionary = cut_dictionary(noisy_crops(), WINDOW, config, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    picture = cv2.resize(
        rng.integers(0, 255, (30, 40), dtype=np.uint8), (111, 63), interpolation=cv2.INTER_CUBIC
    )
    features = level_features(picture, dictionary, WINDOW, stride=2)
    step = 2 * config.grid_px
    assert features.shape == (60, (63 - 40) // step + 1, (111 - 80) // step + 1)
    rows, columns = np.indices(features.shape[1:]).reshape(2, -1) * step
    crops = np.stack([picture[r : r + 40, c : c + 80] for r, c in zip(rows, columns, strict=True)])
    assert crop_features(crops, dictionary) == pytest.approx(features.reshape(60, -1), abs=2e-5)


def test_a_crop_has_its_features_whatever_lies_beside_it():
    # 77 px are no whole number of grid steps
    crops = np.ascontiguousarray(noisy_crops(5)[:, :, :77])
    window = WindowGeometry(61, 24, 8, 8)
    dictionary = cut_dictionary(crops, window, FragmentConfig(count=40), np.random.default_rng(0))
    together = crop_features(crops, dictionary)
    assert together.shape == (40, 5)
    for crop, features in zip(crops, together.T, strict=True):
        alone = level_features(crop, dictionary, window, stride=2)
        assert alone.shape == (40, 1, 1)
        assert features == pytest.approx(alone.ravel(), abs=2e-5)


def test_a_fragment_answers_most_to_the_crop_it_was_cut_from():
    crops = noisy_crops(1)
    dictionary = cut_dictionary(
        crops, WINDOW, FragmentConfig(count=40, noise_floor=0.0), np.random.default_rng(0)
    )
    assert crop_features(crops, dictionary) == pytest.approx(np.ones((40, 1)), abs=1e-4)
    assert crop_features(noisy_crops(1, seed=5), dictionary).mean() < 0.9


def test_a_fragment_is_found_as_far_as_its_mask_reaches():
    config = FragmentConfig(count=1, sizes_px=(7,), noise_floor=0.0)
    crops = noisy_crops(1)
    dictionary = cut_dictionary(crops, WINDOW, config, np.random.default_rng(0))
    wide = np.pad(crops[0], 10, mode="reflect")
    reach = config.mask_radius * config.grid_px

    def moved(dx):
        return crop_features(wide[None, 10 : 10 + 40, 10 - dx : 10 - dx + 80], dictionary)[0, 0]

    assert moved(reach) == pytest.approx(1.0, abs=1e-4)
    assert moved(-reach) == pytest.approx(1.0, abs=1e-4)
    assert moved(reach + 2) < 0.99


def test_chosen_fragments_keep_their_features():
    crops = noisy_crops(5)
    dictionary = cut_dictionary(crops, WINDOW, FragmentConfig(count=30), np.random.default_rng(0))
    index = np.array([0, 3, 14, 15, 29])
    assert crop_features(crops, dictionary.chosen(index)) == pytest.approx(
        crop_features(crops, dictionary)[index], abs=1e-5
    )
    only_small = dictionary.chosen(np.array([2, 4]))
    assert [len(p) for p in only_small.patches] == [2, 0]
    assert crop_features(crops, only_small).shape == (2, 5)


def test_finds_the_planted_pattern_at_its_place_and_size(trained):
    rng = np.random.default_rng(7)
    for _ in range(8):
        picture, boxes = toy_picture(rng, [random_car(rng)])
        found = trained.detect(picture)
        assert iou_matrix(found.xyxy_px[:1], boxes)[0, 0] > 0.7


def test_only_used_fragments_are_kept(trained):
    assert trained.stumps.used().tolist() == list(range(len(trained.dictionary)))
    assert len(trained.dictionary) <= SMALL.boosting.rounds


def test_scan_scores_are_those_of_the_windows(trained):
    picture, _ = toy_picture(np.random.default_rng(11), [(100.0, 100.0, 64.0)])
    features = level_features(picture, trained.dictionary, WINDOW, 2)
    crop = picture[48 : 48 + 40, 80 : 80 + 80]
    scores = trained.stumps.score(crop_features(crop[None], trained.dictionary))
    assert trained.stumps.score(features)[12, 20] == pytest.approx(scores[0], abs=1e-4)


def test_no_candidate_is_legal(trained):
    assert len(trained.detect(np.full((240, 320, 3), 128, np.uint8))) == 0
    assert len(trained.detect(np.zeros((5, 5, 3), np.uint8))) == 0


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


def test_same_seed_same_detector_whatever_the_jobs(tmp_path):
    data = toy_dataset(tmp_path, 4, 1)
    config = BoostedConfig(
        scan=SMALL.scan,
        fragments=FragmentConfig(count=40),
        boosting=BoostConfig(rounds=10, features_per_round=20),
        mining=MiningConfig(random_per_frame=5, hard_per_frame=3, rounds=1),
    )
    one, again, two = (train_boosted(data, config, np.random.default_rng(3), jobs) for jobs in (1, 1, 2))
    for other in (again, two):
        assert one.stumps.threshold.tobytes() == other.stumps.threshold.tobytes()
        assert one.stumps.above.tobytes() == other.stumps.above.tobytes()
        assert [p.tobytes() for p in one.dictionary.patches] == [
            p.tobytes() for p in other.dictionary.patches
        ]


def test_crops_without_contrast_are_refused():
    flat = np.full((3, 40, 80), 90, np.uint8)
    with pytest.raises(RescoreError, match="crops of cars have hardly any contrast"):
        cut_dictionary(flat, WINDOW, FragmentConfig(count=5), np.random.default_rng(0))


def test_patches_larger_than_the_window_are_refused():
    with pytest.raises(RescoreError, match="no room for patches of 61 px"):
        cut_dictionary(noisy_crops(), WINDOW, FragmentConfig(sizes_px=(61,)), np.random.default_rng(0))
