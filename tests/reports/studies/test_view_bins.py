from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.errors import RescoreError
from reports.studies.view_bins import write_confusion, write_view_study
from rescore.studies.view_bins import Confusion, save_confusions


def test_the_picture_is_dark_where_the_counts_are(tmp_path: Path) -> None:
    for name, counts in (("right", np.eye(12)), ("none", np.zeros((12, 12)))):
        save_confusions(
            tmp_path / f"{name}.json", {"level_set": Confusion(counts.astype(np.int64), {})}, "car"
        )
        write_confusion(tmp_path / f"{name}.json", tmp_path / f"{name}.png")
    right, none = (cv2.imread(str(tmp_path / f"{name}.png")) for name in ("right", "none"))
    # opencv's blue, green, red: only a full cell of the colour map is dark blue
    full = [(p[..., 0].astype(int) - p[..., 2] > 80).mean() for p in (right, none)]
    # 12 of 144 cells of a map that covers about half of the picture
    assert 0.02 < full[0] < 0.09
    assert full[1] == 0


def test_the_page_has_shares_and_mistakes(tmp_path: Path) -> None:
    # 12 photographs a bin: 9 right, 3 of bin 6 taken for 0, of the others for the next bin
    counts = np.eye(12, dtype=np.int64) * 9 + 3 * np.roll(np.eye(12, dtype=np.int64), 1, axis=1)
    counts[6] = 0
    counts[6, [6, 0]] = 9, 3
    tables = {"level_set": Confusion(counts, {}), "true_outline": Confusion(np.diag(np.full(12, 12)), {})}
    save_confusions(tmp_path / "car.json", tables, "car, 20 degrees")
    page = write_view_study(tmp_path, ["car"], 3, "rescore study-views --out X").read_text()
    assert "Made by `rescore study-views --out X`" in page
    assert "144 rendered photographs" in page
    # 108 of 144, standard error sqrt(0.75 * 0.25 / 144) = 0.036; 141 within one; 3 opposite
    row = "| car, 20 degrees, outline by level set | 75 ± 4 % | 98 % | 0 % | 2 % | 2 % |"
    assert row in page
    assert "outline by level set: 0 for 6 (3 of 12)\n" in page
    assert "true outline: none\n" in page
    assert "(car.png)" in page
    assert (tmp_path / "car.png").is_file()


def test_a_missing_table_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match="confusion tables"):
        write_view_study(tmp_path, ["car"], 3, "X")
