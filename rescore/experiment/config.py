"""The config of a whole run, its presets, and the reading of a user's changes to it."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.errors import RescoreError

if TYPE_CHECKING:
    pass

from collections.abc import Mapping
from typing import get_type_hints

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from datasets_synth.presets import SynthConfig, synth_preset
from recon.learning.learn import LearnConfig
from rescore.detectors.boosted import BoostedConfig
from rescore.detectors.hog_svm import HogConfig
from rescore.detectors.registry import DetectorKind
from rescore.evidence.model import EvidenceConfig
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.files import read_json
from rescore.formats.checked_json import first_difference, merged, refuse_unknown_keys
from rescore.fusion.tune import TuneConfig


class RunConfig(BaseModel):
    """Everything that decides the result of a run. Defaults are those of the parts."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    preset: str
    """Name of the preset it started from."""
    detectors: tuple[DetectorKind, ...] = Field(
        default=(DetectorKind.HOG, DetectorKind.BOOSTED), min_length=1
    )
    """Detectors to train and compare."""
    class_name: str = "car"
    synth: SynthConfig
    learn: LearnConfig = LearnConfig()
    hog: HogConfig = HogConfig()
    boosted: BoostedConfig = BoostedConfig()
    rescore: RescoreConfig = RescoreConfig()
    evidence: EvidenceConfig = EvidenceConfig()
    registrations: tuple[Registration, ...] = Field(default=tuple(Registration), min_length=1)
    """Modes to compare."""
    tune: TuneConfig = TuneConfig()

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown(cls, value: Any) -> Any:
        """Dataclasses would drop keys they do not know; a misspelt setting must not go unseen."""
        if isinstance(value, Mapping):
            hints = get_type_hints(cls)
            for name, part in value.items():
                refuse_unknown_keys(name, hints.get(name), part)
        return value

    def detector(self, kind: DetectorKind) -> HogConfig | BoostedConfig:
        """The settings of one detector."""
        return self.hog if kind is DetectorKind.HOG else self.boosted

    def as_json(self) -> dict[str, Any]:
        """The effective config as JSON values."""
        return self.model_dump(mode="json")


def run_preset(name: str) -> RunConfig:
    """The config of a preset: "paper" (the report's protocol), "demo" (smaller), "tiny" (a few small frames).

    Raises:
        RescoreError: no such preset.
    """
    config = RunConfig(preset=name, synth=synth_preset(name))
    if name != "tiny":
        return config
    # of three training frames every car must serve, and floors must be low for anything to be found
    mining = replace(config.hog.mining, rounds=0, jitter_copies=12, min_visibility=0.3)
    boosted = replace(
        config.boosted,
        floor=-50.0,
        mining=mining,
        fragments=replace(config.boosted.fragments, count=200),
        boosting=replace(config.boosted.boosting, rounds=30),
    )
    return config.model_copy(
        update={
            "hog": replace(config.hog, floor=-5.0, mining=mining),
            "boosted": boosted,
            "evidence": replace(config.evidence, min_cars=1),
        }
    )


def with_changes(config: RunConfig, file: Path) -> RunConfig:
    """The config with the settings of a JSON file in place of its own, at any depth.

    Raises:
        RescoreError: no such file, an unknown setting, or a value of another kind.
    """
    changes = read_json(file, "settings as a JSON object")
    if not isinstance(changes, dict):
        raise RescoreError(
            f"{file}: expected a JSON object of settings, got {type(changes).__name__}; mend it"
        )
    try:
        return RunConfig.model_validate(merged(config.as_json(), changes))
    except ValidationError as error:
        raise RescoreError(
            f"{file}: expected settings, got {first_difference(error)}; mend the file"
        ) from error


def part_as_json(part: Any) -> Any:
    """One part of the config as JSON values."""
    return TypeAdapter(type(part)).dump_python(part, mode="json")


def run_config(root: Path) -> "RunConfig":
    """The settings of a finished run.

    Raises:
        RescoreError: no settings there, or not those of `rescore reproduce`.
    """
    from pydantic import ValidationError

    pass
    from rescore.files import read_json

    value = read_json(root / "config.json", "the settings of a run")
    try:
        return RunConfig.model_validate(value["config"])
    except (ValidationError, KeyError, TypeError) as error:
        raise RescoreError(
            f"{root}: expected a run of `rescore reproduce`, got other settings in config.json "
            f"({type(error).__name__}); run it again"
        ) from error
