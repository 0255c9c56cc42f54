import subprocess
import sys
from pathlib import Path

import pytest

from recon.errors import RescoreError
from recon.files import atomic_path


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
        pytest.raises(RescoreError, match=r"expected to write here, got .*choose another place"),
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
