import shutil
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

from rescore import fusion
from rescore.evidence import align_depth, model
from rescore.experiment.config import run_preset
from rescore.experiment.reproduce import Experiment
from rescore.experiment.source_digest import ROOT, imported_modules, source_digest, source_files
from rescore.experiment.stages import Done, Stage
from rescore.fusion import fuse, tune
from rescore.results.run_folder import RunFolder


def test_source_digest_follows_imports() -> None:
    files = source_files()
    assert files["rescore.fusion.fuse"] == Path(fuse.__file__)
    assert not {"numpy", "rescore.nothing"} & set(files)
    assert "rescore.fusion.fuse" in imported_modules(Path(tune.__file__), files)
    assert source_digest(fuse) != source_digest(tune)
    assert source_digest(tune) == source_digest(tune, fuse)


def test_a_package_counts_as_its_own_file() -> None:
    assert source_files()["rescore.fusion"] == Path(str(fusion.__file__))


@pytest.mark.parametrize("name", ["rescore.no_such_module", "numpy", "nothing"])
def test_an_unknown_module_is_an_error(name: str) -> None:
    # a name that is skipped would freeze a stage for ever
    with pytest.raises(ValueError, match=f"{name}: expected a module of recon, rescore"):
        source_digest(ModuleType(name))


def test_an_import_of_a_module_that_is_gone_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "recon").mkdir()
    file = tmp_path / "recon" / "one.py"
    file.write_text("from recon.errors import RescoreError\n")
    with pytest.raises(ValueError, match=r"expected imports of modules that are there, got recon\.errors"):
        source_digest(ModuleType("recon.one"), root=tmp_path)


@pytest.fixture(scope="module")
def stages() -> list[Stage]:
    """The stages of a whole run, in order, none of them run."""
    found: list[Stage] = []

    def note(_root: Path, stage: Stage, _work: object) -> Done:
        found.append(stage)
        return Done(stage.name, reused=True, seconds=0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rescore.experiment.reproduce.run_stage", note)
        patch.setattr("rescore.experiment.reproduce.run_stage_in_place", note)
        patch.setattr("rescore.experiment.reproduce.read_metrics", lambda _path: None)
        patch.setattr(Experiment, "_data", lambda _run: None)
        Experiment(RunFolder(Path("run")), run_preset("tiny"), 0, 1, lambda _done: None).all()
    return found


Code = tuple[ModuleType, ...]


@dataclass(frozen=True)
class Copy:
    """A copy of the source that a test may change."""

    root: Path
    digest: dict[Code, str]
    """Of the code of each stage, before anything is changed."""

    def changed_by(self, module: ModuleType, stages: list[Stage]) -> list[str]:
        """Names of the stages that go stale where one line of a module changes."""
        file = source_files(self.root)[module.__name__]
        text = file.read_text()
        file.write_text(text + "# one line\n")
        try:
            stale = {code for code, was in self.digest.items() if source_digest(*code, root=self.root) != was}
        finally:
            file.write_text(text)
        return [s.name for s in stages if s.code in stale]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory, stages: list[Stage]) -> Copy:
    root = tmp_path_factory.mktemp("source")
    left_out = shutil.ignore_patterns("published", "*.npz")
    for package in ("recon", "rescore", "datasets_synth", "reports"):
        shutil.copytree(ROOT / package, root / package, ignore=left_out)
    return Copy(root, {code: source_digest(*code, root=root) for code in {s.code for s in stages}})


def test_every_stage_names_the_module_that_does_its_work(stages: list[Stage], copy: Copy) -> None:
    names = [s.name for s in stages]
    assert len(names) == len(set(names)) > 20
    for module in {s.code[0] for s in stages}:
        worked_for = [s.name for s in stages if s.code[0] is module]
        changed = copy.changed_by(module, stages)
        assert set(worked_for) <= set(changed)
        # stages before the first that this module works for read none of it
        early = [n for n in changed if names.index(n) < names.index(worked_for[0])]
        assert not early, f"{module.__name__} makes {early} stale"


def test_a_detector_has_its_own_stages(stages: list[Stage], copy: Copy) -> None:
    hog, boosted = (
        {n for n in copy.changed_by(s.code[-1], stages) if n.startswith(("train", "calibrate", "detect"))}
        for s in stages
        if s.name in ("train_hog", "train_boosted")
    )
    assert hog
    assert boosted
    assert not hog & boosted


def test_what_depth_says_is_no_matter_of_detection(stages: list[Stage], copy: Copy) -> None:
    fused = copy.changed_by(tune, stages)
    assert fused[0].startswith("tune_")
    assert not {n for n in copy.changed_by(model, stages) if n.startswith(("train", "calibrate", "detect"))}
    assert {"evidence_hog_test", "apply_hog_paper"} <= set(copy.changed_by(align_depth, stages))
