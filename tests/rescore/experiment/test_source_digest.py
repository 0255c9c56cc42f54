import shutil
from pathlib import Path
from types import ModuleType

import pytest

from rescore import fusion
from rescore.evidence import align_depth, model
from rescore.experiment.config import run_preset
from rescore.experiment.reproduce import Experiment
from rescore.experiment.source_digest import ROOT, imported_modules, module_file, source_digest
from rescore.experiment.stages import Done, Stage
from rescore.fusion import fuse, tune
from rescore.results.run_folder import RunFolder


def test_source_digest_follows_imports() -> None:
    file = module_file("rescore.fusion.fuse")
    assert file == Path(fuse.__file__)
    assert module_file("numpy") is None
    assert module_file("rescore.nothing") is None
    assert "rescore.fusion.fuse" in imported_modules(Path(tune.__file__))
    assert source_digest(fuse) != source_digest(tune)
    assert source_digest(tune) == source_digest(tune, fuse)


def test_a_package_counts_as_its_own_file() -> None:
    assert module_file("rescore.fusion") == Path(str(fusion.__file__))


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


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the source that a test may change."""
    root = tmp_path_factory.mktemp("source")
    left_out = shutil.ignore_patterns("published", "*.npz")
    for package in ("recon", "rescore", "datasets_synth", "reports"):
        shutil.copytree(ROOT / package, root / package, ignore=left_out)
    return root


def changed_by(module: ModuleType, stages: list[Stage], root: Path) -> list[str]:
    """Names of the stages that go stale where one line of a module changes."""
    before = [source_digest(*s.code, root=root) for s in stages]
    file = module_file(module.__name__, root)
    assert file is not None
    text = file.read_text()
    file.write_text(text + "# one line\n")
    try:
        after = [source_digest(*s.code, root=root) for s in stages]
    finally:
        file.write_text(text)
    return [s.name for s, a, b in zip(stages, before, after, strict=True) if a != b]


def test_every_stage_names_the_module_that_does_its_work(stages: list[Stage], copy: Path) -> None:
    names = [s.name for s in stages]
    assert len(names) == len(set(names)) > 20
    first_with = {module: names.index(s.name) for s in reversed(stages) for module in s.code[:1]}
    for stage in stages:
        changed = changed_by(stage.code[0], stages, copy)
        assert stage.name in changed
        # stages before the first that this module works for read none of it
        early = [n for n in changed if names.index(n) < first_with[stage.code[0]]]
        assert not early, f"{stage.code[0].__name__} makes {early} stale"


def test_a_detector_has_its_own_stages(stages: list[Stage], copy: Path) -> None:
    hog, boosted = (
        {n for n in changed_by(s.code[-1], stages, copy) if n.startswith(("train", "calibrate", "detect"))}
        for s in stages
        if s.name in ("train_hog", "train_boosted")
    )
    assert hog
    assert boosted
    assert not hog & boosted


def test_what_depth_says_is_no_matter_of_detection(stages: list[Stage], copy: Path) -> None:
    fused = changed_by(tune, stages, copy)
    assert fused[0].startswith("tune_")
    assert not {n for n in changed_by(model, stages, copy) if n.startswith(("train", "calibrate", "detect"))}
    assert {"evidence_hog_test", "apply_hog_paper"} <= set(changed_by(align_depth, stages, copy))
