"""Pairs of moments that are nearly one."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from operator import itemgetter

MAX_SECONDS_APART = 0.02
"""Farthest that times may be apart which TUM's tools take for one moment."""


def nearest_pairs(times: Sequence[float], others: Sequence[float], most: float) -> dict[int, int]:
    """Places in ``others`` by the places in ``times`` that go with them, the closest first, each place once.

    Args:
        times: Moments, in any unit.
        others: Moments in the same unit.
        most: Farthest that a pair may be apart; places without such a partner are not in the result.
    """
    there = sorted((t, i) for i, t in enumerate(others))
    apart = []
    for i, time in enumerate(times):
        first = bisect_left(there, time - most, key=itemgetter(0))
        last = bisect_right(there, time + most, key=itemgetter(0))
        apart += [(abs(t - time), i, other) for t, other in there[first:last]]
    found: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, other in sorted(apart):
        if i not in found and other not in taken:
            found[i] = other
            taken.add(other)
    return dict(sorted(found.items()))
