"""Pairs of messages of two topics, by their time stamps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.errors import RescoreError
from rescore.formats.bags.heard import Heard
from rescore.formats.bags.topics import Topics
from rescore.formats.time_pairs import MAX_SECONDS_APART, nearest_pairs

_NS = 10**9
MAX_NS_APART = round(MAX_SECONDS_APART * _NS)
"""Farthest that the stamps of a pair may be apart, in nanoseconds."""


@dataclass(frozen=True)
class BagPairs:
    """Messages of the left topic with those of the right that go with them, by their numbers."""

    names: Mapping[tuple[int, int], str]
    """Name of each pair's files, in the order of their times."""
    left_ns: Mapping[str, int]
    """Time of the left picture by that name."""
    notes: tuple[str, ...]

    @staticmethod
    def of(path: Path, topics: Topics, heard: Heard) -> "BagPairs":
        """The pairs of a recording; of messages with one stamp the first counts.

        Raises:
            RescoreError: there is none.
        """
        lefts, rights = (_first_of(heard.stamps[t]) for t in (topics.left, topics.right))
        times, others = [t for t, _ in lefts], [t for t, _ in rights]
        found = nearest_pairs(times, others, MAX_NS_APART)
        within = f"within {MAX_SECONDS_APART * 1000:g} ms"
        if not found:
            raise RescoreError(
                f"{path}: expected pictures of {topics.left} and {topics.right} {within} of each other, "
                f"got none among {len(times)} and {len(others)}; check the stamps of their headers"
            )
        names = {(lefts[i][1], rights[j][1]): _name(times[i]) for i, j in found.items()}
        apart = max(abs(times[i] - others[j]) for i, j in found.items()) / 10**6
        counts = [len(heard.stamps[t]) for t in (topics.left, topics.right)]
        notes = [f"{path}: paired {len(found)} pictures {within}, at most {apart:.3g} ms apart"]
        notes += [
            f"{path}: left out {count - len(found)} of {count} pictures of {topic} without a partner"
            for topic, count in zip((topics.left, topics.right), counts, strict=True)
            if count > len(found)
        ]
        return BagPairs(names, {_name(times[i]): times[i] for i in found}, tuple(notes))

    def spread(self, most: int | None) -> Mapping[tuple[int, int], str]:
        """At most so many pairs, evenly spread; all if None."""
        rows = list(self.names.items())
        if most is None or most >= len(rows):
            return self.names
        return dict(rows[i] for i in np.unique(np.linspace(0, len(rows) - 1, most).astype(int)))


def _first_of(stamps: Sequence[int]) -> list[tuple[int, int]]:
    """Each stamp once, with the number of its first message, in the order of time."""
    first: dict[int, int] = {}
    for number, stamp in enumerate(stamps):
        first.setdefault(stamp, number)
    return sorted(first.items())


def _name(time_ns: int) -> str:
    # as in TUM: seconds with a fraction
    return f"{time_ns // _NS}.{time_ns % _NS:09d}"
