"""Malformed predictions of depth beside our own layout, and what `rescore apply` must say of each."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.rescore import own_data as own

MAP = np.linspace(5, 30, own.WIDTH * own.HEIGHT).reshape(own.HEIGHT, own.WIDTH)
MASK = np.full((own.HEIGHT, own.WIDTH), 255, np.uint8)
RELATIVE = {"folder": "net", "as": "inverse"}
METRIC = {"folder": "net", "as": "depth", "unit": "metric"}
MASKED = RELATIVE | {"masks": "masks"}


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
    """Leave the folder good; the description is what is wrong."""


def described(path: Path, description: Any) -> Path:
    """The file that `--predicted` names; written as it is where it is text."""
    return own.write_text(path, description if isinstance(description, str) else json.dumps(description))


PREDICTIONS: dict[str, tuple[Callable[[Path], object], Any, str]] = {
    "no JSON": (as_is, "folder: net", "net.json: expected a description of predicted depth as JSON"),
    "no object": (as_is, ["net"], "net.json: expected a description of predicted depth, got input should be"),
    "no name of a folder": (
        as_is,
        {"as": "depth"},
        "net.json: .*got folder: field required; keys are folder",
    ),
    "unknown key": (as_is, METRIC | {"scale": 2}, "net.json: .*got scale: extra inputs are not permitted"),
    "factor a word": (
        as_is,
        METRIC | {"factor": "mm"},
        "net.json: .*got factor: input should be a valid num",
    ),
    "no kind": (as_is, {"folder": "net"}, "net.json: as: expected depth or inverse, got None; say what"),
    "kind unknown": (as_is, {"folder": "net", "as": "disparity"}, "net.json: as: .*got 'disparity'"),
    "unit unknown": (as_is, RELATIVE | {"unit": "cm"}, "net.json: unit: expected relative or"),
    "factor of relative": (as_is, RELATIVE | {"factor": 256}, "net.json: factor: expected met"),
    "factor 0": (as_is, METRIC | {"factor": 0}, "net: expected a positive factor .*got 0"),
    "factor NaN": (as_is, METRIC | {"factor": float("nan")}, "net.json: .*NaN, which is no number of JSON"),
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
        RELATIVE | {"masks": "nowhere"},
        "nowhere: expected a folder with a mask",
    ),
    "mask missing": (
        lambda root: (root / "masks/1.png").unlink(),
        MASKED,
        "masks: expected a mask of every frame with detections, found none for 1 of 2, such as '1'",
    ),
    "mask in colour": (
        lambda root: own.write_png(root / "masks/1.png", np.dstack([MASK] * 3)),
        MASKED,
        r"1.png: expected a mask with one channel of 96 x 64 pixels, got shape \(64, 96, 3\)",
    ),
    "mask cut off": (
        lambda root: (root / "masks/1.png").write_bytes((root / "masks/1.png").read_bytes()[:60]),
        MASKED,
        "1.png: expected a mask .*got no whole picture",
    ),
}
