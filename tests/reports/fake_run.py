"""A small run folder whose depths are known in closed form, so that pictures and files can be checked."""

import json
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from recon.boxes import xywh_from_xyxy
from recon.camera import GroundPlane, PinholeCamera, StereoCamera
from recon.depth_map import DepthMap
from recon.errors import Failure
from recon.reconstruction.reconstruct import Reconstruction
from recon.stereo.sgbm import SgbmConfig, write_disparity
from rescore.data.frames import DataSet, load_frame
from rescore.evidence.align_depth import AlignConfig, align_depth, measured_depth
from rescore.evidence.candidates import NUMBERS
from rescore.evidence.files import evidence_path, write_evidence
from rescore.files import write_json
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.fuse import fuse
from rescore.fusion.weight_interval import WeightInterval, WeightUncertainty, describe
from rescore.metrics.bootstrap import BootstrapConfig
from rescore.metrics.curves import summarise
from rescore.metrics.matching import HIT, OUTCOMES, TruthTable, greedy_match, ranking_of
from rescore.metrics.reliability import reliability
from rescore.results.candidate_file import ALONE
from rescore.results.comparisons import certainty
from rescore.results.metrics_file import (
    DetectorTuning,
    DisparityErrors,
    FusionRow,
    Metrics,
    ModeComparison,
    ReliabilityRow,
    Row,
    StereoStatistics,
    TunedWeight,
    write_metrics,
)
from rescore.results.run_config_file import RunConfigFile, RunSettings
from rescore.results.run_folder import RunFolder, boxes_px

WIDTH, HEIGHT = 320, 240
CAMERA = StereoCamera(PinholeCamera(300.0, 300.0, 159.5, 119.5, WIDTH, HEIGHT), 0.25)
GROUND = GroundPlane(1.4, 0.05)
WEIGHTS = {"hog": 0.6, "boosted": 0.5}
CAR_H_M, CAR_L_M = 1.5, 4.2


def ground_depth() -> np.ndarray:
    """Depth (h, w) of an endless ground; NaN above 40 m and over the horizon."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    z = GROUND.intersect(CAMERA.left.rays(np.stack([u, v], -1)))[..., 2]
    return np.where(z < 40, z, np.nan)


def car_box(z_m: float, x_m: float) -> np.ndarray:
    """Box of a car seen from its side whose near side stands at depth z_m, its middle at x_m."""
    foot = (GROUND.height_m - z_m * np.sin(GROUND.pitch_rad)) / np.cos(GROUND.pitch_rad)
    corners = np.array([[x_m - CAR_L_M / 2, foot - CAR_H_M, z_m], [x_m + CAR_L_M / 2, foot, z_m]])
    return np.round(CAMERA.left.project(corners) + 0.5).ravel()


def car_shape(h: int, w: int) -> tuple[np.ndarray, np.ndarray]:
    """Relative depth in [0, 1] and part labels (h, w) of a car-like relief: a cabin set back over a body."""
    y, x = np.mgrid[:h, :w]
    y, x = (y + 0.5) / h, (x + 0.5) / w
    cabin = (y < 0.45) & (np.abs(x - 0.52) < 0.3 - 0.2 * (0.45 - y))
    body = (y >= 0.45) & (y < 0.85)
    wheels = (np.hypot((x - 0.2) * 2.8, y - 0.8) < 0.2) | (np.hypot((x - 0.8) * 2.8, y - 0.8) < 0.2)
    labels = np.zeros((h, w), np.uint8)
    labels[cabin], labels[body] = 9, 8
    labels[wheels & (x < 0.5)], labels[wheels & (x >= 0.5)] = 12, 13
    relief = np.where(labels == 9, 0.6 * (0.45 - y) / 0.45 + 0.4, 0.15 * x)
    return np.where(labels > 0, relief, np.nan).astype(np.float32), labels


def predicted(box: np.ndarray) -> tuple[DepthMap, np.ndarray]:
    """The prediction in a box: the car's relief, in units of its own."""
    x0, y0, x1, y1 = box.astype(int)
    relief, labels = car_shape(y1 - y0, x1 - x0)
    inside = slice(max(-y0, 0), HEIGHT - y0), slice(max(-x0, 0), WIDTH - x0)
    depth = (3 + 2 * relief[inside]).astype(np.float32)
    return DepthMap(int(max(x0, 0)), int(max(y0, 0)), depth), labels[inside]


def make_dataset(root: Path, n_frames: int, rng: np.random.Generator) -> dict[int, list[np.ndarray]]:
    """Write annotations.json, pictures and disparities; car boxes by image. The last image has no car."""
    (root / "left").mkdir(parents=True)
    (root / "disparity").mkdir()
    images, annotations, cars = [], [], {}
    for i in range(n_frames):
        depth, rgb = ground_depth(), _street(rng)
        cars[i + 1] = []
        for x in (-2.6, 2.8)[: 0 if i == n_frames - 1 else 1 + i % 2]:
            box = car_box(float(rng.uniform(7, 12)), x)
            cars[i + 1].append(box)
            _paint(depth, rgb, box, rng)
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": i + 1,
                    "category_id": 1,
                    "bbox": xywh_from_xyxy(box)[0].tolist(),
                }
            )
        cv2.imwrite(str(root / "left" / f"{i}.png"), rgb[..., ::-1])
        depth[60:200, 40:44] = np.nan
        write_disparity(root / "disparity" / f"{i}.png", CAMERA.disparity_px(depth))
        c = CAMERA.left
        camera = {"fx": c.fx_px, "fy": c.fy_px, "cx": c.cx_px, "cy": c.cy_px, "baseline_m": CAMERA.baseline_m}
        camera |= {"height_m": GROUND.height_m, "pitch_rad": GROUND.pitch_rad}
        images.append(
            {
                "id": i + 1,
                "file_name": f"left/{i}.png",
                "disparity_file_name": f"disparity/{i}.png",
                "width": WIDTH,
                "height": HEIGHT,
                "split": "test",
                "camera": camera,
            }
        )
    value = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "car"}]}
    (root / "annotations.json").write_text(json.dumps(value))
    return cars


def _street(rng: np.random.Generator) -> np.ndarray:
    rgb = np.full((HEIGHT, WIDTH, 3), (150, 180, 215), np.uint8)
    rgb[np.isfinite(ground_depth())] = (110, 108, 105)
    return np.clip(rgb + rng.normal(0, 6, rgb.shape), 0, 255).astype(np.uint8)


def _paint(depth: np.ndarray, rgb: np.ndarray, box: np.ndarray, rng: np.random.Generator) -> None:
    x0, y0, x1, y1 = box.astype(int)
    relief, labels = car_shape(y1 - y0, x1 - x0)
    rows = slice(max(y0, 0), min(y1, HEIGHT)), slice(max(x0, 0), min(x1, WIDTH))
    cut = slice(rows[0].start - y0, rows[0].stop - y0), slice(rows[1].start - x0, rows[1].stop - x0)
    near = CAMERA.left.fy_px * CAR_H_M / (y1 - y0)
    seen = labels[cut] > 0
    depth[rows][seen] = near + 1.2 * relief[cut][seen]
    paint = rng.integers(40, 220, 3)
    rgb[rows][seen] = np.where(labels[cut][seen][:, None] == 8, paint, (35, 38, 45))


def make_run(root: Path, n_frames: int = 5, seed: int = 3) -> Path:
    """Write a whole run folder without its pictures."""
    rng = np.random.default_rng(seed)
    cars = make_dataset(root / "data", n_frames, rng)
    data = read_dataset(root / "data").split("test")
    truth = TruthTable.of(data)
    tables: list[pa.Table] = []
    rows: list[Row] = []
    comparisons: list[ModeComparison] = []
    fusion: list[FusionRow] = []
    scores: list[ReliabilityRow] = []
    for detector, w in WEIGHTS.items():
        table = _detector_rows(root, detector, cars, data, rng)
        posterior = fuse(table["likelihood"], table["depth_difference"], w)
        matches = {}
        for mode, value in ((ALONE, table["likelihood"]), ("paper", posterior)):
            ranking = ranking_of(value, table["detector_score"])
            match = matches[mode] = greedy_match(table["image_id"], boxes_px(table), ranking, truth)
            scores.append(
                ReliabilityRow.of(detector, mode, reliability(value, match.outcome == HIT, n_bins=4))
            )
            table[f"outcome_{mode}"] = np.array([str(OUTCOMES[o]) for o in match.outcome], object)
            table[f"annotation_id_{mode}"] = match.annotation_id
        sure = certainty(
            detector, matches, table["kind"], truth.cars_of_image, seed, BootstrapConfig(n_resamples=100)
        )
        comparisons += sure.comparisons
        found = {mode: summarise(match) for mode, match in matches.items()}
        rows.append(Row.of(detector, ALONE, 1.0, found[ALONE], sure.intervals[ALONE]))
        rows.append(Row.of(detector, "paper", w, found["paper"], sure.intervals["paper"]))
        for rule in (ALONE, "depth", "product", "maximum", "eq7", "learned"):
            figures = found[ALONE if rule == ALONE else "paper"]
            fusion.append(FusionRow.of(detector, "paper", rule, figures))
        table["posterior_paper"], table["w"] = posterior, np.full(len(posterior), w)
        tables.append(pa.table(table))
    folder = RunFolder(root)
    everything = pa.concat_tables(tables)
    pq.write_table(everything, folder.candidates)
    on_cars = DisparityErrors(density=0.93, end_point_error_px=1.25, wrong_share=0.18)
    elsewhere = on_cars.model_copy(update={"wrong_share": 0.07})
    metrics = Metrics(
        n_images=truth.n_images,
        n_cars=truth.n_cars,
        n_candidates=everything.num_rows,
        rows=tuple(rows),
        comparisons=tuple(comparisons),
        fusion=tuple(fusion),
        reliability=tuple(scores),
        stereo=StereoStatistics(splits={"test": {"car": on_cars, "elsewhere": elsewhere}}),
        tuning={d: DetectorTuning.first_of({"paper": _tuning(w)}) for d, w in WEIGHTS.items()},
    )
    write_metrics(folder.metrics, metrics)
    config = RunConfigFile(seed=seed, config=RunSettings(preset="fake"), versions={"rescore": "0.1.0"})
    write_json(folder.config, config.as_json())
    return root


def _tuning(w: float) -> TunedWeight:
    grid = np.linspace(0, 1, 21)
    separable = np.abs(grid - w) > 0.36
    uncertainty = WeightUncertainty(w, w - 0.25, w + 0.25, 0.02, (w - 0.2, w + 0.2), separable, 100, 0)
    return TunedWeight(
        w=w,
        objective_name="average_precision",
        w_grid=tuple(grid.tolist()),
        objective=(None, *(0.7 - 0.3 * (grid[1:] - w) ** 2).tolist()),
        uncertainty=WeightInterval.of(uncertainty),
        sentence=describe(grid, w, uncertainty),
    )


def _detector_rows(
    root: Path, detector: str, cars: dict[int, list[np.ndarray]], data: DataSet, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Candidates of one detector: its cars, a duplicate, and false alarms on the road."""
    columns: dict[str, list[object]] = {}
    for record in data.frames:
        frame = load_frame(record, SgbmConfig())
        measured = measured_depth(frame.disparity_px, frame.camera)
        boxes = [*cars[record.image_id], *(car_box(z, x) for z, x in ((6.0, 0.3), (15.0, -3.0), (20.0, 5.0)))]
        boxes += [b + 3 for b in cars[record.image_id][:1]]
        score = np.sort(rng.normal(0, 1.5, len(boxes)))[::-1]
        order = rng.permutation(len(boxes))
        found: list[Reconstruction | Failure] = []
        for rank, (s, which) in enumerate(zip(score, order, strict=True)):
            box = boxes[which]
            depth, labels = predicted(box)
            solved = align_depth(depth, measured, box, AlignConfig())
            failed = isinstance(solved, Failure)
            found.append(_instance(box, depth, labels))
            row = {
                "detector": detector,
                "image_id": record.image_id,
                "rank": rank,
                "x0": box[0],
                "y0": box[1],
                "x1": box[2],
                "y1": box[3],
                "detector_score": s,
                "likelihood": 1 / (1 + np.exp(-s)),
                "status": solved.reason.value if failed else "ok",
                "reason_detail": solved.detail if failed else "",
                "kind": "car" if which < len(cars[record.image_id]) else "wall",
            }
            for name in NUMBERS:
                row[name] = np.nan if failed else getattr(solved, name.removeprefix("depth_"))
            for name, value in row.items():
                columns.setdefault(name, []).append(value)
        write_evidence(evidence_path(root / "evidence" / detector, record.image_id), found)
    return {
        name: np.array(values, object if isinstance(values[0], str) else None)
        for name, values in columns.items()
    }


def _instance(box: np.ndarray, depth: DepthMap, labels: np.ndarray) -> Reconstruction:
    x0, y0, x1, y1 = box
    outline = np.array([[x0, y0], [x1 - 1, y0], [x1 - 1, y1 - 1], [x0, y1 - 1]])
    planes = {int(i): np.array([0.0, 0.0, 1.0, -3.0]) for i in np.unique(labels[labels > 0])}
    return Reconstruction(
        outline_px=outline,
        initial_outline_px=outline,
        x0_px=depth.x0_px,
        y0_px=depth.y0_px,
        part_labels=labels,
        part_planes=planes,
        unplaced_parts={},
        depth=depth,
        ground_line_px=outline[[3, 2]],
        cam_from_object=np.eye(3),
        registration_cost=0.1,
        placed_share=1.0,
    )
