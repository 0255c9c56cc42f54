"""Where a ``Rescorer`` comes from: a small JSON file that names its parts, or the folder of a run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from recon.class_model import ClassModel
from recon.errors import RescoreError
from rescore.detectors.platt import PlattScaling, load_scaling
from rescore.evidence.model import EvidenceModel, load_model
from rescore.evidence.registration import CLASS_MODEL, LEARNED, Registration
from rescore.evidence.settings import RescoreConfig
from rescore.formats.checked_json import read_checked
from rescore.fusion.tuning_file import load_tuning, tuned_weight
from rescore.results.run_config_file import read_run_config, rescore_config
from rescore.results.run_folder import RunFolder


@dataclass(frozen=True, eq=False)
class Parts:
    """What a ``Rescorer`` is made of."""

    class_model: ClassModel | None
    w: float
    evidence_model: EvidenceModel | None
    scaling: PlattScaling | None
    config: RescoreConfig


class _File(BaseModel):
    """The JSON file. Paths are relative to its folder."""

    model_config = ConfigDict(extra="forbid")

    format: Literal["rescorer 1"]
    class_model: str | None = None
    registration: Registration = Registration.PAPER
    evidence_model: str | None = None
    log_odds_shift: Annotated[float, Field(allow_inf_nan=False)] = 0.0
    w: Annotated[float, Field(ge=0, le=1)] | None = None
    tuned: str | None = None
    scaling: str | None = None
    settings: dict[str, Any] = {}


_FILE = TypeAdapter(_File)


def parts_of_file(path: Path) -> Parts:
    """The parts that a JSON file names.

    Raises:
        RescoreError: no such file or another content, here or in the files that it names.
    """
    file = read_checked(path, _FILE, "a rescorer")
    mode, beside = file.registration, path.parent
    if (file.w is None) == (file.tuned is None):
        raise RescoreError(
            f"{path}: expected either w or tuned, got {'neither' if file.w is None else 'both'}; "
            "w is the weight itself, tuned the file that `rescore tune` wrote"
        )
    if (mode in LEARNED) != (file.evidence_model is not None):
        raise RescoreError(
            f"{path}: expected evidence_model for registrations {' and '.join(LEARNED)} alone, got "
            f"{file.evidence_model!r} for {mode}; mend one of the two"
        )
    if file.log_odds_shift and file.evidence_model is None:
        raise RescoreError(
            f"{path}: expected log_odds_shift beside an evidence_model, got {file.log_odds_shift:g} without; "
            "leave it out"
        )
    learned = load_model(beside / file.evidence_model, mode) if file.evidence_model else None
    return Parts(
        class_model=ClassModel.load(beside / file.class_model) if file.class_model else None,
        w=_weight(beside / str(file.tuned), mode, file.class_model) if file.w is None else file.w,
        evidence_model=None if learned is None else learned.shifted(file.log_odds_shift),
        scaling=load_scaling(beside / file.scaling) if file.scaling else None,
        config=_config(path, file.settings),
    )


def _weight(path: Path, mode: Registration, class_model: str | None) -> float:
    """The tuned w; where there is no class model, one that was tuned with another system's depth."""
    tuning = load_tuning(path)
    if class_model is None and tuning.depth_of == CLASS_MODEL:
        raise RescoreError(
            f"{path}: expected a weight tuned with predictions, since there is no class_model, got one tuned "
            "with depth of the class model; name the class model or run `rescore tune --predicted`"
        )
    return tuned_weight(path, mode, CLASS_MODEL if class_model else tuning.depth_of)


def parts_of_run(run_dir: Path, detector: str, mode: str) -> Parts:
    """The parts of one detector of a run in one mode.

    Raises:
        RescoreError: no such run, detector or mode, or a damaged file.
    """
    if mode not in list(Registration):
        raise RescoreError(
            f"mode: expected {', '.join(Registration)}, got {mode!r}; choose one that the run compared"
        )
    registration, folder = Registration(mode), RunFolder(run_dir)
    known = sorted(p.name.removesuffix(".platt.json") for p in run_dir.glob("models/*.platt.json"))
    if detector not in known:
        raise RescoreError(
            f"{run_dir}: expected a run with detector {detector!r}, found {', '.join(known) or 'none'}; "
            "give the folder that `rescore reproduce` wrote, and a detector of it"
        )
    config = _rescoring(folder.config)
    if config is None:
        raise RescoreError(
            f"{folder.config}: expected the settings of `rescore reproduce`, got others; give the folder "
            "that it wrote"
        )
    learned = registration in LEARNED
    return Parts(
        class_model=ClassModel.load(folder.class_model),
        w=tuned_weight(folder.tuned(detector, mode), registration),
        evidence_model=load_model(folder.evidence_model(detector), registration) if learned else None,
        scaling=load_scaling(folder.scaling(detector)),
        config=config,
    )


def _config(path: Path, settings: dict[str, Any]) -> RescoreConfig:
    """The default settings with changes of JSON values."""
    try:
        return rescore_config(settings)
    except ValueError as error:
        raise _unreadable(path, error) from error


def _rescoring(path: Path) -> RescoreConfig | None:
    """The settings of rescoring of a run; None where its command has none."""
    settings = read_run_config(path).config
    try:
        return settings.rescoring()
    except ValueError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: ValueError) -> RescoreError:
    return RescoreError(f"{path}: expected settings of rescoring, got {error}; mend the file")
