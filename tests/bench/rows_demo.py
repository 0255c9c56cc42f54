"""The demo as a user runs it, and its two detectors on its pictures."""

import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

from recon.arrays import UInt8Array
from reports.publishing.bench_file import Row
from rescore.data.pictures import read_rgb
from rescore.detectors.hog_svm import HogDetector
from rescore.detectors.registry import load_detector
from rescore.formats.coco_dataset import read_dataset
from rescore.results.run_folder import RunFolder
from tests.bench.timing import Call, paired

PICTURES = 6


def demo_and_detectors() -> list[Row]:
    """Wall time of the demo after set-up, and the detectors that it has trained."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "demo"
        start = time.perf_counter()
        command = [sys.executable, "-m", "rescore.cli", "reproduce", "--preset", "demo"]
        subprocess.run([*command, "--out", str(out), "--jobs", "2"], check=True, stdout=subprocess.DEVNULL)
        took_s = time.perf_counter() - start
        return [Row("`make demo` after set-up, two cores", took_s, "s", 90, clock="wall"), *detection(out)]


def detection(run: Path) -> list[Row]:
    """HOG against the bare detectMultiScale call with the same windows; boosted against HOG."""
    folder = RunFolder(run)
    hog, boosted = (load_detector(folder.detector(kind)) for kind in ("hog", "boosted"))
    assert isinstance(hog, HogDetector)
    frames = read_dataset(folder.data, "car").split("test").frames[:PICTURES]
    pictures = [read_rgb(f.left_path, f.width_px, f.height_px) for f in frames]
    against_bare = ((partial(hog.detect, rgb), bare_call(hog, rgb)) for rgb in pictures)
    against_hog = ((partial(boosted.detect, rgb), partial(hog.detect, rgb)) for rgb in pictures)
    return [
        paired("HOG detection / bare detectMultiScale", 1.05, against_bare),
        paired("boosted detection / HOG detection", 1.0, against_hog),
    ]


def bare_call(hog: HogDetector, rgb: UInt8Array) -> Call:
    """The library's call alone, on the same picture with the same windows."""
    zoomed, _ = hog.zoomed(rgb)
    return partial(hog.descriptor().detectMultiScale, zoomed, **hog.scan_arguments())
