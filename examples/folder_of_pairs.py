"""A folder of stereo pairs and a detector's boxes: the boxes with new scores.

    python examples/folder_of_pairs.py --out rescored.json
    python examples/folder_of_pairs.py --out rescored.json --data DATA --boxes boxes.json --model car.json

DATA holds `annotations.json` in COCO's form, whose images name `file_name`, `right_file_name` and `camera`
(docs/own-data.md). The boxes are a COCO results file: `image_id`, `bbox` (left, top, width, height), and
`score` in [0, 1]. Without them a small data set is rendered, with boxes on its cars and beside them.
`rescore evaluate DATA rescored.json --out run` then draws curves. (`rescore apply` does all this by itself.)
"""

import argparse
import json
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from datasets_synth.build import build_dataset
from datasets_synth.presets import SplitSize, synth_preset
from recon import ClassModel, learn_class_model, load_part_views
from rescore import Boxes, Camera, GroundPlane, Rescorer, StereoFrame

Rows = list[dict[str, Any]]


def rendered_input(folder: Path) -> tuple[Path, Path, Path]:
    """Data set, boxes and class model, made in a folder."""
    data = folder / "data"
    config = replace(synth_preset("tiny"), splits={"test": SplitSize(n_images=2, n_cars=3)})
    annotations = json.loads(build_dataset(config, data, seed=0).read_text())
    rng = np.random.default_rng(0)
    rows: Rows = []
    for car in annotations["annotations"]:
        shaken = np.asarray(car["bbox"]) * (1 + rng.uniform(-0.03, 0.03, 4))
        beside = shaken + np.array([rng.choice([-1, 1]) * 1.2 * shaken[2], 0, 0, 0])
        for bbox in (shaken, beside):
            rows.append({"image_id": car["image_id"], "category_id": 1, "bbox": bbox.tolist(), "score": 0.5})
    (folder / "boxes.json").write_text(json.dumps(rows))
    views = load_part_views(data / "part_views")
    learn_class_model(views, "car", views.part_names).save(folder / "car.json")
    return data, folder / "boxes.json", folder / "car.json"


def frame_of(image: dict[str, Any], data: Path) -> StereoFrame:
    """One pair with its calibration."""
    known = image["camera"]
    camera = Camera(**{name: known[name] for name in ("fx", "fy", "cx", "cy", "baseline_m")})
    # where the ground is not stated it is taken from the disparity
    stated = "height_m" in known
    ground = (
        GroundPlane(known["height_m"], known.get("pitch_rad", 0.0), known.get("roll_rad", 0.0))
        if stated
        else None
    )
    left, right = (
        np.asarray(Image.open(data / image[name]).convert("RGB")) for name in ("file_name", "right_file_name")
    )
    return StereoFrame(left, right_rgb=right, camera=camera, ground=ground)


def rescored(rescorer: Rescorer, frame: StereoFrame, rows: Rows) -> Rows:
    """The boxes of one frame, with the posterior as score and what depth said of them."""
    left, top, width, height = np.array([row["bbox"] for row in rows], float).T
    boxes = Boxes(
        np.stack([left, top, left + width, top + height], axis=1),
        likelihood=np.array([row["score"] for row in rows], float),
    )
    found = rescorer.rescore(frame, boxes)
    said = zip(rows, found.posterior.tolist(), found.status, strict=True)
    return [
        row | {"score": posterior, "detector_score": row["score"], "status": status}
        for row, posterior, status in said
    ]


def main() -> None:
    """Run the example."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--out", type=Path, required=True, help="rescored boxes, COCO results")
    options.add_argument("--data", type=Path, help="folder with annotations.json")
    options.add_argument("--boxes", type=Path, help="COCO results of a detector")
    options.add_argument("--model", type=Path, help="class model of `rescore learn`")
    options.add_argument(
        "--w", type=float, default=0.6, help="weight of the detector; `rescore tune` finds it"
    )
    chosen = options.parse_args()
    if chosen.data is None:
        chosen.data, chosen.boxes, chosen.model = rendered_input(chosen.out.parent)
    rescorer = Rescorer(ClassModel.load(chosen.model), w=chosen.w)
    by_image: dict[int, Rows] = defaultdict(list)
    for row in json.loads(chosen.boxes.read_text()):
        by_image[row["image_id"]].append(row)
    images = json.loads((chosen.data / "annotations.json").read_text())["images"]
    out: Rows = []
    for image in images:
        rows = by_image[image["id"]]
        if rows:
            out += rescored(rescorer, frame_of(image, chosen.data), rows)
    chosen.out.write_text(json.dumps(out, indent=1) + "\n")
    compared = sum(row["status"] == "ok" for row in out)
    print(f"{len(out)} boxes of {len(images)} pairs, {compared} compared with depth: {chosen.out}")


if __name__ == "__main__":
    main()
