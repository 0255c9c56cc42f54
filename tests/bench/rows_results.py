"""Matching, curves and intervals."""

import numpy as np

from reports.publishing.bench_file import Row
from rescore.metrics.bootstrap import BootstrapConfig, bootstrap
from rescore.metrics.curves import Summary, summarise
from rescore.metrics.matching import FALSE_ALARM, HIT, MatchTable, greedy_match
from tests.bench.timing import median_s, paired
from tests.coco_boxes import coco_average_precision, coco_sets, random_boxes


def evaluation() -> list[Row]:
    """Matching and all curves of 5,000 images of 15 candidates, against faster-coco-eval on the same boxes.

    faster-coco-eval gets its data structures ready-made, one overlap and one range of sizes.
    """
    boxes = random_boxes(np.random.default_rng(0), 5000, 15, n_levels=1_000_000)
    truth, found = coco_sets(boxes)

    def ours() -> Summary:
        return summarise(greedy_match(boxes.image_id, boxes.xyxy_px, boxes.score, boxes.truth))

    pair = (ours, lambda: coco_average_precision(truth, found))
    row = paired("evaluate 5000 x 15 candidates / faster-coco-eval", 1.0, [pair])
    assert row.ours_ms is not None
    return [row, Row("evaluate 5000 images of 15 candidates, all curves", row.ours_ms / 1e3, "s", 1.0)]


def resampling() -> list[Row]:
    """All intervals of two tables of 109 images of 15 candidates."""
    rng = np.random.default_rng(0)
    image = np.repeat(np.arange(109), 15)
    outcome = np.where(rng.random(len(image)) < 0.07, HIT, FALSE_ALARM).astype(np.int8)
    cars = np.bincount(image[outcome == HIT], minlength=109)
    before, after = (
        MatchTable(109, int(cars.sum()), image, rng.random(len(image)), outcome, image) for _ in range(2)
    )

    def work() -> None:
        bootstrap({"before": before, "after": after}, cars, [("before", "after")], rng, BootstrapConfig())

    what = "2000 paired resamples of two tables of 1635 candidates, all figures"
    return [Row(what, median_s(work, repeats=1), "s", 2.0)]
