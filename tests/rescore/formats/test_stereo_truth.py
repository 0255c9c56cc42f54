from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.formats.stereo_truth import find_true_scenes, seen_in_right
from tests.true_pairs import HEIGHT, SHIFT, WIDTH, kitti_2015, scene


def test_kitti_2015_is_read_with_its_objects_and_calibrations(tmp_path: Path):
    found = find_true_scenes(kitti_2015(tmp_path))
    assert found is not None
    assert found.kitti
    first, second = (s.load() for s in found.scenes)
    assert (first.name, second.name) == ("000000_10", "000001_10")
    assert first.foreground is not None
    assert first.foreground.sum() == 32 * WIDTH
    assert np.isfinite(first.truth_px).sum() == (32 + 16) * WIDTH
    assert first.seen_twice.sum() == (32 + 16) * (WIDTH - SHIFT)
    assert first.truth_px[0, 0] == SHIFT
    assert first.camera is not None
    assert first.camera.left.fx_px * first.camera.baseline_m == pytest.approx(48)


@pytest.mark.parametrize("mask", [False, True])
def test_a_middlebury_scene_is_read_with_or_without_its_mask(tmp_path: Path, mask: bool):
    scene(tmp_path / "wall", mask)
    found = find_true_scenes(tmp_path)
    assert found is not None
    assert not found.kitti
    (pair,) = (s.load() for s in found.scenes)
    assert pair.name == "wall"
    assert np.isnan(pair.truth_px[:4]).all()
    assert (pair.truth_px[4:] == SHIFT).all()
    hidden = 20 if mask else SHIFT
    assert not pair.seen_twice[:, :hidden].any()
    assert pair.seen_twice[4:, hidden:].all()
    assert pair.seen_twice.sum() == (HEIGHT - 4) * (WIDTH - hidden)
    itself = find_true_scenes(tmp_path / "wall")
    assert itself is not None
    assert [s.name for s in itself.scenes] == ["wall"]


def test_a_folder_without_truth_holds_no_scenes(tmp_path: Path):
    assert find_true_scenes(tmp_path) is None
    assert find_true_scenes(tmp_path / "none") is None


@pytest.mark.parametrize("missing", ["image_3", "disp_noc_0", "obj_map"])
def test_a_missing_file_of_kitti_is_named(tmp_path: Path, missing: str):
    root = kitti_2015(tmp_path)
    (root / missing / "000001_10.png").unlink()
    with pytest.raises(RescoreError, match=rf"{missing}/000001_10\.png: expected a file of KITTI"):
        find_true_scenes(root)


def test_a_mask_of_another_size_is_refused(tmp_path: Path):
    scene(tmp_path, mask=True)
    (tmp_path / "mask0nocc.png").write_bytes(b"none")
    found = find_true_scenes(tmp_path)
    assert found is not None
    with pytest.raises(RescoreError, match="expected a grey picture of 160 x 64 pixels, got no whole"):
        found.scenes[0].load()


def test_what_a_near_surface_hides_is_seen_once():
    # far wall at 2 px; in columns 10 to 14 a board at 6 px, which lands on columns 4 to 8: those of the wall
    # are seen from columns 6 to 10, of which 10 is the board's, so 6 to 9 are hidden; 0 and 1 fall outside
    truth = np.full((1, 20), 2.0, np.float32)
    truth[0, 10:15] = 6
    truth[0, 19] = np.nan
    seen = seen_in_right(truth)[0]
    assert np.flatnonzero(~seen).tolist() == [0, 1, 6, 7, 8, 9, 19]


def test_a_slanted_surface_hides_nothing_of_itself():
    column = np.arange(200, dtype=np.float32)
    truth = np.tile(20 - 0.05 * column, (3, 1)).astype(np.float32)
    seen = seen_in_right(truth)
    assert not seen[:, :18].any()
    assert seen[:, 21:].all()
