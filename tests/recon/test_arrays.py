"""Columns that one value fills, rows by value, and medians."""

import numpy as np
import pytest

from recon.arrays import constant, median, percentiles, rows_by_value, rows_of, stacked


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_medians_and_percentiles_are_those_of_numpy(n: int, kind: type) -> None:
    values = np.random.default_rng(n).normal(5, 2, n).astype(kind)
    assert median(values) == pytest.approx(float(np.median(values)), rel=1e-6)
    expected = np.percentile(values.astype(float), [0, 2, 50, 98, 100])
    np.testing.assert_allclose(percentiles(values, [0, 2, 50, 98, 100]), expected, rtol=1e-12)


def test_rows_by_value_are_those_of_a_look_at_each_value() -> None:
    column = np.random.default_rng(0).integers(-3, 9, 200)
    found = rows_by_value(column)
    assert list(found) == sorted(set(column.tolist()))
    for value, rows in found.items():
        np.testing.assert_array_equal(rows, np.flatnonzero(column == value))
    assert rows_by_value(np.zeros(0, np.int64)) == {}


def test_columns_of_one_value_stay_such() -> None:
    """A million rows of 43 unknown numbers would take 344 MB; they take eight bytes."""
    unknown = constant(np.nan, (10**6, 43))
    both = stacked([unknown, rows_of(unknown, np.arange(7)), constant(np.nan, (0, 43))])
    assert both.shape == (10**6 + 7, 43)
    assert both.strides == (0, 0)
    assert np.isnan(both[-1]).all()
    texts = stacked([constant("", (3,), object), constant("", (2,), object)])
    assert (texts.strides, texts.tolist()) == ((0,), [""] * 5)


def test_columns_of_several_values_are_joined() -> None:
    assert stacked([constant(1.0, (2,)), constant(2.0, (2,))]).tolist() == [1, 1, 2, 2]
    assert stacked([constant("a", (1,), object), np.array(["b", "c"], object)]).tolist() == ["a", "b", "c"]
    assert stacked([np.zeros(0), np.zeros(0)]).tolist() == []
    column = np.array([3.0, 1.0, 2.0])
    assert rows_of(column, np.array([True, False, True])).tolist() == [3, 2]
    assert rows_of(constant(5.0, (3,)), np.array([True, False, True])).tolist() == [5, 5]
