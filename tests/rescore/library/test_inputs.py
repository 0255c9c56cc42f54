"""What the library says of input that it cannot take."""

import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from recon.camera import GroundPlane
from recon.stereo.sgbm import SgbmConfig
from rescore import Boxes, Camera, RescoreError, StereoFrame
from rescore.data.frames import GroundSource

RGB = np.zeros((40, 60, 3), np.uint8)
MAP = np.ones((40, 60), np.float32)
BOX = np.array([[5.0, 5, 30, 20]])
HALF = np.array([0.5])
CAMERA = Camera(50, 50, 30, 20, 0.3)


def frame_of(**changes: Any) -> Callable[[], StereoFrame]:
    return lambda: StereoFrame(**{"left_rgb": RGB, "disparity_px": MAP} | changes)


def boxes_of(**changes: Any) -> Callable[[], Boxes]:
    return lambda: Boxes(**{"xyxy_px": BOX, "likelihood": HALF} | changes)


BAD_INPUT: list[tuple[Callable[[], object], str]] = [
    (
        frame_of(left_rgb=MAP),
        "left_rgb: expected an array (h, w, 3) of uint8, red first, got shape (40, 60) of",
    ),
    (frame_of(left_rgb=RGB / 255), "got shape (40, 60, 3) of float64; convert the picture"),
    (frame_of(left_rgb=None), "left_rgb: expected an array (h, w, 3) of uint8, red first, got NoneType"),
    (frame_of(disparity_px=None), "expected one of disparity_px, depth_m, right_rgb, got none; give the one"),
    (frame_of(right_rgb=RGB), "got disparity_px and right_rgb; give the one that was measured"),
    (frame_of(disparity_px=None, right_rgb=RGB[1:]), "right_rgb: expected shape (40, 60, 3) as the left"),
    (
        frame_of(disparity_px=MAP[1:]),
        "disparity_px: expected shape (40, 60) as the left picture has, got (39, 60)",
    ),
    (frame_of(disparity_px=MAP[..., None]), "got (40, 60, 1); register it to the left picture"),
    (
        frame_of(disparity_px=None, depth_m=MAP.astype(np.uint16), camera=CAMERA),
        "depth_m: expected an array of floats in metres, got shape (40, 60) of uint16; divide by the factor",
    ),
    (frame_of(disparity_px=None, depth_m=MAP), "expected a camera with depth_m, got none; give Camera("),
    (frame_of(camera=Camera(50, 50, 30, 20)), "expected a camera with baseline_m for disparity_px, got none"),
    (frame_of(ground=GroundPlane(1.5, float("nan"))), "ground: expected finite height and angles, got"),
    (
        lambda: Camera(50, 50, 30, float("nan"), 0.3),
        "camera: expected finite numbers, focal lengths and base",
    ),
    (
        lambda: Camera(50, -50, 30, 20, 0.3),
        "camera: expected finite numbers, focal lengths and baseline above 0",
    ),
    (
        lambda: Camera(50, 50, 30, 20, 0),
        "camera: expected finite numbers, focal lengths and baseline above 0",
    ),
    (boxes_of(xyxy_px=BOX[0]), "xyxy_px: expected an array (n, 4) of numbers, a box a row, got shape (4,)"),
    (boxes_of(xyxy_px=BOX.tolist()), "xyxy_px: expected an array (n, 4) of numbers, a box a row, got list"),
    (boxes_of(xyxy_px=BOX.astype(str)), "a box a row, got shape (1, 4) of <U32; convert the boxes"),
    (
        boxes_of(xyxy_px=BOX * np.nan),
        "xyxy_px: expected finite numbers, got NaN or infinity for box 0; leave",
    ),
    (boxes_of(xyxy_px=BOX[:, [2, 1, 0, 3]]), "got [30.0, 5.0, 5.0, 20.0] for box 0; give edges, not width"),
    (
        boxes_of(xyxy_px=np.array([[5, 5, 5, 9]])),
        "got [5, 5, 5, 9] for box 0; give edges, not width and height",
    ),
    (boxes_of(likelihood=None), "boxes: expected likelihood or score, got neither; give likelihoods"),
    (boxes_of(score=HALF), "boxes: expected likelihood or score, got both; give likelihoods in [0, 1]"),
    (
        boxes_of(likelihood=np.ones(2)),
        "likelihood: expected an array (1,) of numbers, one a box, got shape (2,)",
    ),
    (boxes_of(likelihood=HALF + 1), "likelihood: expected numbers in [0, 1], got 1.5 for box 0; give raw"),
    (boxes_of(likelihood=HALF - 1), "likelihood: expected numbers in [0, 1], got -0.5 for box 0; give raw"),
    (
        boxes_of(likelihood=HALF * np.nan),
        "likelihood: expected numbers in [0, 1], got nan for box 0; give raw",
    ),
    (
        boxes_of(likelihood=None, score=HALF * np.inf),
        "score: expected finite numbers, got NaN or infinity for box 0",
    ),
    (
        boxes_of(azimuth_deg=HALF * np.inf),
        "azimuth_deg: expected finite numbers, got infinity for box 0",
    ),
    (boxes_of(azimuth_deg=90.0), "azimuth_deg: expected an array (1,) of numbers, one a box, got float"),
]


@pytest.mark.parametrize(("make", "message"), BAD_INPUT)
def test_bad_input_says_what_was_expected(make: Callable[[], object], message: str) -> None:
    with pytest.raises(RescoreError, match=re.escape(message)) as raised:
        make()
    assert "\n" not in str(raised.value)


def test_without_a_stated_ground_the_measured_depth_gives_it() -> None:
    true = GroundPlane(1.1, np.radians(8))
    camera = Camera(150, 150, 79.5, 59.5)
    v, u = np.mgrid[:120, :160].astype(float)
    depth = true.intersect(camera.of_size(160, 120).left.rays(np.stack([u, v], axis=-1)))[..., 2]
    rgb = np.zeros((120, 160, 3), np.uint8)
    seen = StereoFrame(rgb, depth_m=depth, camera=camera).loaded(SgbmConfig(), 2.0)
    assert seen.ground_source is GroundSource.STEREO
    assert seen.ground is not None
    assert seen.ground.height_m == pytest.approx(1.1, abs=1e-3)
    assert seen.ground.pitch_rad == pytest.approx(np.radians(8), abs=1e-3)
    stated = StereoFrame(rgb, depth_m=depth, camera=camera, ground=GroundPlane(1.5)).loaded(SgbmConfig(), 2.0)
    assert (stated.ground, stated.ground_source) == (GroundPlane(1.5), GroundSource.STATED)


class Tensor:
    """What a tensor on a graphics card is: an array only after ``detach``, ``cpu`` and ``numpy``."""

    def __init__(self, values: np.ndarray, steps: tuple[str, ...] = ("detach", "cpu", "numpy")) -> None:
        self._values, self._steps = values, steps

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        raise TypeError("can't convert cuda:0 device type tensor to numpy")

    def __getattr__(self, name: str) -> Any:
        if self._steps[:1] != (name,):
            raise RuntimeError(f"{name} before {self._steps[0]}")
        rest = self._steps[1:]
        return lambda: Tensor(self._values, rest) if rest else self._values


CONFIDENCE = np.array([0.25], np.float32)


@pytest.mark.parametrize(
    "detections",
    [
        SimpleNamespace(xyxy=BOX.astype(np.float32), confidence=CONFIDENCE, class_id=np.array([2])),
        SimpleNamespace(xyxy=Tensor(BOX.astype(np.float32)), conf=Tensor(CONFIDENCE)),
        SimpleNamespace(xyxy=BOX.tolist(), conf=[0.25]),
    ],
)
def test_boxes_of_what_detectors_hand_out(detections: Any) -> None:
    boxes = Boxes.of(detections)
    assert boxes.xyxy_px.dtype == float
    np.testing.assert_array_equal(boxes.xyxy_px, BOX)
    assert boxes.likelihood is not None
    assert boxes.likelihood.tolist() == [0.25]
    assert boxes.score is None


def test_a_detector_that_found_nothing() -> None:
    assert len(Boxes.of(SimpleNamespace(xyxy=np.zeros((0, 4), np.float32), confidence=np.zeros(0)))) == 0


@pytest.mark.parametrize(
    ("detections", "message"),
    [
        (
            [1, 2],
            "detections: expected an object with xyxy and conf or confidence, got list without xyxy; give",
        ),
        (SimpleNamespace(xyxy=BOX), "got SimpleNamespace without conf or confidence; give results[0].boxes"),
        (SimpleNamespace(xyxy=BOX, confidence=None), "got SimpleNamespace without conf or confidence; give"),
        (SimpleNamespace(xyxy=["a"], conf=HALF), "xyxy: expected an array or tensor of numbers, got list"),
        (
            SimpleNamespace(xyxy=BOX, conf=HALF * 90),
            "likelihood: expected numbers in [0, 1], got 45 for box 0",
        ),
        (SimpleNamespace(xyxy=BOX[:, :3], conf=HALF), "xyxy_px: expected an array (n, 4) of numbers"),
        (SimpleNamespace(xyxy=BOX, conf=np.ones(2)), "likelihood: expected an array (1,) of numbers"),
    ],
)
def test_what_is_no_detections_is_refused(detections: Any, message: str) -> None:
    with pytest.raises(RescoreError, match=re.escape(message)) as raised:
        Boxes.of(detections)
    assert "\n" not in str(raised.value)
