"""Builds a rendered data set on disk, frame by frame, and resumes a build that was stopped."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets_synth.cars.models import TRAINING_CARS, ImportedModel, cars_of_splits, part_labelled_cars
from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.mesh import Scene
from datasets_synth.objects.object_classes import labelled_views, object_class
from datasets_synth.presets import SynthConfig
from datasets_synth.street.along import truth as along_truth
from datasets_synth.street.car_pictures import car_picture
from datasets_synth.street.frame_synth import (
    SynthFrame,
    annotation_record,
    camera_record,
    car_schedule,
    synth_frame,
)
from recon.arrays import Float32Array, UInt8Array
from recon.errors import RescoreError
from recon.files import atomic_path
from recon.part_views import save_part_views
from recon.stereo.accuracy import DisparityError, disparity_error
from recon.stereo.sgbm import (
    SgbmConfig,
    compute_disparity,
    disparities_to_reach,
    read_disparity,
    write_disparity,
)
from recon.view_bins import ViewBins
from rescore.data.frames import SPLITS
from rescore.data.pictures import is_whole_png_file
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.files import read_json, write_json
from rescore.parallel import one_thread, track
from rescore.speech import say

RECORDS = "records"
PICTURES = "pictures"
PART_VIEWS = "part_views"
_PICTURE_STREAM = 2_000_000
_KINDS = ("left", "right", "disparity", "truth", "instance")
"""Folders of the pictures of a frame."""
_RECORD_KEYS = {"key", "attempts", "image", "annotations", "stereo"}
CATEGORY = {"id": 1, "name": "car", "supercategory": "vehicle"}


@dataclass(frozen=True)
class _Build:
    """What all frames of a data set need to be built."""

    out: Path
    config: SynthConfig
    seed: int
    cars: dict[str, tuple[CarModel, ...]]
    """By split."""
    key: str
    picture_paths: dict[str, tuple[Path, ...]]
    """By split."""

    def task(self, split: str, index: int, n_cars: int | None) -> "_Task":
        """One frame."""
        cars, paths = self.cars[split], self.picture_paths[split]
        return _Task(self.out, self.config, self.seed, split, index, n_cars, cars, self.key, paths)


@dataclass(frozen=True)
class _Task:
    """What one frame needs to be built."""

    out: Path
    config: SynthConfig
    seed: int
    split: str
    index: int
    n_cars: int | None
    cars: tuple[CarModel, ...]
    key: str
    picture_paths: tuple[Path, ...]

    @property
    def name(self) -> str:
        return f"{self.split}_{self.index:04d}"

    @property
    def files(self) -> dict[str, Path]:
        """Pictures of the frame by what they show."""
        return {kind: self.out / kind / f"{self.name}.png" for kind in _KINDS}

    @property
    def record_path(self) -> Path:
        return self.out / RECORDS / f"{self.name}.json"


def build_dataset(
    config: SynthConfig,
    out: Path,
    seed: int = 0,
    jobs: Workers = 1,
    *,
    train_meshes: Path | None = None,
    test_meshes: Path | None = None,
) -> Path:
    """Write a rendered data set; returns the path of its ``annotations.json``, which is written last.

    Frames that a stopped build with the same settings has finished are kept. The same settings and seed
    give the same bytes, whatever the number of jobs.

    Args:
        config: What to render.
        out: Folder of the data set.
        seed: Of every random choice.
        jobs: Frames at a time.
        train_meshes: Folder of a user's own cars for the split "train".
        test_meshes: The same for the split "test".

    Raises:
        RescoreError: A mesh cannot be used, the folder cannot be written, or a street cannot be found.
    """
    cars = {s: tuple(m) for s, m in cars_of_splits(train_meshes, test_meshes).items()}
    key = _key(config, seed, cars)
    for folder in (*_KINDS, RECORDS, PICTURES):
        _make_folder(out / folder)
    (out / "annotations.json").unlink(missing_ok=True)
    paths = _write_pictures(config, out, seed, cars, key=key, jobs=jobs)
    labelled, labels_from = part_labelled_cars(cars["train"])
    if labels_from != TRAINING_CARS:
        say(f"part-labelled views: of {labels_from}")
    _write_part_views(config, out, labelled)
    build = _Build(out, config, seed, cars, key, paths)
    frames = [
        (split, index, n)
        for split, size in config.splits.items()
        for index, n in enumerate(car_schedule(size, seed, split))
    ]
    tasks = [build.task(*frame) for frame in frames]
    todo = [frame for frame, task in zip(frames, tasks, strict=True) if not _is_done(task)]
    built = map_frames(_build_frame, todo, build, jobs, ordered=False)
    for _ in track(built, "render frames", len(tasks), done=len(tasks) - len(todo)):
        pass
    records = [read_json(task.record_path, "a frame record") for task in tasks]
    return _finish(out, config, seed, records, labels_from)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RescoreError(
            f"{folder}: expected a folder to write to, got {error.strerror!r}; choose another place"
        ) from error


def _key(config: SynthConfig, seed: int, cars: dict[str, tuple[CarModel, ...]]) -> str:
    """Digest of everything that decides the bytes of a frame, apart from the code."""
    shapes = {
        split: [(c.shape_id, c.size_m, c.digest if isinstance(c, ImportedModel) else "") for c in models]
        for split, models in cars.items()
    }
    text = json.dumps([asdict(config), seed, shapes], sort_keys=True, default=float)
    return hashlib.sha256(text.encode()).hexdigest()


def _is_done(task: _Task) -> bool:
    """Whether a frame has a record of these settings, and all its pictures are whole."""
    record = _kept(task.record_path)
    if not isinstance(record, dict) or record.get("key") != task.key or not record.keys() >= _RECORD_KEYS:
        return False
    return all(is_whole_png_file(path) for path in task.files.values())


def _kept(path: Path) -> Any:
    """What a stopped build noted in a file; None where it is missing or damaged, so that it is made again."""
    try:
        return read_json(path, "a record of a build")
    except RescoreError:
        return None


def _build_frame(frame: tuple[str, int, int | None], build: _Build) -> None:
    """Render, measure and write one frame; its record comes last."""
    with one_thread():
        _build_frame_alone(build.task(*frame))


def _build_frame_alone(task: _Task) -> None:
    pictures = tuple(_picture(path, path.stat().st_mtime_ns) for path in task.picture_paths)
    frame = synth_frame(
        task.config, task.seed, task.split, task.index, n_cars=task.n_cars, cars=task.cars, pictures=pictures
    )
    render = frame.render
    measured = compute_disparity(render.left_rgb, render.right_rgb, _matcher(task.config, frame.scene))
    truth = frame.scene.camera.disparity_px(render.depth_m)
    files = task.files
    names = {kind: path.relative_to(task.out).as_posix() for kind, path in files.items()}
    _write_png(files["left"], render.left_rgb[..., ::-1])
    _write_png(files["right"], render.right_rgb[..., ::-1])
    _write_png(files["instance"], render.instance)
    write_disparity(files["disparity"], measured)
    write_disparity(files["truth"], truth)
    height, width = truth.shape
    # what is read back is what users get, so the error is that of the file
    stored = read_disparity(files["disparity"], width, height)
    write_json(task.record_path, _record(task, frame, names, stored, truth))


def _matcher(config: SynthConfig, scene: Scene) -> SgbmConfig:
    """The settings of the matcher; along a street rigs differ, and so does the range that each searches."""
    if config.layout == "across":
        return config.sgbm
    reach = disparities_to_reach(scene.camera, config.along.nearest_m)
    return replace(config.sgbm, num_disparities=reach)


def _record(
    task: _Task,
    frame: SynthFrame,
    names: dict[str, str],
    measured: Float32Array,
    truth: Float32Array,
) -> dict[str, Any]:
    height, width = truth.shape
    items = frame.scene.items
    car_ids = [i + 1 for i, item in enumerate(items) if item.kind == "car"]
    on_car = np.isin(frame.render.instance, car_ids)
    present = np.unique(frame.render.instance)
    return {
        "key": task.key,
        "attempts": frame.attempts,
        "image": {
            "file_name": names["left"],
            "right_file_name": names["right"],
            "disparity_file_name": names["disparity"],
            "truth_disparity_file_name": names["truth"],
            "instance_file_name": names["instance"],
            "width": width,
            "height": height,
            "split": task.split,
            **_seen_from(frame),
            "instances": [{"id": int(i), "kind": items[i - 1].kind} for i in present if i > 0],
        },
        "annotations": _annotations(task, frame),
        "stereo": {
            "car": _error_sums(disparity_error(measured, truth, on_car)),
            "elsewhere": _error_sums(disparity_error(measured, truth, ~on_car)),
        },
    }


def _seen_from(frame: SynthFrame) -> dict[str, Any]:
    """What an image record says of the camera and of the ground before it."""
    street = frame.along
    if street is None:
        return {"camera": camera_record(frame.scene)}
    stated = street.ground if street.states_ground else None
    return {
        "camera": along_truth.camera_record(street.scene, stated),
        "rig": street.rig,
        "ground_truth": along_truth.ground_record(street.ground),
    }


def _annotations(task: _Task, frame: SynthFrame) -> list[Mapping[str, Any]]:
    if task.config.layout == "across":
        return [annotation_record(car, task.config.cars) for car in frame.cars]
    sizes = {model.shape_id: model.size_m for model in task.cars}
    return [along_truth.annotation(v, frame.scene, sizes, task.config.along) for v in frame.cars]


def _error_sums(error: DisparityError) -> dict[str, float]:
    """Sums over pixels, which add up over frames."""
    return {
        "n_truth": error.n_truth,
        "n_measured": error.n_measured,
        "abs_error_px": error.absolute_error_px,
        "wrong_measured": error.n_wrong_measured,
        "wrong_filled": error.n_wrong_filled,
    }


def _finish(
    out: Path, config: SynthConfig, seed: int, records: Sequence[dict[str, Any]], labels_from: str
) -> Path:
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for image_id, record in enumerate(records, start=1):
        images.append({"id": image_id, **record["image"]})
        for annotation in record["annotations"]:
            row = {
                "id": len(annotations) + 1,
                "image_id": image_id,
                "category_id": CATEGORY["id"],
                **annotation,
            }
            annotations.append(row)
    write_json(out / "stereo.json", _stereo_statistics(config, records))
    settings = {"seed": seed, "part_views_of": labels_from, "config": asdict(config)}
    write_json(out / "synth_config.json", settings)
    path = out / "annotations.json"
    info = {"description": "rendered stereo street scenes", "seed": seed}
    write_json(path, {"info": info, "images": images, "annotations": annotations, "categories": [CATEGORY]})
    return path


def _stereo_statistics(config: SynthConfig, records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Errors of the measured disparity by split and region."""
    out: dict[str, Any] = {
        "wrong": "off by more than 3 px and 5 % of the truth (KITTI D1); wrong_share counts every pixel with "
        "truth, holes filled from the background; wrong_share_measured counts measured pixels",
        "sgbm": asdict(config.sgbm),
        "splits": {},
    }
    for split in (*config.splits, "all"):
        chosen = [r for r in records if split in ("all", r["image"]["split"])]
        out["splits"][split] = {
            region: _statistics([r["stereo"][region] for r in chosen]) for region in ("car", "elsewhere")
        }
    return out


def _statistics(sums: Sequence[dict[str, float]]) -> dict[str, float | None]:
    total = {name: float(sum(s[name] for s in sums)) for name in sums[0]}
    n, m = total["n_truth"], total["n_measured"]
    return {
        "n_pixels": n,
        "density": m / n if n else None,
        "end_point_error_px": total["abs_error_px"] / m if m else None,
        "wrong_share": total["wrong_filled"] / n if n else None,
        "wrong_share_measured": total["wrong_measured"] / m if m else None,
    }


def _write_png(path: Path, picture: NDArray[Any]) -> None:
    done, encoded = cv2.imencode(".png", picture)
    if not done:
        raise RescoreError(f"{path}: could not encode a picture of shape {picture.shape}")
    with atomic_path(path) as beside:
        beside.write_bytes(encoded.tobytes())


@lru_cache(maxsize=64)
def _picture(path: Path, _modified_ns: int) -> UInt8Array:
    """A picture for posters; kept per process."""
    bgr = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise RescoreError(
            f"{path}: expected a PNG of a car, could not decode it; delete the folder and build again"
        )
    return np.ascontiguousarray(bgr[..., ::-1])


def _write_pictures(
    config: SynthConfig,
    out: Path,
    seed: int,
    cars: dict[str, tuple[CarModel, ...]],
    *,
    key: str,
    jobs: Workers,
) -> dict[str, tuple[Path, ...]]:
    """Render the pictures of cars that posters show, each split its own cars."""
    paths = {
        s: tuple(out / PICTURES / f"{s}_{k:02d}.png" for k in range(config.n_pictures)) for s in config.splits
    }
    stamp = out / PICTURES / "key.json"
    if _kept(stamp) == key and all(is_whole_png_file(path) for own in paths.values() for path in own):
        return paths
    tasks = [
        (path, cars[s], [seed, SPLITS.index(s), _PICTURE_STREAM, k])
        for s in paths
        for k, path in enumerate(paths[s])
    ]
    rendered = map_frames(_render_picture, tasks, None, jobs, ordered=False)
    for _ in track(rendered, "render posters", len(tasks)):
        pass
    write_json(stamp, key)
    return paths


def _render_picture(task: tuple[Path, tuple[CarModel, ...], list[int]], _shared: None) -> None:
    path, cars, stream = task
    _write_png(path, car_picture(cars, np.random.default_rng(stream))[..., ::-1])


def _write_part_views(config: SynthConfig, out: Path, cars: Sequence[CarModel]) -> None:
    """Part-labelled views of shapes in every view bin; the first is a sedan, where there is one."""
    chosen = _instances_to_label(cars, config.part_views.n_instances)
    views = labelled_views(object_class("car"), chosen, ViewBins(), config.part_views.size_px)
    save_part_views(out / PART_VIEWS, views)


def _instances_to_label(cars: Sequence[CarModel], count: int) -> list[CarModel]:
    """A sedan first, then others spread over the list, which goes by body type."""
    sedans = [c for c in cars if "sedan" in c.shape_id]
    first = sedans[:1] or list(cars[:1])
    others = [c for c in cars if c is not first[0]]
    step = max(1, len(others) // max(1, count - 1))
    return first + others[::step][: count - 1]
