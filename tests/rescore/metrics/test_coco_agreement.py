"""The second implementation of matching and average precision is COCO's own rule in another program."""

import numpy as np
import pytest

from rescore.metrics.curves import average_precision
from rescore.metrics.matching import DUPLICATE, HIT, IGNORED, greedy_match, ranking_of
from tests.coco_boxes import coco_average_precision, coco_sets, random_boxes


def test_average_precision_equals_faster_coco_eval_on_200_random_sets() -> None:
    seen = {"undefined": 0, "no detections": 0, "tied": 0, HIT: 0, DUPLICATE: 0, IGNORED: 0}
    for seed in range(200):
        rng = np.random.default_rng(seed)
        n_images, per_image = int(rng.integers(1, 9)), int(rng.integers(0, 9)) if seed % 10 else 0
        boxes = random_boxes(rng, n_images, per_image, n_levels=int(rng.choice([3, 20, 100_000])))
        match = greedy_match(boxes.image_id, boxes.xyxy_px, boxes.score, boxes.truth)
        ours, theirs = average_precision(match), coco_average_precision(*coco_sets(boxes))
        if not match.n_cars:
            seen["undefined"] += 1
            assert (np.isnan(ours), theirs) == (True, -1)
        else:
            assert ours == pytest.approx(theirs, abs=1e-12), seed
        seen["no detections"] += not len(boxes.score)
        seen["tied"] += len(np.unique(boxes.score)) < len(boxes.score)
        for outcome in (HIT, DUPLICATE, IGNORED):
            seen[outcome] += bool((match.outcome == outcome).any())
    # the sets are what they should be
    assert seen["undefined"] >= 3
    assert min(v for k, v in seen.items() if k != "undefined") >= 20


def test_average_precision_by_posterior_and_score_equals_faster_coco_eval_by_rank() -> None:
    boxes = random_boxes(np.random.default_rng(0), 40, 15, n_levels=5)
    tie_break = np.random.default_rng(1).normal(size=len(boxes.score))
    ranking = ranking_of(boxes.score, tie_break)
    match = greedy_match(boxes.image_id, boxes.xyxy_px, ranking, boxes.truth)
    truth, found = coco_sets(type(boxes)(boxes.truth, boxes.image_id, boxes.xyxy_px, ranking / len(ranking)))
    assert average_precision(match) == pytest.approx(coco_average_precision(truth, found), abs=1e-12)
