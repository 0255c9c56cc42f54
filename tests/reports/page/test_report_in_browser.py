"""The report as a browser shows it; needs Debian's chromium, which `make test` installs where it may."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from recon.errors import RescoreError
from reports.page.report import build_report
from reports.publishing.browser import CHROMIUM, BrowserPage, open_browser
from rescore.results.run_folder import Run

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="needs a browser: apt-get install --no-install-recommends chromium"
)

SHOWN = "[...document.querySelectorAll('.card')].filter(c => !c.hidden)"
DRAWN = "document.querySelectorAll('#r0-curves .kind:not([hidden]) .plot path.line').length"


@pytest.fixture(scope="module")
def reports(run: Run, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("reports")
    shutil.copytree(run.root, folder / "other")
    both = build_report([run.root, folder / "other"], folder / "both.html")
    return build_report(run.root, folder / "one.html"), both


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserPage]:
    with open_browser() as page:
        yield page


@pytest.fixture
def page(browser: BrowserPage, reports: tuple[Path, Path]) -> Iterator[BrowserPage]:
    """The report of one run, freshly opened; at the end nothing must have been complained of."""
    browser.requests.clear()
    browser.complaints.clear()
    browser.open(reports[0])
    browser.wait_until("document.querySelectorAll('.plot svg').length >= 6")
    yield browser
    assert browser.complaints == []
    assert {url.split(":")[0] for url in browser.requests} <= {"file"}
    assert len(browser.requests) >= 1


def press(page: BrowserPage, selector: str) -> None:
    page.run(f"document.querySelector({selector!r}).click()")


def test_every_chart_in_sight_has_its_curves(page: BrowserPage):
    # the detector alone and the last mode, of two detectors
    assert page.run(DRAWN) == 4
    assert page.run("document.querySelectorAll('#r0-curves .kind:not([hidden]) path.area').length") == 4
    lengths = page.run("[...document.querySelectorAll('.plot path.line')].map(p => p.getTotalLength())")
    assert min(lengths) > 50
    for name, lines in (("weight", 2), ("reliability", 4)):
        assert page.run(f"document.querySelectorAll('#r0-{name} .plot > svg path.line').length") == lines


def test_modes_bands_and_axes_can_be_switched(page: BrowserPage):
    press(page, "#r0-curves [data-tag=detector]")
    assert page.run(DRAWN) == 2
    press(page, "#r0-curves [data-bands]")
    assert page.run("document.querySelectorAll('#r0-curves .area').length") == 0
    ticks = "[...document.querySelectorAll('#r0-curves-0-0 text')].map(t => t.textContent)"
    assert "0" not in page.run(ticks)
    press(page, "#r0-curves [data-log]")
    assert "0" in page.run(ticks)
    press(page, "#r0-curves button[data-kind='1']")
    page.wait_until(f"{DRAWN} === 2")
    assert page.run("document.querySelectorAll('.plot .diagonal').length") == 4
    assert page.run("document.querySelector('#r0-curves [data-log]').hidden")


def test_thresholds_are_read_off_with_the_keyboard(page: BrowserPage, run: Run):
    page.run("document.querySelector('#r0-curves-0-0').focus()")
    page.press("End", 35)
    said = page.run("document.querySelector('#r0-curves-0-0 .tip').textContent")
    # at the right end all candidates count
    ceiling = run.row("hog", "detector").recall_ceiling
    lowest = run.of("hog")["likelihood"].min()
    assert f"detector alone{100 * ceiling:.1f} %threshold {lowest:.4f}" in said
    page.press("Home", 36)
    assert "threshold" in page.run("document.querySelector('#r0-curves-0-0 .tip').textContent")
    page.press("Escape", 27)
    assert page.run("document.querySelector('#r0-curves-0-0 .tip').hidden")


def test_filters_leave_what_they_say(page: BrowserPage):
    total = page.run("document.querySelectorAll('.card').length")
    choose = (
        "(s => {{ s.value = '{1}'; s.dispatchEvent(new Event('change')); }})"
        "(document.querySelector('select[data-filter={0}]'))"
    )
    for name, value in (("move", "loss"), ("detector", "hog"), ("outcome", "false alarm")):
        page.run(choose.format(name, value))
        assert page.run(f"{SHOWN}.every(c => c.dataset.{name} === '{value}')")
    left = page.run(f"{SHOWN}.length")
    assert 0 < left < total
    assert page.run("document.querySelector('.count').textContent") == f"{left} of {total} candidates"
    press(page, "[data-reset]")
    assert page.run(f"{SHOWN}.length") == min(total, 12)
    if total > 12:
        press(page, "[data-more]")
        assert page.run(f"{SHOWN}.length") == total


def test_a_card_opens_large_pictures_with_the_keyboard(page: BrowserPage):
    page.run("document.querySelector('.card button').focus()")
    page.press("Enter", 13, "\r")
    page.wait_until("document.querySelector('dialog').open")
    title = "document.querySelector('#large-title').textContent"
    first = page.run(title)
    assert first == page.run(f"{SHOWN}[0].querySelector('h3').textContent")
    assert page.run("document.querySelectorAll('dialog img').length") == 5
    loaded = "[...document.querySelectorAll('dialog img')].every(i => i.complete && i.naturalWidth > 0)"
    page.wait_until(loaded)
    page.press("ArrowRight", 39)
    assert page.run(title) == page.run(f"{SHOWN}[1].querySelector('h3').textContent")
    page.press("Escape", 27)
    page.wait_until("!document.querySelector('dialog').open")
    page.wait_until(f"document.activeElement === {SHOWN}[1].querySelector('button')")


def test_themes_follow_the_system_and_the_switch(page: BrowserPage, reports: tuple[Path, Path]):
    ground = "getComputedStyle(document.body).backgroundColor"
    light = page.run(ground)
    press(page, "[data-set-theme=dark]")
    dark = page.run(ground)
    assert dark != light
    press(page, "[data-set-theme=auto]")
    assert page.run(ground) == light
    page.open(reports[0], dark=True)
    assert page.run(ground) == dark


@pytest.mark.parametrize("width_px", [1200, 900, 768, 390])
@pytest.mark.parametrize("several", [False, True])
def test_nothing_is_wider_than_the_window(
    page: BrowserPage, reports: tuple[Path, Path], width_px: int, several: bool
):
    page.open(reports[several], width_px)
    page.wait_until("document.querySelectorAll('.plot svg').length >= 6")
    assert page.run("document.documentElement.scrollWidth") <= width_px
    cut = (
        "[...document.querySelectorAll('table.wide')]"
        ".filter(t => t.offsetWidth > t.parentElement.clientWidth).map(t => t.id)"
    )
    if width_px > 860:
        assert page.run(cut) == []


def test_on_a_phone_tables_stay_tables_that_scroll(page: BrowserPage, reports: tuple[Path, Path]):
    page.open(reports[0], 390, 844)
    page.wait_until("document.querySelectorAll('.plot svg').length >= 6")
    table = "document.querySelector('#r0-results')"
    assert page.run(f"getComputedStyle({table}.rows[1]).display") == "table-row"
    # a row is a line or two, also where the detector's name is that of the row above
    assert page.run(f"Math.max(...[...{table}.tBodies[0].rows].map(r => r.offsetHeight))") < 90
    assert page.run(f"{table}.rows[2].offsetHeight") < 40
    assert page.run(f"{table}.offsetWidth > {table}.parentElement.clientWidth")
    # the first column stays in sight while the others scroll
    page.run(f"{table}.parentElement.scrollLeft = 200")
    assert page.run(f"{table}.rows[1].cells[0].getBoundingClientRect().left") < 30
    assert page.run("document.documentElement.scrollHeight") < 12_000


def test_the_first_screen_has_sentence_curves_and_three_candidates(
    page: BrowserPage, reports: tuple[Path, Path]
):
    page.open(reports[0], 1280, 800)
    page.wait_until("document.querySelectorAll('.plot svg').length >= 6")
    page.wait_until("[...document.querySelectorAll('.brief img')].every(i => i.complete)")
    bottom = "(e => e.getBoundingClientRect().bottom)(document.querySelector('{}'))"
    ends = [page.run(bottom.format(part)) for part in (".result", "#r0-curves .charts", ".briefs")]
    assert ends == sorted(ends)
    assert ends[-1] <= 800
    assert page.run("document.querySelectorAll('.brief').length") == 3
    assert page.run(DRAWN) == 4


def test_a_telling_candidate_opens_its_large_pictures(page: BrowserPage):
    press(page, ".brief button")
    page.wait_until("document.querySelector('dialog').open")
    title = page.run("document.querySelector('#large-title').textContent")
    assert title == page.run("document.querySelector('.brief h3').title")
    page.press("Escape", 27)
    page.wait_until("document.activeElement === document.querySelector('.brief button')")


def test_paper_gets_all_kinds_of_curves(page: BrowserPage):
    assert page.pdf().startswith(b"%PDF")
    # drawn for the paper although out of sight on the screen
    assert page.run("document.querySelectorAll('#r0-curves-2-1 path.line').length") == 2


def test_a_missing_page_is_an_error(browser: BrowserPage, tmp_path: Path):
    with pytest.raises(RescoreError, match="expected a page, got"):
        browser.open(tmp_path / "none.html")


def test_a_script_that_throws_is_an_error(page: BrowserPage):
    with pytest.raises(RescoreError, match="TypeError"):
        page.run("null.x")
