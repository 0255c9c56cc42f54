"""Local noise of the matcher's disparity on the pairs of data sets, which ``MATCHER_NOISE_PX`` is taken from.

``python -m tests.recon.stereo.matcher_noise FOLDER...`` prints a line a folder.
"""

import sys
from pathlib import Path

import numpy as np

from recon.stereo.depth_noise import local_noise
from rescore.data.frames import load_frame
from rescore.evidence.settings import automatic_stereo
from rescore.formats.open import read_dataset

MOST = 20
"""Frames of a data set that are matched."""


def main(folders: list[str]) -> None:
    """Print least, median and largest noise in pixels over frames of each data set."""
    for folder in folders:
        data = read_dataset(Path(folder), "car")
        frames = data.frames[:: -(-len(data.frames) // MOST)]
        stereo = automatic_stereo(data)
        noise = [local_noise(load_frame(f, stereo).disparity_px) for f in frames]
        low, middle, high = np.percentile(noise, [0, 50, 100])
        print(f"{folder}: {len(frames)} frames, {low:.3f} {middle:.3f} {high:.3f} px")


if __name__ == "__main__":
    main(sys.argv[1:])
