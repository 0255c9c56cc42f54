"""The scripts of .ci where they may install nothing: they say so in a line, and only tests go on without."""

import shutil
import subprocess
from pathlib import Path

import pytest

CI = Path(__file__).resolve().parent.parent / ".ci"
REAL = ("sh", "dirname", "ls")


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """A folder of programs as a user without rights has them, and no browser."""
    for name in REAL:
        found = shutil.which(name)
        assert found is not None
        (tmp_path / name).symlink_to(found)
    for name, body in (("id", "echo 1000"), ("sudo", "exit 1"), ("apt-get", "echo touched; exit 1")):
        (tmp_path / name).write_text(f"#!/bin/sh\n{body}\n")
        (tmp_path / name).chmod(0o755)
    return tmp_path


def run(tools: Path, script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [str(tools / "sh"), str(CI / script), *arguments]
    return subprocess.run(command, env={"PATH": str(tools)}, capture_output=True, text=True, check=False)


def test_tests_go_on_without_what_cannot_be_installed(tools: Path) -> None:
    done = run(tools, "setup-tests")
    assert done.returncode == 0
    assert done.stdout == ""
    why, goes_on = done.stderr.splitlines()
    assert why.startswith(
        "install: expected root, or sudo without a password, for missing packages: chromium"
    )
    assert goes_on.startswith("setup: going on without chromium")


@pytest.mark.parametrize(
    ("gone", "words"),
    [("", "expected root, or sudo without a password"), ("apt-get", "expected apt-get for these Debian")],
)
def test_what_is_needed_is_named_with_the_command(tools: Path, gone: str, words: str) -> None:
    if gone:
        (tools / gone).unlink()
    done = run(tools, "install", "libusb-1.0-0", "libegl1")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert words in line
    assert "apt-get install libusb-1.0-0 libegl1" in line
    assert done.stdout == ""


def test_a_fresh_machine_needs_root(tools: Path) -> None:
    done = run(tools, "fresh-machine")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("fresh-machine: expected root")
    assert done.stdout == ""
