"""Recordings of ROS 2: written with rosbags and with the mcap package, and read back as data sets."""

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import mcap.writer
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from rescore.data.frames import DataSet, load_frame
from rescore.data.pictures import read_rgb
from rescore.doctor.data import examine_dataset
from rescore.doctor.findings import Level
from rescore.formats.bags.messages import picture_file
from rescore.formats.bags.reader import is_bag
from rescore.formats.bags.topics import Wanted
from rescore.formats.bags.unpack import import_bag
from rescore.formats.labels import ClassMap
from rescore.formats.open import read_dataset, read_detections
from tests.rescore import own_data as own
from tests.rescore.formats import test_rectify as bent
from tests.rescore.ros_bags import (
    LEFT,
    RIGHT,
    START_NS,
    STORAGES,
    STORE,
    boxes,
    info,
    infos,
    packed,
    pictures,
    raw,
    write_bag,
)
from tests.rescore.spoiling import Run


def imported(bag: Path, out: Path, wanted: Wanted | None = None, **options: Any) -> DataSet:
    return import_bag(bag, wanted or Wanted(), ClassMap("car"), out, rectify=False, **options)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_recording_is_a_data_set(storage: StoragePlugin, tmp_path: Path, run: Run) -> None:
    topics = pictures([0, 100, 200, 300], [1.5, 100, 225, 299]) | infos()
    topics["/detector"] = [
        boxes(START_NS, [("car", 0.75, (30, 30, 20, 10)), ("truck", 0.9, (50, 30, 8, 8))]),
        boxes(START_NS + 100 * 10**6, [("Car", 0.5, (40, 32, 30, 20))], turned_rad=np.pi / 2),
        boxes(START_NS + 700 * 10**6, [("car", 0.5, (40, 32, 30, 20))]),
    ]
    bag = write_bag(tmp_path / "bag", topics, storage)
    out = tmp_path / "mine"
    code, printed, said = run("import", bag, "--out", out)
    assert code == 0, said
    said += printed
    data = read_dataset(out)
    assert [f.left_path.name for f in data.frames] == [
        f"1700000000.{ms:03d}000000.png" for ms in (0, 100, 300)
    ]
    for frame, seed in zip(data.frames, (0, 1, 3), strict=True):
        assert frame.right_path is not None
        for path, pixels in zip((frame.left_path, frame.right_path), own.pair(seed), strict=True):
            assert np.array_equal(read_rgb(path, own.WIDTH, own.HEIGHT), np.stack([pixels] * 3, axis=-1))
        camera = frame.camera
        assert camera is not None
        assert camera.baseline_m == pytest.approx(own.BASELINE_M)
        assert (camera.left.fx_px, camera.left.cx_px, camera.left.cy_px) == (own.FX, 48, 32)
    assert np.nanmedian(load_frame(data.frames[0], own.STEREO).disparity_px) == pytest.approx(
        own.SHIFT, abs=0.1
    )
    table = read_detections(out / "detections.json", data).table
    assert table.xyxy_px.tolist() == [[20, 25, 40, 35], pytest.approx([30, 17, 50, 47])]
    assert table.score.tolist() == [0.75, 0.5]
    assert table.image_id.tolist() == [1, 2]
    for words in (
        "paired 3 pictures within 20 ms, at most 1.5 ms apart",
        f"left out 1 of 4 pictures of {LEFT} without a partner",
        f"left out 1 of 4 pictures of {RIGHT} without a partner",
        "left out 1 messages of detections of no pair",
        f"wrote 2 detections to {out / 'detections.json'}",
        "left out boxes of other classes: 1 truck",
        "3 frames, 0 boxes",
    ):
        assert words in said


@pytest.mark.parametrize(
    ("encoding", "channels"),
    [("rgb8", 3), ("bgr8", 3), ("rgba8", 4), ("bgra8", 4), ("mono8", 1), ("8UC1", 1), ("8UC3", 3)],
)
def test_raw_pictures_keep_their_colours(encoding: str, channels: int, tmp_path: Path) -> None:
    rgb = np.random.default_rng(0).integers(0, 255, (6, 9, 3), np.uint8)
    sent = {
        "rgb8": rgb,
        "bgr8": rgb[..., ::-1],
        "8UC3": rgb[..., ::-1],
        "rgba8": np.dstack([rgb, rgb[..., :1]]),
        "bgra8": np.dstack([rgb[..., ::-1], rgb[..., :1]]),
    }.get(encoding, rgb[..., 0])
    assert sent.size == 6 * 9 * channels
    got = decoded(raw(0, sent, encoding, padding=5), tmp_path)
    assert np.array_equal(got, rgb if channels > 1 else np.stack([rgb[..., 0]] * 3, axis=-1))


def decoded(message: Any, folder: Path) -> UInt8Array:
    file = picture_file("topic", message)
    assert file is not None
    path = folder / f"a{file[0]}"
    path.write_bytes(file[1])
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR)[..., ::-1], np.uint8)


MOSAICS = {
    "rggb": [[0, 1], [1, 2]],
    "bggr": [[2, 1], [1, 0]],
    "gbrg": [[1, 2], [0, 1]],
    "grbg": [[1, 0], [2, 1]],
}
"""Which of red, green and blue a pixel has, by even and odd row and column."""


@pytest.mark.parametrize("pattern", MOSAICS)
@pytest.mark.parametrize("form", ["raw", "png"])
def test_a_mosaic_of_colours_is_filled(pattern: str, form: str, tmp_path: Path) -> None:
    colour = np.array([200, 120, 40], np.uint8)
    mosaic = np.tile(colour[np.array(MOSAICS[pattern])], (8, 8))
    message = raw(0, mosaic, f"bayer_{pattern}8")
    if form == "png":
        content = cv2.imencode(".png", mosaic)[1].tobytes()
        message = packed(0, content, f"bayer_{pattern}8; png compressed ")
    assert (decoded(message, tmp_path) == colour).all()


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_compressed_pictures_keep_their_bytes(suffix: str, tmp_path: Path) -> None:
    form = "jpeg" if suffix == ".jpg" else "png"
    topics: dict[str, list[Any]] = infos()
    contents = [cv2.imencode(suffix, side)[1].tobytes() for side in own.pair()]
    for topic, content in zip((LEFT, RIGHT), contents, strict=True):
        topics[f"{topic}/compressed"] = [packed(START_NS, content, f"bgr8; {form} compressed bgr8")]
    data = imported(write_bag(tmp_path / "bag", topics), tmp_path / "out")
    (frame,) = data.frames
    assert frame.right_path is not None
    assert [p.read_bytes() for p in (frame.left_path, frame.right_path)] == contents
    assert frame.left_path.suffix == suffix
    assert frame.camera is not None


def test_damaged_pictures_are_left_out_with_their_partners(tmp_path: Path) -> None:
    topics = pictures([0, 100, 200], [0, 100, 200]) | infos()
    topics[RIGHT][1].step = 7
    data = imported(write_bag(tmp_path / "bag", topics), tmp_path / "out")
    assert len(data.frames) == 2
    assert sorted(p.name for p in (tmp_path / "out" / "left").iterdir()) == sorted(
        p.name for p in (tmp_path / "out" / "right").iterdir()
    )
    assert any("left out 1 pairs with a damaged picture" in n for n in data.notes)


@pytest.mark.parametrize("apart_ms", [19.9, 20.1])
def test_pictures_pair_within_the_tolerance(apart_ms: float, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", pictures([0, 1000], [0, 1000 + apart_ms]) | infos())
    assert len(imported(bag, tmp_path / "out").frames) == (2 if apart_ms < 20 else 1)


def test_no_pair_within_the_tolerance(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", pictures([0, 100], [50, 150]) | infos())
    with pytest.raises(RescoreError, match=r"expected pictures of .* within 20 ms of each other, got none"):
        imported(bag, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_without_stamps_the_time_of_recording_counts(tmp_path: Path) -> None:
    topics = pictures([-START_NS / 10**6] * 2, [-START_NS / 10**6] * 2) | infos()
    data = imported(write_bag(tmp_path / "bag", topics), tmp_path / "out")
    # all were logged in one moment, and the first counts
    assert [f.left_path.stem for f in data.frames] == ["1.000000000"]
    assert any("4 messages without a time stamp" in n for n in data.notes)
    assert any(f"left out 1 of 2 pictures of {LEFT}" in n for n in data.notes)


@pytest.mark.parametrize("form", ["file", "folder", "described"])
@pytest.mark.parametrize("storage", STORAGES)
def test_files_are_read_alone_too(form: str, storage: StoragePlugin, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", pictures([0], [0]) | infos(), storage)
    path = bag
    if form != "described":
        (bag / "metadata.yaml").unlink()
    if form == "file":
        (path,) = bag.iterdir()
    assert is_bag(path)
    assert len(imported(path, tmp_path / "out").frames) == 1


@pytest.mark.parametrize("compression", list(mcap.writer.CompressionType))
def test_mcap_of_its_own_library_is_read(compression: mcap.writer.CompressionType, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file, compression=compression)
        writer.start(profile="ros2")
        for topic, messages in (pictures([0, 100], [0, 100]) | infos()).items():
            kind = messages[0].__msgtype__
            text = STORE.generate_msgdef(kind, ros_version=2)[0]
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for message in messages:
                data = bytes(STORE.serialize_cdr(message, kind))
                writer.add_message(channel, START_NS, data, START_NS)
        writer.finish()
    assert len(imported(path, tmp_path / "out").frames) == 2


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.95])
def test_a_truncated_recording_is_one_line(
    share: float, storage: StoragePlugin, tmp_path: Path, run: Run
) -> None:
    bag = write_bag(tmp_path / "bag", pictures(range(0, 800, 100), range(0, 800, 100)) | infos(), storage)
    (file,) = (p for p in bag.iterdir() if p.suffix != ".yaml")
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    for path in (bag, file):
        code, shown, said = run("import", path, "--out", tmp_path / "out")
        assert (code, shown) == (1, "")
        (line,) = said.splitlines()
        assert "expected a recording of ROS 2, could not read it" in line
        assert not (tmp_path / "out").exists()


def test_topics_are_named_where_there_are_several_pairs(tmp_path: Path) -> None:
    topics = pictures([0], [0]) | infos()
    topics |= {f"{side}/compressedDepth": [packed(START_NS, b"", "")] for side in (LEFT, RIGHT)}
    assert len(imported(write_bag(tmp_path / "one", topics), tmp_path / "of_one").frames) == 1
    topics |= {f"/rear{name}": messages for name, messages in topics.items()}
    bag = write_bag(tmp_path / "bag", topics)
    with pytest.raises(
        RescoreError, match=rf"found 2; name them by --left and --right: {LEFT} and {RIGHT}; /rear"
    ):
        imported(bag, tmp_path / "out")
    assert len(imported(bag, tmp_path / "out", Wanted(left=f"rear{LEFT}")).frames) == 1
    with pytest.raises(RescoreError, match="--right: expected a topic of pictures"):
        imported(bag, tmp_path / "other", Wanted(LEFT, "/nothing"))
    with pytest.raises(RescoreError, match="found 0; name them"):
        imported(bag, tmp_path / "other", Wanted(LEFT, LEFT))


def test_without_camera_info_depth_is_known_but_for_scale(tmp_path: Path) -> None:
    data = imported(write_bag(tmp_path / "bag", pictures([0], [0])), tmp_path / "out")
    assert data.frames[0].camera is None
    assert any("no calibration" in n for n in data.notes)


def test_a_calibration_of_another_size_leaves_nothing(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", pictures([0], [0]) | infos(size=(640, 480)))
    with pytest.raises(RescoreError, match="got that of 640 x 480"):
        imported(bag, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def as_taken(path: Path, *, topic: str = "image_raw") -> Path:
    """A recording of the wall of ``test_rectify`` as two cameras with bent lenses saw it."""
    views = [
        bent.seen(bent.K1, np.eye(3), np.zeros(3), False),
        bent.seen(bent.K2, bent.TURN, bent.MOVE, False),
    ]
    cameras = (bent.K1, bent.BENT, bent.K2, bent.BENT, bent.SIZE, bent.TURN, bent.MOVE)
    r1, r2, p1, p2 = cv2.stereoRectify(*cameras, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0)[:4]
    topics: dict[str, list[Any]] = {}
    for side, view, k, r, p in zip(
        ("left", "right"), views, (bent.K1, bent.K2), (r1, r2), (p1, p2), strict=True
    ):
        topics[f"/cam/{side}/{topic}"] = [raw(START_NS, view, "mono8")]
        topics[f"/cam/{side}/camera_info"] = [info(k, p, d=bent.BENT, r=r, size=bent.SIZE)]
    topics["/boxes"] = [boxes(START_NS, [("car", 0.5, (140, 110, 120, 100))])]
    return write_bag(path, topics)


def test_pictures_as_taken_are_refused_or_rectified(tmp_path: Path, run: Run) -> None:
    bag, out = as_taken(tmp_path / "bag"), tmp_path / "out"
    code, _, said = run("import", bag, "--out", tmp_path / "no")
    assert code == 1
    (line,) = said.splitlines()
    assert "expected rectified pictures, got /cam/left/image_raw with lens distortion (D1 up to 0.25" in line
    assert "--rectify --out NEW" in line
    assert not (tmp_path / "no").exists()
    code, _, said = run("import", bag, "--rectify", "--out", out)
    assert code == 0, said
    assert "left out 1 detection made on pictures as taken" in said
    assert sorted(p.name for p in out.iterdir()) == ["annotations.json", "left", "right"]
    (frame,) = read_dataset(out).frames
    loaded = load_frame(frame, bent.SgbmConfig(num_disparities=32))
    assert frame.camera is not None
    expected_px = frame.camera.left.fx_px * frame.camera.baseline_m / bent.PLANE_M
    assert np.nanmedian(loaded.disparity_px) == pytest.approx(expected_px, abs=0.4)


def test_topics_that_say_rectified_are(tmp_path: Path, run: Run) -> None:
    bag = as_taken(tmp_path / "bag", topic="image_rect")
    assert imported(bag, tmp_path / "out").frames[0].camera is not None
    code, _, said = run("import", bag, "--rectify", "--out", tmp_path / "no")
    assert code == 1
    assert "expected topics of pictures as taken to rectify, got /cam/left/image_rect" in said


def test_the_doctor_examines_a_recording(tmp_path: Path, run: Run) -> None:
    bag = write_bag(tmp_path / "bag", pictures(range(0, 900, 100), range(0, 900, 100)) | infos())
    found = examine_dataset(bag, "car", 3)
    assert not [f for f in found if f.level is Level.ERROR]
    assert "3 frames (3 test)" in found[0].what
    told = [f.what for f in found]
    assert any("paired 9 pictures" in what for what in told)
    assert any("3 of 9 pairs are read" in what for what in told)
    assert run("doctor", as_taken(tmp_path / "bent"))[0] == 1
    code, shown, _ = run("doctor", bag, "--left", LEFT, "--right", "/cam/none", "--json")
    assert code == 1
    assert "--right: expected a topic of pictures" in json.loads(shown)[-1]["what"]


def test_what_is_no_recording_or_cannot_be_read_is_one_line(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_bag(tmp_path / "bag", pictures([0], [0]) | infos())
    old = own.write_text(tmp_path / "old.bag", "#ROSBAG V2.0\n")
    own.write_png(tmp_path / "pairs" / "left" / "a.png", own.pair()[0])
    cases = (
        (("import", old), "got one of ROS 1; convert it by `rosbags-convert --src old.bag --dst NEW`"),
        (("import", tmp_path / "pairs", "--left", "/a"), "expected a recording of ROS to take topics from"),
        (("convert", bag), f"got a recording of ROS; unpack it by `rescore import {bag} --out MY_FOLDER`"),
    )
    for arguments, words in cases:
        code, _, said = run(*arguments, "--out", tmp_path / "out")
        assert code == 1
        assert words in said
        assert len(said.splitlines()) == 1
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    code, _, said = run("import", bag, "--out", tmp_path / "out")
    assert code == 1
    assert "expected the package rosbags" in said
    assert "`pip install rosbags`" in said
    assert len(said.splitlines()) == 1
