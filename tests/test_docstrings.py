"""Every docstring can be read alone: it names its subject, ends its first sentence, and is there at all."""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("recon", "rescore", "datasets_synth", "reports")
WITHOUT_SUBJECT = re.compile(
    r"(Of|That|Those|This|These|Which|Both|Neither|Nor|So|So many|The same|Such|Or|And|But|As above|"
    r"It|Its|They|Them|Their|Likewise|For people)\b"
)
"""First words that point at something outside the docstring."""
ARRAYS = re.compile(r"(Array\b|NDArray\[)")
"""Types that say nothing of the shape."""

FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
Definition = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Docstring:
    """A string that documents what it follows, or what it stands in."""

    place: str
    """File and line."""
    text: str

    @property
    def first_paragraph(self) -> str:
        """The text up to the first empty line, on one line."""
        return " ".join(self.text.strip().split("\n\n")[0].split())


@cache
def trees() -> dict[str, ast.Module]:
    """The syntax tree of every file of the packages, by its path in the project."""
    files = (f for package in PACKAGES for f in sorted((ROOT / package).rglob("*.py")))
    return {str(f.relative_to(ROOT)): ast.parse(f.read_text(encoding="utf-8")) for f in files}


def text_of(statement: ast.stmt | None) -> str | None:
    """The text of a statement that is a string alone; None for another one."""
    if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Constant):
        return None
    return statement.value.value if isinstance(statement.value.value, str) else None


@cache
def docstrings() -> tuple[Docstring, ...]:
    """Docstrings of modules, classes, functions and fields: every string that is a statement."""
    return tuple(
        Docstring(f"{file}:{node.lineno}", text)
        for file, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.stmt) and (text := text_of(node)) is not None
    )


def public(node: Definition) -> Iterator[Definition]:
    """A module, class or function and the public classes and functions in it, but for those in functions."""
    yield node
    if not isinstance(node, FUNCTION):
        for inner in node.body:
            if isinstance(inner, ast.ClassDef | FUNCTION[0] | FUNCTION[1]) and not inner.name.startswith("_"):
                yield from public(inner)


def undocumented_fields(node: ast.ClassDef) -> Iterator[str]:
    """Public fields of a dataclass that hold an array and have no docstring."""
    following = [*node.body[1:], None]
    for field, after in zip(node.body, following, strict=True):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and not field.target.id.startswith("_")
            and ARRAYS.search(ast.unparse(field.annotation))
            and text_of(after) is None
        ):
            yield field.target.id


def is_dataclass(node: Definition) -> bool:
    """Whether a definition is a dataclass."""
    return isinstance(node, ast.ClassDef) and any(
        ast.unparse(d).startswith("dataclass") for d in node.decorator_list
    )


def test_docstrings_begin_with_their_subject() -> None:
    found = [f"{d.place}: {d.first_paragraph}" for d in docstrings() if WITHOUT_SUBJECT.match(d.text.strip())]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("Of the fuselage, which is round.", True),
        ("So many cues at most are told.", True),
        ("The same after.", True),
        ("Its settings.", True),
        ("Offset from a point to its label.", False),
        ("Thatched roofs.", False),
        ("The samest of all.", False),
        ("Sorted features.", False),
        ("Order of the bins.", False),
        ("Radius of the fuselage, which is round.", False),
    ],
)
def test_what_counts_as_no_subject(text: str, found: bool) -> None:
    assert bool(WITHOUT_SUBJECT.match(text)) is found


def test_the_first_paragraph_ends_a_sentence() -> None:
    # a colon opens the list that follows
    found = [
        f"{d.place}: {d.first_paragraph}"
        for d in docstrings()
        if not d.first_paragraph.endswith((".", "?", ":"))
    ]
    assert not found, "\n".join(found)


def test_a_paragraph_on_one_line_comes_first_where_more_follow() -> None:
    found = [
        f"{d.place}: {d.first_paragraph}"
        for d in docstrings()
        if "\n\n" in d.text.strip() and "\n" in d.text.strip().split("\n\n")[0]
    ]
    assert not found, "\n".join(found)


def test_everything_public_is_documented() -> None:
    found = [
        f"{file}: {getattr(node, 'name', 'the module')}"
        for file, tree in trees().items()
        for node in public(tree)
        if not ast.get_docstring(node)
        # what Python itself calls says what it does by its name
        and not getattr(node, "name", "").startswith("__")
    ]
    assert not found, "\n".join(found)


def test_fields_that_hold_arrays_are_documented() -> None:
    found = [
        f"{file}: {node.name}.{field}"
        for file, tree in trees().items()
        for node in public(tree)
        if isinstance(node, ast.ClassDef) and is_dataclass(node)
        for field in undocumented_fields(node)
    ]
    assert not found, "\n".join(found)


def test_the_files_are_read() -> None:
    """The tests above would pass with nothing to look at."""
    assert len(trees()) > 200
    assert len(docstrings()) > 2000
