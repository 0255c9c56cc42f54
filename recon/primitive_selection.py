"""A small set of primitives for all parts of several classes, by greedy selection (section 3.2)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class PrimitiveSelection:
    """Primitives in the order in which they were chosen."""

    order: NDArray[np.intp]
    """Indices into the library, shape (s,)."""
    cost: FloatArray
    """Mean cost of all parts with the first 1, 2, ... of them, shape (s,); never rises."""
    full_cost: float
    """The same with the whole library: the least there can be."""


def select_primitives(cost: FloatArray, count: int) -> PrimitiveSelection:
    """Greedy selection: each step adds the primitive that lowers the mean cost of the parts most.

    A part costs what the best of the chosen primitives costs it.

    Args:
        cost: cost of each primitive for each part, shape (parts, primitives), finite.
        count: primitives to choose.

    Raises:
        ValueError: no parts, costs that are not finite, or more primitives asked for than there are.
    """
    if not cost.size or not np.isfinite(cost).all() or not 1 <= count <= cost.shape[1]:
        raise ValueError(f"expected finite costs of at least {count} primitives, got shape {cost.shape}")
    best = np.full(len(cost), np.inf)
    order: list[int] = []
    mean: list[float] = []
    for _ in range(count):
        with_each = np.minimum(best[:, None], cost).mean(axis=0)
        with_each[order] = np.inf
        order.append(int(np.argmin(with_each)))
        best = np.minimum(best, cost[:, order[-1]])
        mean.append(float(best.mean()))
    return PrimitiveSelection(np.array(order), np.array(mean), float(cost.min(axis=1).mean()))
