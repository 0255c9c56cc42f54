"""All corners of a factor of false positives, as words and as cells, from the counts themselves."""

import numpy as np
import pytest

from reports.run.reductions import reduction_cell, reduction_text
from rescore.metrics.bootstrap import BootstrapConfig
from rescore.metrics.matching import FALSE_ALARM, HIT, MatchTable
from rescore.results.comparisons import certainty
from rescore.results.metrics_file import Ends, Reduction


def reduction(
    before: float | None, after: float | None, value: float | None, interval: Ends | None
) -> Reduction:
    return Reduction(value=value, interval=interval, n_undefined=0, n_infinite=0, before=before, after=after)


CORNERS = [
    # some to some
    (0.2, 0.1, 2.0, (1.5, 3.0), "2.0 times fewer (95 % interval 1.5 to 3.0)", "2.00 (1.50–3.00)"),
    (
        *(0.2, 0.1, 2.0, (0.9, None)),
        "2.0 times fewer (95 % interval 0.9 to infinity; chance may explain it)",
        "2.00 (0.90–∞)",
    ),
    (0.1, 0.2, 0.5, (0.25, 0.8), "2.0 times as many (95 % interval 1.2 to 4.0)", "0.50 (0.25–0.80)"),
    (
        *(0.1, 0.2, 0.5, (0.0, 1.25)),
        "2.0 times as many (95 % interval 0.8 to infinity; chance may explain it)",
        "0.50 (0.00–1.25)",
    ),
    (0.1, 0.1, 1.0, (0.8, 1.2), "about as many (95 % interval 0.8 to 1.2 times fewer)", "1.00 (0.80–1.20)"),
    # some to none
    (
        0.2,
        0.0,
        None,
        (3.0, None),
        "none after (95 % interval 3.0 to infinity times fewer)",
        "none after (3.00–∞)",
    ),
    # none to some
    (
        *(0.0, 0.08, 0.0, (0.0, 0.5)),
        "more: none before (95 % interval 2.0 to infinity times as many)",
        "none before (0.00–0.50)",
    ),
    (
        *(0.0, 0.08, 0.0, (0.0, None)),
        "more: none before (95 % interval 0.0 to infinity times as many; chance may explain it)",
        "none before (0.00–∞)",
    ),
    # none to none
    (0.0, 0.0, 1.0, (1.0, 1.0), "none before, none after", "none, none (1.00–1.00)"),
    (
        *(0.0, 0.0, 1.0, (0.0, None)),
        "none before, none after (95 % interval 0.0 to infinity times fewer)",
        "none, none (0.00–∞)",
    ),
    # the recall is never reached on one side
    (
        *(None, 0.1, None, (2.0, None)),
        "infinitely many times fewer (95 % interval 2.0 to infinity times fewer)",
        "∞ (2.00–∞)",
    ),
    (None, None, None, None, "", "–"),
]


@pytest.mark.parametrize(("before", "after", "value", "interval", "text", "cell"), CORNERS)
def test_every_corner_is_named(
    before: float | None,
    after: float | None,
    value: float | None,
    interval: Ends | None,
    text: str,
    cell: str,
) -> None:
    figure = reduction(before, after, value, interval)
    assert (reduction_text(figure), reduction_cell(figure)) == (text, cell)
    assert reduction_cell(None) == "–"
    assert reduction_text(None) == ""


N_IMAGES, N_FALSE = 25, 10


def table(above: int) -> MatchTable:
    """Images of one car each, all found; of the false alarms in the first of them some rank above."""
    image = np.concatenate([np.arange(N_IMAGES), np.arange(N_FALSE)])
    outcome = np.repeat(np.array([HIT, FALSE_ALARM], np.int8), [N_IMAGES, N_FALSE])
    ranking = np.repeat([0.5, 0.9, 0.1], [N_IMAGES, above, N_FALSE - above])
    return MatchTable(N_IMAGES, N_IMAGES, image, ranking, outcome, np.where(outcome == HIT, image, -1))


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (0, 2, "more: none before (95 % interval "),
        (2, 0, "none after (95 % interval "),
        (0, 0, "none before, none after"),
        (10, 2, "5.0 times fewer (95 % interval "),
        (2, 10, "5.0 times as many (95 % interval "),
    ],
)
def test_the_figures_of_an_evaluation_say_which_corner_it_is(before: int, after: int, said: str) -> None:
    tables = {"detector": table(before), "paper": table(after)}
    kind, cars = np.full(N_IMAGES + N_FALSE, "wall", object), np.ones(N_IMAGES, np.int64)
    (change,) = certainty("hog", tables, kind, cars, 0, BootstrapConfig(n_resamples=200)).comparisons
    assert change.reduction_without_pictures is not None
    for figure in (change.reduction["0.7"], change.reduction_without_pictures["0.7"]):
        assert (figure.before, figure.after) == (before / N_IMAGES, after / N_IMAGES)
        assert reduction_text(figure).startswith(said)
