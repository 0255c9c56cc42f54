"""Tables of view bins: what counts as which mistake, and that failures stay in the denominator."""

import json
from pathlib import Path

import numpy as np
import pytest

from recon.errors import Failure, Reason, RescoreError
from rescore.studies.view_bins import Confusion, ViewShares, count_choices, load_confusions, save_confusions

NO_OUTLINE = Failure(Reason.NO_OUTLINE, "an outline expected")
# true bin, chosen bin: exact, a neighbour over the end, mirrored, ends exchanged, opposite, none
TRUE = (1, 11, 2, 2, 1, 5)
CHOSEN = (1, 0, 10, 4, 7, NO_OUTLINE)


def test_shares_by_hand() -> None:
    table = count_choices(TRUE, CHOSEN, 12)
    assert table.photos == 6
    assert table.failures == {"no_outline": 1}
    # one of six each; the neighbour and the exact one are within one
    shares = table.shares()
    assert shares.within_one == pytest.approx(2 / 6)
    for name in ("exact", "mirrored", "ends_exchanged", "opposite"):
        assert getattr(shares, name) == pytest.approx(1 / 6), name


def test_an_exact_choice_is_no_mistake() -> None:
    # bins 0 and 6 are their own mirror images, bins 3 and 9 show the same with the ends exchanged
    table = count_choices(range(12), range(12), 12)
    assert table.shares() == ViewShares(
        exact=1.0, within_one=1.0, mirrored=0.0, ends_exchanged=0.0, opposite=0.0
    )
    np.testing.assert_array_equal(table.counts, np.eye(12))


def test_a_failure_lowers_the_shares() -> None:
    alone = count_choices((3,), (3,), 12).shares()
    with_failure = count_choices((3, 3), (3, NO_OUTLINE), 12).shares()
    assert with_failure.exact == alone.exact / 2


def test_files_give_back_the_tables(tmp_path: Path) -> None:
    table = count_choices(TRUE, CHOSEN, 12)
    save_confusions(tmp_path / "t.json", {"level_set": table}, "car, elevation 5 degrees")
    found, title = load_confusions(tmp_path / "t.json")
    assert title == "car, elevation 5 degrees"
    np.testing.assert_array_equal(found["level_set"].counts, table.counts)
    assert found["level_set"].failures == table.failures


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text('{"format": "something"}')
    with pytest.raises(RescoreError, match="expected format 'view-confusion 1', got 'something'"):
        load_confusions(tmp_path / "other.json")
    (tmp_path / "half.json").write_text('{"format": "view-confusion 1", "tables": {}}')
    with pytest.raises(RescoreError, match="title"):
        load_confusions(tmp_path / "half.json")
    save_confusions(tmp_path / "t.json", {"level_set": count_choices(TRUE, CHOSEN, 12)}, "car")
    narrow = json.loads((tmp_path / "t.json").read_text())
    narrow["tables"]["level_set"]["counts"][3].pop()
    (tmp_path / "narrow.json").write_text(json.dumps(narrow))
    with pytest.raises(RescoreError, match=r"tables\.level_set\.counts: .*as many columns as rows, 12"):
        load_confusions(tmp_path / "narrow.json")
    with pytest.raises(ValueError, match="expected counts"):
        Confusion(np.zeros((2, 3), np.int64), {})
