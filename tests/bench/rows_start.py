"""Starting: the first answer of the command, and importing the library."""

import statistics
import subprocess
import sys
import time

from reports.publishing.bench_file import Row

REPEATS = 7
LIBRARY = "from rescore import Boxes, Camera, GroundPlane, Rescorer, StereoFrame"
"""As docs/library.md begins."""


def starting() -> list[Row]:
    """Wall time of a fresh process, the median of several whose files are in memory."""
    return [
        Row(
            "`rescore --help`, first answer", _median_s("-m", "rescore.cli", "--help"), "s", 0.3, clock="wall"
        ),
        Row(f"`{LIBRARY}`", _median_s("-c", LIBRARY), "s", 0.7, clock="wall"),
    ]


def _median_s(*arguments: str) -> float:
    times = []
    for _ in range(REPEATS + 1):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])
