"""Pictures on disk: pixels as they are stored, whatever EXIF says."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from recon.errors import RescoreError
from rescore.data.frames import load_frame
from rescore.data.pictures import picture_size, read_rgb, turned_by_exif
from rescore.doctor import examine_dataset
from rescore.doctor.findings import Level
from rescore.formats.open import read_dataset
from rescore.library.single_picture import read_photo
from tests.rescore import own_data as own
from tests.rescore.spoiling import Run

ORIENTATION = 0x0112


def write_turned(path: Path, orientation: int, form: str) -> None:
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    picture = Image.fromarray(np.repeat(own.pair()[0][..., None], 3, axis=2))
    picture.save(path, form, exif=exif, **({"quality": 95} if form != "PNG" else {}))


@pytest.mark.parametrize("form", ["JPEG", "PNG", "WEBP"])
@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_pixels_are_those_that_are_stored(tmp_path: Path, orientation: int, form: str) -> None:
    path = tmp_path / f"a.{form.lower()}"
    write_turned(path, orientation, form)
    assert picture_size(path) == (own.WIDTH, own.HEIGHT)
    got = read_rgb(path, own.WIDTH, own.HEIGHT)[..., 0].astype(float)
    assert np.corrcoef(got.ravel(), own.pair()[0].ravel())[0, 1] > 0.95
    said = turned_by_exif(path)
    assert said == (
        "" if orientation == 1 else f" as stored, which EXIF orientation {orientation} asks viewers to turn"
    )


@pytest.mark.parametrize("orientation", [3, 6])
def test_the_doctor_says_that_exif_turns_a_picture(tmp_path: Path, orientation: int) -> None:
    own.pair_folder(tmp_path)
    (tmp_path / "left" / "a.png").unlink()
    write_turned(tmp_path / "left" / "a.jpg", orientation, "JPEG")
    data = read_dataset(tmp_path)
    disparity = load_frame(data.frames[0], own.STEREO).disparity_px
    assert float(np.nanmedian(disparity)) == pytest.approx(own.SHIFT, abs=0.1)
    findings = [f for f in examine_dataset(tmp_path, "car", 1) if "EXIF" in f.what]
    assert [(f.level, f.where) for f in findings] == [(Level.WARNING, "image 1")]
    assert "boxes, depth and calibration must be of the stored pixels" in str(findings[0])


def test_an_orientation_that_says_nothing_is_none(tmp_path: Path) -> None:
    write_turned(tmp_path / "a.jpg", 0, "JPEG")
    assert turned_by_exif(tmp_path / "a.jpg") == ""


def test_a_photograph_that_exif_turns_is_refused(tmp_path: Path) -> None:
    write_turned(tmp_path / "a.jpg", 6, "JPEG")
    with pytest.raises(
        RescoreError, match=r"a.jpg: expected a picture that is stored upright, .*EXIF orientation 6"
    ):
        read_photo(tmp_path / "a.jpg")
    write_turned(tmp_path / "a.jpg", 1, "JPEG")
    assert read_photo(tmp_path / "a.jpg").shape == (own.HEIGHT, own.WIDTH, 3)


def test_a_size_that_exif_turned_names_it(tmp_path: Path) -> None:
    write_turned(tmp_path / "a.jpg", 6, "JPEG")
    with pytest.raises(
        RescoreError, match=r"expected 64 x 96 pixels, got 96 x 64 as stored, which EXIF orientation 6"
    ):
        read_rgb(tmp_path / "a.jpg", own.HEIGHT, own.WIDTH)


def test_a_tiff_with_an_orientation_is_refused(tmp_path: Path) -> None:
    write_turned(tmp_path / "a.tif", 3, "TIFF")
    with pytest.raises(
        RescoreError, match=r"a.tif: .* EXIF orientation 3 .*; write it without an orientation"
    ):
        read_rgb(tmp_path / "a.tif", own.WIDTH, own.HEIGHT)
    write_turned(tmp_path / "a.tif", 1, "TIFF")
    assert read_rgb(tmp_path / "a.tif", own.WIDTH, own.HEIGHT)[..., 0].tolist() == own.pair()[0].tolist()


def test_a_link_to_no_picture_is_one_line(tmp_path: Path) -> None:
    """Pictures that are yet to be fetched; before, they were left out without a word."""
    own.pair_folder(tmp_path)
    (tmp_path / "left" / "c.png").symlink_to("nowhere.png")
    with pytest.raises(RescoreError, match=r"left/c.png: expected a file, got a link to none; fetch"):
        read_dataset(tmp_path)


def test_a_name_that_is_not_utf8_is_one_line(tmp_path: Path, run: Run) -> None:
    """Before, `import` and `evaluate` ended in a traceback."""
    own.pair_folder(tmp_path)
    for side in ("left", "right"):
        (tmp_path / side / "a.png").rename(tmp_path / side / os.fsdecode(b"a\xff.png"))
    assert run("import", tmp_path, "--out", tmp_path / "out") == (
        1,
        "",
        f"rescore: {tmp_path}/left: expected names in UTF-8, got 'a\\udcff.png'; rename it\n",
    )


def test_a_folder_whose_name_is_not_utf8_is_one_line(tmp_path: Path, run: Run) -> None:
    data = own.pair_folder(tmp_path / os.fsdecode(b"d\xff"))
    code, _, err = run("--quiet", "import", data, "--out", tmp_path / "out")
    assert code == 1
    assert err.count("\n") == 1
    assert "expected names of files in UTF-8, got" in err
    assert not (tmp_path / "out" / "annotations.json").exists()
