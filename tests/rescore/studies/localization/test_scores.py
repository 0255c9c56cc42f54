import json
from pathlib import Path

import numpy as np
import pytest

from recon.errors import Failure, Reason
from recon.localization.single_plane import UprightSurface
from recon.localization.standing_box import StandingBox
from recon.pixels import linear_from_srgb
from rescore.studies.localization.result_file import (
    ScoredPlacement,
    TablePose,
    localization_result,
    read_localization,
    scores_by_car,
    write_localization,
)
from rescore.studies.localization.scores import (
    METHODS,
    Score,
    markdown_table,
    score,
    summary,
)
from rescore.studies.localization.segment import EmptyTable, TableSegmentConfig, segment_table

LOST = Failure(Reason.NO_OUTLINE, "a region expected, got none")


def test_scores_of_a_box_and_of_a_surface() -> None:
    truth = StandingBox(np.array([0.0, 1.0]), 0.1, np.array([0.2, 0.1, 0.08]))
    # 3 mm aside, 8 mm higher, so that its centre is 4 mm higher: 5 mm away; and pointing the other way
    box = StandingBox(np.array([0.003, 1.0]), 0.1 + np.pi, np.array([0.2, 0.1, 0.088]))
    found = score(box, truth)
    assert isinstance(found, Score)
    assert found.centroid_mm == pytest.approx(5)
    assert found.orientation_deg == pytest.approx(180)
    surface = score(UprightSurface(truth.centroid_m, 0.1 + np.pi - 0.05), truth)
    assert isinstance(surface, Score)
    assert surface.overlap is None
    assert surface.orientation_deg == pytest.approx(np.rad2deg(0.05))
    assert score(LOST, truth) is LOST


def test_lost_placements_are_counted_and_do_not_count_as_zero() -> None:
    scores = [Score(0.8, 4.0, 1.0), LOST, Score(0.6, 8.0, 3.0)]
    mean = summary(scores)
    assert mean.model_dump() == {
        "overlap": pytest.approx(0.7),
        "centroid_mm": pytest.approx(6),
        "orientation_deg": pytest.approx(2),
        "n": 2,
        "lost": 1,
    }
    assert summary([LOST]).centroid_mm is None
    table = markdown_table({"a": dict.fromkeys(METHODS, scores), "b": {m: [LOST] for m in METHODS}})
    lines = table.splitlines()
    assert len(lines) == 5
    assert len({line.count("|") for line in lines}) == 1
    assert "70.0 (1 lost)" in lines[2]


def test_results_come_back_from_their_file(tmp_path: Path) -> None:
    scores = [Score(0.8, 4.0, 1.0), LOST, Score(None, 8.0, 3.0)]
    pose = TablePose(x_mm=1.0, y_mm=-2.0, yaw_deg=30.0)
    placements = [ScoredPlacement(car="a", pose=pose, methods=dict.fromkeys(METHODS, s)) for s in scores]
    result = localization_result(placements)
    assert result.methods["3dp"] == summary(scores)
    assert scores_by_car(result.placements) == {"a": dict.fromkeys(METHODS, scores)}
    write_localization(tmp_path / "localization.json", result)
    text = json.loads((tmp_path / "localization.json").read_text())
    assert text["placements"][1]["methods"]["3dp"]["reason"] == "no_outline"
    assert read_localization(tmp_path / "localization.json") == result


EVERYWHERE = np.ones((120, 160), bool)


def picture() -> np.ndarray:
    return np.full((120, 160, 3), 60, np.uint8)


def test_table_is_segmented_into_things_and_not_shadows() -> None:
    rng = np.random.default_rng(0)
    empty = picture()
    shot = empty.copy()
    shot[40:80, 50:110] = (200, 30, 30)
    shot[80:90, 50:110] = 48  # shade: 0.6 of the linear light
    shot[84:88, 60:70] = 8  # a tyre, darker than any shade
    shot[78:84, 60:70] = 8
    shot[5:7, 5:7] = 250  # a speck
    noisy = np.clip(shot + rng.normal(0, 2, shot.shape), 0, 255).astype(np.uint8)
    table = EmptyTable.of_pictures(linear_from_srgb(empty), EVERYWHERE, TableSegmentConfig())
    regions = segment_table(noisy, table)
    assert not isinstance(regions, Failure)
    assert len(regions) == 1
    mask = regions[0].mask
    assert mask[45:78, 53:107].all()
    assert mask[85, 62:68].all()
    assert not mask[86:, 80:].any()
    assert not mask[:30].any()


def test_beside_the_table_no_shadow_is_expected() -> None:
    # the upper half shows a pale room; a car of nearly its light reaches into it
    empty = picture()
    empty[:60] = 210
    on_table = EVERYWHERE.copy()
    on_table[:60] = False
    shot = empty.copy()
    shot[30:90, 50:110] = 200  # 0.9 of the room's linear light: a shade, if shades fell there
    shot[95:105, 20:40] = 50  # a shade on the table
    regions = segment_table(
        shot, EmptyTable.of_pictures(linear_from_srgb(empty), on_table, TableSegmentConfig())
    )
    assert not isinstance(regions, Failure)
    assert len(regions) == 1
    assert regions[0].mask[33:87, 53:107].all()
    assert not regions[0].mask[:25].any()


def test_an_empty_table_has_a_reason() -> None:
    table = EmptyTable.of_pictures(linear_from_srgb(picture()), EVERYWHERE, TableSegmentConfig())
    found = segment_table(picture(), table)
    assert isinstance(found, Failure)
    assert found.reason is Reason.NO_OUTLINE


def test_a_dark_panel_between_pale_pieces_is_part_of_the_thing() -> None:
    shot = picture()
    shot[30:90, 40:120] = 48  # a panel as dark as shade, 0.6 of the table's linear light
    shot[30:36, 40:120] = shot[84:90, 40:120] = 180  # pale above and below it
    shot[30:90, 40:46] = 180
    shot[90:110, 10:60] = 48  # a shade beside it
    table = EmptyTable.of_pictures(linear_from_srgb(picture()), EVERYWHERE, TableSegmentConfig())
    regions = segment_table(shot, table)
    assert not isinstance(regions, Failure)
    assert len(regions) == 1
    assert regions[0].mask[38:82, 48:116].all()
    assert not regions[0].mask[96:].any()
