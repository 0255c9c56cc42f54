"""Depth evidence: what 15 candidates of a frame cost beside the stereo matcher, and a live loop."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from io import BytesIO

import numpy as np
from PIL import Image

from datasets_synth.objects.object_classes import object_class
from datasets_synth.photos.single_object import Viewpoint, photograph
from recon.camera import default_camera
from recon.reconstruction.reconstruct import Reconstruction, reconstruct
from recon.view_bins import ViewBins
from reports.publishing.bench_file import Row
from rescore import RescoreConfig, Rescorer
from rescore.data.frames import Frame
from rescore.evidence.align_depth import align_depth, measured_depth
from rescore.evidence.candidates import Candidates
from rescore.evidence.instances import assumed_camera
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.parallel import one_thread
from tests.bench.scenes import Pair, across_pairs, class_model, kitti_pairs
from tests.bench.timing import Call, median_s, paired

N = 15
"""Candidates of a frame, as many as a detector may keep."""
SIDE = 3
"""View bin of the left side of a car."""
LIVE_FRAMES = 12
"""Frames of the live loop, the rendered pairs in turn."""


def evidence(frame: Frame, candidates: Candidates, view_bin: int | str = SIDE) -> object:
    """Outlines, parts, depth, eq. 6 and the cues of all candidates."""
    settings = RescoreConfig(view_bin=view_bin)  # type: ignore[arg-type]
    return rescore_frame(frame, candidates, class_model(), Rescoring(settings))


def known_view() -> list[Row]:
    """15 candidates whose view is known, from picture and disparity to the cues, 640 x 480 pixels."""
    what = "evidence of 15 candidates, view known / SGBM, 640 x 480"
    rng = np.random.default_rng(0)

    def pairs() -> Iterator[tuple[Call, Call]]:
        for pair in across_pairs(4):
            candidates = car_sized_boxes(640, 480, rng)
            yield partial(evidence, pair.frame(), candidates), pair.disparity_px

    return [paired(what, 1.0, pairs())]


def known_view_kitti() -> list[Row]:
    """The same at KITTI's size and calibration, against reading the pictures and SGBM."""
    what = "evidence of 15 candidates, view known / reading and SGBM, 1242 x 375"

    def pairs() -> Iterator[tuple[Call, Call]]:
        for pair in kitti_pairs(2):
            yield partial(evidence, pair.frame(), pair.candidates(N, view_known=True)), reading(pair)

    return [paired(what, 0.5, pairs())]


def chosen_view_kitti() -> list[Row]:
    """The same where the class model chooses among its 12 views, against SGBM alone."""
    what = "evidence of 15 candidates, view chosen among 12 / SGBM, 1242 x 375"

    def pairs() -> Iterator[tuple[Call, Call]]:
        for pair in kitti_pairs(2):
            unknown = pair.candidates(N, view_known=False)
            yield partial(evidence, pair.frame(), unknown, "model"), pair.disparity_px

    return [paired(what, 1.5, pairs(), repeats=3)]


def live_loop() -> list[Row]:
    """Pairs in, posteriors and 3D boxes out, all views, by the rescorer that comes with the package."""
    pairs = kitti_pairs(2)
    rescorer = Rescorer.default("car")
    frames = [(pair.stereo, pair.boxes(N)) for pair in pairs]

    def one(i: int) -> None:
        frame, boxes = frames[i % len(frames)]
        found = rescorer.rescore(frame, boxes)
        assert found.boxes3d is not None

    with one_thread(), ThreadPoolExecutor(2) as threads:
        list(threads.map(one, range(len(frames))))
        start = time.perf_counter()
        list(threads.map(one, range(LIVE_FRAMES)))
        took_s = time.perf_counter() - start
    what = "live loop: pair in, posterior and 3D boxes of 15 boxes out, all views, two cores, 1242 x 375"
    return [Row(what, LIVE_FRAMES / took_s, "frames/s", 10.0, at_least=True, clock="wall")]


def all_modes() -> list[Row]:
    """The evidence of all modes for 15 candidates of a frame, against that of eq. 6 alone."""
    rng = np.random.default_rng(0)

    def pairs() -> Iterator[tuple[Call, Call]]:
        for pair in across_pairs(4):
            frame, candidates = pair.frame(), car_sized_boxes(640, 480, rng)
            yield partial(evidence, frame, candidates), partial(eq_6_alone, frame, candidates)

    return [paired("evidence of all modes / of eq. 6 alone", 1.2, pairs())]


def eq_6_alone(frame: Frame, candidates: Candidates) -> None:
    """Predicted depth and its alignment with what is measured."""
    settings = RescoreConfig(view_bin=SIDE)
    seen_from, boxes = assumed_camera(frame, settings.camera), candidates.xyxy_px
    found = reconstruct(frame.left_rgb, boxes, SIDE, class_model(), seen_from, settings.reconstruct)
    measured = measured_depth(frame.disparity_px, frame.camera)
    for one, box in zip(found, boxes, strict=True):
        if isinstance(one, Reconstruction):
            align_depth(one.depth, measured, box, settings.align)


def reconstruction() -> list[Row]:
    """One box of 128 x 64 pixels that shows a car from bin 3, all stages of section 4."""
    cars = object_class("car")
    view = Viewpoint(ViewBins().azimuth_rad(SIDE), cars.elevation_rad)
    shot = photograph(cars, cars.test[0], view, default_camera(200, 120), np.random.default_rng(0))
    middle = (shot.xyxy_px[:2] + shot.xyxy_px[2:]) / 2
    half = np.array([64.0, 32.0])
    box = np.concatenate([middle - half, middle + half])

    def work() -> None:
        (found,) = reconstruct(shot.rgb, box[None], SIDE, class_model(), shot.seen_from)
        assert isinstance(found, Reconstruction), found

    what = "one reconstruction of a 128 x 64 px box, all stages"
    return [Row(what, 1e3 * median_s(work, repeats=20), "ms", 5.0)]


def reading(pair: Pair) -> Call:
    """Unpacking both PNG pictures from memory, and SGBM."""
    packed = []
    for rgb in (pair.left_rgb, pair.right_rgb):
        file = BytesIO()
        Image.fromarray(rgb).save(file, format="png")
        packed.append(file)

    def work() -> None:
        for file in packed:
            np.asarray(Image.open(file))
        pair.disparity_px()

    return work


def car_sized_boxes(width_px: int, height_px: int, rng: np.random.Generator) -> Candidates:
    """Fifteen boxes inside the picture, 60 to 300 px wide, below the horizon: all stages run on each."""
    width = rng.uniform(60, 300, N)
    height = width / 2.8
    left = rng.uniform(0, width_px - width)
    top = height_px / 2 + 20 + rng.uniform(0, 20, N) - height / 2
    boxes = np.stack([left, top, left + width, top + height], axis=1)
    return Candidates(0, boxes, np.linspace(1, 0, N), np.linspace(0.9, 0.1, N))
