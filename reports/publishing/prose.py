"""The figures in README and docs, from the published files: ``python -m reports.publishing.prose``.

A block of a page between the marks of a fragment is what the fragment's template says of the published JSON,
so that no figure is written by hand. Pages of studies whose text comes of their JSON alone are written anew.
"""

import re
import textwrap
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from recon.errors import RescoreError
from recon.files import atomic_path
from reports.publishing.real_figures import figures_table, read_figures
from reports.run.reductions import reduction_cell
from reports.run.tables import LEVEL, RECALLS, Table, number
from reports.studies.published import study_figures, study_pages
from reports.templating import render
from rescore.files import read_json_object
from rescore.results.candidate_file import ALONE
from rescore.results.metrics_file import Metrics, ModeComparison, Row, read_metrics

ROOT = Path(__file__).resolve().parents[2]
PUBLISHED = ROOT / "reports" / "published"
PAGES = {
    "README.md": ("caption", "real", "paper", "more", "localization", "grasping", "limits"),
    "docs/class-models.md": ("localization",),
    "docs/grasping.md": ("grasping",),
    "docs/detectors.md": ("uiuc", "uiuc_intervals", "view_detectors", "modelled_detector"),
    "docs/boxes3d.md": ("second_boxes",),
    "docs/evidence.md": ("even_odds", "guarded_checks", "guarded_steps", "places"),
    "docs/own-data.md": ("strong_detector",),
    "docs/stereo.md": ("ground_from_stereo",),
    "docs/predicted-depth.md": ("true_depth",),
}
"""The fragments of each page."""
_WIDTH = 120
_MODE_NAMES = {ALONE: "alone", "paper": "paper (eq. 6)"}
_DETECTOR_NAMES = {"hog": "HOG + SVM", "boosted": "boosted fragments"}


def marks(name: str) -> tuple[str, str]:
    """What stands before and after a fragment in a page."""
    return f"<!-- {name}: from published figures -->", f"<!-- {name}: end -->"


def fragment(name: str, page: str) -> str:
    """The text of a fragment in a page."""
    up = "" if page == "README.md" else "../"
    links = {"docs": "docs/" if page == "README.md" else "", "published": f"{up}reports/published"}
    return _filled(render("reports.publishing", f"prose/{name}.md.j2", **_figures(), **links))


def with_fragments(page: str, text: str) -> str:
    """The text of a page with all its fragments as the published files have them.

    Raises:
        RescoreError: the page lacks the marks of one.
    """
    for name in PAGES[page]:
        begin, end = marks(name)
        marked = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
        if not marked.search(text):
            raise RescoreError(f"{page}: expected the marks {begin} and {end}, found none; put them back")
        shown = f"{begin}\n\n{fragment(name, page)}\n\n{end}"
        # text given to re.sub would have its backslashes read
        text = shown.join(marked.split(text))
    return text


def write_prose() -> list[Path]:
    """Write all pages anew; returns those that changed."""
    texts = {ROOT / page: with_fragments(page, (ROOT / page).read_text(encoding="utf-8")) for page in PAGES}
    changed = []
    for path, text in (*texts.items(), *study_pages(PUBLISHED)):
        if path.read_text(encoding="utf-8") == text:
            continue
        with atomic_path(path) as beside:
            beside.write_text(text, encoding="utf-8")
        changed.append(path)
    return changed


@cache
def _figures() -> Mapping[str, Any]:
    """What templates may name."""
    roc = read_metrics(PUBLISHED / "roc" / "metrics.json")
    return {
        "roc": roc,
        "roc_config": read_json_object(PUBLISHED / "roc" / "config.json", "settings")["config"],
        "roc_table": _roc_table(roc).markdown(),
        "real": read_figures(PUBLISHED / "streets" / "real.json"),
        "real_table": figures_table(read_figures(PUBLISHED / "streets" / "real.json")).markdown(),
        "measured": read_json_object(PUBLISHED / "measured" / "measured.json", "measured figures"),
        **study_figures(PUBLISHED),
        "percent": lambda share, digits=1: f"{100 * share:.{digits}f} %",
        "number": number,
        "factor": lambda detector, mode, bare=False: _factor(_comparison(roc, detector, mode), bare),
    }


def _roc_table(metrics: Metrics) -> Table:
    first, *others = (f"{100 * float(r):.0f} %" for r in RECALLS)
    level = f"{100 * float(LEVEL):.0f} %"
    head = (
        *("detector, depth", "w", "area (ROC)", "average precision"),
        *(f"FP/image at {first}", *others[:-1], f"{others[-1]} of all cars"),
        f"fewer FP at {level}, times (95 %)",
    )
    return Table("", head, tuple(_roc_row(metrics, row) for row in metrics.rows))


def _roc_row(metrics: Metrics, row: Row) -> tuple[str, ...]:
    detector, mode = _DETECTOR_NAMES[row.detector], _MODE_NAMES.get(row.mode, row.mode)
    alone = row.mode == ALONE
    return (
        f"{detector}, {mode}",
        number(row.w, 2),
        number(row.auc),
        number(row.average_precision),
        *(number(row.fppi_at_recall.get(r), 2) for r in RECALLS),
        "" if alone else reduction_cell(_comparison(metrics, row.detector, row.mode).reduction[LEVEL]),
    )


def _comparison(metrics: Metrics, detector: str, mode: str) -> ModeComparison:
    return next(c for c in metrics.comparisons if (c.detector, c.mode) == (detector, mode))


def _factor(comparison: ModeComparison, bare: bool) -> str:
    """The factor at 70 % of the cars with one digit; ``bare``: without the flat pictures of cars."""
    found = comparison.reduction_without_pictures if bare else comparison.reduction
    value = (found or {})[LEVEL].value
    return "infinitely many" if value is None else f"{value:.1f}"


def _filled(text: str) -> str:
    """The text with its paragraphs and items in lines of one width; tables and pictures stay as they are."""
    blocks = [block.strip("\n") for block in re.split(r"\n{2,}", text.strip())]
    return "\n\n".join(_filled_block(block) for block in blocks)


def _filled_block(block: str) -> str:
    if block.startswith(("|", "![")):
        return block
    # a number and its sign of per cent stay on one line
    parts = re.split(r"\n(?=- )", block.replace(" %", "\N{NO-BREAK SPACE}%"))
    filled = "\n".join(
        textwrap.fill(
            re.sub(r"[ \n]+", " ", part).strip(),
            _WIDTH,
            subsequent_indent="  " if part.startswith("- ") else "",
            break_long_words=False,
            break_on_hyphens=False,
        )
        for part in parts
    )
    return filled.replace("\N{NO-BREAK SPACE}", " ")


if __name__ == "__main__":
    for written in write_prose():
        print(written.relative_to(ROOT))
