"""Random boxes for one image set, as truth and detections, and what faster-coco-eval makes of them."""

from dataclasses import dataclass

import numpy as np
from faster_coco_eval import COCO, COCOeval_faster

from recon.arrays import FloatArray, IntArray
from recon.boxes import xywh_from_xyxy
from rescore.metrics.matching import TruthTable


@dataclass(frozen=True, eq=False)
class Boxes:
    """Detections of a set of images, in the order of the images."""

    truth: TruthTable
    image_id: IntArray
    xyxy_px: FloatArray
    score: FloatArray


def random_boxes(
    rng: np.random.Generator, n_images: int, per_image: int, n_levels: int, ignored: float = 0.2
) -> Boxes:
    """Up to three cars an image, the detections half of them near cars; ``n_levels`` distinct scores."""
    car_image = np.repeat(np.arange(n_images), rng.integers(0, 4, n_images))
    corner = rng.uniform(0, 60, (len(car_image), 2))
    cars = np.concatenate([corner, corner + rng.uniform(15, 40, (len(car_image), 2))], axis=1)
    ignore = rng.random(len(car_image)) < ignored
    truth = TruthTable(np.arange(n_images) + 1, car_image, np.arange(len(car_image)) + 1, cars, ignore)
    image = np.repeat(np.arange(n_images), per_image)
    corner = rng.uniform(0, 70, (len(image), 2))
    boxes = np.concatenate([corner, corner + rng.uniform(10, 40, (len(image), 2))], axis=1)
    if len(cars):
        first = np.searchsorted(car_image, image)
        count = np.searchsorted(car_image, image, side="right") - first
        near = (count > 0) & (rng.random(len(image)) < 0.5)
        chosen = (first + rng.integers(0, np.maximum(count, 1)))[near]
        boxes[near] = cars[chosen] + rng.normal(0, 3, (len(chosen), 4))
    score = rng.integers(1, n_levels + 1, len(image)) / n_levels
    return Boxes(truth, image + 1, boxes, score)


def coco_sets(boxes: Boxes) -> tuple[COCO, COCO]:
    """Truth and detections as COCO reads them; ignored cars are its crowds."""
    t = boxes.truth
    cars = [
        {
            "id": int(a),
            "image_id": int(t.image_id[i]),
            "category_id": 1,
            "bbox": xywh,
            "area": xywh[2] * xywh[3],
            "iscrowd": int(ignore),
        }
        for a, i, xywh, ignore in zip(
            t.annotation_id, t.car_image, xywh_from_xyxy(t.xyxy_px).tolist(), t.ignore, strict=True
        )
    ]
    images = [{"id": int(i), "width": 120, "height": 120} for i in t.image_id]
    truth = COCO({"images": images, "annotations": cars, "categories": [{"id": 1, "name": "car"}]})
    rows = zip(
        boxes.image_id.tolist(), xywh_from_xyxy(boxes.xyxy_px).tolist(), boxes.score.tolist(), strict=True
    )
    found = [{"image_id": i, "category_id": 1, "bbox": b, "score": s} for i, b, s in rows]
    return truth, truth.loadRes(found)


def coco_average_precision(truth: COCO, found: COCO) -> float:
    """COCO's average precision at IoU 0.5, all sizes, all detections; -1 where no car counts."""
    run = COCOeval_faster(truth, found, "bbox")
    run.params.iouThrs = np.array([0.5])
    run.params.areaRng, run.params.areaRngLbl = [[0, 1e10]], ["all"]
    run.params.maxDets = [10_000]
    run.evaluate()
    run.accumulate()
    precision = np.asarray(run.eval["precision"])[0, :, 0, 0, 0]
    return float(precision.mean())
