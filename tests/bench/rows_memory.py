"""Peak memory of the commands that walk over frames, for more and more frames."""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from reports.publishing.bench_file import Growth, Row
from rescore.files import write_json
from tests.bench.scenes import Pair, across_pairs

FRAMES = (12, 48, 192)
SIZE_PX = (320, 240)
"""Small, so that what grows is not hidden beside what a frame takes, and soon done."""
N = 4
"""Boxes of a frame."""
COMMANDS = ("apply", "evaluate", "log", "report")


def memory() -> tuple[list[Row], list[Growth]]:
    """The largest peak over the smallest of each command, and the time of `apply` over frames."""
    peaks: dict[str, list[float]] = {command: [] for command in COMMANDS}
    apply_s = []
    pair = across_pairs(1)[0].resized(*SIZE_PX)
    with tempfile.TemporaryDirectory() as folder:  # the first call compiles loops, which takes memory too
        write_frames(Path(folder) / "data", pair, 1)
        measured(*_calls(Path(folder))[0])
    for n in FRAMES:
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            write_frames(root / "data", pair, n)
            for command, arguments in _calls(root):
                seconds, peak_mb = measured(command, arguments)
                peaks[command].append(peak_mb)
                if command == "apply":
                    apply_s.append(seconds)
    rows = [
        Row(_what(command, mb), max(mb) / min(mb), "ratio", 1.05, clock="memory")
        for command, mb in peaks.items()
    ]
    return rows, [Growth("`rescore apply`, one job", "frames", FRAMES, tuple(apply_s))]


def _what(command: str, peaks_mb: Sequence[float]) -> str:
    told = ", ".join(f"{mb:.0f}" for mb in peaks_mb)
    frames = ", ".join(map(str, FRAMES))
    return f"peak memory of `rescore {command}`, largest / smallest of {frames} frames ({told} MB)"


def write_frames(folder: Path, pair: Pair, n: int) -> None:
    """A folder of pairs as docs/own-data.md has it: the same pair under n names, labels, detections."""
    for side, rgb in (("left", pair.left_rgb), ("right", pair.right_rgb)):
        (folder / side).mkdir(parents=True)
        first = folder / side / "000000.png"
        Image.fromarray(rgb).save(first)
        for i in range(1, n):
            shutil.copyfile(first, folder / side / f"{i:06d}.png")
    c = pair.camera
    assert c.baseline_m is not None
    shifts = {"P2": 0.0, "P3": -c.fx * c.baseline_m}
    shifts = {"P2": 0.0, "P3": -c.fx * c.baseline_m}
    rows = ((name, f"{c.fx} 0 {c.cx} {x} 0 {c.fy} {c.cy} 0 0 0 1 0") for name, x in shifts.items())
    (folder / "calib.txt").write_text("".join(f"{name}: {row}\n" for name, row in rows), encoding="utf-8")
    boxes, _ = pair.boxes_px(N)
    detections = [
        {"image_id": i, "category_id": 1, "bbox": [*box[:2], *(box[2:] - box[:2])], "score": float(s)}
        for i in range(n)
        for box, s in zip(boxes, np.linspace(0.9, 0.1, N), strict=True)
    ]
    write_json(folder / "detections.json", detections)
    (folder / "label_2").mkdir()
    unknown = "-1 -1 -1 -1000 -1000 -1000 -10"
    cars = (" ".join(f"{edge:.2f}" for edge in box) for box in pair.cars_px)
    labels = "".join(f"Car 0 0 -10 {box} {unknown}\n" for box in cars)
    for i in range(n):
        (folder / "label_2" / f"{i:06d}.txt").write_text(labels, encoding="utf-8")


def _calls(root: Path) -> list[tuple[str, list[Path | str]]]:
    data, run, rescored = root / "data", root / "run", root / "run" / "rescored.json"
    evidence = run / "evidence"
    return [
        ("apply", [data, data / "detections.json", "--out", rescored, "--evidence", evidence, "--jobs", "1"]),
        ("evaluate", [data, rescored, "--out", run, "--no-report"]),
        ("log", [run, "--jobs", "1"]),
        ("report", [run]),
    ]


_LAUNCHER = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""
"""A process starts with the peak of the one that starts it, so a small one starts the command."""


def measured(command: str, arguments: Sequence[Path | str]) -> tuple[float, float]:
    """Processor seconds and peak megabytes of one command in a process of its own."""
    words = [sys.executable, "-m", "rescore.cli", "--quiet", command, *map(str, arguments)]
    told = subprocess.run(
        [sys.executable, "-c", _LAUNCHER, *words], check=True, capture_output=True, text=True
    )
    seconds, peak_mb = map(float, told.stdout.split())
    return seconds, peak_mb
