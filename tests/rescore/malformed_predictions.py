"""Malformed predictions of depth beside our own layout, and what `rescore apply` must say of each."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.rescore import own_data as own

MAP = np.linspace(5, 30, own.WIDTH * own.HEIGHT).reshape(own.HEIGHT, own.WIDTH)
MASK = np.full((own.HEIGHT, own.WIDTH), 255, np.uint8)
RELATIVE = ("--predicted-as", "inverse")
METRIC = ("--predicted-as", "depth", "--predicted-unit", "metric")


def save(path: Path, value: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, value)
    return path


def predictions(root: Path) -> Path:
    """A good folder: both frames of ``own_folder``."""
    for name in ("1", "2"):
        save(root / "net" / f"{name}.npy", MAP)
        own.write_png(root / "masks" / f"{name}.png", MASK)
    return root / "net"


def file(name: str, write: Callable[[Path], object]) -> Callable[[Path], object]:
    """Another file in place of those of frame 1."""

    def spoil(root: Path) -> None:
        (root / name).parent.joinpath("1.npy").unlink(missing_ok=True)
        write(root / name)

    return spoil


def as_is(_root: Path) -> None:
    """Leave the folder good; the options are what is wrong."""


PREDICTIONS: dict[str, tuple[Callable[[Path], object], tuple[str, ...], str]] = {
    "no kind": (as_is, (), "--predicted-as: expected depth or inverse, got None; say what"),
    "kind unknown": (as_is, ("--predicted-as", "disparity"), "--predicted-as: .*got 'disparity'"),
    "unit unknown": (as_is, (*RELATIVE, "--predicted-unit", "cm"), "--predicted-unit: expected relative or"),
    "factor of relative": (
        as_is,
        (*RELATIVE, "--predicted-factor", "256"),
        "--predicted-factor: expected met",
    ),
    "factor 0": (as_is, (*METRIC, "--predicted-factor", "0"), "net: expected a positive factor .*got 0"),
    "factor NaN": (
        as_is,
        (*METRIC, "--predicted-factor", "nan"),
        "net: expected a positive factor .*got nan",
    ),
    "class model too": (as_is, (*RELATIVE, "--model", "car.json"), "expected one of the two, got both"),
    "no folder": (
        lambda root: (root / "net").rename(root / "gone"),
        RELATIVE,
        "net: expected a folder with predicted depth of each frame, found none",
    ),
    "frame missing": (
        lambda root: (root / "net/2.npy").rename(root / "net/two.npy"),
        RELATIVE,
        r"net: expected predicted depth of every frame with detections, found none for 1 of 2, such as '2'",
    ),
    "two files of a frame": (
        lambda root: own.write_pfm(root / "net/1.pfm", MAP),
        RELATIVE,
        "net: expected one file of a name, found 1.npy and 1.pfm",
    ),
    "another size": (
        file("net/1.npy", lambda p: save(p, MAP[::2, ::2])),
        RELATIVE,
        "1.npy: expected .*96 x 64",
    ),
    "three channels": (
        file("net/1.npy", lambda p: save(p, np.dstack([MAP] * 3))),
        RELATIVE,
        r"\(64, 96, 3\)",
    ),
    "words": (
        file("net/1.npy", lambda p: save(p, MAP.astype(str))),
        RELATIVE,
        "expected an array of numbers",
    ),
    "cut off": (
        lambda root: (root / "net/1.npy").write_bytes((root / "net/1.npy").read_bytes()[:900]),
        RELATIVE,
        "1.npy: expected a whole NPY",
    ),
    "picture of 8 bits": (
        file("net/1.png", lambda p: own.write_png(p, MASK)),
        RELATIVE,
        "1.png: expected 16-bit grey with value = 1 x predicted depth, got a PNG of mode L",
    ),
    "PFM in colour": (
        file("net/1.pfm", lambda p: own.write_text(p, "PF\n96 64\n-1\n")),
        RELATIVE,
        "1.pfm: .*PFM",
    ),
    "no masks": (
        as_is,
        (*RELATIVE, "--predicted-masks", "nowhere"),
        "nowhere: expected a folder with a mask",
    ),
    "mask missing": (
        lambda root: (root / "masks/1.png").unlink(),
        (*RELATIVE, "--predicted-masks", "MASKS"),
        "masks: expected a mask of every frame with detections, found none for 1 of 2, such as '1'",
    ),
    "mask in colour": (
        lambda root: own.write_png(root / "masks/1.png", np.dstack([MASK] * 3)),
        (*RELATIVE, "--predicted-masks", "MASKS"),
        r"1.png: expected a mask with one channel of 96 x 64 pixels, got shape \(64, 96, 3\)",
    ),
    "mask cut off": (
        lambda root: (root / "masks/1.png").write_bytes((root / "masks/1.png").read_bytes()[:60]),
        (*RELATIVE, "--predicted-masks", "MASKS"),
        "1.png: expected a mask .*got no whole picture",
    ),
}
