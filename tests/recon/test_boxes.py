import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from recon.boxes import iou_matrix, suppress, xywh_from_xyxy, xyxy_from_xywh

corner_size = arrays(
    np.float64, st.tuples(st.integers(1, 25), st.just(4)), elements=st.integers(1, 40).map(float)
)


@given(corner_size)
def test_box_conversions_undo_each_other(xywh):
    assert xywh_from_xyxy(xyxy_from_xywh(xywh)) == pytest.approx(xywh)


def test_iou_by_hand():
    a = np.array([[0.0, 0, 4, 2]])
    b = np.array([[2.0, 0, 6, 2], [0, 0, 4, 2], [4, 0, 8, 2], [1, 1, 1, 1]])
    # overlap 2 x 2 = 4 of 8 + 8 - 4 = 12; the same box; boxes that touch; an empty box
    assert iou_matrix(a, b)[0] == pytest.approx([4 / 12, 1, 0, 0])


@given(corner_size, corner_size)
def test_iou_is_symmetric_and_at_most_one(a_xywh, b_xywh):
    a, b = xyxy_from_xywh(a_xywh), xyxy_from_xywh(b_xywh)
    iou = iou_matrix(a, b)
    assert iou == pytest.approx(iou_matrix(b, a).T)
    assert (iou >= 0).all()
    assert (iou <= 1).all()
    assert np.diag(iou_matrix(a, a)) == pytest.approx(1.0)


def brute_force_suppress(boxes, score, max_iou):
    left, kept = sorted(range(len(score)), key=lambda i: (-score[i], i)), []
    while left:
        best = left.pop(0)
        kept.append(best)
        left = [i for i in left if iou_matrix(boxes[best], boxes[i])[0, 0] <= max_iou]
    return kept


@given(corner_size, st.floats(0, 1), st.data())
def test_suppress_equals_a_plain_loop_and_keeps_no_overlap(xywh, max_iou, data):
    boxes = xyxy_from_xywh(xywh)
    score = np.array(data.draw(st.lists(st.integers(0, 4), min_size=len(boxes), max_size=len(boxes))), float)
    keep = suppress(boxes, score, max_iou)
    assert keep.tolist() == brute_force_suppress(boxes, score, max_iou)
    overlap = iou_matrix(boxes[keep], boxes[keep])
    np.fill_diagonal(overlap, 0)
    assert overlap.max() <= max_iou
    dropped = np.setdiff1d(np.arange(len(boxes)), keep)
    for i in dropped:  # each dropped box has a kept one, at least as good, that overlaps it by more
        better = keep[score[keep] >= score[i]]
        assert iou_matrix(boxes[i], boxes[better]).max() > max_iou
    assert suppress(boxes, score, max_iou, 2).tolist() == keep[:2].tolist()


def test_suppress_of_nothing():
    assert suppress(np.empty((0, 4)), np.empty(0), 0.5).shape == (0,)
