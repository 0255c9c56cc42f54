import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = """
import pytest
pytestmark = pytest.mark.skipif(True, reason="no browser here")

@pytest.mark.parametrize("width", range(5))
def test_pages(width): pass
"""
WHOLE = "import pytest; pytest.skip('no viewer here', allow_module_level=True)"
INSIDE = """
import pytest

def test_works(): pass

def test_needs_data(): pytest.skip("no data here")
"""
EXPECTED = [
    "5 skipped: no browser here",
    "    test_a.py: test_pages[0], test_pages[1], test_pages[2] and 2 more",
    "1 skipped: no data here",
    "    test_c.py: test_needs_data",
    "1 skipped: no viewer here",
    "    test_b.py: the whole file",
]


@pytest.mark.parametrize("jobs", [[], ["-n", "2"]])
def test_the_end_says_what_was_skipped_and_why(tmp_path: Path, jobs: list[str]) -> None:
    for name, text in (("a", TESTS), ("b", WHOLE), ("c", INSIDE)):
        (tmp_path / f"test_{name}.py").write_text(text)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "conftest",
        "-p",
        "no:cacheprovider",
        *jobs,
        str(tmp_path),
    ]
    path = {"PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | path, capture_output=True, text=True, check=False
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout
    (start,) = (i for i, line in enumerate(lines) if "skipped, and why" in line)
    assert lines[start + 1 : start + 1 + len(EXPECTED)] == EXPECTED
    assert "1 passed" in lines[start + 1 + len(EXPECTED)]
