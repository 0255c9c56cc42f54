from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.results.candidate_file import CANDIDATE_COLUMNS, read_candidates, write_candidates


def test_candidates_table_round_trip(tmp_path: Path) -> None:
    text = {"detector", "status", "reason_detail", "outcome_detector", "outcome_paper", "kind"}
    columns = {n: np.array(["a", ""], object) if n in text else np.array([1, 2]) for n in CANDIDATE_COLUMNS}
    columns["depth_difference"] = np.array([0.25, np.nan])
    path = tmp_path / "candidates.parquet"
    write_candidates(path, columns)
    back = read_candidates(path)
    assert list(back) == list(CANDIDATE_COLUMNS)
    np.testing.assert_array_equal(back["depth_difference"], [0.25, np.nan])
    assert back["status"].tolist() == ["a", ""]
    views = {"view_bin": np.array(["rear", ""], object), "view_probability": np.array([0.5, np.nan])}
    views["second_view"] = np.array(["front", ""], object)
    write_candidates(path, columns | views)
    seen = read_candidates(path)
    assert seen["view_bin"].tolist() == ["rear", ""]
    np.testing.assert_array_equal(seen["view_probability"], [0.5, np.nan])
    with pytest.raises(ValueError, match="columns differ: \\['kind'\\]"):
        write_candidates(path, {n: c for n, c in columns.items() if n != "kind"})
    path.write_text("no table")
    with pytest.raises(RescoreError, match="expected a table of candidates, could not read it"):
        read_candidates(path)
