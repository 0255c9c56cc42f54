"""The page on what the class model is worth: false positives with and without its cues, by detector."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from reports.pages import write_figure, write_page
from reports.palette import DARK_GREY, GREEN, ORANGE, detector_name
from reports.run.reductions import reduction_text
from reports.run.tables import Table, interval_text, number_text
from reports.studies.false_positives import draw_false_positives
from rescore.results.candidate_file import ALONE
from rescore.results.metrics_file import Reduction, finite
from rescore.results.sweep_file import SweptInterval
from rescore.studies.class_model_worth import (
    RECALLS,
    WITH,
    WITHOUT,
    DetectorWorth,
    WorthResult,
    write_worth,
)

NAMES = {ALONE: "detector alone", WITHOUT: "depth without the class model", WITH: "depth with all cues"}
_LOOKS = {ALONE: (DARK_GREY, "s"), WITHOUT: (ORANGE, "o"), WITH: (GREEN, "D")}
MAIN_RECALL = "0.7"


def write_worth_study(result: WorthResult, folder: Path) -> Path:
    """Write the page with its figure and numbers; returns the page."""
    write_figure(folder / "class_model.png", draw_worth(result), dpi=120)
    write_worth(folder / "class_model.json", result)
    return write_page(folder, worth_page(result))


def figures_table(result: WorthResult) -> Table:
    """A row a detector and way of scoring: w, false positives an image by recall, average precision."""
    rows = [
        (
            detector_name(one.detector, short=True),
            NAMES[name],
            f"{one.figures[name].w:.2f}",
            f"{one.figures[name].with_evidence:.0%}",
            *(interval_text(one.figures[name].fppi[f"{recall:g}"]) for recall in RECALLS),
            interval_text(one.figures[name].average_precision, 3),
        )
        for one in result.detectors
        for name in NAMES
    ]
    head = ("detector", "scores", "w", "evidence", *(f"FP/image at {recall:.0%}" for recall in RECALLS), "AP")
    return Table("False positives with and without the class model", head, tuple(rows), text_columns=2)


def changes_table(result: WorthResult) -> Table:
    """A row a detector and comparison: times fewer false positives by recall, change of average precision."""
    rows = []
    for one in result.detectors:
        changes = {
            "the class model, added to the other cues": one.class_model,
            "depth with all cues, to the detector": one.depth[WITH],
            "depth without the class model, to the detector": one.depth[WITHOUT],
        }
        for name, change in changes.items():
            factors = (interval_text(change.factor[f"{recall:g}"]) for recall in RECALLS)
            gain = interval_text(change.average_precision, 3)
            rows.append((detector_name(one.detector, short=True), name, *factors, gain))
    head = ("detector", "what is added", *(f"at {recall:.0%}" for recall in RECALLS), "AP gained")
    return Table("Times fewer false positives", head, tuple(rows), text_columns=2)


def worth_sentence(one: DetectorWorth) -> str:
    """Whether the class model earns its place with a detector, by how much, how sure."""
    factor, name = one.class_model.factor[MAIN_RECALL], detector_name(one.detector, short=True)
    if np.isnan(factor.value):
        return (
            f"{name}: 70 % of the cars are not found, so that false positives cannot be compared there; "
            f"{_gain(one.class_model.average_precision)}."
        )
    if factor.low > 1:
        verdict = "it earns its place"
    else:
        verdict = "it makes things worse" if factor.high < 1 else "these images cannot tell whether it helps"
    before, after = (one.figures[way].fppi[MAIN_RECALL].value for way in (WITHOUT, WITH))
    reduction = Reduction(
        value=finite(factor.value),
        interval=(finite(factor.low), finite(factor.high)),
        n_undefined=factor.n_undefined,
        n_infinite=factor.n_infinite,
        before=finite(before),
        after=finite(after),
    )
    return (
        f"{name}: where 70 % of the cars are found, the class model takes {number_text(before, 2)} to "
        f"{number_text(after, 2)} false positives an image, {reduction_text(reduction)}: {verdict}; "
        f"{_gain(one.class_model.average_precision)}."
    )


def _gain(gain: SweptInterval) -> str:
    return f"average precision changes by {gain.value:+.3f} ({gain.low:+.3f} to {gain.high:+.3f})"


def draw_worth(result: WorthResult) -> Figure:
    """False positives an image over recall, a panel a detector, with intervals."""
    count = len(result.detectors)
    figure = Figure(figsize=(max(7.2, 4.4 * count), 4.4), layout="constrained")
    axes = figure.subplots(1, count, squeeze=False)[0]
    for ax, one in zip(axes, result.detectors, strict=True):
        draw_false_positives(ax, {NAMES[way]: (one.figures[way].fppi, *_LOOKS[way]) for way in NAMES})
        ax.set_title(detector_name(one.detector, short=True), loc="left", fontweight="bold")
    axes[0].set_ylabel("false positives an image")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure


def worth_page(result: WorthResult) -> str:
    """The page in Markdown; its picture lies beside it."""
    parts = [
        "# Does the class model earn its place?",
        f"Made by `{result.command}`: mode instance on {result.n_images} test images with {result.n_cars} "
        f"annotated cars, with all of its {result.n_cues} cues, and without the {len(result.cues)} that come "
        "of an instance of the class fitted to the box and the disparity. Both are done as in the run: "
        "evidence fitted on the splits train and calibration, w chosen on validation. In brackets intervals "
        "of 95 % from a bootstrap over test images, paired in the second table.",
        "\n".join(f"- {worth_sentence(one)}" for one in result.detectors),
        "![False positives an image with and without the class model](class_model.png)",
        "## False positives an image",
        "A share of cars that is never found takes infinitely many (inf). Evidence: share of the candidates "
        "that have some. With all cues that takes a fitted instance, and so a ground that is stated or "
        "trusted; without the class model it does not.",
        figures_table(result).markdown().rstrip(),
        "## Times fewer false positives",
        "Above 1 what is added makes fewer; the first row of a detector is what the class model is worth.",
        changes_table(result).markdown().rstrip(),
        f"Left out: {', '.join(result.cues)}.",
    ]
    return "\n\n".join(parts) + "\n"
