"""The tables of a run, and its figures with intervals in words: for the terminal, HTML and Markdown."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.table import Table as RichTable

from reports.palette import detector_name, mode_name
from reports.run.reductions import reduction_cell
from rescore.results.candidate_file import ALONE, Columns, of_mode
from rescore.results.metrics_file import (
    DetectorDifficulty,
    Estimate,
    Metrics,
    StereoStatistics,
    TunedWeight,
)
from rescore.results.sweep_file import SweptInterval
from rescore.results.words import status_text

RECALLS = ("0.5", "0.6", "0.7", "0.8")
LEVEL = "0.7"
"""Recall at which the small tables compare."""
RULE_TEXT = {
    ALONE: "detector alone",
    "depth": "depth alone, 1 − D",
    "product": "product, l (1 − D)",
    "maximum": "maximum of l and 1 − D",
    "eq7": "eq. 7",
    "learned": "learned from log l and log(1 − D)",
}
TERMINAL_CAPTION = (
    f"FP at {float(LEVEL):.0%}: so many times fewer false positives per image, above 1 is better. "
    "no pictures: false alarms on flat pictures of cars left out. area, AP: difference. In brackets "
    "intervals of 95 %, paired over images."
)
_SPLIT_TEXT = {"all": "all splits"}
SHORT_MODE = {ALONE: "alone"}
"""Modes where there is little room, if they have another name there."""


@dataclass(frozen=True)
class Table:
    """A table as text: what is shown, ready for any medium."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text_columns: int = 1
    """Number of columns of text, counted from the first; the others hold numbers and are aligned to the
    right."""

    def markdown(self) -> str:
        """The table in GitHub's Markdown, without its title."""
        rule = ["---"] * self.text_columns + ["---:"] * (len(self.head) - self.text_columns)
        lines = [self.head, rule, *self.rows]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"

    def rich(self, caption: str | None = None) -> RichTable:
        """The table for the terminal."""
        # a table of 80 columns has no room for frames and double gaps
        table = RichTable(title=self.title, title_justify="left", caption=caption, caption_justify="left")
        table.box, table.pad_edge, table.padding = SIMPLE_HEAD, False, (0, 1, 0, 0)
        for i, name in enumerate(self.head):
            figures = i >= self.text_columns
            # where there is no room names are broken, figures are not
            table.add_column(name, justify="right" if figures else "left", no_wrap=figures)
        for row in self.rows:
            table.add_row(*row)
        return table


def result_table(metrics: Metrics, split: str = "test") -> Table:
    """A row a detector and mode: w, areas, average precision, false positives per image, ceiling."""
    levels = (f"FP/image at {float(r):.0%}" for r in RECALLS)
    head = ("detector", "scores", "w", "area (ROC)", "average precision", *levels, "recall ceiling")
    rows = tuple(
        (
            detector_name(row.detector),
            mode_name(row.mode),
            number(row.w, 2),
            number(row.auc),
            number(row.average_precision),
            *(number(row.fppi_at_recall.get(r), 2) for r in RECALLS),
            number(row.recall_ceiling),
        )
        for row in metrics.rows
    )
    return Table(_title(split), head, rows, text_columns=2)


def short_table(metrics: Metrics, levels: Sequence[str] = RECALLS, split: str = "test") -> Table:
    """The results with short names and fewer columns; ``levels`` picks the recalls."""
    rows = tuple(
        (
            f"{detector_name(row.detector, short=True)}, {SHORT_MODE.get(row.mode, row.mode)}",
            number(row.w, 2),
            number(row.auc),
            number(row.average_precision),
            *(number(row.fppi_at_recall.get(r), 2) for r in levels),
            number(row.recall_ceiling),
        )
        for row in metrics.rows
    )
    head = ("detector, scores", "w", "area", "AP", *(f"{float(r):.0%}" for r in levels), "ceiling")
    return Table(_title(split), head, rows)


def _title(split: str) -> str:
    return "Results on all splits" if split == "all" else f"Results on the {split} set"


def terminal_table(metrics: Metrics, split: str = "test") -> RichTable:
    """The result table for a terminal of 80 columns."""
    return short_table(metrics, split=split).rich(
        f"{metrics.n_cars} cars in {metrics.n_images} images. area: under the candidate ROC. "
        "AP: average precision. 50% to 80%: false positives per image where this share of all cars is found "
        "(– never). ceiling: share of the cars found by all candidates."
    )


def tie_notes(metrics: Metrics) -> tuple[str, ...]:
    """A sentence for each row whose average precision depends on the order of equal scores."""
    notes = []
    for row in metrics.rows if metrics.n_cars else ():
        if row.ties is None:
            continue
        low, high = (number(end) for end in row.ties.average_precision)
        if low != high:
            notes.append(
                f"{detector_name(row.detector, short=True)}, {SHORT_MODE.get(row.mode, row.mode)}: "
                f"{row.ties.n_candidates} candidates share their score, hits with false positives. Their "
                f"order in the file decides where average precision lies between {low} and {high}, as in "
                "COCO's tool"
            )
    return tuple(notes)


def reason_table(columns: Columns, detectors: Sequence[str]) -> Table:
    """How many candidates of each detector had depth evidence, and why the others had none."""
    counts = {d: _counts([str(s) for s in columns["status"][columns["detector"] == d]]) for d in detectors}
    statuses = sorted({s for c in counts.values() for s in c}, key=lambda s: (s != "ok", s))
    totals = {d: max(sum(counts[d].values()), 1) for d in detectors}
    rows = tuple(
        (
            status_text(status),
            *(f"{counts[d].get(status, 0)} ({counts[d].get(status, 0) / totals[d]:.0%})" for d in detectors),
        )
        for status in statuses
    )
    return Table(
        "Depth evidence of the candidates", ("outcome", *(detector_name(d) for d in detectors)), rows
    )


def kind_table(columns: Columns, detectors: Sequence[str], max_rows: int = 12) -> Table | None:
    """What the false alarms show, by kind of rendered thing, most first; None where that is unknown, or
    there is none."""
    if "kind" not in columns or not any(str(k) for k in columns["kind"]):
        return None
    false = of_mode(columns, "outcome", ALONE) == "false_alarm"
    if not false.any():
        return None
    per = {
        d: _counts([str(k) or "unknown" for k in columns["kind"][false & (columns["detector"] == d)]])
        for d in detectors
    }
    kinds = sorted(
        {k for c in per.values() for k in c}, key=lambda k: (-sum(c.get(k, 0) for c in per.values()), k)
    )
    shown = kinds[:max_rows]
    rows = [(kind.replace("_", " "), *(str(per[d].get(kind, 0)) for d in detectors)) for kind in shown]
    if kinds[max_rows:]:
        others = (str(sum(per[d].get(kind, 0) for kind in kinds[max_rows:])) for d in detectors)
        rows.append((f"{len(kinds) - max_rows} other kinds", *others))
    return Table(
        "False alarms by what they show", ("kind", *(detector_name(d) for d in detectors)), tuple(rows)
    )


def difficulty_table(difficulty: Mapping[str, DetectorDifficulty], max_kinds: int = 4) -> Table | None:
    """How hard the test set is for each detector alone, on well-seen cars; None where unknown."""
    if not any(d.share_by_kind for d in difficulty.values()):
        return None
    rows = []
    for name, d in difficulty.items():
        kinds = list(d.share_by_kind.items())[:max_kinds]
        shown = ", ".join(
            f"{(kind or 'unknown').replace('_', ' ')} {percent(share)}" for kind, share in kinds
        )
        row = (detector_name(name), str(d.n_cars), percent(d.recall_ceiling))
        rows.append((*row, number(d.fppi_at_70, 2), shown))
    header = ("detector", "cars", "found by a candidate", "FP/image at 70%", "what makes most of these")
    return Table("Difficulty: cars that are at least 60% visible, detector alone", header, tuple(rows))


def stereo_table(stereo: StereoStatistics) -> Table | None:
    """Error of the measured disparity by split and region; None where there is no truth to compare with."""
    rows = tuple(
        (
            _SPLIT_TEXT.get(split, split),
            {"car": "cars"}.get(region, region),
            percent(values.density),
            number(values.end_point_error_px, 2),
            percent(values.wrong_share),
            percent(values.wrong_share_measured),
        )
        for split, regions in stereo.splits.items()
        for region, values in regions.items()
    )
    if not rows:
        return None
    head = ("split", "pixels", "measured", "mean error (px)", "wrong, of all", "wrong, of measured")
    return Table("Error of the measured disparity", head, rows, text_columns=2)


def comparison_table(metrics: Metrics) -> Table | None:
    """What each mode changes against the detector alone, with intervals of 95 %, a row a mode."""
    rows = tuple(
        (
            detector_name(c.detector),
            mode_name(c.mode),
            *(reduction_cell(c.reduction.get(level)) for level in RECALLS),
            reduction_cell((c.reduction_without_pictures or {}).get(LEVEL)),
            difference(c.auc_difference),
            difference(c.average_precision_difference),
        )
        for c in metrics.comparisons
    )
    levels = (f"fewer FP at {float(r):.0%}" for r in RECALLS)
    head = ("detector", "scores", *levels, f"at {float(LEVEL):.0%} without pictures", "area", "AP")
    return Table("Change against the detector alone", head, rows, text_columns=2) if rows else None


def terminal_comparison(metrics: Metrics) -> Table | None:
    """The change against the detector alone for 80 columns: short names, one recall, intervals below the
    figures."""
    rows = []
    for c in metrics.comparisons:
        factors = (c.reduction.get(LEVEL), (c.reduction_without_pictures or {}).get(LEVEL))
        areas = (c.auc_difference, c.average_precision_difference)
        rows.append(
            (
                f"{detector_name(c.detector, short=True)}, {c.mode}",
                *(reduction_cell(f).replace(" (", "\n(", 1) for f in factors),
                # no room for noughts before the point
                *(difference(f).replace(" (", "\n(", 1).replace("0.", ".") for f in areas),
            )
        )
    head = ("detector, scores", f"FP at {float(LEVEL):.0%}", "no pictures", "area", "AP")
    return Table("Change against the detector alone", head, tuple(rows)) if rows else None


def fusion_table(metrics: Metrics) -> Table | None:
    """Eq. 7 beside other ways of fusing, a row a detector, mode and way."""
    rows = tuple(
        (
            detector_name(f.detector),
            mode_name(f.mode),
            RULE_TEXT.get(f.rule, f.rule),
            number(f.auc),
            number(f.average_precision),
            number(f.fppi_at_recall.get(LEVEL), 2),
        )
        for f in metrics.fusion
        if f.rule != ALONE or f.mode == _first_mode(metrics, f.detector)
    )
    head = ("detector", "D", "score", "area (ROC)", "average precision", f"FP/image at {float(LEVEL):.0%}")
    return Table("Ways of fusing likelihood and depth", head, rows, text_columns=3) if rows else None


def reliability_table(metrics: Metrics) -> Table | None:
    """Brier score and calibration error of likelihoods and posteriors."""
    rows = tuple(
        (
            detector_name(r.detector),
            mode_name(r.mode),
            number(r.brier_score),
            number(r.calibration_error),
        )
        for r in metrics.reliability
    )
    head = ("detector", "scores", "Brier score", "calibration error")
    return Table("Are scores probabilities?", head, rows, text_columns=2) if rows else None


def weight_table(metrics: Metrics) -> Table | None:
    """The choice of w of every detector and mode with its interval."""
    rows = tuple(
        (
            detector_name(name),
            mode_name(mode),
            number(t.w, 2),
            f"{t.uncertainty.low:.2f} to {t.uncertainty.high:.2f}",
            "{:.2f} to {:.2f}".format(*t.uncertainty.plateau),
            t.sentence,
        )
        for name, tuning in metrics.tuning.items()
        for mode, t in tuning.modes.items()
        if t.uncertainty is not None
    )
    head = ("detector", "scores", "w", "95 % interval", "within one standard error", "what the data tell")
    return Table("The weight w on the validation set", head, rows, text_columns=6) if rows else None


def percent(value: float | None) -> str:
    """A share as per cent with one decimal; a dash where there is none."""
    return "–" if value is None else f"{value:.1%}"


def number(value: float | None, digits: int = 3) -> str:
    """A figure for people; a dash where there is none."""
    return "–" if value is None or math.isnan(value) else f"{value:.{digits}f}"


def number_text(value: float, digits: int) -> str:
    """A figure of a study for people; "never" where it is infinite."""
    if math.isnan(value):
        return "-"
    return "never" if math.isinf(value) else f"{value:.{digits}f}"


def interval_text(interval: SweptInterval, digits: int = 2) -> str:
    """A figure of a study with its interval for people."""

    def text(value: float) -> str:
        return "-" if math.isnan(value) else "inf" if math.isinf(value) else f"{value:.{digits}f}"

    return f"{text(interval.value)} [{text(interval.low)}, {text(interval.high)}]"


def weight_text(tuned: TunedWeight) -> str:
    """The chosen w with its interval, where it is known."""
    u = tuned.uncertainty
    return f"{tuned.w:g}" + ("" if u is None else f" ({u.low:.2f} to {u.high:.2f})")


def difference(figure: Estimate) -> str:
    """A signed difference with its interval; a dash where it is undefined."""
    if figure.interval is None:
        return "–"
    value, low, high = (f"{v:+.3f}".replace("-", "−") for v in (figure.value, *figure.interval))
    return f"{value} ({low}, {high})"


def _counts(values: Sequence[str]) -> dict[str, int]:
    return {v: values.count(v) for v in dict.fromkeys(values)}


def _first_mode(metrics: Metrics, detector: str) -> str:
    """The mode beside which the detector alone is shown, once."""
    return next(f.mode for f in metrics.fusion if f.detector == detector)
