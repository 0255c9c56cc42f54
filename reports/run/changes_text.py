"""What rescoring changed in a run folder, as text: a summary, a table, and lines for other tools."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from recon.arrays import IntArray
from recon.errors import RescoreError
from reports.palette import detector_name
from reports.run.tables import number
from rescore.evidence.candidates import OK
from rescore.evidence.car_share import as_used_for
from rescore.evidence.model import EvidenceModel, load_models
from rescore.evidence.registration import LEARNED
from rescore.results.candidate_file import ALONE, difference, status
from rescore.results.changes import Group, OperatingPoint
from rescore.results.explain import ExplainConfig, cues_of
from rescore.results.ranked_changes import Inspection
from rescore.results.run_folder import Run

GROUP_TEXT = {
    Group.LOST_CAR: "car lost",
    Group.GAINED_CAR: "car gained",
    Group.SWAPPED_CAR: "car lost, another gained",
    Group.REJECTED_FALSE_ALARM: "false alarm gone",
    Group.ACCEPTED_FALSE_ALARM: "new false alarm",
    Group.MOVED_HIT: "other box of a car",
    Group.KEPT_CAR: "car kept",
    Group.KEPT_FALSE_ALARM: "false alarm kept",
    Group.REJECTED: "below the threshold",
    Group.IGNORED: "not judged",
}
"""Words for each group, for people."""
PLAIN_COLUMNS = (
    *("image_id", "rank", "rank_after", "place_before", "place_after", "delta", "loss"),
    *("score_before", "score_after", "depth_difference", "group", "outcome_after", "kind", "reason"),
)
"""Columns of the lines for other tools, as ``Inspection.columns`` names them."""
WIDE = 120
"""Number of columns below which a terminal has no room for rank and scores."""


def inspect_run(
    run: Run,
    detector: str | None = None,
    mode: str | None = None,
    point: OperatingPoint | None = None,
    evidence_model: Path | None = None,
    explained: bool = True,
) -> Inspection:
    """The changes of one detector in one mode of a run, explained.

    Args:
        run: the run folder.
        detector: None for the first of the run.
        mode: None for the detector's last one, which is that of the most evidence.
        point: the points of the two curves; None for ``rescore.results.changes.default_point``.
        evidence_model: file of the models that made D; None for that of the run folder, if there is one.
        explained: whether the parts of D are told; else D alone, whatever made it.

    Raises:
        RescoreError: no such detector or mode, the point is never reached, or the model is another.
    """
    detector = _known("--detector", detector, run.detectors, 0)
    modes = [row.mode for row in run.metrics.rows if row.detector == detector]
    rescored = tuple(m for m in modes if m != ALONE)
    if not rescored:
        raise RescoreError(
            f"{run.root}: expected {detector} to be rescored, got the detector alone; `rescore apply`, then "
            "evaluate what it wrote"
        )
    mode = _known("--mode", mode, rescored, -1)
    return Inspection.of(
        run.of(detector),
        mode,
        run.metrics.n_images,
        run.metrics.n_cars,
        point,
        model_of(run, detector, mode, evidence_model) if explained else None,
        explain_config(run),
    )


def _known(option: str, chosen: str | None, known: tuple[str, ...], default: int) -> str:
    if chosen is None:
        return known[default]
    if chosen not in known:
        raise RescoreError(f"{option}: expected {' or '.join(known)}, got {chosen!r}; choose one of these")
    return chosen


def model_of(run: Run, detector: str, mode: str, file: Path | None = None) -> EvidenceModel | None:
    """The model of depth evidence that made D of a mode: from the file, or else from the run folder.

    None where neither is.

    Raises:
        RescoreError: the file has no model of the mode.
    """
    if mode not in list(LEARNED):
        return None
    own = run.folder.evidence_model(detector)
    if file is None and not own.is_file():
        return None
    path = file or own
    models = {str(m): model for m, model in load_models(path).items()}
    if mode not in models:
        raise RescoreError(f"{path}: expected a model for {mode}, got {', '.join(models)}; name another file")
    rows = run.of(detector)
    # a candidate without evidence has the D of silent cues, which is none of its own
    d = np.where(status(rows, mode) == OK, difference(rows, mode), np.nan)
    return as_used_for(models[mode], cues_of(rows), d)


def explain_config(run: Run) -> ExplainConfig:
    """Settings of a run that the words need; without them sizes are told as multiples of a car's."""
    cues = run.config.config.cues
    if cues is None:
        return ExplainConfig(height_m=None)
    return ExplainConfig(cues.surroundings.size_m[2], cues.guarded.scale_limits)


def summary(inspection: Inspection) -> str:
    """What changed, in one sentence."""
    c, match = inspection.changes, inspection.changes.after.match
    name = f"{detector_name(inspection.detector, short=True)}, {inspection.mode}"
    if not match.n_cars:
        return (
            f"{name}: no car is annotated, so that nothing is right or wrong; {len(c.group)} candidates by "
            "how far they moved"
        )
    t = c.tally
    turned = [
        f", {count} {text}"
        for count, text in (
            (t.became_hit, "became the hit of its car"),
            (t.became_false, "a second box now"),
        )
        if count
    ]
    per_image = "{:.2f} to {:.2f} an image".format(
        *(n / max(match.n_images, 1) for n in (t.false_before, t.false_after))
    )
    return (
        f"{name}, at {c.point.text}: "
        f"{t.newly_rejected} of {t.false_before} false alarms gone, {t.newly_accepted} new"
        f"{''.join(turned)}: {t.false_after} left ({per_image}); cars found {t.cars_before} to "
        f"{t.cars_after} of {match.n_cars}, {t.gained} gained, {t.lost} lost, {t.moved} by another box"
    )


def note(inspection: Inspection) -> str | None:
    """What a reader should know of the reasons; None where there is nothing."""
    if inspection.mode in list(LEARNED) and not any(e.parts for e in inspection.explanations):
        return (
            "which parts of the evidence made D is not known: --evidence-model names the file given to "
            "`rescore apply`"
        )
    return None


def terminal_table(inspection: Inspection, rows: IntArray, width: int) -> Table:
    """The listed candidates for a terminal of this many columns."""
    columns = inspection.columns()
    wide = width >= WIDE
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), caption_justify="left")
    table.caption = (
        "place: among all candidates of the test set. D: 0 a car, 1 none. In brackets: where the numbers of "
        "cars lie."
    )
    for name in ("frame", *(("in frame", "l", "score") if wide else ()), "place"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("change", min_width=12, max_width=22)
    table.add_column("reason", ratio=1)
    for i in rows:
        more = (
            f"{columns['rank'][i] + 1} → {columns['rank_after'][i] + 1}",
            number(float(columns["score_before"][i])),
            number(float(columns["score_after"][i])),
        )
        place = f"{columns['place_before'][i]} → {columns['place_after'][i]}"
        kind = str(columns["kind"][i] or "").replace("_", " ")
        change = GROUP_TEXT[inspection.changes.group[i]] + (f" ({kind})" if kind else "")
        cells = (str(columns["image_id"][i]), *(more if wide else ()), place, change, columns["reason"][i])
        # text from files is no markup
        table.add_row(*(Text(cell) for cell in cells))
    return table


def plain_lines(inspection: Inspection, rows: IntArray) -> Iterator[str]:
    """A header and a line a candidate, separated by tabs; columns ``PLAIN_COLUMNS``."""
    columns = inspection.columns()
    yield "\t".join(PLAIN_COLUMNS)
    for i in rows:
        yield "\t".join(_plain(columns[name][i]) for name in PLAIN_COLUMNS)


def _plain(value: Any) -> str:
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    return " ".join(str("" if value is None else value).split())
