import errno
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from recon.errors import RescoreError
from recon.files import atomic_path, copy_file, refuse_as_file, refuse_as_folder


def test_atomic_path_moves_a_whole_file_into_place(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "x.json"
    with atomic_path(target) as beside:
        assert beside.suffix == ".json"
        assert beside.parent == target.parent
        beside.write_text("new")
        assert not target.exists()
    assert [p.name for p in target.parent.iterdir()] == ["x.json"]
    assert target.read_text() == "new"


def test_atomic_path_leaves_nothing_on_failure(tmp_path: Path) -> None:
    target = tmp_path / "x.json"
    target.write_text("old")

    def fail() -> None:
        with atomic_path(target) as beside:
            beside.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert [p.name for p in tmp_path.iterdir()] == ["x.json"]
    assert target.read_text() == "old"


def test_atomic_path_says_where_it_cannot_write(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(
            RescoreError, match=r"expected a folder to write to, got the file .*choose another place"
        ),
        atomic_path(tmp_path / "file" / "x.json"),
    ):
        pass


def test_a_killed_writer_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "x.txt"
    target.write_text("old")
    code = (
        "import os, sys; from pathlib import Path; from recon.files import atomic_path\n"
        "with atomic_path(Path(sys.argv[1])) as beside:\n    beside.write_text('half'); os._exit(9)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(target)], check=False)
    assert done.returncode == 9
    assert target.read_text() == "old"
    (partial,) = (p for p in tmp_path.iterdir() if p != target)
    assert ".partial" in partial.name
    # the next process that writes here clears what it left
    again = "import sys; from pathlib import Path; from recon.files import copy_file; x = Path(sys.argv[1]); "
    again += "copy_file(x, x.with_name('y.txt'))"
    assert subprocess.run([sys.executable, "-c", again, str(target)], check=False).returncode == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.txt", "y.txt"]


def test_what_a_living_process_writes_is_not_cleared(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "x.txt") as beside:
        beside.write_text("mine")
        code = "import sys; from pathlib import Path; from recon.files import clear_partials; "
        code += "clear_partials(Path(sys.argv[1]))"
        assert subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False).returncode == 0
        assert beside.exists()


def test_two_processes_do_not_share_a_partial_name(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "x.txt") as first, atomic_path(tmp_path / "x.txt") as second:
        assert first != second
        assert str(os.getpid()) in first.name
        first.write_text("1")
        second.write_text("2")


def test_a_full_disk_while_copying_names_the_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, target = tmp_path / "a.png", tmp_path / "out" / "b.png"
    source.write_bytes(b"1")

    def full(source: Path, beside: Path) -> None:
        beside.write_bytes(b"")
        # as shutil does: the source first
        raise OSError(errno.ENOSPC, "No space left on device", str(source), None, str(beside))

    monkeypatch.setattr("shutil.copyfile", full)
    with pytest.raises(
        RescoreError, match=r"out/b\.png: expected to write here, got 'No space left on device'"
    ):
        copy_file(source, target)
    assert list(target.parent.iterdir()) == []


def test_what_is_no_regular_file_is_refused_and_kept(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(tmp_path / "socket"))
    for name in ("pipe", "link", "socket"):
        target = tmp_path / name
        before = target.lstat()
        with pytest.raises(RescoreError, match="expected a regular file or none here, got a device, pipe or"):
            write(target)
        assert target.lstat() == before
    listening.close()
    with pytest.raises(RescoreError, match="expected the name of a file to write, got a folder; add a name"):
        write(tmp_path)


def write(target: Path) -> None:
    with atomic_path(target) as beside:
        beside.write_text("x")


@pytest.mark.parametrize("name", ["", ".", "file/x", "n" * 5000, "a\0b"])
def test_names_that_cannot_be_written_are_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    with pytest.raises(RescoreError, match="expected"):
        refuse_as_file(Path(name))
    if name not in ("", "."):
        with pytest.raises(RescoreError, match="expected"):
            refuse_as_folder(Path(name))
    refuse_as_file(Path("new/deep/x.json"))
    refuse_as_folder(Path("new/deep"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]
