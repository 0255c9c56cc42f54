from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.camera import GroundedStereo, GroundPlane, PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.stereo.ground import GroundDoubt
from recon.stereo.sgbm import SgbmConfig, write_disparity
from rescore.data.depth_files import MeasuredFile, Quantity, read_measured
from rescore.data.frames import SPLITS, DataSet, Frame, FrameRecord, GroundSource, Truth, load_frame
from rescore.data.pictures import read_rgb
from rescore.data.splits import Splits


def record(image_id: int, path: Path, split: str = "test") -> FrameRecord:
    return FrameRecord(image_id, path, None, None, split, 40, 20, None, None)


def data_set(shapes: dict[str, str], names: dict[str, str]) -> DataSet:
    frames = tuple(record(i, Path(names[s]), s) for i, s in enumerate(SPLITS))
    box = np.array([[0.0, 0, 5, 5]])
    truths = {
        i: Truth(np.array([i]), box, np.array([False]), np.array([1.0]), (shapes[s],))
        for i, s in enumerate(SPLITS)
    }
    return DataSet(Path(), 1, "car", frames, truths)


OWN = {s: s for s in SPLITS}


def test_splits_take_the_frames_of_their_name() -> None:
    splits = Splits.of(data_set(OWN, OWN))
    assert [f.split for f in splits.calibration.frames] == ["calibration"]
    assert list(splits.test.truth) == [3]
    assert splits.validation_set.data.frames == splits.validation.frames


def test_splits_refuse_a_shared_picture() -> None:
    with pytest.raises(RescoreError, match="train and test must share no image, both hold 'train'"):
        Splits.of(data_set(OWN, OWN | {"test": "train"}))


def test_splits_refuse_a_shared_car_shape() -> None:
    with pytest.raises(RescoreError, match="validation and test must share no car shape, both hold 'mini'"):
        Splits.of(data_set(OWN | {"validation": "mini", "test": "mini"}, OWN))
    Splits.of(data_set(dict.fromkeys(SPLITS, ""), OWN))  # unknown shapes say nothing


def test_read_rgb_gives_red_first(tmp_path: Path) -> None:
    path = tmp_path / "a b é.png"
    path.write_bytes(cv2.imencode(".png", np.full((20, 40, 3), (1, 2, 3), np.uint8))[1].tobytes())
    assert read_rgb(path, 40, 20)[0, 0].tolist() == [3, 2, 1]
    with pytest.raises(RescoreError, match="expected 41 x 20 pixels, got 40 x 20"):
        read_rgb(path, 41, 20)
    with pytest.raises(RescoreError, match="expected a picture, found no file"):
        read_rgb(tmp_path / "none.png", 40, 20)
    path.write_bytes(path.read_bytes()[:30])
    with pytest.raises(RescoreError, match=r"could not (decode|read) it"):
        read_rgb(path, 40, 20)


def test_load_frame_reads_or_computes_disparity(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    wide = rng.integers(0, 255, (20, 60, 3)).astype(np.uint8)
    left, right = wide[:, 5:45], wide[:, 9:49]  # what is at column x on the left is at x - 4 on the right
    for name, picture in (("left.png", left), ("right.png", right)):
        (tmp_path / name).write_bytes(cv2.imencode(".png", picture[..., ::-1])[1].tobytes())
    pair = replace(record(1, tmp_path / "left.png"), right_path=tmp_path / "right.png")
    computed = load_frame(pair, SgbmConfig(num_disparities=16)).disparity_px
    assert np.nanmedian(computed) == pytest.approx(4, abs=0.1)
    write_disparity(tmp_path / "d.png", np.full((20, 40), 7.5, np.float32))
    given = replace(pair, disparity_path=tmp_path / "d.png")
    assert (load_frame(given, SgbmConfig()).disparity_px == 7.5).all()
    with pytest.raises(RescoreError, match="expected right_file_name or disparity_file_name, got neither"):
        load_frame(record(1, tmp_path / "left.png"), SgbmConfig())


def test_a_damaged_picture_is_one_error_and_prints_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (20, 40, 3), dtype=np.uint8)
    whole = bytearray(cv2.imencode(".png", noise)[1].tobytes())
    path = tmp_path / "left.png"
    for place in (20, 200, *range(len(whole) - 30, len(whole))):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
        with pytest.raises(RescoreError, match=r"could not (decode|read) it"):
            read_rgb(path, 40, 20)
    path.write_bytes(whole + b"what follows the end is nothing")
    np.testing.assert_array_equal(read_rgb(path, 40, 20), noise[..., ::-1])
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("share", [0.0, 0.6, 0.9999])
def test_a_cut_off_picture_is_one_error_and_prints_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], suffix: str, share: float
) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (20, 40, 3), dtype=np.uint8)
    whole = cv2.imencode(suffix, noise)[1].tobytes()
    path = tmp_path / f"left{suffix}"
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(RescoreError, match=r"could not (decode|read) it"):
        read_rgb(path, 40, 20)
    assert capfd.readouterr() == ("", "")


def test_a_png_without_its_last_chunk_is_one_error_and_prints_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = cv2.imencode(".png", np.zeros((20, 40), np.uint8))[1].tobytes()
    path = tmp_path / "left.png"
    for left_out in range(1, 13):
        path.write_bytes(whole[:-left_out])
        with pytest.raises(RescoreError, match=r"could not (decode|read) it"):
            read_rgb(path, 40, 20)
    assert capfd.readouterr() == ("", "")


TRUE = GroundPlane(1.8, np.radians(3))


def street_record(folder: Path, ground: GroundPlane | None) -> FrameRecord:
    """A bare street at 1.8 m and 3 degrees, in steps of 1/256 pixel."""
    lens = StereoCamera(PinholeCamera(150, 150, 79.5, 59.5, 160, 120), 0.5)
    v, u = np.mgrid[:120, :160].astype(float)
    depth = TRUE.intersect(lens.left.rays(np.stack([u, v], axis=-1)))[..., 2]
    write_disparity(folder / "d.png", lens.disparity_px(depth))
    (folder / "l.png").write_bytes(cv2.imencode(".png", np.zeros((120, 160, 3), np.uint8))[1].tobytes())
    return FrameRecord(1, folder / "l.png", None, folder / "d.png", "test", 160, 120, lens, ground)


def test_stereo_gives_the_ground_where_none_is_stated(tmp_path: Path) -> None:
    frame = load_frame(street_record(tmp_path, None), SgbmConfig())
    assert frame.ground_source is GroundSource.STEREO
    assert frame.ground is not None
    assert frame.ground_estimate is not None
    assert frame.ground == frame.ground_estimate.ground
    assert frame.ground.height_m == pytest.approx(1.8, abs=2e-3)
    assert frame.ground.pitch_rad == pytest.approx(np.radians(3), abs=2e-3)


def test_a_stated_ground_is_kept(tmp_path: Path) -> None:
    stated = GroundPlane(1.2, 0.0)
    frame = load_frame(street_record(tmp_path, stated), SgbmConfig())
    assert (frame.ground, frame.ground_source, frame.ground_estimate) == (stated, GroundSource.STATED, None)


def test_a_pair_is_seen_from_somewhere_where_camera_and_ground_are_known(tmp_path: Path) -> None:
    frame = load_frame(street_record(tmp_path, TRUE), SgbmConfig())
    assert frame.camera is not None
    assert frame.seen_from == GroundedStereo(frame.camera, TRUE)
    assert replace(frame, camera=None).seen_from is None
    assert replace(frame, ground=None).seen_from is None


def test_no_ground_is_taken_that_is_not_trusted(tmp_path: Path) -> None:
    frame = load_frame(street_record(tmp_path, None), SgbmConfig())
    assert frame.camera is not None
    noise = np.random.default_rng(0).uniform(1, 64, (120, 160)).astype(np.float32)
    unknown = Frame(1, frame.left_rgb, noise, frame.camera, None).with_stereo_ground()
    assert (unknown.ground, unknown.ground_source) == (None, GroundSource.DEFAULT)
    assert unknown.ground_estimate is not None
    assert isinstance(unknown.ground_estimate.doubt, GroundDoubt)
    uncalibrated = Frame(1, frame.left_rgb, frame.disparity_px, None, None).with_stereo_ground()
    assert (uncalibrated.ground_source, uncalibrated.ground_estimate) == (GroundSource.DEFAULT, None)


def test_a_measured_picture_that_claims_too_many_pixels_is_refused_from_its_head(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENCV_IO_ENABLE_OPENEXR", "1")
    corners = np.array([-5, 0, 29_994, 19_999], "<i4").tobytes()
    head = b"\x76\x2f\x31\x01\x02\0\0\0dataWindow\0box2i\0" + (16).to_bytes(4, "little") + corners
    (tmp_path / "a.exr").write_bytes(head)
    with pytest.raises(RescoreError, match=r"a\.exr: expected at most 100 million pixels, got 30000 x 20000"):
        read_measured(MeasuredFile(tmp_path / "a.exr", Quantity.DISPARITY), 40, 20)
    # a PNG is compared with the picture that it belongs to
    cv2.imwrite(str(tmp_path / "disparity.png"), np.zeros((30, 40), np.uint16))
    with pytest.raises(RescoreError, match="expected 40 x 20 pixels, got 40 x 30"):
        read_measured(MeasuredFile(tmp_path / "disparity.png", Quantity.DISPARITY, 256), 40, 20)
