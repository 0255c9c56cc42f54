"""Figures in README and docs are those of the published JSON, and no other figure stands in the README."""

import re
from pathlib import Path

import pytest

from recon.errors import RescoreError
from reports.publishing import prose
from reports.publishing.prose import PAGES, fragment, marks, with_fragments
from reports.run.tables import (
    comparison_table,
    difficulty_table,
    fusion_table,
    reliability_table,
    result_table,
    stereo_table,
    weight_table,
)
from reports.studies.published import study_pages
from rescore.results.metrics_file import read_metrics
from tests.conftest import ROOT

PUBLISHED = ROOT / "reports" / "published"
WRITE = "run `python -m reports.publishing.prose`"

CONSTANTS = {
    **dict.fromkeys(("12", "3.11", "2"), "versions that it runs on, and of ROS"),
    **dict.fromkeys(("6", "7"), "equations"),
    **dict.fromkeys(("3", "4"), "sections of the report"),
    **dict.fromkeys(("15",), "candidates an image"),
    **dict.fromkeys(("109", "127", "20"), "the report's protocol: images and cars of preset paper"),
    **dict.fromkeys(("95 %",), "level of intervals"),
}
"""Numbers in the README that are no results, with what they are."""


@pytest.mark.parametrize("page", PAGES)
def test_pages_say_what_the_published_files_say(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert with_fragments(page, text) == text, WRITE


def test_pages_of_studies_say_what_their_json_says() -> None:
    for path, text in study_pages(PUBLISHED):
        assert path.read_text(encoding="utf-8") == text, f"{path.relative_to(ROOT)}: {WRITE}"


@pytest.mark.parametrize("name", ["roc", "streets"])
def test_tables_of_a_published_run_are_those_of_its_metrics(name: str) -> None:
    page = (PUBLISHED / name / "README.md").read_text(encoding="utf-8")
    metrics = read_metrics(PUBLISHED / name / "metrics.json")
    tables = [
        result_table(metrics),
        comparison_table(metrics),
        fusion_table(metrics),
        weight_table(metrics),
        reliability_table(metrics),
        difficulty_table(metrics.difficulty),
        stereo_table(metrics.stereo),
    ]
    assert len([t for t in tables if t is not None]) >= 6
    for table in tables:
        if table is not None:
            assert table.markdown() in page, table.title


def outside_fragments(page: str) -> str:
    """The prose of a page without fragments, code, pictures, comments and the targets of links."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for name in PAGES.get(page, ()):
        begin, end = marks(name)
        text = re.sub(f"{re.escape(begin)}.*?{re.escape(end)}", "", text, flags=re.DOTALL)
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`]*`|!\[[^\]]*\]\([^)]*\)|\]\([^)]*\)|<!--.*?-->", "", text)


def numbers_in(text: str) -> set[str]:
    """Numbers of a text with their sign of per cent; those that are part of a word are names."""
    return {" ".join(n.split()) for n in re.findall(r"(?<![\w.-])\d+(?:\.\d+)?(?:\s?%)?(?![\w])", text)}


def test_no_figure_of_the_readme_is_written_by_hand() -> None:
    left = numbers_in(outside_fragments("README.md"))
    assert left <= set(CONSTANTS), f"{sorted(left - set(CONSTANTS))}: put them into a fragment"
    # what the fragments hold would be seen
    assert not numbers_in(fragment("localization", "README.md")) <= set(CONSTANTS)


HAND_KEPT = {
    # settings: a factor, a distance between scores, the spread of modelled boxes
    "docs/boxes3d.md": {"0.033", "0.003"},
    "docs/detectors.md": {"0.067", "0.045"},
    # what one setting changed, on frames and fits that are not kept
    "docs/evidence.md": {"0.918", "0.926"},
}
"""Numbers of three digits after the point, the form of areas and precisions, that docs hold by themselves."""


@pytest.mark.parametrize("page", sorted(p.relative_to(ROOT).as_posix() for p in (ROOT / "docs").glob("*.md")))
def test_areas_and_precisions_in_docs_come_from_files(page: str) -> None:
    found = set(re.findall(r"(?<![\w.])\d?\.\d{3}(?!\d)", outside_fragments(page)))
    assert found <= HAND_KEPT.get(page, set()), f"{page}: put them into a fragment"


def test_a_table_ends_before_the_words_after_it() -> None:
    for page, names in PAGES.items():
        for name in names:
            assert not re.search(r"^\|.*\n(?![|\n])", fragment(name, page), flags=re.MULTILINE), name


def test_preset_paper_has_the_counts_that_the_readme_tells() -> None:
    roc = read_metrics(PUBLISHED / "roc" / "metrics.json")
    assert f"({roc.n_images} test images, {roc.n_cars} annotated cars" in outside_fragments("README.md")


def test_another_figure_gives_another_text(monkeypatch: pytest.MonkeyPatch) -> None:
    before = fragment("localization", "README.md")
    figures = dict(prose._figures())
    changed = figures["localization"]
    changed = type(changed)(**vars(changed) | {"n": 12345})
    monkeypatch.setattr(prose, "_figures", lambda: figures | {"localization": changed})
    after = fragment("localization", "README.md")
    assert after.split() == before.replace("200 placements", "12345 placements").split()


def test_links_of_a_fragment_lead_from_its_page() -> None:
    assert "(docs/glossary.md#3dp)" in fragment("localization", "README.md")
    assert "(glossary.md#3dp)" in fragment("localization", "docs/class-models.md")


def test_a_number_is_not_parted_from_its_sign() -> None:
    for page, names in PAGES.items():
        for name in names:
            assert not re.search(r"\d\n%", fragment(name, page))


def test_a_page_without_the_marks_is_refused() -> None:
    with pytest.raises(RescoreError, match=r"README.md: expected the marks .*caption.* found none"):
        with_fragments("README.md", "nothing")


def test_only_pages_that_changed_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "docs" / "class-models.md"
    page.parent.mkdir()
    begin, end = marks("localization")
    page.write_text(f"before\n\n{begin}\nold\n{end}\n\nafter\n")
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    monkeypatch.setattr(prose, "PAGES", {"docs/class-models.md": ("localization",)})
    assert prose.write_prose() == [page]
    text = page.read_text()
    assert "old" not in text
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert prose.write_prose() == []
