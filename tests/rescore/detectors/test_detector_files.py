import json

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.detectors.boosted import BoostedConfig, BoostedDetector, BoostedLearner
from rescore.detectors.boosting import BoostConfig
from rescore.detectors.fragments import FragmentConfig
from rescore.detectors.hog_svm import HogConfig, HogDetector, HogLearner
from rescore.detectors.mining import ScanRange
from rescore.detectors.registry import load_detector
from rescore.detectors.windows import WindowGeometry


def random_crops(window, seed):
    rng = np.random.default_rng(seed)
    return rng.integers(0, 255, (12, window.height_px, window.width_px), dtype=np.uint8)


def trained(learner, window, rng):
    cars, street = (learner.features(random_crops(window, seed)) for seed in (0, 1))
    return learner.fit(cars, street, rng)


def hog():
    config = HogConfig(
        window=WindowGeometry(56, 24, 4, 4), scan=ScanRange(50, 120, 1.3), floor=-9, padding_px=(8, 8)
    )
    return trained(HogLearner(config), config.window, np.random.default_rng(0))


def boosted():
    config = BoostedConfig(
        scan=ScanRange(64, 120, 1.3),
        fragments=FragmentConfig(count=30, sizes_px=(7, 9)),
        boosting=BoostConfig(rounds=12, features_per_round=30),
        floor=-99,
    )
    rng = np.random.default_rng(0)
    return trained(BoostedLearner.of(random_crops(config.window, 0), config, rng, 1), config.window, rng)


@pytest.mark.parametrize(("make", "kind"), [(hog, HogDetector), (boosted, BoostedDetector)])
def test_a_loaded_detector_is_the_saved_one(tmp_path, make, kind):
    detector = make()
    path = tmp_path / "models" / "detector.npz"
    detector.save(path)
    loaded = load_detector(path)
    assert isinstance(loaded, kind)
    assert loaded.config == detector.config
    assert loaded.name == detector.name
    picture = np.random.default_rng(5).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    before, after = detector.detect(picture), loaded.detect(picture)
    assert len(before) > 0
    assert before.xyxy_px.tobytes() == after.xyxy_px.tobytes()
    assert before.score.tobytes() == after.score.tobytes()
    assert [p.name for p in path.parent.iterdir()] == ["detector.npz"]


def test_the_header_is_readable_and_nothing_is_pickled(tmp_path):
    path = tmp_path / "d.npz"
    hog().save(path)
    with np.load(path, allow_pickle=False) as stored:
        header = json.loads(stored["header_json"].tobytes())
    assert header["kind"] == "hog_svm"
    assert header["config"]["window"]["object_width_px"] == 56
    assert set(header["versions"]) == {"numpy", "opencv", "scikit-learn"}


def rewritten(tmp_path, change):
    path = tmp_path / "d.npz"
    hog().save(path)
    with np.load(path, allow_pickle=False) as stored:
        arrays = dict(stored)
    header = json.loads(arrays.pop("header_json").tobytes())
    change(header, arrays)
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, header_json=text, **arrays)
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h, a: h.update(format="other"), "got another kind of npz"),
        (lambda h, a: h.update(format_version=99), "expected detector format 1, got 99"),
        (
            lambda h, a: h.update(kind="cascade"),
            "expected a detector of kind boosted_fragments or .* or hog_svm or .* or modelled, got 'cascade'",
        ),
        (lambda h, a: a.pop("weight"), "expected a whole hog_svm detector, could not read it"),
        (lambda h, a: a.update(weight=np.zeros(7)), "expected a whole hog_svm detector, could not read it"),
        (
            lambda h, a: h["config"].update(stride_apples=8),
            "expected a whole hog_svm detector, could not read it",
        ),
    ],
)
def test_wrong_files_are_refused(tmp_path, change, message):
    with pytest.raises(RescoreError, match=message):
        load_detector(rewritten(tmp_path, change))


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04 broken"])
def test_files_of_another_kind_are_refused(tmp_path, content):
    path = tmp_path / "d.npz"
    path.write_bytes(content)
    with pytest.raises(RescoreError, match="expected a detector file, could not read it"):
        load_detector(path)


def test_pickled_arrays_are_refused(tmp_path):
    path = tmp_path / "d.npz"
    np.savez(path, header_json=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RescoreError, match="could not read it"):
        load_detector(path)


def test_a_plain_npz_and_a_missing_file_are_refused(tmp_path):
    np.savez(tmp_path / "d.npz", a=np.zeros(3))
    with pytest.raises(RescoreError, match="could not read it"):
        load_detector(tmp_path / "d.npz")
    with pytest.raises(RescoreError, match="found no file; train the detector again"):
        load_detector(tmp_path / "none.npz")
