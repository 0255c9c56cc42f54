import numpy as np

from reports.curve_bands import curve_bands
from rescore.bootstrap import BootstrapConfig, bootstrap
from rescore.matching import FALSE_ALARM, HIT, MatchTable


def table(n_images: int, rng: np.random.Generator) -> MatchTable:
    """One car an image, found in most, and some false alarms that rank lower on average."""
    image = np.repeat(np.arange(n_images), 4)
    outcome = np.full(len(image), FALSE_ALARM, np.int8)
    outcome[::4] = HIT
    ranking = rng.normal(0, 1, len(image)) + 1.5 * (outcome == HIT)
    annotation = np.where(outcome == HIT, image + 1, -1)
    return MatchTable(n_images, n_images, image, ranking, outcome, annotation)


def test_images_that_are_all_alike_leave_no_doubt():
    # every image: its car at rank 2, a false alarm at rank 1; every resample is the same curve
    image = np.repeat(np.arange(30), 2)
    outcome = np.tile(np.array([HIT, FALSE_ALARM], np.int8), 30)
    match = MatchTable(
        30, 30, image, np.tile([2.0, 1.0], 30), outcome, np.where(outcome == HIT, image + 1, -1)
    )
    bands = curve_bands(match, np.ones(30, int), 0, (0.01, 10))
    for band in (bands.candidate, bands.cars, bands.precision):
        np.testing.assert_array_equal(band.low, band.high)
    # all cars are found before the first false alarm
    np.testing.assert_array_equal(bands.cars.low, 1)
    np.testing.assert_array_equal(bands.precision.low, 1)


def test_a_band_is_about_as_wide_as_the_interval_of_a_reading():
    match = table(120, np.random.default_rng(4))
    cars = np.ones(120, np.int64)
    band = curve_bands(match, cars, 1, (0.004, 20)).cars
    figures = bootstrap({"a": match}, cars, [], np.random.default_rng(1), BootstrapConfig(n_resamples=2000))
    for fppi, reading in figures.tables["a"].recall_at_fppi.items():
        assert abs(np.interp(fppi, band.x, band.low) - reading.low) < 0.04
        assert abs(np.interp(fppi, band.x, band.high) - reading.high) < 0.04
        assert np.interp(fppi, band.x, band.low) <= reading.value <= np.interp(fppi, band.x, band.high)


def test_without_hits_there_is_no_band_of_the_roc():
    match = MatchTable(
        3, 2, np.array([0, 1]), np.array([1.0, 2.0]), np.full(2, FALSE_ALARM, np.int8), np.array([-1, -1])
    )
    bands = curve_bands(match, np.array([1, 1, 0]), 0, (0.1, 10))
    assert len(bands.candidate.x) == 0
    np.testing.assert_array_equal(bands.cars.high, 0)
