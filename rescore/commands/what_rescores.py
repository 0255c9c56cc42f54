"""What rescores in `rescore apply`: what its options name, or the rescorer that comes with the package."""

# ruff: noqa: PLC0415 - imports inside functions keep `--help` quick

from dataclasses import astuple, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from recon.errors import RescoreError
from rescore.commands.base import config_of, mode_of
from rescore.commands.depth_source import Source, source_of

if TYPE_CHECKING:
    from rescore.evidence.model import EvidenceModel
    from rescore.evidence.registration import Registration
    from rescore.experiment.config import RunConfig


@dataclass(frozen=True)
class Rescores:
    """What rescores: the source of predicted depth, the mode with its model of D, the weight, the
    settings."""

    source: Source
    mode: "Registration"
    learned: "EvidenceModel | None"
    w: float
    settings: "RunConfig"
    words: str
    """What of these was used, in one line."""


@dataclass(frozen=True)
class Named:
    """The options that name what rescores; all None for what comes with the package."""

    model: Path | None
    predicted: Path | None
    tuned: Path | None
    w: float | None
    registration: str | None
    evidence_model: Path | None

    def rescores(self, preset: str, changes: Path | None) -> Rescores:
        """What the options name, or what comes with the package for the class of the settings.

        Raises:
            RescoreError: options that do not go together, or no rescorer for the class.
        """
        if all(option is None for option in astuple(self)):
            return _shipped(preset, changes)
        return self._named(config_of(preset, changes))

    def _named(self, settings: "RunConfig") -> Rescores:
        from rescore.evidence.registration import check_depth_of
        from rescore.fusion.tuning_file import tuned_weight

        if (self.tuned is None) == (self.w is None):
            came = "neither" if self.w is None else "both"
            raise RescoreError(f"apply: expected either --tuned or --w, got {came}; give one of them")
        mode, learned = mode_of(self.registration or "paper", self.evidence_model)
        source = source_of(self.model, self.predicted, (mode,))
        w = self.w if self.tuned is None else tuned_weight(self.tuned, mode, source.depth_of)
        assert w is not None
        if learned is not None:
            check_depth_of(str(self.evidence_model), learned.depth_of, source.depth_of)
        depth = f"class model {self.model}" if self.predicted is None else f"predictions {self.predicted}"
        fitted = "" if learned is None else f" ({self.evidence_model})"
        chosen = "" if self.tuned is None else f" ({self.tuned})"
        words = f"{depth}, evidence of mode {mode}{fitted}, w {w:.2f}{chosen}"
        return Rescores(source, mode, learned, w, settings, words)


def _shipped(preset: str, changes: Path | None) -> Rescores:
    """What comes with the package, its settings with the changes of a file."""
    from rescore.experiment.config import run_preset, with_changes
    from rescore.library.bundles import default_bundle

    bundle = default_bundle(config_of(preset, changes).class_name)
    settings = run_preset(preset).model_copy(update={"rescore": bundle.config})
    settings = with_changes(settings, changes) if changes else settings
    mode = bundle.evidence_model.registration
    source = Source(bundle.class_model, None)
    return Rescores(source, mode, bundle.evidence_model, bundle.w, settings, bundle.words)
