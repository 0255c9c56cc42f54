from pathlib import Path

import cv2
import numpy as np

from reports.confusion import write_confusion
from rescore.confusion import Confusion, save_confusions


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
