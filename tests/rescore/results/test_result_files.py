"""Files of results read into types and written again say the same, byte for byte."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from recon.errors import RescoreError
from rescore.evidence.cues import CueConfig
from rescore.experiment.config import RunConfig, run_config, run_preset
from rescore.files import write_json
from rescore.formats.checked_json import merged
from rescore.results.metrics_file import read_metrics, write_metrics
from rescore.results.run_config_file import read_run_config, write_run_config
from rescore.results.sweep_file import read_sweep, write_sweep
from rescore.studies.ablation import AblationRow, write_ablation
from rescore.studies.class_models_file import ModelsResult, write_models
from rescore.studies.distractors import BankResult, write_bank
from rescore.studies.localization.result_file import read_localization, write_localization
from rescore.studies.stereo_file import StereoResult, write_stereo
from rescore.studies.view_bins import VIEW_STUDIES, Confusion, load_confusions, save_confusions
from rescore.studies.weight import WeightRecord, write_weights

PUBLISHED = Path(__file__).parents[3] / "reports" / "published"


def read_ablation(path: Path) -> tuple[AblationRow, ...]:
    return TypeAdapter(tuple[AblationRow, ...]).validate_json(path.read_bytes())


def read_bank(path: Path) -> BankResult:
    return BankResult.model_validate_json(path.read_bytes())


def read_stereo(path: Path) -> StereoResult:
    return StereoResult.model_validate_json(path.read_bytes())


def read_models(path: Path) -> ModelsResult:
    return ModelsResult.model_validate_json(path.read_bytes())


def read_weights(path: Path) -> tuple[WeightRecord, ...]:
    return TypeAdapter(tuple[WeightRecord, ...]).validate_json(path.read_bytes())


def write_confusions(path: Path, file: tuple[dict[str, Confusion], str]) -> None:
    save_confusions(path, *file)


@pytest.mark.parametrize(
    ("name", "read", "write"),
    [
        ("roc/metrics.json", read_metrics, write_metrics),
        ("evidence/sweep/sweep.json", read_sweep, write_sweep),
        ("evidence/ablation.json", read_ablation, write_ablation),
        ("evidence/distractors.json", read_bank, write_bank),
        ("localization/localization.json", read_localization, write_localization),
        ("stereo/stereo.json", read_stereo, write_stereo),
        ("models/models.json", read_models, write_models),
        ("weight/weight.json", read_weights, write_weights),
        *((f"view_bins/{name}.json", load_confusions, write_confusions) for name in VIEW_STUDIES),
    ],
)
def test_published_files_are_written_as_they_were(
    name: str, read: Callable[[Path], Any], write: Callable[[Path, Any], None], tmp_path: Path
) -> None:
    write(tmp_path / "again.json", read(PUBLISHED / name))
    assert (tmp_path / "again.json").read_text() == (PUBLISHED / name).read_text()


def test_published_settings_are_known_whole() -> None:
    config = PUBLISHED / "roc" / "config.json"
    written = json.loads(config.read_text())
    assert read_run_config(config).as_json() == written


def test_a_retired_setting_at_another_value_is_not_dropped(tmp_path: Path) -> None:
    value = json.loads((PUBLISHED / "roc" / "config.json").read_text())
    value["config"]["rescore"]["cues"]["guarded"]["inverse_depth"] = False
    path = tmp_path / "config.json"
    path.write_text(json.dumps(value))
    # a run made with it cannot be taken for one without
    with pytest.raises(ValueError, match="inverse_depth"):
        read_run_config(path).config.rescoring()


def test_figures_of_another_kind_are_named_with_their_place(tmp_path: Path) -> None:
    value = json.loads((PUBLISHED / "roc" / "metrics.json").read_text())
    value["rows"][1]["auc"] = "large"
    path = tmp_path / "metrics.json"
    path.write_text(json.dumps(value))
    with pytest.raises(RescoreError, match=r"expected the figures of a run, got rows\[1\]\.auc: .*'large'"):
        read_metrics(path)
    del value["rows"]
    path.write_text(json.dumps(value))
    with pytest.raises(RescoreError, match="expected key 'rows', found none"):
        read_metrics(path)


def test_settings_of_another_kind_are_named_with_their_place(tmp_path: Path) -> None:
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"seed": "many"}))
    with pytest.raises(RescoreError, match=r"expected the settings of a run, got seed: .*'many'"):
        read_run_config(path)
    path.write_text(json.dumps({"config": {"rescore": {"cues": {"guarded": {"scale_limits": 3}}}}}))
    with pytest.raises(RescoreError, match=r"guarded\.scale_limits: .*\(3\)"):
        read_run_config(path)


@pytest.mark.parametrize("content", [{}, {"config": {"class_name": None, "rescore": {}, "predicted": None}}])
def test_settings_that_older_versions_lack_have_defaults(content: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "config.json"
    path.write_text(json.dumps(content))
    older = read_run_config(path)
    assert older.as_json() == content
    config = older.config
    assert (config.class_name, config.split, config.predicted, config.cues) == ("car", "test", {}, None)


def test_settings_of_rescoring_are_refused_where_one_is_unknown(tmp_path: Path) -> None:
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"config": {"rescore": {"view_bin": 4, "cues": {"new": 1}}}}))
    config = read_run_config(path).config
    assert config.cues == CueConfig()
    with pytest.raises(ValueError, match=r"settings\.cues: unknown setting 'new'"):
        config.rescoring()


def test_what_a_run_writes_is_what_readers_find(tmp_path: Path) -> None:
    preset = run_preset("tiny").as_json() | {"class_name": "lorry"}
    changed = RunConfig.model_validate(merged(preset, {"rescore": {"cues": {"guarded": {"cap": 0.2}}}}))
    path = tmp_path / "config.json"
    write_run_config(path, "reproduce", changed.as_json(), 3, stereo=changed.synth.sgbm, data=tmp_path)
    found = read_run_config(path)
    assert (found.command, found.seed, found.stereo) == ("reproduce", 3, changed.synth.sgbm)
    assert found.data == str(tmp_path)
    config = found.config
    assert (config.preset, config.class_name) == ("tiny", "lorry")
    assert config.rescoring() == changed.rescore
    assert config.cues == changed.rescore.cues
    # in the order of the settings too
    assert list(json.loads(path.read_text())["config"]) == list(changed.as_json())
    write_json(tmp_path / "again.json", found.as_json())
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


def test_a_published_run_of_an_older_version_is_read_without_its_retired_settings() -> None:
    folder = PUBLISHED / "roc"
    content = read_run_config(folder / "config.json")
    assert "inverse_depth" not in content.config.everything["rescore"]["cues"]["guarded"]
    assert run_config(folder).detectors == ("hog", "boosted")
