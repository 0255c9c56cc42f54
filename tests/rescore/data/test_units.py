"""Units of whole pictures: what cannot be is refused with its factor, in the library and on disk alike."""

from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.evidence.candidates import Candidates
from rescore.evidence.settings import RescoreConfig
from rescore.formats.open import read_dataset
from rescore.fusion.rescore_frame import Rescoring
from rescore.fusion.rescore_frames import rescore_frames
from rescore.library.inputs import Camera, StereoFrame
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
