"""Small good inputs of every kind of file that the product reads, and what reads them."""

import json
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin

from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.learning.label_files import read_labelled_views
from recon.learning.primitives import PrimitiveLibrary
from recon.part_views import load_part_views, save_part_views
from recon.view_bins import ViewBins
from rescore.cli import main
from rescore.defaults import default_rescorer_file
from rescore.detectors.registry import load_detector
from rescore.doctor import examine_dataset
from rescore.doctor.findings import Level
from rescore.evidence.files import read_evidence, read_fits
from rescore.evidence.model import load_models, save_models
from rescore.experiment.config import run_preset, with_changes
from rescore.experiment.stages import Stage, run_stage
from rescore.files import write_json
from rescore.formats.open import read_dataset
from rescore.formats.uiuc import read_uiuc
from rescore.library.bundles import default_bundle, read_bundle
from rescore.results.run_folder import RunFolder, load_run
from tests.datasets_synth.cars.test_gltf_files import quantised
from tests.rescore import own_data as own
from tests.rescore import ros_bags as bags

Read = Callable[[Path], object]
"""Reads what lies in a folder."""


@dataclass(frozen=True)
class Kind:
    """One kind of file: how a good folder is made, which of its files are damaged, what reads them."""

    name: str
    make: Read
    files: Sequence[str]
    read: Read


def rescore(*arguments: str) -> Read:
    """The command, with {} for the folder; what it writes goes to the sub-folder ``out``."""

    def call(root: Path) -> None:
        sys.argv = ["rescore", *(a.replace("{}", str(root)) for a in arguments)]
        main()

    return call


def doctor() -> Read:
    """What the doctor finds on a data set, without its look at the installation."""

    def call(root: Path) -> None:
        wrong = [str(f) for f in examine_dataset(root, "car", 1) if f.level is Level.ERROR]
        if wrong:
            raise RescoreError(wrong[0])

    return call


def detections(root: Path) -> Path:
    rows = [
        {"image_id": i, "category_id": 1, "bbox": [10 + i, 20, 30, 24], "score": 0.5 + 0.1 * i}
        for i in (1, 2)
    ]
    return own.write_text(root / "detections.json", json.dumps(rows))


def _own(root: Path) -> None:
    own.own_folder(root)
    detections(root)


def _kitti(root: Path) -> None:
    own.kitti_folder(root)
    for name in ("000003", "000007"):
        own.write_text(root / "found" / f"{name}.txt", f"{own.KITTI_CAR} 0.7\n")


def _voc(root: Path) -> None:
    own.pair_folder(root)
    box = "<bndbox><xmin>5</xmin><ymin>6</ymin><xmax>40</xmax><ymax>30</ymax></bndbox>"
    for name in ("a", "b"):
        text = f"<annotation><size><width>96</width><height>64</height></size><object><name>car</name>{box}"
        own.write_text(root / "Annotations" / f"{name}.xml", f"{text}</object></annotation>")


def _yolo(root: Path) -> None:
    own.pair_folder(root)
    own.write_text(root / "data.yaml", "names:\n  0: person\n  1: car\n")
    for name in ("a", "b"):
        own.write_text(root / "labels" / f"{name}.txt", "1 0.5 0.5 0.2 0.3\n0 0.2 0.2 0.1 0.1\n")


def _yolo_names(root: Path) -> None:
    _yolo(root)
    (root / "data.yaml").unlink()
    own.write_text(root / "labels" / "classes.txt", "person\ncar\n")


def _layouts(root: Path) -> None:
    from tests.rescore.formats import test_layouts as layouts  # noqa: PLC0415 (needs pytest)

    layouts.cityscapes(root / "city")
    for file in sorted(root.glob("city/camera/*/*/*.json")):
        place = Path(*file.parts[-3:-1]) / file.name.replace("_camera", "_gtFine_polygons")
        own.write_text(root / "city" / "gtFine" / place, layouts.polygons("car"))
    layouts.virtual_kitti(root / "virtual")
    layouts.argoverse(root / "argo")
    both = [layouts.argoverse_camera("left", 0.25), layouts.argoverse_camera("right", -0.25)]
    own.write_text(root / "argo/log1/vehicle_calibration_info.json", json.dumps({"camera_data_": both}))
    layouts.color_and_depth(root / "open3d", {"intrinsic_matrix": layouts.COLUMNS}, "camera_intrinsic.json")


LAYOUT_FILES = ("city/camera/val/*/*.json", "city/gtFine/val/*/*.json", "virtual/*/15-deg-left/*trinsic.txt")
LAYOUT_FILES += ("argo/log1/vehicle_calibration_info.json", "open3d/camera_intrinsic.json")


def _read_layouts(root: Path) -> None:
    for folder in ("city", "virtual", "argo", "open3d"):
        read_dataset(root / folder)


def _depth(suffix: str) -> Read:
    return lambda root: own.depth_folder(root, suffix, 256 if suffix == ".png" else None)


def _models(root: Path) -> None:
    _own(root)
    bundle = default_bundle("car")
    bundle.class_model.save(root / "model.json")
    save_models(root / "evidence.json", {bundle.evidence_model.registration: bundle.evidence_model})
    shutil.copyfile(str(default_rescorer_file("car")), root / "bundle.gz")


def _predicted(root: Path) -> None:
    _own(root)
    for i in (1, 2):
        (root / "net").mkdir(exist_ok=True)
        np.save(root / "net" / f"{i}.npy", np.linspace(5, 30, own.WIDTH * own.HEIGHT).reshape(own.HEIGHT, -1))
        own.write_png(root / "masks" / f"{i}.png", np.full((own.HEIGHT, own.WIDTH), 255, np.uint8))
    about = {"folder": "net", "as": "inverse", "masks": "masks"}
    own.write_text(root / "net.json", json.dumps(about))


def _tuned(root: Path) -> None:
    _predicted(root)
    value = {
        "detector": "detections",
        "w": 0.5,
        "w_grid": [0.0, 0.5, 1.0],
        "objective": [0.1, 0.3, 0.2],
        "objective_name": "average_precision",
        "n_images": 2,
        "n_cars": 1,
        "registration": "paper",
        "depth_of": "another system (relative inverse depth)",
    }
    own.write_text(root / "tuned.json", json.dumps(value))
    own.write_text(root / "config.json", json.dumps({"rescore": {"stereo": {"num_disparities": 16}}}))


def _uiuc(root: Path) -> None:
    for i in range(3):
        own.write_png(root / "TestImages" / f"test-{i}.pgm", own.pair(i)[0])
    own.write_text(root / "trueLocations.txt", "0: (10,20)\n1: (4,5) (30,8)\n2: (1,1)\n")


def _stage(root: Path) -> None:
    own.write_text(root / "in.txt", "1")
    _run_stage(root)


def _run_stage(root: Path) -> None:
    stage = Stage("work", {"a": 1}, (root / "in.txt",), (root / "out.txt",), ())
    run_stage(root, stage, lambda path: path.write_text("done") and None)


def _run(root: Path) -> None:
    from tests.reports.fake_run import make_run  # noqa: PLC0415 (drawing takes a second to import)

    make_run(root, n_frames=2)
    bundle = default_bundle("car")
    save_models(
        RunFolder(root).evidence_model("hog"), {bundle.evidence_model.registration: bundle.evidence_model}
    )
    bundle.class_model.save(RunFolder(root).class_model)


def _read_models(root: Path) -> None:
    run = load_run(root)
    run.part_names()
    ClassModel.load(run.folder.class_model)
    load_models(run.folder.evidence_model("hog"))


def _show(root: Path) -> None:
    from reports.page.paired_runs import Evaluated  # noqa: PLC0415
    from reports.page.report import render_report  # noqa: PLC0415 (drawing takes a second to import)
    from reports.recording.log import write_recording  # noqa: PLC0415

    render_report([Evaluated("run", load_run(root))])
    write_recording(root, root / "out.rrd", max_frames=1, show=False)


def _read_evidence(root: Path) -> None:
    for path in sorted(root.glob("evidence/*/*.npz")):
        read_evidence(path)
        read_fits(path)


def _detectors(root: Path) -> None:
    from tests.rescore.detectors.test_detector_files import boosted, hog  # noqa: PLC0415 (they are trained)

    hog().save(root / "hog.npz")
    boosted().save(root / "boosted.npz")


def _labels(root: Path) -> None:
    from tests.recon.learning.test_label_files import coco, labelme  # noqa: PLC0415 (needs pytest)

    own.write_text(root / "coco.json", json.dumps(coco()))
    own.write_text(root / "me" / "a.json", json.dumps(labelme(view_bin=3)))
    own.write_text(root / "me" / "labels.txt", "__ignore__\nbody\nwheel\n")
    views = read_labelled_views(root / "coco.json", ViewBins(16))
    save_part_views(root / "views", views.part_views)


def _primitives(root: Path) -> None:
    bins = ViewBins(4)
    transform, residual = np.zeros((2, 4, 4, 3, 3)), np.zeros((2, 4, 4))
    PrimitiveLibrary(bins, np.eye(3)[:2], transform, residual).save(root / "primitives.npz")


def _meshes(root: Path) -> None:
    import trimesh  # noqa: PLC0415 (slow to import)

    box = trimesh.creation.box(extents=(1.8, 1.4, 4.2))
    for name in ("car.obj", "car.glb", "car.ply"):
        folder = root / name.rpartition(".")[2]
        folder.mkdir()
        box.export(folder / name)
    (root / "quantised").mkdir()
    quantised(root / "quantised" / "car.glb")


def _recording(storage: StoragePlugin) -> Read:
    def make(root: Path) -> None:
        found = bags.boxes(bags.START_NS, [("car", 0.5, (30, 30, 20, 10))])
        topics = bags.pictures([0, 100], [0, 100]) | bags.infos() | {"/boxes": [found]}
        bags.write_bag(root / "bag", topics, storage)

    return make


def _read_meshes(root: Path) -> None:
    from datasets_synth.cars.mesh_import import load_meshes  # noqa: PLC0415 (slow to import)

    for folder in sorted(p for p in root.iterdir() if p.is_dir()):
        load_meshes(folder)


def _stored(root: Path) -> None:
    write_json(root / "config.json", {"tune": {"min_iou": 0.5}, "rescore": {}, "learn": {}})


BINS = ViewBins(16)
RUN_FILES = ("metrics.json", "config.json", "candidates.parquet", "data/annotations.json", "evidence/*/*.npz")
RUN_FILES += ("models/*.json",)
PREDICTED = ("apply", "{}", "{}/detections.json", "--predicted", "{}/net.json", "--out", "{}/out/r.json")
PREDICTED += ("--split", "all", "--jobs", "1")
WEIGHT = ("--w", "0.5")
WITH_MODEL = ("apply", "{}", "{}/detections.json", "--out", "{}/out/r.json", "--split", "all")
WITH_MODEL += ("--jobs", "1", "--disparities", "16")
EVALUATE = ("evaluate", "{}", "{}/detections.json", "--out", "{}/out", "--split", "all", "--no-report")
IMPORT_BAG = ("import", "{}/bag", "--out", "{}/out")
CLASS_MODEL = (*WITH_MODEL, "--model", "{}/model.json", "--w", "0.5")

KINDS = (
    Kind("annotations.json", _own, ["annotations.json"], rescore("doctor", "{}")),
    Kind(
        "annotations.json, imported", _own, ["annotations.json"], rescore("import", "{}", "--out", "{}/out")
    ),
    Kind("pictures", _own, ["left/1.png", "right/1.png"], doctor()),
    Kind("detections, COCO", _own, ["detections.json"], rescore(*EVALUATE)),
    Kind("KITTI calibration, labels", _kitti, ["calib/000003.txt", "label_2/000003.txt"], doctor()),
    Kind(
        "detections, KITTI",
        _kitti,
        ["found/000003.txt"],
        rescore("convert", "{}", "{}/found", "--out", "{}/out/r.json"),
    ),
    Kind("calib.yaml", own.pair_folder, ["calib.yaml"], doctor()),
    Kind("calib.txt, Middlebury", lambda r: own.middlebury(r, 2, 6), ["Adirondack/calib.txt"], doctor()),
    Kind("calibrations, boxes of data sets", _layouts, LAYOUT_FILES, _read_layouts),
    Kind("VOC", _voc, ["Annotations/a.xml"], doctor()),
    Kind("YOLO", _yolo, ["labels/a.txt", "data.yaml"], doctor()),
    Kind("YOLO, classes.txt", _yolo_names, ["labels/classes.txt"], doctor()),
    Kind("depth, PNG", _depth(".png"), ["depth/1.png", "calib.yaml"], doctor()),
    Kind("depth, NPY", _depth(".npy"), ["depth/1.npy"], doctor()),
    Kind("depth, PFM", _depth(".pfm"), ["depth/1.pfm"], doctor()),
    Kind(
        "predicted depth", _predicted, ["net.json", "net/1.npy", "masks/1.png"], rescore(*PREDICTED, *WEIGHT)
    ),
    Kind("tuned weight", _tuned, ["tuned.json"], rescore(*PREDICTED, "--tuned", "{}/tuned.json")),
    Kind(
        "settings, applied",
        _tuned,
        ["config.json"],
        rescore(*PREDICTED, *WEIGHT, "--config", "{}/config.json"),
    ),
    Kind(
        "settings",
        _stored,
        ["config.json"],
        lambda root: with_changes(run_preset("paper"), root / "config.json"),
    ),
    Kind("class model", _models, ["model.json"], rescore(*CLASS_MODEL)),
    Kind(
        "evidence model",
        _models,
        ["evidence.json"],
        rescore(*CLASS_MODEL, "--registration", "instance", "--evidence-model", "{}/evidence.json"),
    ),
    Kind("rescorer", _models, ["bundle.gz"], lambda root: read_bundle(root / "bundle.gz")),
    Kind("detector, HOG", _detectors, ["hog.npz"], lambda root: load_detector(root / "hog.npz")),
    Kind("detector, boosted", _detectors, ["boosted.npz"], lambda root: load_detector(root / "boosted.npz")),
    Kind("run, JSON", _run, ["metrics.json", "config.json"], rescore("inspect", "{}", "--only", "all")),
    Kind("run, table", _run, ["candidates.parquet"], rescore("inspect", "{}", "--only", "all")),
    Kind("run, models", _run, ["models/*.json"], _read_models),
    Kind("run, shown", _run, RUN_FILES, _show),
    Kind("evidence files", _run, ["evidence/*/*.npz"], _read_evidence),
    Kind(
        "part labels, COCO",
        _labels,
        ["coco.json"],
        lambda r: read_labelled_views(r / "coco.json", ViewBins(16)),
    ),
    Kind(
        "part labels, LabelMe",
        _labels,
        ["me/a.json", "me/labels.txt"],
        lambda r: read_labelled_views(r / "me", BINS),
    ),
    Kind(
        "part views",
        _labels,
        ["views/part_views.json", "views/*.png"],
        lambda r: load_part_views(r / "views"),
    ),
    Kind("primitives", _primitives, ["*.npz"], lambda r: PrimitiveLibrary.load(r / "primitives.npz")),
    Kind("meshes", _meshes, ["obj/car.obj", "glb/car.glb", "ply/car.ply", "quantised/car.glb"], _read_meshes),
    Kind("recording, MCAP", _recording(StoragePlugin.MCAP), ["bag/*"], rescore(*IMPORT_BAG)),
    Kind("recording, SQLite", _recording(StoragePlugin.SQLITE3), ["bag/*"], rescore(*IMPORT_BAG)),
    Kind("UIUC", _uiuc, ["trueLocations.txt", "TestImages/test-0.pgm"], read_uiuc),
    Kind("stage record", _stage, [".stages/work.json"], _run_stage),
)
"""Every kind of file that the product reads."""
