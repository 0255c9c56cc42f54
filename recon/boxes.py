"""Boxes: ``xyxy_px`` arrays (n, 4) of left, top, right, bottom pixel edges (see recon.camera)."""

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray


def xyxy_from_xywh(xywh_px: FloatArray) -> FloatArray:
    """COCO boxes (n, 4) of left, top, width, height to edges (n, 4)."""
    boxes = np.asarray(xywh_px, dtype=float).reshape(-1, 4)
    return np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)


def xywh_from_xyxy(xyxy_px: FloatArray) -> FloatArray:
    """Edges (n, 4) to COCO boxes (n, 4)."""
    boxes = np.asarray(xyxy_px, dtype=float).reshape(-1, 4)
    return np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)


def iou_matrix(a_xyxy_px: FloatArray, b_xyxy_px: FloatArray) -> FloatArray:
    """Intersection over union of every a with every b, shape (n, m), in [0, 1]; 0 where both are empty."""
    a = np.asarray(a_xyxy_px, dtype=float).reshape(-1, 4)
    b = np.asarray(b_xyxy_px, dtype=float).reshape(-1, 4)
    return paired_overlap(a[:, None, :], b[None, :, :])[0]


def paired_overlap(a_xyxy_px: FloatArray, b_xyxy_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Intersection over union, and intersection over the area of a, of boxes (..., 4) that broadcast.

    Both in [0, 1]; 0 where the area below the line is 0.
    """
    low = np.maximum(a_xyxy_px[..., :2], b_xyxy_px[..., :2])
    high = np.minimum(a_xyxy_px[..., 2:], b_xyxy_px[..., 2:])
    inter = _area(np.maximum(high - low, 0))
    area_a = _area(a_xyxy_px[..., 2:] - a_xyxy_px[..., :2])
    area_b = _area(b_xyxy_px[..., 2:] - b_xyxy_px[..., :2])
    union = area_a + area_b - inter
    area_a = np.broadcast_to(area_a, inter.shape)
    iou = np.divide(inter, union, out=np.zeros_like(inter), where=union > 0)
    share = np.divide(inter, area_a, out=np.zeros_like(inter), where=area_a > 0)
    return iou, share


def _area(size_px: FloatArray) -> FloatArray:
    # of two numbers, np.prod is slower by far
    return np.asarray(size_px[..., 0] * size_px[..., 1])


def suppress(
    xyxy_px: FloatArray, score: FloatArray, max_iou: float, max_count: int | None = None
) -> NDArray[np.intp]:
    """Indices kept by greedy non-maximum suppression, best first.

    Ties keep the earlier index, so the result does not depend on the sorting algorithm.
    """
    order = np.argsort(-score, kind="stable")
    boxes = np.asarray(xyxy_px, dtype=float).reshape(-1, 4)[order]
    alive = np.ones(len(order), dtype=bool)
    keep: list[int] = []
    for i in range(len(order)):
        if not alive[i]:
            continue
        keep.append(i)
        if max_count is not None and len(keep) == max_count:
            break
        alive[i + 1 :] &= iou_matrix(boxes[i], boxes[i + 1 :])[0] <= max_iou
    return order[np.array(keep, dtype=np.intp)]
