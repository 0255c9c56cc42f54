"""Lays two pairs with known disparity, which Linux and Python packages ship, out as Middlebury scenes.

Aloe (Middlebury 2006) comes with Debian's opencv-doc, unpacked by ``dpkg -x``: 8-bit disparities in pixels,
0 where unknown. Motorcycle (Middlebury 2014, a quarter of its size) comes in the wheels of scikit-image 0.16:
disparities in pixels, infinite where unknown. Pictures are copied as they are.
"""

import shutil
import sys
import zipfile
from pathlib import Path

import cv2
import numpy as np

from recon.errors import RescoreError
from recon.files import atomic_path
from rescore.data.pictures import decode_picture

_OPENCV = Path("usr/share/doc/opencv-doc/examples/data")
_SKIMAGE = "skimage/data/motorcycle_"


def lay_out_aloe(package: Path, out: Path) -> Path:
    """The scene folder of aloe, from opencv-doc as unpacked in a folder."""
    data = package / _OPENCV
    truth = decode_picture(data / "aloeGT.png", cv2.IMREAD_UNCHANGED)
    if truth is None or truth.dtype != np.uint8 or truth.ndim != 2:
        raise RescoreError(f"{data / 'aloeGT.png'}: expected an 8-bit grey picture; unpack opencv-doc again")
    folder = out / "aloe"
    for side, name in (("L", "im0"), ("R", "im1")):
        with atomic_path(folder / f"{name}.jpg") as beside:
            shutil.copyfile(data / f"aloe{side}.jpg", beside)
    with atomic_path(folder / "disp0GT.npy") as beside:
        np.save(beside, truth.astype(np.float32))
    return folder


def lay_out_motorcycle(wheel: Path, out: Path) -> Path:
    """The scene folder of motorcycle, from a wheel of scikit-image."""
    folder = out / "motorcycle"
    with zipfile.ZipFile(wheel) as files:
        for side, name in (("left", "im0"), ("right", "im1")):
            with atomic_path(folder / f"{name}.png") as beside:
                beside.write_bytes(files.read(f"{_SKIMAGE}{side}.png"))
        with files.open(f"{_SKIMAGE}disp.npz") as packed:
            truth = np.load(packed, allow_pickle=False)["arr_0"]
    with atomic_path(folder / "disp0GT.npy") as beside:
        np.save(beside, truth.astype(np.float32))
    return folder


if __name__ == "__main__":
    unpacked, scikit_image, target = (Path(text) for text in sys.argv[1:])
    print(lay_out_aloe(unpacked, target), lay_out_motorcycle(scikit_image, target))
