"""The page on the depth evidence: what it is worth, what it takes for a car, where it breaks."""

from collections.abc import Sequence
from pathlib import Path

from reports.pages import write_page
from reports.run.tables import Table, interval_text, number_text
from reports.studies.distractors import distractor_text
from reports.studies.sweep import losses_text
from rescore.results.sweep_file import SweepResult
from rescore.studies.ablation import AblationRow
from rescore.studies.distractors import BankResult


def write_evidence_page(
    folder: Path,
    command: str,
    distractors: BankResult,
    ablation: Sequence[AblationRow],
    sweep: SweepResult,
) -> Path:
    """Write README.md to a folder, arguments as for ``evidence_text``; returns the page."""
    return write_page(folder, evidence_text(command, distractors, ablation, sweep))


def evidence_text(
    command: str,
    distractors: BankResult,
    ablation: Sequence[AblationRow],
    sweep: SweepResult,
) -> str:
    """The page in Markdown; its pictures lie beside it and in ``sweep/``.

    Args:
        command: what made it.
        distractors: the bank of distractors, judged.
        ablation: the evidence without each of its parts.
        sweep: the input spoilt step by step.
    """
    parts = [
        "# Depth evidence: what it is worth, what fools it, where it breaks",
        f"Made by `{command}`. Detector: {sweep.detector}.",
        "## What it takes for a car",
        "Rendered streets with one thing each, through the stereo head and matcher of the data set; the box "
        "is that of the thing, jittered like a detector's. D is 0 for a car and 1 for anything else; eq. 6 "
        "(paper) has a scale of its own.",
        "![D by kind and mode](distractors.png)",
        distractor_text(distractors),
        "![One example of each kind with its disparity](examples.png)",
        "## What each part is worth",
        "The metric mode fitted again without some of its cues, w tuned again on the validation split; test "
        "split. Factor: false positives an image without them over those with all, where 70 % of the cars "
        "are found; above 1 they are worth something.",
        ablation_table(ablation).markdown().rstrip(),
        ablation_sentence(ablation),
        "## Where it breaks",
        f"The input of {sweep.n_images} test images spoilt step by step; tables and more curves in "
        "[sweep](sweep/README.md).",
        "![Times fewer false positives while the input is spoilt](sweep/reduction.png)",
        "Significant losses, where depth makes more false positives than the detector alone:",
        losses_text(sweep.dials),
        "Intervals of so few images are wide, so that a loss which is not significant is no proof that there "
        "is none: factors below 1 stand in the tables.",
        "The modes *guarded* and *metric* take a candidate to have no evidence where measurements are fewer, "
        "agree less with their neighbours or (metric) agree less with the ground plane of the whole picture "
        "than all but one in a hundred of those that they were fitted to. Eq. 6 has no such check.",
    ]
    return "\n\n".join(parts) + "\n"


def ablation_table(rows: Sequence[AblationRow]) -> Table:
    """A row a part that is left out."""
    text = [
        (
            row.without,
            str(row.n_cues),
            f"{row.w:.2f}",
            interval_text(row.fppi),
            number_text(row.auc.value, 4),
            interval_text(row.factor) if row.factor else "",
        )
        for row in rows
    ]
    return Table("", ("without", "cues", "w", "FP/image at 70 %", "area", "factor"), tuple(text))


def ablation_sentence(rows: Sequence[AblationRow]) -> str:
    """A sentence on the parts that are needed beyond chance."""
    needed = [row.without for row in rows if row.factor is not None and row.factor.low > 1]
    harmful = [row.without for row in rows if row.factor is not None and row.factor.high < 1]
    said = [f"Worse without, beyond the interval: {', '.join(needed) or 'none'}."]
    said.append(f"Better without: {', '.join(harmful) or 'none'}.")
    said.append(
        "No allowance is made for the number of rows, so one in forty is expected by chance each way."
    )
    return " ".join(said)
