"""Made-up tables in parts of any size, to measure with: frames with cars, and candidates rescored in a mode.

All cues and 3D boxes are filled, as `rescore apply` fills them: a candidate takes half a kilobyte. Run it to
measure `rescore evaluate` on a million frames:

    python -m tests.rescore.large_tables FOLDER 1000000
"""

import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from rescore.cli import app
from rescore.data.boxes3d import BOX_NAMES
from rescore.formats.parts.forms import CANDIDATE_SCHEMA, FRAME_SCHEMA, FRAMES, RESCORED
from rescore.formats.parts.table import Part, PartTable, write_part

FRAMES_A_PART = 250
CANDIDATES_A_FRAME = 15
CARS_A_FRAME = 3
LOW, HIGH = np.array([0.0, 0, 40, 40]), np.array([560.0, 400, 80, 80])
"""Limits of left, top, width and height of a box."""
LOW_3D, HIGH_3D = (
    np.array([-8.0, 0.8, 5, 3.5, 1.5, 1.3, -np.pi]),
    np.array([8.0, 1.2, 40, 4.8, 2, 1.8, np.pi]),
)
"""Limits of the numbers of a 3D box."""
SPREAD_3D = np.array([0.2, 0.05, 0.4, 0.2, 0.08, 0.08, 0.15])
"""By how much the 3D box of a candidate on a car is off."""
BOXES3D = [f"box3d_{name}" for name in BOX_NAMES]
CAMERA = {"fx": 700.0, "fy": 700.0, "cx": 320.0, "cy": 240.0, "baseline_m": 0.5, "height_m": 1.65}
CAMERA |= {"pitch_rad": 0.0, "roll_rad": 0.0}


def write_tables(root: Path, n_frames: int, seed: int) -> tuple[PartTable, PartTable]:
    """The frames, and the candidates in mode instance, of so many frames."""
    rng = np.random.default_rng(seed)
    frames, rescored = [], []
    for first in range(0, n_frames, FRAMES_A_PART):
        ids = np.arange(first, min(first + FRAMES_A_PART, n_frames))
        name = f"{first // FRAMES_A_PART:06d}"
        cars = rng.uniform(LOW, HIGH, (len(ids), CARS_A_FRAME, 4))
        cars[..., 2:] += cars[..., :2]
        solid = rng.uniform(LOW_3D, HIGH_3D, (len(ids), CARS_A_FRAME, 7))
        size = write_part(root / "data", name, [_frames(ids, cars, solid)])
        frames.append(Part(name=name, rows=len(ids), bytes=size, frames=len(ids)))
        groups = _candidates(ids, cars, solid, rng)
        size = write_part(root / "rescored", name, groups)
        rescored.append(Part(name=name, rows=len(groups[1]), bytes=size, frames=len(ids)))
    data = PartTable(root / "data", FRAMES, {"class": "car", "category_id": 1, "renamed": {}}, tuple(frames))
    about = {"detector": "hog", "registration": "instance", "w": 0.5}
    found = PartTable(root / "rescored", RESCORED, about, tuple(rescored))
    data.write()
    found.write()
    return data, found


def _frames(ids: Any, cars: Any, solid: Any) -> pa.Table:
    corners = cars.reshape(-1, 4)
    n = len(corners)
    numbers = np.repeat(ids, CARS_A_FRAME) * CARS_A_FRAME + np.tile(np.arange(CARS_A_FRAME), len(ids))
    schema = FRAME_SCHEMA
    fields = list(schema.field("objects").type.value_type)
    known = dict(zip(("x0", "y0", "x1", "y1"), corners.T, strict=True)) | {
        "annotation_id": numbers,
        "ignore": np.zeros(n, np.bool_),
        "truncated": numbers % 8 / 10.0,
        "occluded": numbers % 3,
        **dict(zip(BOXES3D, solid.reshape(-1, 7).T, strict=True)),
    }
    rows = pa.StructArray.from_arrays(
        [pa.array(known[f.name], f.type) if f.name in known else pa.nulls(n, f.type) for f in fields],
        fields=fields,
    )
    listed = pa.ListArray.from_arrays(pa.array(np.arange(0, n + 1, CARS_A_FRAME), pa.int32()), rows)
    columns = {
        "image_id": pa.array(ids),
        "split": pa.array(["test"] * len(ids)),
        "width_px": pa.array([640] * len(ids), pa.int64()),
        "height_px": pa.array([480] * len(ids), pa.int64()),
        "left_file": pa.array([f"left/street_{i // 1000}/{i:08d}.png" for i in ids]),
        "objects": listed,
        **{name: pa.array([value] * len(ids), pa.float64()) for name, value in CAMERA.items()},
    }
    return pa.table([columns.get(f.name, pa.nulls(len(ids), f.type)) for f in schema], schema=schema)


def _candidates(ids: Any, cars: Any, solid: Any, rng: np.random.Generator) -> tuple[pa.Table, pa.Table]:
    shape = (len(ids), CANDIDATES_A_FRAME)
    boxes = rng.uniform(LOW, HIGH, (*shape, 4))
    boxes[..., 2:] += boxes[..., :2]
    boxes[:, :CARS_A_FRAME] = cars + rng.normal(0, 4, cars.shape)
    on_car = np.zeros(shape, np.bool_)
    on_car[:, :CARS_A_FRAME] = True
    likelihood = 1 / (1 + np.exp(-rng.normal(np.where(on_car, 0.5, -1.5), 1.2)))
    # single precision makes some ties
    likelihood = likelihood.astype(np.float16).astype(float)
    difference = 1 / (1 + np.exp(-rng.normal(np.where(on_car, -1.5, 1.0), 1.0)))
    order = np.argsort(-likelihood, axis=1, kind="stable")
    boxes = np.take_along_axis(boxes, order[..., None], axis=1).reshape(-1, 4)
    boxes3d = rng.uniform(LOW_3D, HIGH_3D, (*shape, 7))
    boxes3d[:, :CARS_A_FRAME] = solid + rng.normal(0, SPREAD_3D, solid.shape)
    # some have none
    boxes3d[rng.random(shape) < 0.1] = np.nan
    boxes3d = np.take_along_axis(boxes3d, order[..., None], axis=1).reshape(-1, 7)
    likelihood, difference = (np.take_along_axis(v, order, axis=1).ravel() for v in (likelihood, difference))
    n = len(likelihood)
    known: dict[str, Any] = {
        "image_id": np.repeat(ids, CANDIDATES_A_FRAME),
        "rank": np.tile(np.arange(CANDIDATES_A_FRAME), len(ids)),
        **dict(zip(("x0", "y0", "x1", "y1"), boxes.T, strict=True)),
        "detector_score": likelihood,
        "likelihood": likelihood,
        "posterior": np.exp(0.5 * np.log(likelihood) + 0.5 * np.log1p(-difference)),
        "depth_difference": difference,
        "status": np.full(n, "ok", object),
        **dict.fromkeys(("reason_detail", "ground", "view_bin", "second_view"), np.full(n, "", object)),
    }
    filled = [f.name for f in CANDIDATE_SCHEMA if f.name not in known and pa.types.is_floating(f.type)]
    known |= dict(zip(filled, np.abs(rng.standard_normal((len(filled), n))), strict=True))
    known |= dict(zip(BOXES3D, boxes3d.T, strict=True))
    for name in (f"box3d_sd_{name}" for name in BOX_NAMES):
        known[name] = np.where(np.isnan(boxes3d[:, 0]), np.nan, known[name])
    rows = [
        pa.array(known[f.name], f.type, from_pandas=True) if f.name in known else pa.nulls(n, f.type)
        for f in CANDIDATE_SCHEMA
    ]
    frames = pa.table(
        [
            pa.array(ids)
            if f.name == "image_id"
            else pa.array(["ok"] * len(ids))
            if f.name == "status"
            else pa.array([""] * len(ids))
            if f.name == "reason_detail"
            else pa.nulls(len(ids), f.type)
            for f in CANDIDATE_SCHEMA
        ],
        schema=CANDIDATE_SCHEMA,
    )
    return frames, pa.table(rows, schema=CANDIDATE_SCHEMA)


def _main(folder: str, n_frames: str) -> None:
    root = Path(folder)
    if not (root / "rescored" / "parts.json").is_file():
        write_tables(root, int(n_frames), 0)
    began, before = time.time(), time.process_time()
    app(
        ["evaluate", f"{root}/data", f"{root}/rescored", "--out", f"{root}/run", "--no-report"],
        standalone_mode=False,
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    spent, took = time.process_time() - before, time.time() - began
    print(f"{n_frames} frames: {took:.0f} s, {spent:.0f} s of processor, {peak:.0f} MB")


if __name__ == "__main__":
    _main(*sys.argv[1:])
