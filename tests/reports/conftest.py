from pathlib import Path

import pytest
import rerun as rr

from rescore.results.run_folder import Run, load_run
from tests.reports.fake_run import make_run
from tests.reports.instance_run import make_instance_run


@pytest.fixture(scope="session", autouse=True)
def _strict_rerun():
    """Without it, a value of the wrong shape would be a warning and the data would be missing."""
    rr.set_strict_mode(True)


@pytest.fixture(scope="session")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("run"), n_frames=5)


@pytest.fixture(scope="session")
def run(run_dir: Path) -> Run:
    return load_run(run_dir)


@pytest.fixture(scope="session")
def instance_run(run_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return load_run(make_instance_run(run_dir, tmp_path_factory.mktemp("instance") / "run"))
