import numpy as np
import pytest

from rescore.metrics.bootstrap import BootstrapConfig, bootstrap
from rescore.metrics.curve_bands import Band, curve_bands
from rescore.metrics.curves import recall_curve
from rescore.metrics.matching import FALSE_ALARM, HIT, MatchTable
from rescore.metrics.resampled import Levels


def table(n_images: int = 30, per_image: int = 6, seed: int = 0) -> tuple[MatchTable, np.ndarray]:
    """Candidates of which the first of each image is its one car, and ranks well on the whole."""
    rng = np.random.default_rng(seed)
    image = np.repeat(np.arange(n_images), per_image)
    hit = np.arange(len(image)) % per_image == 0
    ranking = rng.normal(np.where(hit, 1.5, 0.0))
    outcome = np.where(hit, HIT, FALSE_ALARM).astype(np.int8)
    match = MatchTable(n_images, n_images, image, ranking, outcome, np.where(hit, image, -1))
    return match, np.ones(n_images, np.int64)


def at(band: Band, x: float) -> tuple[float, float]:
    i = int(np.argmin(np.abs(band.x - x)))
    assert band.x[i] == pytest.approx(x)
    return float(band.low[i]), float(band.high[i])


def test_the_band_of_cars_is_that_of_the_bootstrap_of_single_readings():
    match, cars = table()
    band = curve_bands(match, cars, seed=3).cars
    level = float(band.x[40])
    config = BootstrapConfig(n_resamples=500, levels=Levels(fppi=(level,), recalls=()))
    single = bootstrap({"a": match}, cars, (), np.random.default_rng(3), config).tables["a"]
    expected = single.recall_at_fppi[level]
    assert at(band, level) == pytest.approx((expected.low, expected.high))


def test_the_curve_lies_in_its_band():
    match, cars = table()
    bands = curve_bands(match, cars, seed=0)
    curve = recall_curve(match)
    reading = curve.y[np.searchsorted(curve.x, bands.cars.x + 1e-12, side="right") - 1]
    assert (bands.cars.low <= reading).all()
    assert (reading <= bands.cars.high).all()
    for band in (bands.candidate, bands.cars, bands.precision):
        assert ((band.low >= 0) & (band.low <= band.high) & (band.high <= 1)).all()
        assert (np.diff(band.x) > 0).all()
    assert (bands.cars.high > bands.cars.low).sum() > 30


def test_images_that_are_all_alike_leave_no_doubt():
    # every image: its car above its false alarm, so each resample gives the same rates
    n = 10
    image = np.repeat(np.arange(n), 2)
    hit = np.tile([True, False], n)
    ranking = np.where(hit, 2.0, 1.0)
    outcome = np.where(hit, HIT, FALSE_ALARM).astype(np.int8)
    bands = curve_bands(MatchTable(n, n, image, ranking, outcome, image), np.ones(n, np.int64), seed=1)
    for band in (bands.candidate, bands.cars, bands.precision):
        np.testing.assert_array_equal(band.low, 1.0)
        np.testing.assert_array_equal(band.high, 1.0)


def test_draws_that_never_reach_a_share_of_cars_count_as_precision_0():
    # 24 images with a car found, 6 with a false alarm above all cars instead: about half of the draws hold
    # fewer than 24 of the first kind and never find 80 %; those that do find h of 30 with precision h / 30
    n, n_hit = 30, 24
    hit = np.arange(n) < n_hit
    image, ranking = np.arange(n), np.where(hit, 1.0, 2.0)
    outcome = np.where(hit, HIT, FALSE_ALARM).astype(np.int8)
    match = MatchTable(n, n, image, ranking, outcome, image)
    band = curve_bands(match, np.ones(n, np.int64), seed=1).precision
    assert band.x[-1] == pytest.approx(n_hit / n)
    assert band.low[-1] == 0
    assert n_hit / n < band.high[-1] < 1


def test_more_images_make_a_narrower_band():
    few, many = (curve_bands(*table(n), seed=0).candidate for n in (20, 320))
    width = [np.mean(b.high - b.low) for b in (few, many)]
    # sixteen times the images: a quarter of the width
    assert width[1] == pytest.approx(width[0] / 4, rel=0.35)


def test_nothing_to_draw_from_gives_no_band():
    match, cars = table(n_images=1)
    assert curve_bands(match, cars, seed=0) is None
    match, cars = table()
    nothing = MatchTable(30, 0, match.image, match.ranking, np.full(180, FALSE_ALARM, np.int8), match.image)
    assert curve_bands(nothing, np.zeros(30, np.int64), seed=0) is None


def test_resamples_some_at_a_time_give_the_same_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    match, cars = table(40)
    whole = curve_bands(match, cars, seed=0)
    monkeypatch.setattr("rescore.metrics.curve_bands.CELLS", 7 * len(match.image))
    parts = curve_bands(match, cars, seed=0)
    assert whole is not None
    assert parts is not None
    for name in ("candidate", "cars", "precision"):
        for end in ("x", "low", "high"):
            np.testing.assert_array_equal(
                getattr(getattr(parts, name), end), getattr(getattr(whole, name), end), err_msg=name
            )
