"""Small data sets of every layout, written to a folder, for tests to read and to break."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, UInt8Array
from recon.stereo.sgbm import SgbmConfig

WIDTH, HEIGHT = 96, 64
SHIFT = 6
"""Disparity of every pixel, in pixels."""
FX, BASELINE_M = 80.0, 0.5
STEREO = SgbmConfig(num_disparities=16)
KITTI_CAR = "Car 0.00 0 1.65 10.0 20.0 40.5 44.0 1.5 1.6 4.0 1.0 1.7 20.0 1.6"
KITTI_LABEL = f"""{KITTI_CAR}
Car 0.25 2 -10 50 20 90 44 1.5 1.6 4.0 1.0 1.7 20.0 1.6
Van 0.00 0 0.0 60 5 80 20 1.5 1.6 4.0 1.0 1.7 20.0 1.6
Pedestrian 0.00 0 0.0 1 5 9 30 1.5 1.6 4.0 1.0 1.7 20.0 1.6
DontCare -1 -1 -10 70 1 90 9 -1 -1 -1 -1000 -1000 -1000 -10
"""


def write_png(path: Path, value: NDArray[Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(path.suffix, value)[1].tobytes())
    return path


def write_text(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def pair(seed: int = 0, shift: int = SHIFT) -> tuple[UInt8Array, UInt8Array]:
    """Grey noise and the same, seen from the right: column x is at x - shift there."""
    wide = np.random.default_rng(seed).integers(0, 255, (HEIGHT, WIDTH + abs(shift)), dtype=np.uint8)
    wide = cv2.GaussianBlur(wide, (0, 0), 0.8)
    if shift < 0:
        return wide[:, -shift:], wide[:, :WIDTH]
    return wide[:, :WIDTH], wide[:, shift:]


def write_pair(left: Path, right: Path, seed: int = 0, shift: int = SHIFT) -> None:
    for path, value in zip((left, right), pair(seed, shift), strict=True):
        write_png(path, value)


def kitti_calib(fx: float = FX, baseline_m: float = BASELINE_M) -> str:
    # the left colour camera stands 6 cm beside the one that all is measured from, as in KITTI
    def row(shift: float) -> str:
        return f"{fx} 0 48 {shift} 0 {fx} 32 0.2 0 0 1 0.003"

    x2, x3 = 0.06 * fx, 0.06 * fx - fx * baseline_m
    return (
        "\n".join(f"P{i}: {row(shift)}" for i, shift in enumerate((0, -fx * baseline_m, x2, x3)))
        + "\nR0_rect: 1 0 0 0 1 0 0 0 1\n"
    )


def kitti_folder(root: Path, names: tuple[str, ...] = ("000003", "000007")) -> Path:
    """KITTI's object layout."""
    for i, name in enumerate(names):
        write_pair(root / "image_2" / f"{name}.png", root / "image_3" / f"{name}.png", i)
        write_text(root / "calib" / f"{name}.txt", kitti_calib())
        write_text(root / "label_2" / f"{name}.txt", KITTI_LABEL if i == 0 else "")
    return root


def opencv_yaml(values: dict[str, FloatArray | float]) -> str:
    """As OpenCV itself writes it."""
    file = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in values.items():
        file.write(name, value)
    return str(file.releaseAndGetString())


def projection(x: float, cx: float = 48) -> FloatArray:
    return np.array([[FX, 0, cx, x], [0, FX, 32, 0], [0, 0, 1, 0]], dtype=float)


def pair_folder(root: Path, left: str = "left", right: str = "right") -> Path:
    """Two folders of pictures and OpenCV's calibration."""
    for i, name in enumerate(("a", "b")):
        write_pair(root / left / f"{name}.png", root / right / f"{name}.png", i)
    calibration = {"P1": projection(0), "P2": projection(-FX * BASELINE_M)}
    write_text(root / "calib.yaml", opencv_yaml(calibration))
    return root


def annotations() -> dict[str, Any]:
    camera = {"fx": FX, "fy": FX, "cx": 48, "cy": 32, "baseline_m": BASELINE_M, "height_m": 1.6}
    image = {"width": WIDTH, "height": HEIGHT, "camera": camera}
    return {
        "images": [
            {"id": i, "file_name": f"left/{i}.png", "right_file_name": f"right/{i}.png"} | image
            for i in (1, 2)
        ],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox": [10, 20, 30, 24]}],
        "categories": [{"id": 1, "name": "car"}],
    }


def own_folder(root: Path, value: dict[str, Any] | None = None) -> Path:
    """Our own layout."""
    for i in (1, 2):
        write_pair(root / "left" / f"{i}.png", root / "right" / f"{i}.png", i)
    write_text(root / "annotations.json", json.dumps(annotations() if value is None else value))
    return root


def write_pfm(path: Path, value: NDArray[np.floating]) -> Path:
    head = f"Pf\n{value.shape[1]} {value.shape[0]}\n-1.0\n".encode()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(head + np.flipud(value).astype("<f4").tobytes())
    return path


def middlebury(root: Path, doffs: float, shift: int) -> Path:
    for i, name in enumerate(("Adirondack", "Motorcycle")):
        write_pair(root / name / "im0.png", root / name / "im1.png", i, shift)
        write_text(
            root / name / "calib.txt",
            f"cam0=[{FX} 0 48; 0 {FX} 32; 0 0 1]\n"
            f"cam1=[{FX} 0 {48 + doffs}; 0 {FX} 32; 0 0 1]\n"
            f"doffs={doffs}\nbaseline={BASELINE_M * 1000}\nwidth=96\nheight=64\nndisp=16\n",
        )
    return root


K = np.array([[FX, 0, 48], [0, FX, 32], [0, 0, 1]])
DEPTH_M = np.linspace(2, 30, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH)


def depth_folder(root: Path, suffix: str, factor: float | None = None) -> Path:
    write_png(root / "left" / "1.png", pair()[0])
    values: dict[str, object] = {"cameraMatrix": K}
    if factor:
        values["depth_factor"] = factor
    write_text(root / "calib.yaml", opencv_yaml(values))
    path = root / "depth" / f"1{suffix}"
    path.parent.mkdir()
    if suffix == ".png":
        write_png(path, np.rint(DEPTH_M * (factor or 256)).astype(np.uint16))
    elif suffix == ".npy":
        np.save(path, DEPTH_M)
    elif suffix == ".pfm":
        write_pfm(path, DEPTH_M)
    return root
