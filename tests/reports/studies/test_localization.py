"""The published page of section 5.1: numbers, flips and lost placements come from the JSON."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.errors import Failure, Reason, RescoreError
from reports.studies.localization import page, publish
from rescore.studies.localization.result_file import (
    LocalizationResult,
    ScoredPlacement,
    TablePose,
    localization_result,
    write_localization,
)
from rescore.studies.localization.scores import Score

GOOD = Score(0.9, 3.0, 1.0)
FLIPPED = Score(0.7, 9.0, 179.0)
LOST = Failure(Reason.NO_OUTLINE, "a region expected")


def run() -> LocalizationResult:
    plane = Score(None, 60.0, 20.0)
    pose = TablePose(x_mm=0.0, y_mm=0.0, yaw_deg=0.0)
    placements = [
        ScoredPlacement(
            car="sedan", pose=pose, methods={"3dp": own, "3dp_report": parts, "single_plane": plane}
        )
        for own, parts in ((GOOD, GOOD), (FLIPPED, LOST))
    ]
    return localization_result(placements)


def test_page_names_flips_and_lost_ones_beside_the_reports_figures() -> None:
    text = page(run(), "make it", ["table"])
    own = next(line for line in text.splitlines() if line.startswith("| 3DP, joint fit |"))
    # 1 degree without the flip, one flipped, none lost; then the report's 77.5 %, 8.75 mm, 2.34 degrees
    assert own.split("|")[2:11] == [
        *(" 80.0 ", " 6.00 ", " 90.00 ", " 1.00 ", " 1 ", " 0 ", " 77.5 ", " 8.75 ", " 2.34 ")
    ]
    assert "- 3DP, joint fit: turned by more than 90 degrees: 1 sedan; lost: none." in text
    assert "lost: 1 sedan (no_outline)." in text
    assert "](table.jpg)" in text
    assert "worst.jpg" not in text


def test_publish_copies_numbers_and_reduces_pictures(tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    run_dir.mkdir()
    with pytest.raises(RescoreError, match="localize"):
        publish(run_dir, tmp_path / "out", "make it")
    write_localization(run_dir / "localization.json", run())
    noise = np.random.default_rng(0).integers(0, 255, (900, 900, 3)).astype(np.uint8)
    cv2.imwrite(str(run_dir / "table.png"), noise)
    readme = publish(run_dir, tmp_path / "out", "make it")
    assert {p.name for p in readme.parent.iterdir()} == {"README.md", "localization.json", "table.jpg"}
    assert (readme.parent / "table.jpg").stat().st_size < 400_000
    shown = cv2.imread(str(readme.parent / "table.jpg"))
    assert shown is not None
    assert shown.shape == noise.shape
