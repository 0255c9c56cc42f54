"""Tables of chosen view bins against true ones, and their file."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.arrays import IntArray
from recon.errors import RescoreError
from recon.outcome import Failure
from rescore.store import read_json, write_json

FORMAT = "view-confusion 1"


@dataclass(frozen=True, eq=False)
class Confusion:
    """Which bins were chosen for which."""

    counts: IntArray
    """Shape (k, k): photographs by true bin (row) and chosen bin (column)."""
    failures: dict[str, int]
    """Photographs without a choice by reason."""

    def __post_init__(self) -> None:
        if self.counts.ndim != 2 or self.counts.shape[0] != self.counts.shape[1]:
            raise ValueError(f"confusion: expected counts (k, k), got {self.counts.shape}")

    @property
    def photos(self) -> int:
        """All photographs, those without a choice too."""
        return int(self.counts.sum()) + sum(self.failures.values())

    def shares(self) -> dict[str, float]:
        """Shares of all photographs; the last three are kinds of mistake, of which one may be two.

        ``exact``: the true bin. ``within_one``: it or a neighbour. ``mirrored``: bin -b for b, the other side
        of the object and its picture mirrored. ``ends_exchanged``: bin k/2 - b, the same side with front and
        rear exchanged. ``opposite``: bin b + k/2.
        """
        k = len(self.counts)
        true, chosen = np.mgrid[:k, :k]
        wrong = true != chosen
        kinds = {
            "exact": ~wrong,
            "within_one": np.isin((chosen - true) % k, [0, 1, k - 1]),
            "mirrored": wrong & ((chosen + true) % k == 0),
            "ends_exchanged": wrong & ((chosen + true - k // 2) % k == 0),
            "opposite": (chosen - true) % k == k // 2,
        }
        return {name: float(self.counts[use].sum() / max(self.photos, 1)) for name, use in kinds.items()}


def count_choices(true: Sequence[int], chosen: Sequence[int | Failure], count: int) -> Confusion:
    """The table for ``count`` bins from true bins and what was chosen for each."""
    counts = np.zeros((count, count), np.int64)
    for b, found in zip(true, chosen, strict=True):
        if not isinstance(found, Failure):
            counts[b, found] += 1
    failures = Counter(found.reason.value for found in chosen if isinstance(found, Failure))
    return Confusion(counts, dict(sorted(failures.items())))


def save_confusions(path: Path, tables: Mapping[str, Confusion], title: str) -> None:
    """Write tables by name, with their shares, as JSON."""
    rows = {
        name: {
            "photos": table.photos,
            "shares": table.shares(),
            "failures": table.failures,
            "counts": table.counts.tolist(),
        }
        for name, table in tables.items()
    }
    write_json(path, {"format": FORMAT, "title": title, "tables": rows})


def load_confusions(path: Path) -> tuple[dict[str, Confusion], str]:
    """The tables of a file by name, and their title.

    Raises:
        RescoreError: no such file, or another format.
    """
    data = read_json(path, "confusion tables")
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise RescoreError(
            f"{path}: expected format {FORMAT!r}, got {found!r}; write it with rescore study-views"
        )
    try:
        tables = {
            str(name): Confusion(np.array(row["counts"], np.int64), dict(row["failures"]))
            for name, row in data["tables"].items()
        }
        return tables, str(data["title"])
    except (KeyError, TypeError, ValueError) as error:
        raise RescoreError(
            f"{path}: expected {FORMAT!r}, could not read it ({error!r}); write it again"
        ) from error
