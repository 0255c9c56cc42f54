"""A slice of the fuzzer: `make fuzz` runs all of it."""

from pathlib import Path

import numpy as np
import pytest

from tests.faults.fuzz import MEMORY_BYTES, OK, REFUSED, fuzz, outcome, table
from tests.faults.inputs import KINDS, Kind
from tests.faults.mutate import KINDS as DAMAGES
from tests.faults.mutate import damaged


def test_damaged_files_are_read_or_refused_in_one_line() -> None:
    tallies, faults = fuzz(len(KINDS), seed=1)
    assert faults == []
    assert {name: t.outcomes.total() for name, t in tallies.items()} == {kind.name: 1 for kind in KINDS}
    assert max(t.peak_bytes for t in tallies.values()) < MEMORY_BYTES
    assert f"| **all** | {len(KINDS)} |" in table(tallies)


def test_a_fault_is_seen(tmp_path: Path) -> None:
    def fail(_root: Path) -> None:
        raise KeyError("x")

    def ends(_root: Path) -> None:
        raise SystemExit(1)

    assert outcome(Kind("a", fail, [], fail), tmp_path)[0] == "traceback"
    assert outcome(Kind("a", fail, [], ends), tmp_path)[0] == "no line"
    assert outcome(Kind("a", fail, [], lambda _root: None), tmp_path)[0] == OK
    assert REFUSED != OK


@pytest.mark.parametrize("data", [b'{"a": [1, 2.5, {"b": null}]}', b"1 2 3\n4 5 6\n", b"\x89PNG\0\0", b""])
def test_damage_is_of_every_kind_and_repeats(data: bytes) -> None:
    found = [damaged(data, np.random.default_rng(i)) for i in range(300)]
    assert found == [damaged(data, np.random.default_rng(i)) for i in range(300)]
    assert {name for name, _ in found} >= {"cut", "flip", "zero", "splice", "foreign", "empty"}
    if data[:1] == b"{":
        assert {name for name, _ in found} == set(DAMAGES)
    assert len({after for _, after in found}) > (20 if data else 5)
