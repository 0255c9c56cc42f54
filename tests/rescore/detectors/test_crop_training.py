import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from recon.boxes import iou_matrix
from recon.errors import RescoreError
from rescore.cli import app
from rescore.detectors.boosted import BoostedConfig
from rescore.detectors.boosting import BoostConfig
from rescore.detectors.crop_training import (
    Crops,
    SceneConfig,
    at_one_size,
    config_for_crops,
    cross_validate,
    read_crops,
    scenes_of,
    train_on_crops,
)
from rescore.detectors.fragments import FragmentConfig
from rescore.detectors.hog_svm import HogConfig
from rescore.detectors.mining import MiningConfig
from rescore.detectors.registry import DETECTORS, load_detector
from rescore.detectors.windows import WindowGeometry
from rescore.formats.uiuc import CARS_PATTERN, STREET_PATTERN, read_uiuc
from rescore.studies.uiuc import evaluate_uiuc
from tests.rescore.toy_street import random_car, toy_picture

WIDTH, HEIGHT = 100, 40
MINING = MiningConfig(jitter_copies=1, hard_per_frame=5, rounds=2)
HOG_LEARNER = DETECTORS["hog"].learner
HOG = config_for_crops(HogConfig(mining=MINING), WIDTH, HEIGHT)
BOOSTED = config_for_crops(
    BoostedConfig(
        mining=MINING,
        fragments=FragmentConfig(count=100),
        boosting=BoostConfig(rounds=40, features_per_round=15),
        floor=-50.0,
    ),
    WIDTH,
    HEIGHT,
)


def toy_crops(n, seed):
    """Crops of the toy street: planted patterns cut with a margin, and ground without one."""
    rng = np.random.default_rng(seed)
    cars, street = [], []
    for _ in range(n):
        picture, boxes = toy_picture(rng, [random_car(rng)])
        x0, y0, x1, y1 = boxes[0]
        size = (x1 - x0) * 1.15
        middle = (x0 + x1) / 2, (y0 + y1) / 2
        cars.append(cut(picture, middle, size))
        empty, _ = toy_picture(rng, [])
        street.append(cut(empty, (rng.uniform(80, 240), rng.uniform(60, 180)), rng.uniform(70, 130)))
    return Crops(np.stack(cars), np.stack(street))


def cut(picture, middle, width):
    return cv2.getRectSubPix(
        cv2.resize(picture, None, fx=WIDTH / width, fy=WIDTH / width),
        (WIDTH, HEIGHT),
        tuple(m * WIDTH / width for m in middle),
    )


def write(folder, crops):
    folder.mkdir()
    for i, crop in enumerate(crops):
        cv2.imwrite(str(folder / f"{i:03d}.png"), crop)
    return folder


def test_folders_and_patterns_are_read(tmp_path):
    crops = toy_crops(3, 0)
    cars, street = write(tmp_path / "cars", crops.cars), write(tmp_path / "street", crops.street[:2])
    (cars / "notes.txt").write_text("no picture")
    read = read_crops(cars, street)
    assert (read.cars == crops.cars).all()
    assert (read.street == crops.street[:2]).all()
    assert len(read_crops(cars / "00[01].png", street).cars) == 2


def test_other_crops_are_refused(tmp_path):
    crops = toy_crops(2, 0)
    cars, street = write(tmp_path / "cars", crops.cars), write(tmp_path / "street", crops.street)
    with pytest.raises(RescoreError, match="got no picture"):
        read_crops(tmp_path / "nothing", street)
    cv2.imwrite(str(cars / "zzz.png"), np.zeros((40, 90), np.uint8))
    with pytest.raises(RescoreError, match=r"zzz.png: expected 100 x 40 px as 000.png has, got 90 x 40"):
        read_crops(cars, street)
    with pytest.raises(RescoreError, match="expected cars and street of one size"):
        Crops(crops.cars, crops.street[:, :30])
    with pytest.raises(RescoreError, match="got 2 and 0"):
        Crops(crops.cars, crops.street[:0])
    (cars / "zzz.png").write_bytes(b"no picture")
    with pytest.raises(RescoreError, match=r"zzz.png: expected a picture, could not read it"):
        read_crops(cars, street)


def test_the_window_is_the_crop():
    assert HOG.window == WindowGeometry(120, 48, 0, 0)
    assert BOOSTED.window == WindowGeometry(100, 40, 0, 0)
    # 48 * 90 / 40 = 108 px are 13.5 cells
    assert config_for_crops(HogConfig(), 90, 40).window.width_px % 8 == 0
    assert (HOG.scan.smallest_car_px, HOG.scan.largest_car_px) == (100, 350)
    assert config_for_crops(HogConfig(), 500, 200).scan.largest_car_px == 500


def test_a_scene_shows_each_car_among_tiles_of_street():
    crops = Crops(
        np.arange(200, 204, dtype=np.uint8)[:, None, None].repeat(40, 1).repeat(100, 2),
        np.zeros((2, 40, 100), np.uint8),
    )
    scenes = list(scenes_of(crops, SceneConfig(rows=2, columns=3), np.random.default_rng(0)))
    assert len(scenes) == 4
    for value, scene in zip(range(200, 204), scenes, strict=True):
        assert scene.picture.shape == (80, 300)
        x0, y0, x1, y1 = scene.truth.xyxy_px[0].astype(int)
        assert (scene.picture[y0:y1, x0:x1] == value).all()
        assert (scene.picture > 0).sum() == 40 * 100


@pytest.mark.parametrize("mirror", [True, False])
def test_mirrored_tiles_only_where_cars_face_both_ways(mirror):
    ramp = np.arange(100, dtype=np.uint8)[None, None].repeat(40, 1).repeat(8, 0)
    scenes = scenes_of(Crops(ramp, ramp), SceneConfig(mirror=mirror), np.random.default_rng(1))
    rises = {bool(s.picture[0, 1] > s.picture[0, 0]) for s in scenes}
    assert rises == ({True, False} if mirror else {True})


@pytest.mark.parametrize(("name", "config"), [("hog", HOG), ("boosted", BOOSTED)])
def test_finds_the_cars_of_crops_it_has_not_seen(name, config):
    learner = DETECTORS[name].learner
    validation = cross_validate(
        toy_crops(30, 0), config, learner, SceneConfig(folds=2), np.random.default_rng(0), jobs=1
    )
    assert validation.curve.n_cars == 30
    assert validation.curve.equal_error_recall > 0.9
    assert validation.scaling.a < 0


def test_finds_cars_of_other_sizes_in_a_whole_picture():
    detector = train_on_crops(toy_crops(40, 2), HOG, HOG_LEARNER, SceneConfig(), np.random.default_rng(0), 1)
    picture, boxes = toy_picture(np.random.default_rng(3), [(60.0, 90.0, 160.0)])
    wide = (boxes[0, 2] - boxes[0, 0]) * 0.075
    assert iou_matrix(detector.detect(picture).xyxy_px[:1], boxes + np.array([-wide, 0, wide, 0]))[0, 0] > 0.6
    widths = np.ptp(at_one_size(detector).scan(picture).xyxy_px[:, [0, 2]], axis=1)
    assert widths == pytest.approx(100)


def test_mirrored_copies_serve_cars_that_face_the_other_way():
    crops = toy_crops(40, 2)
    picture, _ = toy_picture(np.random.default_rng(3), [(60.0, 90.0, 160.0)])
    loss = {}
    for mirror in (True, False):
        detector = train_on_crops(
            crops, HOG, HOG_LEARNER, SceneConfig(mirror=mirror), np.random.default_rng(0), 1
        )
        other_way = np.ascontiguousarray(picture[:, ::-1])
        loss[mirror] = detector.detect(picture).score[0] - detector.detect(other_way).score[0]
    # every toy car's nose is on the left
    assert loss[False] > 0.2
    assert abs(loss[True]) < 0.5 * loss[False]


def test_same_seed_same_detector_whatever_the_jobs():
    crops = toy_crops(10, 4)
    one, two = (
        train_on_crops(crops, HOG, HOG_LEARNER, SceneConfig(), np.random.default_rng(5), jobs)
        for jobs in (1, 2)
    )
    assert one.weight.tobytes() == two.weight.tobytes()


def test_too_few_crops_to_hold_some_out_are_refused():
    with pytest.raises(RescoreError, match="expected at least 3 of cars and of street"):
        cross_validate(toy_crops(2, 0), HOG, HOG_LEARNER, SceneConfig(), np.random.default_rng(0), 1)


def test_the_commands_train_on_folders_and_evaluate_the_set(tmp_path):
    crops = toy_crops(12, 6)
    cars, street = write(tmp_path / "cars", crops.cars), write(tmp_path / "street", crops.street)
    arguments = [
        "train",
        "--crops",
        str(cars),
        str(street),
        "--detector",
        "hog",
        "--out",
        str(tmp_path / "m"),
    ]
    done = CliRunner().invoke(app, [*arguments, "--jobs", "1"])
    assert done.exit_code == 0, done.exception
    assert (tmp_path / "m" / "hog.platt.json").is_file()
    assert load_detector(tmp_path / "m" / "hog.npz").config.window == WindowGeometry(120, 48, 0, 0)

    picture = np.vstack([np.hstack(crops.street[i : i + 3]) for i in (0, 3, 6)])
    picture[30:70, 110:210] = crops.cars[0]
    (tmp_path / "TestImages").mkdir()
    cv2.imwrite(str(tmp_path / "TestImages" / "test-0.pgm"), picture)
    (tmp_path / "trueLocations.txt").write_text("0: (30,110)\n")
    done = CliRunner().invoke(app, ["uiuc", str(tmp_path), str(tmp_path / "m" / "hog.npz"), "--jobs", "1"])
    assert done.exit_code == 0, done.exception
    assert done.stdout.startswith("hog, 1 pictures: 1 cars, recall 100.0% at equal error")


def test_a_data_set_or_crops(tmp_path):
    done = CliRunner().invoke(app, ["train", "--out", str(tmp_path)])
    assert "expected a data set or --crops, got both or neither" in str(done.exception)


def test_a_third_of_the_real_crops_makes_a_detector_for_real_pictures(uiuc):
    crops = read_crops(uiuc / CARS_PATTERN, uiuc / STREET_PATTERN)
    third = Crops(crops.cars[::3], crops.street[::3])
    config = config_for_crops(HogConfig(), crops.width_px, crops.height_px)
    detector = train_on_crops(third, config, HOG_LEARNER, SceneConfig(), np.random.default_rng(0), 1)
    curve = evaluate_uiuc(detector, read_uiuc(uiuc), 1)
    assert curve.n_cars == 200
    assert curve.equal_error_recall > 0.9


def test_a_detector_of_other_windows_is_not_evaluated_on_the_set():
    other = train_on_crops(
        toy_crops(5, 0),
        config_for_crops(HogConfig(mining=MINING), 90, 40),
        HOG_LEARNER,
        SceneConfig(),
        np.random.default_rng(0),
        1,
    )
    with pytest.raises(RescoreError, match="expected one trained on the set's crops, 100 px wide"):
        evaluate_uiuc(other, (), 1)
