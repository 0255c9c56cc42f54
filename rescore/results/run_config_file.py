"""What a run was made with: the file config.json of a run folder, written and read here."""

from pathlib import Path
from typing import Any

from pydantic import (
    AliasPath,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    model_serializer,
    model_validator,
)

from recon.errors import RescoreError
from recon.stereo.sgbm import SgbmConfig
from rescore.evidence.cues import CueConfig
from rescore.evidence.settings import RescoreConfig
from rescore.files import read_json_object, versions, write_json
from rescore.formats.checked_json import first_difference, merged, refuse_unknown_keys

RETIRED: dict[tuple[str, ...], Any] = {
    ("rescore", "cues", "guarded", "inverse_depth"): True,
    ("tune", "recall"): 0.7,
}
"""Settings that only older versions have, by their keys in the settings of a run, with their usual values. At
these they are left out on reading: they changed no result."""
_RESCORE = "rescore"
"""Key of the settings of rescoring in the settings of `rescore reproduce`."""
_RESCORE_CONFIG = TypeAdapter(RescoreConfig)


def _without(settings: dict[str, Any], path: tuple[str, ...], usual: Any) -> dict[str, Any]:
    """The settings without the one at a path of keys, if it is there and usual."""
    first, *rest = path
    if first not in settings:
        return settings
    if not rest:
        return {key: value for key, value in settings.items() if key != first or value != usual}
    part = settings[first]
    return settings if not isinstance(part, dict) else {**settings, first: _without(part, tuple(rest), usual)}


class RunSettings(BaseModel):
    """The settings of the command that made a run, with types where somebody reads one.

    Settings of newer or older versions pass: whoever uses all of them checks them.
    """

    model_config = ConfigDict(frozen=True)

    preset: str | None = None
    """The preset of `rescore reproduce`."""
    class_name: str = "car"
    """The class of the run, as the data set names it."""
    split: str = "test"
    """The split that was evaluated; "all" for the whole data set."""
    detectors: tuple[str, ...] = ()
    """The detectors of `rescore reproduce`."""
    registrations: tuple[str, ...] = ()
    """The modes that `rescore reproduce` compared."""
    sample_of_images: int | None = None
    """Frames of the run whose sample this is (``rescore.large.sample``); None for a run of its own."""
    predicted: dict[str, Any] = {}
    """Depth that another system predicted and that led to scores of the run, by file of detections."""
    rescored: dict[str, dict[str, dict[str, Any]]] = {}
    """Settings of `rescore apply` behind the detections of `rescore evaluate`, by detector and mode."""
    cues: CueConfig | None = Field(default=None, validation_alias=AliasPath(_RESCORE, "cues"))
    """Settings of the parts of the depth evidence; None where the file has none."""
    everything: dict[str, Any] = {}
    """All settings as the file holds them but for ``RETIRED`` ones, to be shown or compared."""

    @model_validator(mode="before")
    @classmethod
    def _keep_everything(cls, given: Any) -> Any:
        """Let go what is retired, keep the rest in the order of the file, and leave nulls to the defaults."""
        if not isinstance(given, dict):
            return given
        for path, usual in RETIRED.items():
            given = _without(given, path, usual)
        return {**{key: value for key, value in given.items() if value is not None}, "everything": given}

    def rescored_with(self, detector: str, mode: str) -> dict[str, Any]:
        """The settings that rescored a detector's candidates in a mode; empty where the file has none."""
        own = self.rescored.get(detector, {}).get(mode)
        if own is not None:
            return {**own, **own.get(_RESCORE, {})}
        return dict(self.everything.get(_RESCORE) or {})

    @model_serializer
    def as_json(self) -> dict[str, Any]:
        """All settings as JSON values, in the order of the file."""
        return self.everything

    def rescoring(self) -> RescoreConfig | None:
        """All settings of rescoring; None where the command has none.

        Raises:
            ValueError: an unknown setting, or a value of another kind; its text is one line.
        """
        settings = self.everything.get(_RESCORE)
        return rescore_config(settings) if isinstance(settings, dict) else None


class RunConfigFile(BaseModel):
    """The content of config.json; what files of older versions lack has a default."""

    model_config = ConfigDict(frozen=True)

    command: str | None = None
    """The command that made the run."""
    seed: int | None = None
    data: str | None = None
    """Folder of the data set; None for ``data`` of the run folder."""
    stereo: SgbmConfig = SgbmConfig()
    """How measured depth is computed where the data set has none."""
    config: RunSettings = RunSettings()
    """Effective settings of the command; of `rescore reproduce` those of
    ``rescore.experiment.config.RunConfig``."""
    versions: dict[str, str] = {}

    def as_json(self) -> dict[str, Any]:
        """The content of the file as JSON values."""
        return self.model_dump(exclude_unset=True)


def rescore_config(changes: dict[str, Any]) -> RescoreConfig:
    """The default settings of rescoring with changes of JSON values, at any depth.

    Raises:
        ValueError: an unknown setting, or a value of another kind; its text is one line.
    """
    refuse_unknown_keys("settings", RescoreConfig, changes)
    default = _RESCORE_CONFIG.dump_python(RescoreConfig(), mode="json")
    try:
        return _RESCORE_CONFIG.validate_python(merged(default, changes))
    except ValidationError as error:
        raise ValueError(first_difference(error)) from error


def write_run_config(
    path: Path,
    command: str,
    config: dict[str, Any],
    seed: int | None,
    *,
    stereo: SgbmConfig,
    data: Path | None = None,
) -> None:
    """Write config.json: effective config, seed, versions, and where the data set is."""
    place = {} if data is None else {"data": str(data.resolve())}
    content = RunConfigFile(
        command=command,
        seed=seed,
        stereo=stereo,
        config=RunSettings.model_validate(config),
        versions=versions(),
        **place,
    )
    write_json(path, content.as_json())


def read_run_config(path: Path) -> RunConfigFile:
    """What config.json of a run folder says.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    value = read_json_object(path, "the settings of a run")
    try:
        return RunConfigFile.model_validate(value)
    except ValidationError as error:
        raise RescoreError(
            f"{path}: expected the settings of a run, got {first_difference(error)}; evaluate again"
        ) from error
