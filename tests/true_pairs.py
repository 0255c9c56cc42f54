"""Stereo pairs with true disparity in the layouts of the benchmarks, made of noise, for tests."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT, SHIFT = 160, 64, 12
"""Size in pixels, and the disparity of every pixel."""
CALIBRATION = "P_rect_02: 96 0 80 0 0 96 32 0 0 0 1 0\nP_rect_03: 96 0 80 -48 0 96 32 0 0 0 1 0\n"
"""48 px m: 24 px at 2 m."""


def write_png(path: Path, value: NDArray[Any]) -> Path:
    """Write a picture in the form that the suffix names."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(path.suffix, value)[1].tobytes())
    return path


def noise(seed: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Left and right picture of a wall."""
    grey = np.random.default_rng(seed).integers(0, 255, (HEIGHT, WIDTH + SHIFT), dtype=np.uint8)
    grey = cv2.GaussianBlur(grey, (0, 0), 0.8)
    return grey[:, :WIDTH], grey[:, SHIFT:]


def kitti_2015(root: Path, frames: int = 2, calibrated: bool = True) -> Path:
    """KITTI stereo 2015: rows 0 to 31 foreground, all of it true; every other row of the background.

    Truth is the shift. In the 10 columns 100 to 109 it is wrong by 10 pixels, in background alone. Truth of
    pixels seen twice leaves out columns 0 to 11, which the right picture does not show.
    """
    for i in range(frames):
        name = f"{i:06d}_10.png"
        for folder, picture in zip(("image_2", "image_3"), noise(i), strict=True):
            write_png(root / folder / name, picture)
        truth = np.full((HEIGHT, WIDTH), SHIFT * 256, np.uint16)
        truth[32:, 100:110] = (SHIFT + 10) * 256
        truth[33::2] = 0
        write_png(root / "disp_occ_0" / name, truth)
        twice = truth.copy()
        twice[:, :SHIFT] = 0
        write_png(root / "disp_noc_0" / name, twice)
        objects = np.zeros((HEIGHT, WIDTH), np.uint8)
        objects[:32] = 3
        write_png(root / "obj_map" / name, objects)
        if calibrated:
            (root / "calib_cam_to_cam").mkdir(exist_ok=True)
            (root / "calib_cam_to_cam" / f"{i:06d}.txt").write_text(CALIBRATION)
    return root


def scene(folder: Path, mask: bool = False) -> Path:
    """A Middlebury scene."""
    left, right = noise(5)
    write_png(folder / "im0.png", left)
    write_png(folder / "im1.png", right)
    truth = np.full((HEIGHT, WIDTH), float(SHIFT), np.float32)
    truth[:4] = np.inf
    head = f"Pf\n{WIDTH} {HEIGHT}\n-1.0\n".encode()
    (folder / "disp0GT.pfm").write_bytes(head + np.flipud(truth).astype("<f4").tobytes())
    if mask:
        values = np.full((HEIGHT, WIDTH), 255, np.uint8)
        values[:, :20] = 128
        write_png(folder / "mask0nocc.png", values)
    return folder


def untrue(root: Path) -> Path:
    """Two pairs of KITTI's object layout, without truth."""
    (root / "calib").mkdir(parents=True)
    for i in range(2):
        for folder, picture in zip(("image_2", "image_3"), noise(i), strict=True):
            write_png(root / folder / f"{i:06d}.png", picture)
        calibration = CALIBRATION.replace("P_rect_02", "P2").replace("P_rect_03", "P3")
        (root / "calib" / f"{i:06d}.txt").write_text(calibration)
    return root
