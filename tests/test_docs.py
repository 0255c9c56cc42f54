"""README and docs name what is there: links, headings, paths, modules, the public surface, versions."""

import importlib
import re
import runpy
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT

PACKAGES = ("recon", "rescore", "datasets_synth", "reports")
PAGES = (
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "reports" / "published").rglob("*.md")),
)
WRITTEN = tuple(p for p in PAGES if "published" not in p.parts)
"""Pages that people write; the published ones are made by commands, with the paths of their day."""
FILES = {
    p.relative_to(ROOT).as_posix()
    for folder in (*PACKAGES, "tests", "docs", "examples")
    for p in (ROOT / folder).rglob("*")
    if p.is_file() and "__pycache__" not in p.parts
}


def by_name(pages: tuple[Path, ...]) -> Any:
    return pytest.mark.parametrize("page", pages, ids=lambda p: str(p.relative_to(ROOT)))


def prose(page: Path) -> str:
    """The text without blocks of code."""
    return re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)


def links(page: Path) -> Iterator[tuple[str, str]]:
    """File and anchor of each link that stays in the repository."""
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if not re.match(r"[a-z]+:", target):
            file, _, anchor = target.partition("#")
            yield file, anchor


def in_code(page: Path, form: str) -> list[str]:
    """What stands in backticks, alone, and has a form."""
    return [m for m in re.findall(r"`([^`\n]+)`", prose(page)) if re.fullmatch(form, m)]


@cache
def anchors(page: Path) -> frozenset[str]:
    """Anchors of the headings of a page, as GitHub makes them."""
    found: Counter[str] = Counter()
    out = set()
    for heading in re.findall(r"^#+ (.+)$", prose(page), flags=re.MULTILINE):
        slug = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        out.add(f"{slug}-{found[slug]}" if found[slug] else slug)
        found[slug] += 1
    return frozenset(out)


@by_name(PAGES)
def test_links_lead_somewhere(page: Path) -> None:
    for file, anchor in links(page):
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), f"{file} is not there"
        if anchor:
            assert anchor in anchors(target), f"{file}#{anchor}: no such heading"


@by_name(WRITTEN)
def test_files_and_folders_in_backticks_are_there(page: Path) -> None:
    names = {Path(f).name for f in FILES}
    for path in in_code(page, r"[\w./-]+\.(py|css|js|j2|svg)"):
        assert path in (FILES if "/" in path else names), path
    inside = "|".join((*PACKAGES, "tests", "docs", "examples"))
    for folder in in_code(page, rf"({inside})/([\w-]+/)*"):
        assert (ROOT / folder).is_dir(), folder


@by_name(WRITTEN)
def test_dotted_names_in_backticks_can_be_imported(page: Path) -> None:
    for name in in_code(page, rf"({'|'.join(PACKAGES)})(\.\w+)+"):
        if name.endswith(".json"):
            continue
        importable(name)


def importable(name: str) -> None:
    """Import a module, or a module and look its member up; fails where neither is there."""
    module, _, member = name.rpartition(".")
    if member[0].isupper():
        assert hasattr(importlib.import_module(module), member), name
    else:
        importlib.import_module(name)


def test_the_glossary_defines_each_word_once() -> None:
    words = re.findall(r"^### (.+)$", (ROOT / "docs" / "glossary.md").read_text(), flags=re.MULTILINE)
    assert len(words) > 40
    assert [w for w, n in Counter(w.casefold() for w in words).items() if n > 1] == []


def test_every_word_that_a_newcomer_meets_is_linked_from_the_readme() -> None:
    linked = {anchor for file, anchor in links(ROOT / "README.md") if file == "docs/glossary.md"}
    asked = {"candidate", "a1-and-a2", "platt-scaling", "view-bin", "3dp", "fragments", "d", "w"}
    assert asked <= linked


def test_the_picture_is_what_its_script_draws() -> None:
    drawn = runpy.run_path(str(ROOT / "docs" / "flow.py"))["draw"]()
    assert (ROOT / "docs" / "flow.svg").read_text() == drawn, "run python docs/flow.py"


def test_the_modules_in_the_picture_are_there() -> None:
    flow = runpy.run_path(str(ROOT / "docs" / "flow.py"))
    rooms = [r for r in flow["ROOMS"] if "/" in r.path]
    assert len(flow["STEPS"]) > 15
    for room in rooms:
        assert (ROOT / room.path).is_dir(), room.path
    for step in flow["STEPS"]:
        room = next(
            (r for r in rooms if r.x < step.x < r.x + r.width and r.y < step.y < r.y + r.height), None
        )
        folders = (room.path,) if room else ("", "rescore/")
        for module in step.module.split(", "):
            assert any(f"{folder}{module}" in FILES for folder in folders), f"{step.name}: {module}"


@pytest.mark.parametrize("package", ["recon", "rescore"])
def test_the_reference_has_the_public_surface(package: str) -> None:
    module = importlib.import_module(package)
    text = (ROOT / "docs" / f"reference-{package}.md").read_text()
    shown = re.findall(rf"^::: {package}\.(\w+)$", text, flags=re.MULTILINE)
    assert sorted(shown) == sorted(module.__all__)
    for name in module.__all__:
        assert getattr(module, name) is not None


def test_one_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), flags=re.MULTILINE)
    released = re.findall(r"^## \[(\d.+?)\]", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)
    assert cited is not None
    assert {cited[1], released[0]} == {project}
