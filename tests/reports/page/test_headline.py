from reports.page.headline import few_images, headline, tiles
from rescore.results.candidate_file import ALONE
from rescore.results.metrics_file import Ends, Estimate, Intervals, Metrics, ModeComparison, Reduction, Row


def row(mode: str, fppi: float | None, detector: str = "hog", ap: float = 0.25) -> Row:
    intervals = Intervals(
        auc=None,
        average_precision=None,
        fppi_at_recall={"0.7": (0.5, None)},
        n_undefined={},
        n_infinite={},
    )
    return Row(
        detector=detector,
        mode=mode,
        auc=None,
        average_precision=ap,
        recall_ceiling=0.6,
        fppi_at_recall={"0.7": fppi},
        intervals=intervals,
    )


def metrics(
    *rows: Row,
    value: float | None = 2.0,
    interval: Ends = (1.5, 3.0),
    n_images: int = 100,
    n_cars: int = 40,
) -> Metrics:
    def estimate(value: float | None, interval: Ends) -> Estimate:
        return Estimate(value=value, interval=interval, n_undefined=0, n_infinite=0)

    def reduction(after: Row) -> Reduction:
        before = next(r for r in rows if r.detector == after.detector)
        sides = {"before": before.fppi_at_recall["0.7"], "after": after.fppi_at_recall["0.7"]}
        return Reduction(**dict(estimate(value, interval)), **sides)

    comparisons = tuple(
        ModeComparison(
            detector=r.detector,
            mode=r.mode,
            against=ALONE,
            auc_difference=estimate(0.0, (0.0, 0.0)),
            reduction={"0.7": reduction(r)},
            average_precision_difference=estimate(0.05, (0.01, 0.1)),
        )
        for r in rows
        if r.mode != ALONE
    )
    return Metrics(n_images=n_images, n_cars=n_cars, n_candidates=0, rows=rows, comparisons=comparisons)


def test_both_values_and_the_interval_of_the_factor_are_said():
    assert headline(metrics(row("detector", 2.0), row("metric", 1.0))) == (
        "At 70 % of the 40 annotated cars found, stereo depth (metric) takes HOG + SVM from 2.00 to 1.00 "
        "false positives an image, 2.0 times fewer (95 % interval 1.5 to 3.0)."
    )


def test_two_detectors_make_one_sentence():
    rows = [
        row(mode, fppi, d) for d in ("hog", "boosted") for mode, fppi in (("detector", 2.0), ("paper", 1.0))
    ]
    text = headline(metrics(*rows))
    assert text.count("stereo depth (paper) takes") == 1
    assert ", and boosted from 2.00 to 1.00" in text
    assert text.count(". ") == 0


def test_a_rate_from_none_to_some_is_more():
    found = metrics(row("detector", 0.0), row("paper", 0.08), value=0.0, interval=(0.0, 0.5))
    said = "more: none before (95 % interval 2.0 to infinity times as many)"
    assert headline(found).endswith(f"from 0.00 to 0.08 false positives an image, {said}.")
    (tile,) = tiles(found)
    assert (tile.factor, tile.worse) == (said, True)


def test_a_rate_that_is_never_reached_is_said_so():
    alone = headline(metrics(row("detector", None)))
    assert alone.endswith("HOG + SVM never gets there: its candidates hold 60.0% of them.")
    later = headline(metrics(row("detector", None), row("paper", 2.0, ap=0.3)))
    assert later.endswith(
        "HOG + SVM never gets there before rescoring (average precision 0.250 to 0.300, 95 % interval of the "
        "difference +0.010 to +0.100)."
    )


def test_a_detector_alone_has_its_own_interval():
    text = headline(metrics(row("detector", 2.0)))
    assert text.endswith(
        "HOG + SVM alone makes 2.00 false positives an image (95 % interval 0.50 to infinity)."
    )
    (tile,) = tiles(metrics(row("detector", 2.0)))
    assert (tile.before, tile.after, tile.factor) == ("2.00", None, "")


def test_nothing_is_claimed_without_annotated_cars():
    assert "nothing can be said" in headline(metrics(row("detector", None), n_cars=0))


def test_cars_that_are_all_ignored_are_told() -> None:
    nothing = metrics(row(ALONE, None), n_cars=0).model_copy(update={"n_ignored": 3})
    assert headline(nothing).startswith("3 boxes are annotated and none counts: all are ignored (")


def test_few_images_get_a_warning():
    assert few_images(metrics(n_images=30)) is None
    # without annotated cars there are no figures, and no intervals
    assert few_images(metrics(n_images=6, n_cars=0)) is None
    assert str(few_images(metrics(n_images=6))).startswith("6 images prove little")
    assert str(few_images(metrics(n_images=1))).startswith("One image proves little")


def test_a_tile_says_whether_it_became_worse():
    for before, after, worse in ((2.0, 1.0, False), (1.0, 2.0, True), (None, 1.0, False), (1.0, None, True)):
        (tile,) = tiles(metrics(row("detector", before), row("paper", after)))
        assert tile.worse == worse
