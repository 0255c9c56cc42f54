"""What tests share: a finished run of preset "tiny", and the real frames where they are at hand."""

import fcntl
import os
import shlex
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import settings

# no test asserts a time: on a busy machine an example may take any
settings.register_profile("rescore", deadline=None)
settings.load_profile("rescore")

ROOT = Path(__file__).resolve().parent.parent
SKIPPED_SHOWN = 3
"""Names of skipped tests of one file in the summary; the rest are counted."""


def run_rescore(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command as a user does."""
    command = [sys.executable, "-m", "rescore.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)


@contextmanager
def made_once(tmp_path_factory: pytest.TempPathFactory, name: str) -> Iterator[Path]:
    """A folder that all test processes share, while nobody else makes it."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield shared / name


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run of preset "tiny", seed 0; read it, never write to it.

    Made once for all test processes: the first that needs it holds the lock, the others wait.
    """
    with made_once(tmp_path_factory, "tiny_run") as out:
        if not (out / "recording.rrd").is_file():
            done = run_rescore("reproduce", "--preset", "tiny", "--out", out, "--jobs", 2)
            (out.parent / "tiny_run.txt").write_text(f"{done.stdout}\n{done.stderr}")
            assert done.returncode == 0, done.stderr
    return out


REAL_STREET = ROOT / "examples" / "real_street"


@pytest.fixture(scope="session")
def real_street_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of the committed real pairs, made by the README's commands; never write to it."""
    with made_once(tmp_path_factory, "real_street") as out:
        if not (out / "recording.rrd").is_file():
            for words in readme_commands("A real street in one minute"):
                done = run_rescore(*(word.replace("runs/street", str(out)) for word in words))
                assert done.returncode == 0, done.stderr
    return out


def readme_commands(heading: str) -> list[list[str]]:
    """The arguments of each `rescore` command in the first block below a heading of the README."""
    below = (ROOT / "README.md").read_text().split(f"\n## {heading}\n", 1)[1]
    block = below.split("```sh\n", 1)[1].split("```", 1)[0].replace("\\\n", " ")
    commands = [part for line in block.splitlines() for part in line.split("&&")]
    words = [shlex.split(command, comments=True) for command in commands]
    return [rest for first, *rest in words if first == "rescore"]


@pytest.fixture(scope="session")
def kitti() -> Path:
    """The folder of six real frames: that of the variable RESCORE_KITTI, else one beside the project."""
    folder = Path(os.environ.get("RESCORE_KITTI", ROOT.parent / "shared" / "data" / "kitti"))
    if not (folder / "annotations.json").is_file():
        pytest.skip(f"no real frames at {folder}; set RESCORE_KITTI to a folder that holds annotations.json")
    return folder


@pytest.fixture(scope="session")
def uiuc() -> Path:
    """The folder of the UIUC car set: that of the variable RESCORE_UIUC, else one beside the project."""
    folder = Path(os.environ.get("RESCORE_UIUC", ROOT.parent / "shared" / "data" / "uiuc_cars"))
    if not (folder / "trueLocations.txt").is_file():
        pytest.skip(f"no UIUC car set at {folder}; set RESCORE_UIUC to a folder that holds trueLocations.txt")
    return folder


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say at the end what was skipped and why: a line a reason, then its tests, file by file."""
    # sets, since each process reports a file that is skipped as a whole
    why: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for report in terminalreporter.getreports("skipped"):
        reason = report.longrepr[-1] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        file, _, name = report.nodeid.partition("::")
        why[reason.removeprefix("Skipped: ")][file].add(name or "the whole file")
    if not why:
        return
    terminalreporter.section("skipped, and why")
    for reason, files in sorted(why.items()):
        terminalreporter.line(f"{sum(map(len, files.values()))} skipped: {reason}")
        for file, names in sorted(files.items()):
            more = f" and {len(names) - SKIPPED_SHOWN} more" if len(names) > SKIPPED_SHOWN else ""
            terminalreporter.line(f"    {file}: {', '.join(sorted(names)[:SKIPPED_SHOWN])}{more}")
