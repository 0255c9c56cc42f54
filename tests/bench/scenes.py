"""Rendered stereo pairs with candidates, as frames of a program that calls the library."""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.presets import RIGS, AlongConfig, synth_preset
from datasets_synth.street.frame_synth import SynthFrame, camera_record, synth_frame
from recon.arrays import FloatArray, UInt8Array
from recon.camera import GroundPlane
from recon.class_model import ClassModel
from recon.stereo.sgbm import SgbmConfig, compute_disparity
from rescore import Boxes, Camera, StereoFrame
from rescore.data.frames import Frame
from rescore.evidence.candidates import Candidates
from rescore.evidence.settings import RescoreConfig
from rescore.library.bundles import default_bundle

SEED = 11
MIN_HEIGHT_PX = 18.0
BOX_NOISE = 0.05
"""Spread of the edges of boxes around cars, as a share of their size."""
MATCHER = SgbmConfig()
"""64 disparities, the preset of rendered streets, at every calibration: the yardstick of the ratios."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A rectified pair with its calibration, and what is seen in it."""

    left_rgb: UInt8Array
    right_rgb: UInt8Array
    camera: Camera
    ground: GroundPlane
    cars_px: FloatArray
    """Boxes of the cars that are seen, shape (n, 4)."""
    azimuth_deg: FloatArray
    """From where each car is seen, shape (n,)."""

    @property
    def stereo(self) -> StereoFrame:
        """The pair as the library takes it."""
        return StereoFrame(self.left_rgb, right_rgb=self.right_rgb, camera=self.camera, ground=self.ground)

    def disparity_px(self) -> FloatArray:
        """Disparity by the yardstick's settings."""
        return compute_disparity(self.left_rgb, self.right_rgb, MATCHER)

    def frame(self) -> Frame:
        """The pair with its disparity, as the method takes it."""
        frame = StereoFrame(
            self.left_rgb, disparity_px=self.disparity_px(), camera=self.camera, ground=self.ground
        )
        return frame.loaded(MATCHER, RescoreConfig.nearest_m)

    def boxes_px(self, n: int) -> tuple[FloatArray, FloatArray]:
        """Boxes around the cars, each a little off, and from where their cars are seen: (n, 4) and (n,)."""
        rng = np.random.default_rng(0)
        of = np.arange(n) % len(self.cars_px)
        boxes = self.cars_px[of]
        size = np.tile(boxes[:, 2:] - boxes[:, :2], 2)
        return boxes + rng.normal(0, BOX_NOISE, (n, 4)) * size, self.azimuth_deg[of]

    def candidates(self, n: int, view_known: bool) -> Candidates:
        """Such boxes as candidates; their detector says from where it sees each, or does not."""
        boxes, azimuth = self.boxes_px(n)
        likelihood = np.linspace(0.9, 0.1, n)
        return Candidates(0, boxes, likelihood, likelihood, azimuth if view_known else None)

    def boxes(self, n: int) -> Boxes:
        """Such boxes as the library takes them."""
        return Boxes(self.boxes_px(n)[0], likelihood=np.linspace(0.9, 0.1, n))

    def resized(self, width_px: int, height_px: int) -> "Pair":
        """The same scene in another size and the same proportion."""
        s = width_px / self.left_rgb.shape[1]
        left, right = (
            cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA)
            for rgb in (self.left_rgb, self.right_rgb)
        )
        c = self.camera
        # the scale is about the corner of the picture, half a pixel off the middle of its first pixel
        middle = ((c.cx + 0.5) * s - 0.5, (c.cy + 0.5) * s - 0.5)
        camera = Camera(c.fx * s, c.fy * s, *middle, c.baseline_m)
        return replace(self, left_rgb=left, right_rgb=right, camera=camera, cars_px=self.cars_px * s)


@cache
def across_pairs(n: int, width_px: int = 640, height_px: int = 480) -> tuple[Pair, ...]:
    """Streets seen across, as the ROC experiment has them, with two cars each."""
    demo = synth_preset("demo")
    config = replace(demo, camera=replace(demo.camera, width_px=width_px, height_px=height_px))
    cars = cars_of_splits()["test"]
    frames = (synth_frame(config, SEED, "test", i, n_cars=2, cars=cars, pictures=()) for i in range(n))
    return tuple(_pair(frame) for frame in frames)


@cache
def kitti_pairs(n: int) -> tuple[Pair, ...]:
    """Streets seen along, 1242 x 375 pixels, by a stereo head of KITTI's calibration."""
    config = replace(synth_preset("streets"), along=AlongConfig(rigs=RIGS[:1]))
    cars = cars_of_splits()["test"]
    frames = (synth_frame(config, SEED, "test", i, n_cars=None, cars=cars, pictures=()) for i in range(n))
    return tuple(_pair(frame) for frame in frames)


def _pair(frame: SynthFrame) -> Pair:
    told = camera_record(frame.scene)
    camera = Camera(*(told[name] for name in ("fx", "fy", "cx", "cy", "baseline_m")))
    flat = GroundPlane(told["height_m"], told["pitch_rad"])
    kinds = [frame.scene.items[v.item].kind for v in frame.cars]
    height = [v.xyxy_px[3] - v.xyxy_px[1] for v in frame.cars]
    seen = [v for v, k, h in zip(frame.cars, kinds, height, strict=True) if k == "car" and h >= MIN_HEIGHT_PX]
    return Pair(
        frame.render.left_rgb,
        frame.render.right_rgb,
        camera,
        flat if frame.along is None else frame.along.ground,
        np.array([v.xyxy_px for v in seen]),
        np.array([v.azimuth_deg for v in seen]),
    )


@cache
def class_model() -> ClassModel:
    """The class model of cars that comes with the package, without shapes to fit to disparity."""
    return replace(default_bundle("car").class_model, shape_space=None)
