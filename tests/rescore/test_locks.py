import json
import subprocess
import sys
from pathlib import Path

import pytest

from recon.errors import RescoreError
from rescore.locks import LOCK, locked

HOLD = """
import sys
from pathlib import Path
from rescore.locks import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def hold(folder: Path) -> None:
    with locked(folder):
        pass


@pytest.fixture
def holder(tmp_path: Path) -> "subprocess.Popen[str]":
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_a_second_process_is_told_who_was_first(tmp_path: Path, holder: "subprocess.Popen[str]") -> None:
    with pytest.raises(RescoreError, match=rf"got process {holder.pid} of .*, which began .*; wait"):
        hold(tmp_path)
    # a file that cannot be read names nobody, and is no way in
    (tmp_path / LOCK).write_bytes(b"\xff{")
    with pytest.raises(RescoreError, match="got one that has just begun"):
        hold(tmp_path)
    holder.communicate("")
    hold(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_killed_process_holds_nothing(tmp_path: Path, holder: "subprocess.Popen[str]") -> None:
    holder.kill()
    holder.wait()
    assert json.loads((tmp_path / LOCK).read_text())["process"] == holder.pid
    hold(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_error_inside_gives_the_lock_back(tmp_path: Path) -> None:
    def fail() -> None:
        with locked(tmp_path / "new"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    hold(tmp_path / "new")


def test_a_place_that_cannot_be_written_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RescoreError, match="expected a folder to write to, got the file"):
        hold(tmp_path / "file" / "run")
