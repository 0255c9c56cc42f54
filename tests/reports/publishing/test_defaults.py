"""The rescorer that comes with the package is what a finished run with mode instance holds."""

import json
from pathlib import Path

import pytest

import rescore.defaults
from recon.errors import RescoreError
from reports.publishing import defaults
from rescore.detectors.platt import PlattScaling, save_scaling
from rescore.evidence.model import save_models
from rescore.evidence.registration import Registration
from rescore.experiment.config import RunConfig, run_preset
from rescore.files import write_json
from rescore.library.bundles import read_bundle
from rescore.results.run_config_file import write_run_config
from rescore.results.run_folder import RunFolder
from tests.rescore import shipped


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """What a bundle is made from, as a run of `rescore reproduce` leaves it."""
    folder, bundle = RunFolder(tmp_path / "runs" / "streets"), shipped.bundle()
    (folder.root / "models").mkdir(parents=True)
    (folder.root / "tuned").mkdir()
    bundle.class_model.save(folder.class_model)
    for name in ("hog", "boosted"):
        save_models(folder.evidence_model(name), {Registration.INSTANCE: bundle.evidence_model})
        save_scaling(folder.scaling(name), PlattScaling(-1.0, 0.0))
        tuned = {"detector": name, "registration": "instance", "w": 0.3 if name == "hog" else 0.6}
        tuned |= {"objective_name": "average_precision", "w_grid": [0.3, 0.6], "objective": [0.9, 0.9]}
        write_json(folder.tuned(name, "instance"), tuned | {"n_images": 4, "n_cars": 6})
    _configure(folder, (Registration.PAPER, Registration.INSTANCE))
    return folder.root


def _configure(folder: RunFolder, modes: tuple[Registration, ...]) -> None:
    preset = run_preset("tiny")
    config: RunConfig = preset.model_copy(update={"registrations": modes, "rescore": shipped.bundle().config})
    write_run_config(folder.config, "reproduce", config.as_json(), 3, stereo=config.synth.sgbm)


def test_the_bundle_holds_what_the_run_holds(
    run_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "defaults"
    out.mkdir()
    monkeypatch.setattr(rescore.defaults, "FOLDER", out)
    assert defaults.main([str(run_dir)]) == 0
    file = out / "car.rescorer.json.gz"
    assert capsys.readouterr().out.startswith(f"rescorer: {file} (")
    bundle = read_bundle(file)
    assert bundle.w == 0.3
    assert bundle.config == shipped.bundle().config
    assert bundle.made_with == (
        "rescore reproduce --preset tiny --seed 3",
        f"python -m reports.publishing.defaults {run_dir} --detector hog",
    )
    assert bundle.class_model.as_json() == json.loads(RunFolder(run_dir).class_model.read_text())
    assert defaults.main([str(run_dir), "--detector", "boosted"]) == 0
    assert read_bundle(file).w == 0.6


def test_a_run_that_will_not_do_is_refused(
    run_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RescoreError, match="expected a run with detector 'dpm', found boosted, hog"):
        defaults.publish_defaults(run_dir, tmp_path, "dpm")
    monkeypatch.setattr(defaults, "MOST_BYTES", 1000)
    with pytest.raises(RescoreError, match=r"expected at most 1000 bytes, got \d+"):
        defaults.publish_defaults(run_dir, tmp_path)
    _configure(RunFolder(run_dir), (Registration.PAPER,))
    assert defaults.main([str(run_dir)]) == 1
    assert "expected a finished run with mode instance, got one without" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.gz"))
    assert not list(Path(str(rescore.defaults.FOLDER)).glob("*.tmp"))
