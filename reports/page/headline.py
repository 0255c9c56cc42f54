"""The result of a run in a sentence, with its interval."""

from collections.abc import Sequence
from dataclasses import dataclass

from reports.palette import detector_name
from reports.run.reductions import reduction_text
from reports.run.tables import number, percent
from rescore.data.frames import none_counts
from rescore.results.metrics_file import Metrics, ModeComparison, Row

HEADLINE_RECALL = "0.7"
"""Recall at which false positives are compared."""
LEVEL_TEXT = f"{float(HEADLINE_RECALL):.0%}".replace("%", " %")
FEW_IMAGES = 30
"""A run with fewer is told to prove little."""


@dataclass(frozen=True)
class Tile:
    """One detector before and after, at a glance."""

    title: str
    short: str
    """The title where there is little room."""
    before: str
    after: str | None
    """Figure after rescoring; None where nothing was rescored."""
    what: str
    factor: str
    """What changed, with its interval; empty where there is none."""
    never: bool
    """Whether so many cars are found neither before nor after."""
    worse: bool
    """Whether there are more false positives after."""


def headline(metrics: Metrics) -> str:
    """The result in one sentence, with intervals of 95 %."""
    if not metrics.n_cars:
        why = none_counts(metrics.n_ignored) if metrics.n_ignored else "No car is annotated in these images"
        return f"{why}; so nothing can be said of what was found."
    clauses, subject = [], ""
    for detector in metrics.detectors:
        mode = _ends(metrics, detector)[1].mode
        clauses.append(_clause(metrics, detector, named=mode == subject))
        subject = mode
    return f"At {LEVEL_TEXT} of the {metrics.n_cars} annotated cars found, {_joined(clauses)}."


def of_sample(metrics: Metrics, images: int | None) -> str | None:
    """A warning that the figures are those of a sample of so many images; None where they are of all."""
    if images is None:
        return None
    return (
        f"The figures are those of a sample: {metrics.n_images} of {images} frames, chosen to be looked at. "
        "Those of the run are in metrics.json of the folder above."
    )


def few_images(metrics: Metrics) -> str | None:
    """A warning where the images are so few that the figures prove little; else None."""
    n = metrics.n_images
    if n >= FEW_IMAGES or not metrics.n_cars:
        return None
    images = "One image proves" if n == 1 else f"{n} images prove"
    return (
        f"{images} little: another {n} would give other figures. The intervals come from the same few "
        "images, so they are rough too."
    )


def tiles(metrics: Metrics) -> tuple[Tile, ...]:
    """False positives at a glance, a tile a detector."""
    shown = []
    for detector in metrics.detectors:
        first, last = _ends(metrics, detector)
        values = [_false_positives(row) for row in (first, last)]
        before, after = ("never" if v is None else number(v, 2) for v in values)
        found = _comparison(metrics, last)
        shown.append(
            Tile(
                detector_name(detector),
                detector_name(detector, short=True),
                before,
                after if last is not first else None,
                f"false positives per image at {LEVEL_TEXT} of the cars",
                "" if found is None else reduction_text(found.reduction.get(HEADLINE_RECALL)),
                never=values[0] is None and values[1] is None,
                worse=values[0] is not None and (values[1] is None or values[1] > values[0]),
            )
        )
    return tuple(shown)


def _clause(metrics: Metrics, detector: str, named: bool) -> str:
    """What became of one detector; ``named`` where the clause before has named what it was rescored with."""
    first, last = _ends(metrics, detector)
    name = detector_name(detector, short=True)
    before, after = _false_positives(first), _false_positives(last)
    if last is first and before is None:
        return f"{name} never gets there: its candidates hold {percent(first.recall_ceiling)} of them"
    if last is first:
        return f"{name} alone makes {number(before, 2)} false positives an image{_own_interval(first)}"
    if before is None or after is None:
        when = {(True, True): "before or after", (True, False): "before", (False, True): "after"}
        reached = when[before is None, after is None]
        return f"{name} never gets there {reached} rescoring{_precision(metrics, first, last)}"
    found = _comparison(metrics, last)
    times = "" if found is None else reduction_text(found.reduction.get(HEADLINE_RECALL))
    subject = "" if named else f"stereo depth ({last.mode}) takes "
    values = f"from {number(before, 2)} to {number(after, 2)} false positives an image"
    return f"{subject}{name} {values}" + (f", {times}" if times else "")


def _precision(metrics: Metrics, first: Row, last: Row) -> str:
    """The average precision in place of a rate that is never reached."""
    values = (number(row.average_precision) for row in (first, last))
    text = "average precision {} to {}".format(*values)
    found = _comparison(metrics, last)
    interval = None if found is None else found.average_precision_difference.interval
    if interval is not None:
        text += f", 95 % interval of the difference {interval[0]:+.3f} to {interval[1]:+.3f}"
    return f" ({text})"


def _own_interval(row: Row) -> str:
    """The interval of a row's false positives, where it is known."""
    ends = None if row.intervals is None else row.intervals.fppi_at_recall.get(HEADLINE_RECALL)
    if not ends:
        return ""
    return f" (95 % interval {number(ends[0], 2)} to {'infinity' if ends[1] is None else number(ends[1], 2)})"


def _false_positives(row: Row) -> float | None:
    return row.fppi_at_recall.get(HEADLINE_RECALL)


def _ends(metrics: Metrics, detector: str) -> tuple[Row, Row]:
    """The rows of a detector alone and of its last mode; one row twice where there is no other."""
    rows = [row for row in metrics.rows if row.detector == detector]
    return rows[0], rows[-1]


def _comparison(metrics: Metrics, row: Row) -> ModeComparison | None:
    for c in metrics.comparisons:
        if (c.detector, c.mode) == (row.detector, row.mode):
            return c
    return None


def _joined(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + ", and " + parts[-1]
