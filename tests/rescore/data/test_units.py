"""Units of whole pictures: what cannot be is refused with its factor, in the library and on disk alike."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recon.camera import GroundPlane, PinholeCamera
from recon.errors import RescoreError
from rescore.data.depth_files import Quantity
from rescore.data.frames import Frame
from rescore.data.units import Things, size_doubt, unit_doubt
from rescore.evidence.candidates import Candidates
from rescore.evidence.settings import RescoreConfig
from rescore.formats.open import read_dataset
from rescore.fusion.rescore_frame import Rescoring
from rescore.fusion.rescore_frames import rescore_frames
from rescore.library.inputs import Boxes, Camera, StereoFrame
from rescore.library.rescorer import Rescorer
from tests.rescore import own_data as own

LEFT = np.repeat(own.pair()[0][:, :, None], 3, axis=2)
DEPTH_M = np.broadcast_to(np.linspace(20.0, 4.0, 64)[:, None], LEFT.shape[:2]).copy()
"""A street that comes nearer downwards, from 20 m to 4 m."""
DISPARITY_PX = 80 * 0.5 / DEPTH_M


def loaded(*, baseline_m: float | None = 0.5, **measured: np.ndarray) -> None:
    camera = Camera(80, 80, 48, 32, baseline_m)
    config = RescoreConfig()
    StereoFrame(LEFT, camera=camera, **measured).loaded(config.stereo, config.nearest_m)


def test_what_can_be_is_taken() -> None:
    for scale in (0.1, 1.0, 4.0):
        loaded(depth_m=DEPTH_M * scale)
    loaded(depth_m=DEPTH_M, baseline_m=None)
    loaded(disparity_px=DISPARITY_PX)


@pytest.mark.parametrize(
    ("scale", "baseline_m", "message"),
    [
        (1000, 0.5, r"farther than 100 m \(nearest 42.. m\): depth looks like millimetres, factor 1000"),
        (100, 0.5, r"\(nearest 42. m\): depth looks like centimetres or millimetres, factor 100 or 1000"),
        (0.001, 0.5, r"nearer than 0.2 m \(farthest 0.02 m\): depth is too small, as by a factor of 1000"),
        (1, 500, r"a disparity beyond its width .*: the baseline looks like millimetres, factor 1000"),
    ],
)
def test_depth_in_other_units(scale: float, baseline_m: float, message: str) -> None:
    with pytest.raises(RescoreError, match=f"frame: expected depth and baseline in metres.*{message}"):
        loaded(depth_m=DEPTH_M * scale, baseline_m=baseline_m)


@pytest.mark.parametrize(
    ("scale", "baseline_m", "message"),
    [
        (1, 500, r"\(nearest 42.. m\): the baseline looks like millimetres, factor 1000"),
        (1, 0.0005, r"nearer than 0.2 m \(farthest 0.02 m\): the baseline is too small"),
        (1 / 96, 0.5, r"farther than 100 m|below a pixel everywhere"),
    ],
)
def test_disparity_and_baseline_in_other_units(scale: float, baseline_m: float, message: str) -> None:
    with pytest.raises(RescoreError, match=message):
        loaded(disparity_px=DISPARITY_PX * scale, baseline_m=baseline_m)


def test_apply_refuses_frames_with_their_number(tmp_path: Path) -> None:
    """A baseline in millimetres, and measured depth whose factor is missing."""
    value = own.annotations()
    value["images"][0]["camera"]["baseline_m"] *= 1000
    data = read_dataset(own.own_folder(tmp_path, value))
    box = np.array([[10.0, 20, 40, 44]])
    candidates = {1: Candidates(1, box, np.array([0.5]), np.array([0.5]))}
    model = Rescorer.default().class_model
    assert model is not None
    with pytest.raises(RescoreError, match=r"^image 1: expected depth and .* the baseline looks"):
        rescore_frames(data, candidates, model, Rescoring(), jobs=1)


STREET = np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)


def street_m(height_m: float = 1.5) -> np.ndarray:
    """Depth of a level street and of the fronts of three cars, 1.5 m tall and 12 m away."""
    left = PinholeCamera(150, 150, 79.5, 59.5, 160, 120)
    v, u = np.mgrid[:120, :160].astype(float)
    depth = GroundPlane(height_m, 0.02).intersect(left.rays(np.stack([u, v], axis=-1)))[..., 2]
    depth[~(depth < 60)] = 60
    for x0, y0, x1, y1 in CARS.astype(int):
        depth[y0:y1, x0:x1] = 12.0
    return depth


CARS = np.array([[x, 57.0, x + 22, 75.75] for x in (10.0, 60.0, 110.0)])


def seen(depth_m: np.ndarray, baseline_m: float | None = 0.4, ground: GroundPlane | None = None) -> Frame:
    camera = Camera(150, 150, 79.5, 59.5, baseline_m)
    frame = StereoFrame(STREET, depth_m=depth_m, camera=camera, ground=ground)
    return frame.loaded(RescoreConfig().stereo, 2.0)


@pytest.mark.parametrize("baseline_m", [0.4, None])
@pytest.mark.parametrize(
    ("scale", "height", "side"), [(10, "1[56] m", "large"), (0.1, r"0\.1[56] m", "small")]
)
def test_ground_where_no_camera_stands(
    scale: float, height: str, side: str, baseline_m: float | None
) -> None:
    depth = street_m() * scale
    with pytest.raises(RescoreError, match=rf"stands {height} above the ground .* depth is too {side}"):
        seen(depth, baseline_m)
    # who states the ground has such a camera
    stated = GroundPlane(1.5 * scale, 0.02)
    assert seen(depth, baseline_m, stated).ground == stated


@pytest.mark.parametrize("height_m", [0.3, 1.1, 3.5, 5.5])
def test_ground_where_cameras_stand(height_m: float) -> None:
    assert unit_doubt(seen(street_m(height_m)), Quantity.DEPTH) == ""


@pytest.mark.parametrize(
    ("scale", "text"),
    [
        (5.0, r"the objects are 7.5 m tall \(median of 3; expected 1.5 m\): depth is too large.* of 5"),
        (0.2, r"the objects are 0.3 m tall \(median of 3; expected 1.5 m\): depth is too small.* of 5"),
        (3.5, ""),
        (0.3, ""),
    ],
)
def test_size_of_what_stands_there(scale: float, text: str) -> None:
    """With a stated ground, which tells nothing of the unit of depth."""
    frame = seen(street_m() * scale, ground=GroundPlane(1.5, 0.02))
    doubt = size_doubt(frame, Quantity.DEPTH, Things(CARS, 1.5))
    assert re.search(text, doubt) if text else doubt == ""
    likely = Things.confident(CARS, np.array([0.9, 0.5, 0.49]), 1.5)
    assert len(likely.xyxy_px) == 2
    assert size_doubt(frame, Quantity.DEPTH, likely) == ""


def test_the_library_refuses_objects_of_another_size() -> None:
    rescorer = Rescorer.default()
    boxes = Boxes(CARS, likelihood=np.full(3, 0.8))
    camera = Camera(150, 150, 79.5, 59.5, 0.4)
    frame = StereoFrame(STREET, depth_m=street_m() * 6, camera=camera, ground=GroundPlane(1.5, 0.02))
    with pytest.raises(RescoreError, match=r"^frame: .* the objects are 9 m tall .*factor of 5\.\d"):
        rescorer.rescore(frame, boxes)
    assert len(rescorer.rescore(replace(frame, depth_m=street_m()), boxes).posterior) == 3
