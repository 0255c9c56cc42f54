"""Without the extras the commands work, start as quickly, and name the extra that a wish needs."""

import subprocess
import sys
from pathlib import Path

import pytest

from recon.stores import objects
from tests.conftest import ROOT
from tests.faults.small_parts import detect, write_street
from tests.rescore.spoiling import Run

PACKAGES = ("dask", "distributed", "ray", "fsspec", "s3fs", "gcsfs", "duckdb")
WITHOUT = f"import sys; sys.modules.update(dict.fromkeys({PACKAGES}))\n"
"""Makes imports fail as where nothing of the extras is installed."""


@pytest.mark.parametrize("start", [WITHOUT, ""], ids=["hidden", "installed"])
def test_help_and_a_run_need_none_of_them_and_import_none(start: str, tmp_path: Path) -> None:
    street, _ = write_street(tmp_path / "street", 6)
    script = (
        "import sys; from rescore.cli import main\n"
        f"for words in (['--help'], {detect(street, tmp_path / 'found', '--jobs', 1)!r}):\n"
        "    sys.argv = ['rescore', *words]\n"
        "    try: main()\n"
        "    except SystemExit as ended: assert not ended.code, ended.code\n"
        f"assert not [m for m in {PACKAGES} if sys.modules.get(m)], sorted(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", start + script], check=True, cwd=ROOT, timeout=120)
    assert (tmp_path / "found" / "parts.json").is_file()


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("detect", "street", "--detector", "street/hog.npz", "--out", "found", "--engine", "dask"), "dask"),
        (("detect", "street", "--detector", "street/hog.npz", "--out", "found", "--engine", "ray"), "ray"),
        (("query", "street", "SELECT 1"), "query"),
        (("inspect", "s3://fleet/run", "--failed"), "s3"),
        (("inspect", "gs://fleet/run", "--failed"), "gcs"),
    ],
)
def test_a_wish_names_its_extra_in_one_line(
    arguments: tuple[str, ...], extra: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_street(tmp_path / "street", 6)
    monkeypatch.chdir(tmp_path)
    for name in PACKAGES:
        monkeypatch.setitem(sys.modules, name, None)
    objects._filesystem.cache_clear()
    split = ("--split", "train") if arguments[0] == "detect" else ()
    code, _, err = run(*arguments, *split)
    assert (code, err.count("\n")) == (1, 1), err
    assert f'pip install "rescore[{extra}]"' in err
