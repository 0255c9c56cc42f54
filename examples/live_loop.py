"""A live loop: pictures, depth and boxes come as arrays, and each frame is rescored as it comes.

    python examples/live_loop.py
    python examples/live_loop.py --frames 100 --rescorer rescorer.json

Put your camera and your detector in the place of `camera` and `detect`; here a rendered car stands for them.
`rescorer.json` names models of your own (docs/library.md); without it a class model is learned first.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from datasets_synth.objects.object_classes import labelled_views, object_class
from datasets_synth.photos.single_object import Viewpoint, photograph
from recon import PinholeCamera, ViewBins, learn_class_model
from rescore import Boxes, Camera, Rescorer, StereoFrame

LEFT_SIDE = np.pi / 2
"""Azimuth in radians from which a car shows its left side."""


def camera(n_frames: int) -> Iterator[tuple[StereoFrame, np.ndarray]]:
    """Frames of a camera that measures depth, and the edges of the car in each, which it does not know of."""
    cars = object_class("car")
    lens = PinholeCamera(450.0, 450.0, 199.5, 149.5, 400, 300)
    for i in range(n_frames):
        seen_from = Viewpoint(LEFT_SIDE, elevation_rad=0.08, distance_m=8.0 + 0.5 * i)
        shot = photograph(cars, cars.test[0], seen_from, lens, np.random.default_rng(0))
        calibration = Camera(lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px)
        yield (
            StereoFrame(shot.rgb, depth_m=shot.depth_m, camera=calibration, ground=shot.seen_from.ground),
            shot.xyxy_px,
        )


def detect(car_px: np.ndarray) -> Boxes:
    """What a detector that is not sure might find: the car, and the wall above it."""
    wall_px = car_px - np.array([0, 0.9, 0, 0.9]) * (car_px[3] - car_px[1])
    return Boxes(np.stack([car_px, wall_px]), likelihood=np.array([0.4, 0.4]))


def learned_rescorer() -> Rescorer:
    """A rescorer by eq. 6 with a class model of one car."""
    cars = object_class("car")
    views = labelled_views(cars, cars.train[:1], ViewBins(), size_px=128)
    return Rescorer(learn_class_model(views, "car", views.part_names), w=0.6)


def main() -> None:
    """Run the example."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--frames", type=int, default=3, help="frames to look at")
    options.add_argument("--rescorer", type=Path, help="file that names models of your own")
    chosen = options.parse_args()
    rescorer = Rescorer.from_file(chosen.rescorer) if chosen.rescorer else learned_rescorer()
    for number, (frame, car_px) in enumerate(camera(chosen.frames)):
        boxes = detect(car_px)
        began = time.perf_counter()
        found = rescorer.rescore(frame, boxes)
        took_ms = 1000 * (time.perf_counter() - began)
        scores = " ".join(f"{p:.3f} {s}" for p, s in zip(found.posterior, found.status, strict=True))
        print(f"frame {number}: {scores} ({took_ms:.0f} ms)")


if __name__ == "__main__":
    main()
