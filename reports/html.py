"""The report of a run: one HTML file that needs no network."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup
from plotly.offline import get_plotlyjs

from reports.certainty_tables import comparison_table, fusion_table, reliability_table, weight_table
from reports.curves import curve_sets
from reports.figures import (
    Figure,
    candidate_roc_figure,
    car_roc_figure,
    json_values,
    precision_recall_figure,
    reliability_figure,
    weight_figure,
)
from reports.gallery import build_gallery
from reports.palette import OUTCOME_COLOUR, OUTCOME_NAME, OUTCOMES, detector_name
from reports.pictures import RESIDUAL_LIMIT_M
from reports.roc import write_curves
from reports.run_folder import Run, load_run
from reports.tables import (
    Table,
    difficulty_table,
    kind_table,
    number,
    reason_table,
    result_table,
    stereo_table,
)
from reports.templating import render
from rescore.store import atomic_path

HEADLINE_RECALL = "0.7"


def build_report(run_dir: Path) -> Path:
    """Draw the curves of a run folder as PNG and write its ``report.html``; the path of the latter.

    Raises:
        RescoreError: the run folder lacks results.
    """
    run = load_run(Path(run_dir))
    write_curves(run, run.root / "curves")
    page = render_report(run)
    out = run.root / "report.html"
    with atomic_path(out) as beside:
        beside.write_text(page, encoding="utf-8")
    return out


def render_report(run: Run) -> str:
    """The page of a run as text."""
    mode = run.modes[-1]
    return render(
        "report.html.j2",
        headline=headline(run.metrics),
        metrics=run.metrics,
        figures=_figures(run),
        tables=_tables(run),
        shelves=build_gallery(run, mode) if len(run.modes) > 1 else (),
        outcomes=[(OUTCOME_NAME[o], OUTCOME_COLOUR[o]) for o in OUTCOMES],
        residual_limit_m=RESIDUAL_LIMIT_M,
        number=number,
        detector_name=detector_name,
        made_from=_made_from(run.config),
        config_text=json.dumps(run.config, indent=1, ensure_ascii=False),
        plotly_js=Markup(get_plotlyjs()),
    )


def headline(metrics: Mapping[str, Any]) -> list[str]:
    """The result in one sentence a detector."""
    sentences = []
    level = f"{float(HEADLINE_RECALL):.0%}"
    for detector in dict.fromkeys(row["detector"] for row in metrics["rows"]):
        rows = {row["mode"]: row for row in metrics["rows"] if row["detector"] == detector}
        before, after = rows["detector"], list(rows.values())[-1]
        name = detector_name(detector)
        false = [row["fppi_at_recall"].get(HEADLINE_RECALL) for row in (before, after)]
        if after is before:
            precision = number(before["average_precision"])
            sentences.append(f"{name}: average precision {precision}, {_false_positives(false[:1], level)}.")
            continue
        w, precision = (
            number(after["w"], 2),
            _from_to(before["average_precision"], after["average_precision"], 3),
        )
        sentences.append(
            f"{name}: with stereo depth (w = {w}), average precision goes {precision}, "
            f"{_false_positives(false, level)}."
        )
    return sentences


def _false_positives(values: list[float | None], level: str) -> str:
    what = f"false positives per image where {level} of all cars are found"
    if all(v is None for v in values):
        return f"and {level} of all cars are never found"
    if len(values) == 1:
        return f"{number(values[0], 2)} {what}"
    return f"and {what} go {_from_to(values[0], values[1], 2)}"


def _from_to(before: float | None, after: float | None, digits: int) -> str:
    texts = ("never reached" if v is None else number(v, digits) for v in (before, after))
    return "from {} to {}".format(*texts)


def _figures(run: Run) -> list[Figure]:
    curves = curve_sets(run)
    figures = [
        candidate_roc_figure(curves, run.metrics),
        car_roc_figure(curves, run.metrics),
        precision_recall_figure(curves, run.metrics),
    ]
    tuning = run.tuning()
    if tuning:
        figures.append(weight_figure(tuning))
    shown = run.reliability()
    if shown:
        figures.append(reliability_figure(shown, run.detectors))
    return [json_values(f) for f in figures]


def _tables(run: Run) -> dict[str, Table | None]:
    return {
        "results": result_table(run.metrics),
        "comparison": comparison_table(run.metrics),
        "fusion": fusion_table(run.metrics),
        "weights": weight_table(run.metrics),
        "reliability": reliability_table(run.metrics),
        "reasons": reason_table(run.candidates, run.detectors),
        "kinds": kind_table(run.candidates, run.detectors),
        "difficulty": difficulty_table(run.metrics.get("difficulty", {})),
        "stereo": stereo_table(run.metrics.get("stereo", {})),
    }


def _made_from(config: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What was run, as name and value."""
    versions = config.get("versions", {})
    settings = config.get("config", {})
    rows = [
        ("command", config.get("command")),
        ("preset", settings.get("preset") if isinstance(settings, dict) else None),
        ("seed", config.get("seed")),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions.items()) or None),
    ]
    return [(name, str(value)) for name, value in rows if value is not None]
