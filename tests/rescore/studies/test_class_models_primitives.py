"""Greedy selection of primitives: closed forms, properties, and against trying all sets."""

from itertools import combinations

import numpy as np
import pytest

from rescore.studies.class_models import select_primitives


def test_greedy_by_hand() -> None:
    # alone, primitive 1 costs (1 + 2 + 4) / 3, less than 8 / 3 and 9 / 3; with 0 beside it (0 + 2 + 4) / 3,
    # with 2 beside it (1 + 2 + 0) / 3
    cost = np.array([[0.0, 1.0, 6.0], [4.0, 2.0, 3.0], [4.0, 4.0, 0.0]])
    chosen = select_primitives(cost, 3)
    assert chosen.order.tolist() == [1, 2, 0]
    np.testing.assert_allclose(chosen.cost, [7 / 3, 1.0, 2 / 3])
    assert chosen.full_cost == pytest.approx(2 / 3)


def test_cost_falls_to_that_of_the_library_and_is_near_the_best_sets() -> None:
    rng = np.random.default_rng(0)
    cost = rng.gamma(2.0, size=(21, 12))
    chosen = select_primitives(cost, 12)
    assert (np.diff(chosen.cost) <= 0).all()
    assert chosen.cost[-1] == pytest.approx(chosen.full_cost)
    assert sorted(chosen.order.tolist()) == list(range(12))
    for k in (2, 3, 4):
        best = min(cost[:, list(s)].min(axis=1).mean() for s in combinations(range(12), k))
        assert best <= chosen.cost[k - 1] <= 1.15 * best


@pytest.mark.parametrize("cost", [np.zeros((0, 3)), np.array([[np.nan, 1.0]]), np.zeros((2, 1))])
def test_bad_costs(cost: np.ndarray) -> None:
    with pytest.raises(ValueError, match="expected finite costs of at least 2 primitives"):
        select_primitives(cost, 2)
