import io
import re
from pathlib import Path

from rich.console import Console

from reports.page.paired_runs import Evaluated
from reports.page.report import render_report
from reports.run.reductions import reduction_cell
from reports.run.tables import (
    TERMINAL_CAPTION,
    comparison_table,
    difference,
    fusion_table,
    reliability_table,
    terminal_comparison,
    weight_table,
    weight_text,
)
from rescore.files import write_json
from rescore.results.metrics_file import (
    Ends,
    Estimate,
    Metrics,
    ModeComparison,
    Reduction,
    TunedWeight,
    read_metrics,
)
from rescore.results.run_folder import Run


def figure(value: float | None, interval: Ends | None) -> Estimate:
    return Estimate(value=value, interval=interval, n_undefined=0, n_infinite=0)


def reduction(value: float | None, interval: Ends | None) -> Reduction:
    return Reduction(**dict(figure(value, interval)))


def test_differences_are_signed():
    assert difference(figure(-0.0841, (-0.154, 0.0123))) == "−0.084 (−0.154, +0.012)"
    assert difference(figure(None, None)) == "–"


def test_the_comparison_shows_metrics_json(run: Run):
    table = comparison_table(run.metrics)
    assert table is not None
    assert len(table.rows) == len(run.metrics.comparisons) == 2
    for cells, c in zip(table.rows, run.metrics.comparisons, strict=True):
        shown = dict(zip(table.head, cells, strict=True))
        assert shown["fewer FP at 70%"] == reduction_cell(c.reduction["0.7"])
        assert shown["at 70% without pictures"] == reduction_cell(c.reduction_without_pictures["0.7"])
        assert shown["area"] == difference(c.auc_difference)
        assert shown["AP"] == difference(c.average_precision_difference)


def test_the_terminal_comparison_fits_80_columns_at_its_widest():
    wide = figure(-0.1234, (-1.0, -0.9876))
    modes = tuple(
        ModeComparison(
            detector="hog_views",
            mode=mode,
            against="detector",
            reduction={"0.7": reduction(123.4, (11.11, 987.6))},
            reduction_without_pictures={"0.7": reduction(None, (11.11, None))},
            auc_difference=wide,
            average_precision_difference=wide,
        )
        for mode in ("paper", "guarded", "metric")
    )
    table = terminal_comparison(Metrics(n_images=1, n_cars=1, n_candidates=1, rows=(), comparisons=modes))
    assert table is not None
    out = io.StringIO()
    Console(file=out, width=80).print(table.rich(TERMINAL_CAPTION))
    text = out.getvalue()
    assert "…" not in text
    assert max(len(line) for line in text.splitlines()) <= 80
    for shown in (" 123 ", "(11.1–988)", "(11.1–∞)"):
        assert text.count(shown) == 3
    for shown in ("−.123", "(−1.000, −.988)"):
        assert text.count(shown) == 6
    assert re.search(r" HOG \+ SVM, all .*\n views, guarded ", text)


def test_the_terminal_names_the_corners_of_a_factor():
    corners = ((0.0, 0.08, 0.0), (0.1, 0.0, None), (0.0, 0.0, 1.0))
    modes = tuple(
        ModeComparison(
            detector="hog_views",
            mode="instance",
            against="detector",
            reduction={"0.7": reduction(value, (0.0, None)).model_copy(update={"before": b, "after": a})},
            auc_difference=figure(0.0, (0.0, 0.0)),
            average_precision_difference=figure(0.0, (0.0, 0.0)),
        )
        for b, a, value in corners
    )
    table = terminal_comparison(Metrics(n_images=1, n_cars=1, n_candidates=1, rows=(), comparisons=modes))
    assert table is not None
    out = io.StringIO()
    Console(file=out, width=80).print(table.rich(TERMINAL_CAPTION))
    for told in (" none before ", " none after ", " none, none "):
        assert out.getvalue().count(told) == 1
    assert "…" not in out.getvalue()


def test_every_way_of_fusing_has_a_row_and_the_detector_one(run: Run):
    table = fusion_table(run.metrics)
    assert table is not None
    assert [row[2] for row in table.rows[:6]] == [
        "detector alone",
        "depth alone, 1 − D",
        "product, l (1 − D)",
        "maximum of l and 1 − D",
        "eq. 7",
        "learned from log l and log(1 − D)",
    ]
    assert len(table.rows) == 12


def test_weights_and_reliability_are_shown(run: Run):
    weights, scores = weight_table(run.metrics), reliability_table(run.metrics)
    assert weights is not None
    assert weights.rows[0][2:5] == ("0.60", "0.35 to 0.85", "0.40 to 0.80")
    assert weights.rows[0][5].startswith("not separable from w = 0.25 to 0.95")
    assert scores is not None
    assert len(scores.rows) == 4
    assert weight_text(TunedWeight(w=0.6, objective_name="", w_grid=(), objective=())) == "0.6"


def test_a_run_of_an_older_version_has_none_of_these(run: Run, tmp_path: Path):
    new = {"comparisons", "fusion", "reliability"}
    value = {name: part for name, part in run.metrics.as_json().items() if name not in new}
    value["tuning"] = {
        name: {k: v for k, v in t.items() if k not in ("modes", "uncertainty", "sentence")}
        for name, t in value["tuning"].items()
    }
    write_json(tmp_path / "metrics.json", value)
    older = read_metrics(tmp_path / "metrics.json")
    tables = (comparison_table, terminal_comparison, fusion_table, weight_table, reliability_table)
    assert [t(older) for t in tables] == [None] * 5
    page = render_report([Evaluated("run", Run(run.root, run.config, older, run.candidates))])
    assert 'id="r0-results"' in page
    assert 'id="r0-comparison"' not in page
    # the choice of w is still drawn, as that of eq. 6
    assert 'id="r0-weight"' in page
