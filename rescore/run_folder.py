"""Where the files of a run lie."""

from dataclasses import dataclass
from pathlib import Path

from rescore.cues import Registration

EVIDENCE_TABLE = "candidates.json"
"""In a folder of evidence: the candidates with the outcome of eq. 6, before w."""


@dataclass(frozen=True)
class RunFolder:
    """Where everything of a run lies."""

    root: Path

    @property
    def data(self) -> Path:
        """The data set."""
        return self.root / "data"

    @property
    def class_model(self) -> Path:
        """The learned class model."""
        return self.root / "models" / "class_model.json"

    @property
    def html(self) -> Path:
        """The report."""
        return self.root / "report.html"

    @property
    def recording(self) -> Path:
        """The recording for the Rerun viewer."""
        return self.root / "recording.rrd"

    def detector(self, name: str) -> Path:
        """A trained detector."""
        return self.root / "models" / f"{name}.npz"

    def scaling(self, name: str) -> Path:
        """Its Platt scaling."""
        return self.root / "models" / f"{name}.platt.json"

    def detections(self, name: str, split: str) -> Path:
        """Its candidates on a split."""
        return self.root / "detections" / f"{name}_{split}.json"

    def evidence_table(self, name: str, split: str) -> Path:
        """Its candidates on a split with depth evidence, before w; those of the test set lie beside their
        reconstructions."""
        if split == "test":
            return self.evidence(name) / EVIDENCE_TABLE
        return self.root / "rescored" / f"{name}_{split}_evidence.json"

    def evidence(self, name: str) -> Path:
        """Reconstructions of its candidates on the test set, a file a frame."""
        return self.root / "evidence" / name

    def evidence_model(self, name: str) -> Path:
        """The models that turn its candidates' depth cues into D."""
        return self.root / "models" / f"{name}.evidence.json"

    def tuned(self, name: str, mode: str) -> Path:
        """Its weight w in a mode with the curve it was chosen from."""
        return self.root / "tuned" / f"{name}{_suffix(mode)}.json"

    def rescored(self, name: str, mode: str) -> Path:
        """Its candidates on the test set, rescored in a mode."""
        return self.root / "rescored" / f"{name}_test{_suffix(mode)}.json"


def _suffix(mode: str) -> str:
    return "" if mode == Registration.PAPER else f"_{mode}"
