"""The command with parts of four frames: `python -m tests.faults.small_parts ARGUMENT...`.

So a run of some pictures has many parts, and may be stopped between them.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np

from rescore import cli
from rescore.detectors.hog_svm import HogConfig, HogDetector, descriptor_length
from rescore.detectors.mining import ScanRange
from rescore.detectors.platt import PlattScaling, save_scaling
from rescore.formats.coco_write import overwrite_dataset
from rescore.formats.parts.table import PARTS
from rescore.large import run
from tests.conftest import ROOT
from tests.rescore.toy_street import toy_dataset

FRAMES_A_PART = 4
DAMAGED = 5
"""Number of the frame whose picture is cut."""


def write_street(root: Path, frames: int) -> tuple[Path, Path]:
    """A data set of small pictures, one of them damaged, and a detector that finds something in them."""
    root.mkdir()
    pictures = toy_dataset(root, frames, seed=0)
    overwrite_dataset(root, pictures, copy=False)
    damaged = pictures.frames[DAMAGED].left_path
    damaged.write_bytes(damaged.read_bytes()[:-40])
    config = HogConfig(scan=ScanRange(88, 130, 1.2), floor=-100)
    weight = np.random.default_rng(0).normal(0, 0.02, descriptor_length(config)).astype(np.float32)
    detector = root / "hog.npz"
    HogDetector(weight, 0.25, config).save(detector)
    save_scaling(detector.with_suffix(".platt.json"), PlattScaling(-1.0, 0.0))
    return root, detector


def parts_in(out: Path) -> list[Path]:
    """The parts that lie in the folder of a table."""
    return sorted((out / PARTS).glob("[0-9a-f]*.parquet"))


def detect(data: Path, out: Path, *who: object) -> list[str]:
    """Arguments of a command that finds something in all pictures of ``write_street``."""
    words = ("detect", data, "--detector", data / "hog.npz", "--split", "train", "--out", out, *who)
    return list(map(str, words))


def start(arguments: list[str]) -> "subprocess.Popen[str]":
    """The command in a process group of its own, as a terminal starts it."""
    command = [sys.executable, "-m", "tests.faults.small_parts", *arguments]
    return subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True)


if __name__ == "__main__":
    run.FRAMES_A_PART = FRAMES_A_PART
    cli.main()
