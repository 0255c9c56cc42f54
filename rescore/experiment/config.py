"""The config of a whole run, its presets, and the reading of a user's changes to it."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.errors import RescoreError

if TYPE_CHECKING:
    pass

from collections.abc import Mapping
from typing import get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    create_model,
    field_validator,
    model_validator,
)

from datasets_synth.presets import SynthConfig, synth_preset
from recon.learning.learn import LearnConfig
from rescore.detectors.registry import DETECTORS, learned_detectors
from rescore.evidence.fit_model import EvidenceConfig
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.files import read_json
from rescore.formats.checked_json import first_difference, merged, refuse_unknown_keys
from rescore.fusion.tune import TuneConfig
from rescore.results.run_config_file import read_run_config
from rescore.results.run_folder import RunFolder


class RunConfig(BaseModel):
    """Everything that decides the result of a run. Defaults are those of the parts."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    preset: str
    """Name of the preset it started from."""
    detectors: tuple[str, ...] = Field(default_factory=learned_detectors, min_length=1)
    """Detectors to train and compare, names of ``rescore.detectors.registry``."""
    class_name: str = "car"
    synth: SynthConfig
    learn: LearnConfig = LearnConfig()
    detector_settings: dict[str, Any] = Field(default_factory=dict, exclude=True)
    """Settings of every detector of the registry by its name. In JSON they stand beside the other settings,
    under the detector's own name."""
    rescore: RescoreConfig = RescoreConfig()
    evidence: EvidenceConfig = EvidenceConfig()
    registrations: tuple[Registration, ...] = Field(
        default=(Registration.PAPER, Registration.GUARDED, Registration.METRIC), min_length=1
    )
    """Modes to compare."""
    tune: TuneConfig = TuneConfig()

    @model_validator(mode="before")
    @classmethod
    def _read(cls, value: Any) -> Any:
        """Gather the settings of detectors, and refuse unknown keys of all parts.

        Dataclasses would drop keys they do not know; a misspelt setting must not go unseen.
        """
        if not isinstance(value, Mapping):
            return value
        value, hints = dict(value), get_type_hints(cls)
        given = value.pop("detector_settings", {})
        given = {name: value.pop(name, given.get(name, entry.config())) for name, entry in DETECTORS.items()}
        hints |= {name: entry.config for name, entry in DETECTORS.items()}
        for name, part in {**value, **given}.items():
            refuse_unknown_keys(name, hints.get(name), part)
        kinds: dict[str, Any] = {name: (entry.config, ...) for name, entry in DETECTORS.items()}
        checked = create_model("detectors", **kinds).model_validate(given)
        return {**value, "detector_settings": dict(checked)}

    @field_validator("detectors")
    @classmethod
    def _known(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name not in DETECTORS:
                raise ValueError(f"expected {' or '.join(DETECTORS)}, got {name!r}")
        return names

    def as_json(self) -> dict[str, Any]:
        """The effective config as JSON values."""
        parts = {name: part_as_json(part) for name, part in self.detector_settings.items()}
        return {**self.model_dump(mode="json"), **parts}


def run_preset(name: str) -> RunConfig:
    """The config of a preset.

    "paper" is the report's protocol, "demo" smaller, "tiny" a few small frames; "streets" looks along
    streets at cars in all views, with the detectors of all views, modelled boxes and all modes.

    Raises:
        RescoreError: no such preset.
    """
    config = RunConfig(preset=name, synth=synth_preset(name))
    if name == "streets":
        all_views = ("modelled", "hog_views", "boosted_views")
        return config.model_copy(update={"detectors": all_views, "registrations": tuple(Registration)})
    if name != "tiny":
        return config
    # with three training frames every car must serve, and floors must be low for anything to be found
    hog, boosted = config.detector_settings["hog"], config.detector_settings["boosted"]
    mining = replace(hog.mining, rounds=0, jitter_copies=12, min_visibility=0.3)
    small = {
        "hog": replace(hog, floor=-5.0, mining=mining),
        "boosted": replace(
            boosted,
            floor=-50.0,
            mining=mining,
            fragments=replace(boosted.fragments, count=200),
            boosting=replace(boosted.boosting, rounds=30),
        ),
    }
    return config.model_copy(
        update={
            "detector_settings": config.detector_settings | small,
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


def run_config(root: Path) -> RunConfig:
    """The settings of a finished run of `rescore reproduce`.

    Raises:
        RescoreError: no settings there, or those of something else.
    """
    file = RunFolder(root).config
    content = read_run_config(file)
    try:
        return RunConfig.model_validate(content.config.everything)
    except ValidationError as error:
        raise RescoreError(
            f"{file}: expected the settings of a run of `rescore reproduce`, got {first_difference(error)}; "
            "name such a run"
        ) from error
