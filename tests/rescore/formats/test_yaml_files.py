"""YAML of other tools: texts stay texts, and nothing but the safe part of YAML is read."""

from pathlib import Path

import pytest

from recon.errors import RescoreError
from rescore.formats.yaml_files import read_yaml


def test_scalars_keep_their_text() -> None:
    text = "a: 1e5\nb: 1:30\nc: 010\nd: yes\ne: '0x10'\nf:\ng: 2001-01-01\n3: .nan\n"
    assert read_yaml(Path("a.yaml"), text) == [
        {
            **{"a": "1e5", "b": "1:30", "c": "010", "d": "yes", "e": "0x10", "f": "", "g": "2001-01-01"},
            "3": ".nan",
        }
    ]


def test_documents_that_are_mappings() -> None:
    text = "%YAML:1.0\n---\na: [1, {b: 2}]\n...\n---\n- x\n---\n# nothing\n---\nc: 3\n"
    assert read_yaml(Path("a.yaml"), text) == [{"a": ["1", {"b": "2"}]}, {"c": "3"}]
    assert read_yaml(Path("a.yaml"), "") == []
    # OpenCV 2 wrote no line between its head and the first name; YAML's own head is another
    assert read_yaml(Path("a.yaml"), "%YAML:1.0\na: 1\n") == [{"a": "1"}]
    assert read_yaml(Path("a.yaml"), "%YAML 1.2\n---\na: 1\n") == [{"a": "1"}]


def test_tags_of_opencv_are_read_as_what_they_mark() -> None:
    text = "m: !!opencv-matrix\n   rows: 1\n   data: [ 1., 2. ]\n"
    text += "n: !!opencv-nd-matrix {sizes: [1]}\ns: !!opencv-s [a]\n"
    assert read_yaml(Path("a.yaml"), text) == [
        {"m": {"rows": "1", "data": ["1.", "2."]}, "n": {"sizes": ["1"]}, "s": ["a"]}
    ]


BOMB = "a: &a [x, x]\n" + "".join(
    f"{b}: &{b} [*{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (BOMB, r"a mistake in line 2 \(an alias, which is not read"),
        ("a: &a {x: 1}\nb:\n  <<: *a\n", r"a mistake in line 3 \(an alias, which is not read"),
        ("a: &a [*a]\n", r"a mistake in line 1 \(an alias, which is not read"),
        (
            "b: 1\na: !!python/object/apply:os.system [echo no]\n",
            r"a mistake in line 2 \(could not determine a constructor",
        ),
        ("a: !!python/name:os.system\n", "could not determine a constructor"),
        ("a: !!timestamp x\n", "could not determine a constructor"),
        ("a: !!opencv-matrix ro\n", r"a mistake in line 1 \(an OpenCV matrix without entries"),
        ("a: 1\nb:\n  c: 2\n  c: 3\n", r"a mistake in line 3 \(a name that occurs twice"),
        ("a: 1\na: 1\n", r"a mistake in line 1 \(a name that occurs twice"),
        ("{[1]: 2}\n", r"a mistake in line 1 \(found unhashable key"),
        ("a: [1, 2\nb: 3\n", r"a mistake in line 2 \(expected ',' or '\]', but got ':'"),
        ("a:\n\t- 1\n", r"a mistake in line 2 \(found character '.t' that cannot start any token"),
        ("a: \x01\n", "unacceptable character #x0001"),
        ("[" * 100_000, "lists too deep in each other"),
        ("a: " + "{a: " * 100_000, "lists too deep in each other"),
    ],
)
def test_what_is_refused_in_one_line(text: str, problem: str) -> None:
    with pytest.raises(RescoreError, match=f"^a.yaml: expected YAML, got .*{problem}.*; mend it$") as refused:
        read_yaml(Path("a.yaml"), text)
    assert "\n" not in str(refused.value)
