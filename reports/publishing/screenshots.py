"""Pictures of the report for the repository: ``python -m reports.publishing.screenshots RUN FOLDER COMMAND``.

Needs Debian's chromium. The page is made anew from the run folder, which stays as it is.
"""

import io
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from recon.files import atomic_path
from reports.page.report import build_report
from reports.pages import write_page
from reports.publishing.browser import BrowserPage, open_browser

_DESKTOP = (1280, 800)
_PHONE = (390, 844)
_QUALITY = 88
_GAP_PX = 24
_PHONE_SCALE = 0.75
_DRAWN = "[...document.querySelectorAll('.kind:not([hidden]) .plot')].every(p => p.querySelector('svg'))"


@dataclass(frozen=True)
class Shot:
    """One picture: what is scrolled to, side by side where there are several."""

    name: str
    text: str
    """Description of the picture, for people who do not see it and for the line below it."""
    size_px: tuple[int, int]
    dark: bool
    places: tuple[str, ...]
    """Selectors of what comes to the top of the window; "" for the top of the page."""
    card: bool = False
    """Whether the large pictures of the first candidate are open."""


_TOP, _CURVES, _NUMBERS, _TUNING = "", "#r0-curves", "#r0-numbers", "#r0-tuning"
_GALLERY, _CARDS = "#r0-moves", ".count"
_RESULT = "The first screen: the result, curves with bands of 95 %, three telling candidates"
_LARGE = "One candidate: picture, depths, residual, numbers and reason"
SHOTS = (
    Shot("desktop_light", _RESULT, _DESKTOP, False, (_TOP,)),
    Shot("desktop_dark", "The same on a dark page", _DESKTOP, True, (_TOP,)),
    Shot("gallery", "Largest gains and worst losses, with the reason for each", _DESKTOP, False, (_GALLERY,)),
    Shot("candidate", _LARGE, (1280, 800), True, (_GALLERY,), card=True),
    Shot("tuning", "The objective over w, with the interval of w", _DESKTOP, False, (_TUNING,)),
    Shot("phone_light", "On a phone", _PHONE, False, (_TOP, _CURVES, _CARDS)),
    Shot("phone_dark", "On a phone, dark", _PHONE, True, (_TOP, _CURVES, _NUMBERS)),
)


def write_screenshots(run_dir: Path, folder: Path, command: str) -> Path:
    """Photograph the report of a run into a folder, with a page that shows the pictures; returns the page.

    Args:
        run_dir: a finished run.
        folder: where to write; made where it is missing.
        command: what makes the pictures, for the page.

    Raises:
        RescoreError: no browser is installed, or the run lacks results.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place, open_browser() as page:
        report = build_report(run_dir, Path(place) / "report.html")
        for shot in SHOTS:
            with atomic_path(folder / f"{shot.name}.webp") as beside:
                _photograph(page, report, shot).save(beside, "WEBP", quality=_QUALITY)
    return write_page(folder, _page_text(command))


def _photograph(page: BrowserPage, report: Path, shot: Shot) -> Image.Image:
    parts = list(_views(page, report, shot))
    if len(parts) == 1:
        return parts[0]
    parts = [p.resize((round(p.width * _PHONE_SCALE), round(p.height * _PHONE_SCALE))) for p in parts]
    width = sum(p.width for p in parts) + _GAP_PX * (len(parts) - 1)
    whole = Image.new("RGB", (width, parts[0].height), (128, 128, 128))
    left = 0
    for part in parts:
        whole.paste(part, (left, 0))
        left += part.width + _GAP_PX
    return whole


def _views(page: BrowserPage, report: Path, shot: Shot) -> Iterator[Image.Image]:
    page.open(report, *shot.size_px, dark=shot.dark)
    page.wait_until(_DRAWN)
    for selector in shot.places:
        if selector:
            page.run(f"document.querySelector({selector!r}).scrollIntoView({{behavior: 'instant'}})")
        if shot.card:
            page.run("document.querySelector('.card button').click()")
        page.wait_until("[...document.images].every(i => i.complete)")
        yield Image.open(io.BytesIO(page.picture())).convert("RGB")


def _page_text(command: str) -> str:
    parts = [
        "# The report",
        "Pictures of the page that `rescore report RUN` writes, one HTML file for offline use. "
        f"Made by `{command}`.",
        *(f"![{shot.text}]({shot.name}.webp)\n\n{shot.text}." for shot in SHOTS),
    ]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    print(write_screenshots(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
