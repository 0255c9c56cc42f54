import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rescore.fusion.fuse import fuse

UNIT = st.floats(0, 1)


@settings(deadline=None)
@given(UNIT, UNIT, UNIT)
def test_equals_the_product_of_powers_and_is_finite(likelihood: float, d: float, w: float) -> None:
    got = fuse(np.array([likelihood]), np.array([d]), w)[0]
    # Python has 0 ** 0 = 1, as stated for the limits
    assert got == pytest.approx(likelihood**w * (1 - d) ** (1 - w), rel=1e-9, abs=1e-300)
    assert 0 <= got <= 1


def test_closed_form() -> None:
    # sqrt(0.25) * sqrt(1 - 0.36) = 0.5 * 0.8
    assert fuse(np.array([0.25]), np.array([0.36]), 0.5)[0] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("likelihood", "d", "w", "expected"),
    [(0, 0.5, 0.5, 0), (0.5, 1, 0.5, 0), (0, 1, 0.5, 0), (0, 0.3, 0, 0.7), (0.4, 1, 1, 0.4), (0, 1, 1, 0)],
)
def test_limits(likelihood: float, d: float, w: float, expected: float) -> None:
    assert fuse(np.array([likelihood]), np.array([d]), w)[0] == expected


def test_full_weight_is_the_likelihood_bit_for_bit() -> None:
    likelihood = np.random.default_rng(0).uniform(size=1000)
    likelihood[1] = np.nextafter(likelihood[0], 1)
    np.testing.assert_array_equal(fuse(likelihood, np.full(1000, 0.3), 1.0), likelihood)


@pytest.mark.parametrize("w", [0.0, 0.3, 1.0])
def test_no_evidence_keeps_the_likelihood(w: float) -> None:
    likelihood = np.array([0.0, 0.2, 1.0])
    np.testing.assert_array_equal(fuse(likelihood, np.full(3, np.nan), w), likelihood)


@pytest.mark.parametrize("w", [-0.1, 1.1, np.nan])
def test_refuses_a_weight_outside_the_unit_interval(w: float) -> None:
    with pytest.raises(ValueError, match=r"w must lie in \[0, 1\]"):
        fuse(np.zeros(1), np.zeros(1), w)
