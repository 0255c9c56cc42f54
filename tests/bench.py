"""Speed as ratios against the bare library calls, measured side by side in one run: ``make bench``.

Prints tables; asserts nothing, since a busy machine would fail it. Each ratio is the median of paired runs:
both sides are timed in turn on the same frame, so that a machine that slows down slows both. A second table
has times of what no library call can be compared with. Names of rows as arguments choose some of them.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from datasets_synth.build import build_dataset
from datasets_synth.cars.models import cars_of_splits
from datasets_synth.objects.object_classes import Shape, labelled_views, object_class
from datasets_synth.photos.single_object import Viewpoint, photograph
from datasets_synth.presets import SynthConfig
from datasets_synth.render.render import render_pair
from datasets_synth.render.scene_rays import RayTree
from datasets_synth.render.truth import visible_objects
from datasets_synth.street.frame_synth import synth_frame
from recon.camera import default_camera
from recon.class_model import ClassModel
from recon.errors import Failure
from recon.learning.generic_phase import learn_primitives, primitive_library
from recon.learning.learn import learn_class_model
from recon.part_views import load_part_views
from recon.reconstruction.reconstruct import Reconstruction, reconstruct
from recon.stereo.sgbm import compute_disparity
from recon.view_bins import ViewBins
from rescore.data.frames import DataSet, Frame, load_frame
from rescore.data.pictures import read_rgb
from rescore.detectors.hog_svm import HogDetector
from rescore.detectors.registry import train_detector
from rescore.evidence.align_depth import align_depth, measured_depth
from rescore.evidence.candidates import Candidates
from rescore.evidence.instances import assumed_camera
from rescore.experiment.config import RunConfig, run_preset
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.grasping.act import execute
from rescore.grasping.cars import experiment_cars, solid_of
from rescore.grasping.choose import Estimate
from rescore.grasping.hands import HANDS
from rescore.grasping.judge import judge
from rescore.grasping.plan import Motion
from rescore.grasping.solids import Solid
from rescore.grasping.trial import grasp_and_judge, placed_car, planned
from rescore.metrics.bootstrap import BootstrapConfig, bootstrap
from rescore.metrics.curves import Summary, summarise
from rescore.metrics.matching import FALSE_ALARM, HIT, MatchTable, greedy_match
from rescore.parallel import one_thread
from rescore.studies.localization.learned import TableClassConfig, learn_table_class
from rescore.studies.localization.segment import segment_table
from rescore.studies.localization.trials import TrialConfig, empty_table, fit_region
from tests.coco_boxes import coco_average_precision, coco_sets, random_boxes

SCENES = 4
REPEATS = 5


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    what: str
    ours_s: float
    bare_s: float
    ratio: float
    limit: float


@dataclass(frozen=True)
class Timed:
    """One line of the second table."""

    what: str
    seconds: float
    clock: str
    """"processor" time of one core, which a busy machine changes little, or "wall" time."""
    limit_s: float


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def paired(
    what: str, limit: float, pairs: Iterator[tuple[Callable[[], object], Callable[[], object]]]
) -> Row:
    """Medians of both sides, run in turn on each pair after one warm-up, and the median of the ratios."""
    ours: list[float] = []
    bare: list[float] = []
    for our_call, bare_call in pairs:
        our_call()
        bare_call()
        for _ in range(REPEATS):
            ours.append(seconds(our_call))
            bare.append(seconds(bare_call))
    ratio = statistics.median(a / b for a, b in zip(ours, bare, strict=True))
    return Row(what, statistics.median(ours), statistics.median(bare), ratio, limit)


def rendering(config: SynthConfig) -> Row:
    """A stereo pair with truth and measured disparity, against its ray casts and its SGBM alone."""

    def pairs() -> Iterator[tuple[Callable[[], object], Callable[[], object]]]:
        cars = cars_of_splits()["test"]
        for i in range(SCENES):
            scene = synth_frame(config, 11, "test", i, n_cars=1, cars=cars, pictures=()).scene
            first = render_pair(scene, np.random.default_rng(0))

            def ours(scene=scene) -> None:  # type: ignore[no-untyped-def]
                pair = render_pair(scene, np.random.default_rng(0))
                visible_objects(pair, scene)
                compute_disparity(pair.left_rgb, pair.right_rgb, config.sgbm)

            casts = recorded_casts(ours)

            def bare(casts=casts, first=first) -> None:  # type: ignore[no-untyped-def]
                for cast in casts:
                    cast()
                compute_disparity(first.left_rgb, first.right_rgb, config.sgbm)

            yield ours, bare

    return paired("render a stereo pair / ray casts + SGBM", 4.0, pairs())


def recorded_casts(work: Callable[[], object]) -> list[Callable[[], object]]:
    """The bare Open3D call of every ray cast that ``work`` makes, its rays ready."""
    import open3d as o3d  # noqa: PLC0415

    calls: list[Callable[[], object]] = []
    cast, occluded = RayTree.cast, RayTree.occluded

    def tensor(rays):  # type: ignore[no-untyped-def]
        return o3d.core.Tensor.from_numpy(np.ascontiguousarray(rays, dtype=np.float32))

    def note_cast(self, rays):  # type: ignore[no-untyped-def]
        if self.n_faces and len(rays):
            calls.append(partial(self._scene.cast_rays, tensor(rays), nthreads=1))
        return cast(self, rays)

    def note_occluded(self, rays, t_far=np.inf):  # type: ignore[no-untyped-def]
        if self.n_faces and len(rays):
            calls.append(partial(self._scene.test_occlusions, tensor(rays), tfar=t_far, nthreads=1))
        return occluded(self, rays, t_far)

    RayTree.cast, RayTree.occluded = note_cast, note_occluded  # type: ignore[method-assign]
    try:
        work()
    finally:
        RayTree.cast, RayTree.occluded = cast, occluded  # type: ignore[method-assign]
    return calls


def detection(data: DataSet, config: RunConfig) -> list[Row]:
    """HOG against the bare detectMultiScale call with the same windows; boosted against HOG."""
    hog = train_detector("hog", data, config.detector_settings["hog"], 0, 2)
    boosted = train_detector("boosted", data, config.detector_settings["boosted"], 0, 2)
    assert isinstance(hog, HogDetector)
    pictures = [read_rgb(f.left_path, f.width_px, f.height_px) for f in data.split("test").frames[:SCENES]]

    def bare_calls() -> Iterator[tuple[Callable[[], object], Callable[[], object]]]:
        for rgb in pictures:
            zoomed, _ = hog.zoomed(rgb)
            descriptor, arguments = hog.descriptor(), hog.scan_arguments()

            def bare(z=zoomed, d=descriptor, a=arguments) -> None:  # type: ignore[no-untyped-def]
                # as many threads as the detector: with more, OpenCV mixes up scores
                with one_thread():
                    d.detectMultiScale(z, **a)

            yield lambda rgb=rgb: hog.detect(rgb), bare

    against_hog = ((lambda r=rgb: boosted.detect(r), lambda r=rgb: hog.detect(r)) for rgb in pictures)
    return [
        paired("HOG detection / bare detectMultiScale", 1.3, bare_calls()),
        paired("boosted detection / HOG detection", 5.0, against_hog),
    ]


def learned(data: DataSet, config: RunConfig) -> ClassModel:
    """The class model of a data set's part-labelled views."""
    views = load_part_views(data.root / "part_views")
    return learn_class_model(views, config.class_name, views.part_names, config.learn)


def rescoring(data: DataSet, config: RunConfig) -> Row:
    """15 candidates of a frame, from picture and disparity to D, against one 5-path SGBM of the frame."""
    model = learned(data, config)
    rng = np.random.default_rng(0)

    def pairs() -> Iterator[tuple[Callable[[], object], Callable[[], object]]]:
        for record in data.split("test").frames[:SCENES]:
            frame = load_frame(record, config.synth.sgbm)
            assert record.right_path is not None
            right = read_rgb(record.right_path, record.width_px, record.height_px)
            candidates = car_sized_boxes(record.image_id, record.width_px, record.height_px, rng)
            yield (
                lambda f=frame, c=candidates: rescore_frame(f, c, model, Rescoring(config.rescore)),
                lambda f=frame, r=right: compute_disparity(f.left_rgb, r, config.synth.sgbm),
            )

    return paired("rescore 15 candidates / SGBM of the frame", 6.0, pairs())


def modes(data: DataSet, config: RunConfig) -> Row:
    """The evidence of all modes for 15 candidates of a frame, against that of eq. 6 alone."""
    model = learned(data, config)
    rng = np.random.default_rng(0)
    settings = config.rescore

    def eq_6_alone(frame: Frame, candidates: Candidates) -> None:
        seen_from = assumed_camera(frame, settings.camera)
        boxes = candidates.xyxy_px
        found = reconstruct(frame.left_rgb, boxes, settings.view_bin, model, seen_from, settings.reconstruct)
        measured = measured_depth(frame.disparity_px, frame.camera)
        for one, box in zip(found, boxes, strict=True):
            if isinstance(one, Reconstruction):
                align_depth(one.depth, measured, box, settings.align)

    def pairs() -> Iterator[tuple[Callable[[], object], Callable[[], object]]]:
        for record in data.split("test").frames[:SCENES]:
            frame = load_frame(record, config.synth.sgbm)
            candidates = car_sized_boxes(record.image_id, record.width_px, record.height_px, rng)
            yield (
                lambda f=frame, c=candidates: rescore_frame(f, c, model, Rescoring(settings)),
                lambda f=frame, c=candidates: eq_6_alone(f, c),
            )

    return paired("evidence of all modes / of eq. 6 alone", 1.2, pairs())


def car_sized_boxes(image_id: int, width_px: int, height_px: int, rng: np.random.Generator) -> Candidates:
    """Fifteen boxes inside the picture, 60 to 300 px wide, below the horizon: all stages run on each."""
    width = rng.uniform(60, 300, 15)
    height = width / 2.8
    left = rng.uniform(0, width_px - width)
    top = height_px / 2 + 20 + rng.uniform(0, 20, 15) - height / 2
    boxes = np.stack([left, top, left + width, top + height], axis=1)
    return Candidates(image_id, boxes, np.linspace(1, 0, 15), np.linspace(0.9, 0.1, 15))


def evaluation() -> tuple[list[Row], list[Timed]]:
    """Matching and all curves of 5,000 images of 15 candidates, against faster-coco-eval on the same boxes.

    faster-coco-eval gets its data structures ready-made, one overlap and one range of sizes.
    """
    boxes = random_boxes(np.random.default_rng(0), 5000, 15, n_levels=1_000_000)
    truth, found = coco_sets(boxes)

    def ours() -> Summary:
        return summarise(greedy_match(boxes.image_id, boxes.xyxy_px, boxes.score, boxes.truth))

    row = paired(
        "evaluate 5000 x 15 candidates / faster-coco-eval",
        1.0,
        iter([(ours, lambda: coco_average_precision(truth, found))]),
    )
    start = time.process_time()
    ours()
    what = "evaluate 5000 images of 15 candidates, all curves"
    return [row], [Timed(what, time.process_time() - start, "processor", 1.0)]


def resampling() -> list[Timed]:
    """All intervals of two tables of 109 images of 15 candidates."""
    rng = np.random.default_rng(0)
    image = np.repeat(np.arange(109), 15)
    outcome = np.where(rng.random(len(image)) < 0.07, HIT, FALSE_ALARM).astype(np.int8)
    cars = np.bincount(image[outcome == HIT], minlength=109)
    before, after = (
        MatchTable(109, int(cars.sum()), image, rng.random(len(image)), outcome, image) for _ in range(2)
    )
    start = time.process_time()
    bootstrap({"before": before, "after": after}, cars, [("before", "after")], rng, BootstrapConfig())
    what = "2000 paired resamples of two tables of 1635 candidates, all figures"
    return [Timed(what, time.process_time() - start, "processor", 2.0)]


def side_model() -> ClassModel:
    """A car model of view bin 3."""
    views = labelled_views(object_class("car"), learning_cars(), ViewBins(), 96)
    side = tuple(v for v in views.views if v.view_bin in (2, 3, 4))
    return learn_class_model(replace(views, views=side), "car", views.part_names)


def learning_cars() -> Sequence[Shape]:
    """Six train cars, evenly chosen."""
    cars = object_class("car").train
    return cars[:: len(cars) // 6][:6]


def reconstruction() -> list[Timed]:
    """One box of 128 x 64 pixels that shows a car from bin 3, all stages of section 4."""
    cars = object_class("car")
    camera = default_camera(200, 120)
    view = Viewpoint(ViewBins().azimuth_rad(3), cars.elevation_rad)
    shot = photograph(cars, cars.test[0], view, camera, np.random.default_rng(0))
    middle = (shot.xyxy_px[:2] + shot.xyxy_px[2:]) / 2
    half = np.array([64.0, 32.0])
    box = np.concatenate([middle - half, middle + half])
    model = side_model()

    def work() -> None:
        (found,) = reconstruct(shot.rgb, box[None], 3, model, shot.seen_from)
        assert isinstance(found, Reconstruction), found

    work()
    times = []
    for _ in range(20):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    what = "one reconstruction of a 128 x 64 px box, all stages"
    return [Timed(what, statistics.median(times), "processor", 0.04)]


def grasping() -> list[Timed]:
    """One trial without rendering, and what precedes it: the joint fit to a picture, and the plan."""
    car = experiment_cars(8, "validation")[1]
    placed, solid, hand = placed_car(car, 1, 0, 0), solid_of(car), HANDS["three_fingers"]
    assert isinstance(solid, Solid)
    estimate = Estimate(placed.placement.box)
    table_class = learn_table_class(cars_of_splits()["train"][::4], TableClassConfig(heading_pictures=0), 2)
    config = TrialConfig()
    segment_table(placed.rgb, empty_table(config.segment))

    def perceived_and_planned() -> Motion:
        with one_thread():
            regions = segment_table(placed.rgb, empty_table(config.segment))
            assert not isinstance(regions, Failure)
            fit = fit_region(placed.rgb, regions[0], table_class, config)
            assert not isinstance(fit, Failure)
        motion = planned(Estimate(fit.box), hand, 0)
        assert isinstance(motion, Motion)
        return motion

    perceived_and_planned()
    grasp_and_judge(estimate, hand, solid, placed.placement.box, 0)
    times: dict[str, list[float]] = {"fit": [], "trial": []}
    for _ in range(REPEATS):
        start = time.process_time()
        motion = perceived_and_planned()
        middle = time.process_time()
        judge(execute(motion, hand, solid, placed.placement.box), solid)
        times["fit"].append(middle - start)
        times["trial"].append(time.process_time() - middle)
    return [
        Timed(
            "a grasp in the engine, approach to put down", statistics.median(times["trial"]), "processor", 0.3
        ),
        Timed(
            "segmentation, joint fit and plan of a grasp", statistics.median(times["fit"]), "processor", 1.5
        ),
    ]


def learning() -> list[Timed]:
    """The car model of all view bins; the library of primitives is that of the package."""
    primitive_library(ViewBins())
    views = labelled_views(object_class("car"), learning_cars(), ViewBins(), 160)
    start = time.process_time()
    learn_class_model(views, "car", views.part_names)
    what = "learn the car model (6 instances, 12 views), generic phase cached"
    return [Timed(what, time.process_time() - start, "processor", 20)]


def generic() -> list[Timed]:
    """The generic phase of one view space."""
    return [Timed("generic phase", seconds(lambda: learn_primitives(ViewBins(), jobs=2)), "wall", 180)]


def measured(chosen: Sequence[str]) -> tuple[list[Row], list[Timed]]:
    """The rows that were asked for, all where none was."""
    config = run_preset("demo")
    rows: list[Row] = []
    times: list[Timed] = []
    wanted = [name for name in ROWS if not chosen or name in chosen]
    if "rendering" in wanted:
        rows.append(rendering(config.synth))
    if {"detection", "rescoring", "modes"} & set(wanted):
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder) / "data"
            build_dataset(config.synth, root, seed=0, jobs=2)
            data = read_dataset(root, config.class_name)
            if "detection" in wanted:
                rows += detection(data, config)
            if "rescoring" in wanted:
                rows.append(rescoring(data, config))
            if "modes" in wanted:
                rows.append(modes(data, config))
    if "evaluation" in wanted:
        more_rows, more_times = evaluation()
        rows, times = rows + more_rows, times + more_times
    for name, work in (
        ("bootstrap", resampling),
        ("reconstruction", reconstruction),
        ("grasping", grasping),
        ("learning", learning),
        ("generic", generic),
    ):
        if name in wanted:
            times += work()
    return rows, times


ROWS = (
    "rendering",
    "detection",
    "rescoring",
    "modes",
    "evaluation",
    "bootstrap",
    "reconstruction",
    "grasping",
    "learning",
    "generic",
)


def main() -> None:
    """Print the tables."""
    unknown = [name for name in sys.argv[1:] if name not in ROWS]
    if unknown:
        sys.exit(f"bench: expected rows among {', '.join(ROWS)}, got {', '.join(unknown)}; choose from these")
    rows, times = measured(sys.argv[1:])
    if rows:
        table = Table(title="Ratios against the bare library calls")
        for name in ("what", "ours, ms", "bare, ms", "ratio", "wanted"):
            table.add_column(name, justify="left" if name == "what" else "right")
        for row in rows:
            ours, bare = f"{row.ours_s * 1e3:.0f}", f"{row.bare_s * 1e3:.0f}"
            table.add_row(row.what, ours, bare, f"{row.ratio:.2f}", f"<= {row.limit:g}")
        Console().print(table)
    if times:
        table = Table(title="Times")
        for name in ("what", "s", "clock", "wanted, s"):
            table.add_column(name, justify="left" if name == "what" else "right")
        for timed in times:
            table.add_row(timed.what, f"{timed.seconds:.3f}", timed.clock, f"<= {timed.limit_s:g}")
        Console().print(table)


if __name__ == "__main__":
    main()
