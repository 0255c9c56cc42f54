"""Where the files of a run lie."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from rescore.evidence.registration import Registration
from rescore.files import read_json
from rescore.results.candidate_file import Columns, read_candidates

_NEEDED = (
    *("detector", "image_id", "rank", "x0", "y0", "x1", "y1", "detector_score", "likelihood", "status"),
    *("depth_difference", "scale", "offset", "outcome_detector"),
)


@dataclass(frozen=True, eq=False)
class Run:
    """A run folder in memory, without its pictures."""

    root: Path
    config: Mapping[str, Any]
    metrics: Mapping[str, Any]
    candidates: Columns
    """candidates.parquet, a row a candidate."""
    _rows: dict[str, Columns] = field(default_factory=dict, init=False, repr=False)
    """The rows of each detector that was asked for: every picture looks them up."""

    @property
    def detectors(self) -> tuple[str, ...]:
        """Detectors in the order of metrics.json."""
        return tuple(dict.fromkeys(str(row["detector"]) for row in self.metrics["rows"]))

    @property
    def modes(self) -> tuple[str, ...]:
        """Ways of scoring in the order of metrics.json; "detector" is the detector alone."""
        return tuple(dict.fromkeys(str(row["mode"]) for row in self.metrics["rows"]))

    @property
    def data_dir(self) -> Path:
        """The folder of the data set: ``data`` of the run folder, or the one that config.json names."""
        named = self.config.get("data")
        return Path(named) if isinstance(named, str) else self.root / "data"

    @property
    def class_name(self) -> str:
        """The class of the run, as the data set names it."""
        return str(self._settings.get("class_name", "car"))

    @property
    def split(self) -> str:
        """The split that was evaluated; "all" for the whole data set."""
        return str(self._settings.get("split", "test"))

    @property
    def _settings(self) -> Mapping[str, Any]:
        settings = self.config.get("config")
        return settings if isinstance(settings, dict) else {}

    @property
    def other_system(self) -> bool:
        """Whether depth that another system predicted led to scores of the run."""
        return bool(self._settings.get("predicted"))

    def tuning(self) -> Mapping[str, Mapping[str, Any]]:
        """The choice of w in the last mode, by detector: ``w``, ``w_grid``, ``objective``,
        ``objective_name`` and, but for older versions, ``uncertainty``; may be empty."""
        found: Mapping[str, Mapping[str, Any]] = self.metrics.get("tuning", {})
        return {name: t.get("modes", {}).get(self.modes[-1], t) for name, t in found.items()}

    def reliability(self) -> tuple[Mapping[str, Any], ...]:
        """The reliability curves of the detectors alone and of the last mode; may be empty."""
        shown = {"detector", self.modes[-1]}
        return tuple(r for r in self.metrics.get("reliability", ()) if r["mode"] in shown)

    def part_names(self) -> tuple[str, ...]:
        """Names of the parts of the class model, label 1 first; empty where the run folder holds no model."""
        path = self.class_model_path()
        return () if path is None else tuple(str(n) for n in _read_object(path)["part_names"])

    def class_model_path(self) -> Path | None:
        """The class model of the run; None where the run folder holds none."""
        found = sorted((self.root / "models").glob("*.json"))
        return next((p for p in found if _read_object(p).get("part_names")), None)

    def row(self, detector: str, mode: str) -> Mapping[str, Any]:
        """The row of metrics.json of one detector and mode."""
        for row in self.metrics["rows"]:
            if row["detector"] == detector and row["mode"] == mode:
                return dict(row)
        raise RescoreError(
            f"{self.root / 'metrics.json'}: expected a row {detector}/{mode}, got none; evaluate again"
        )

    def of(self, detector: str) -> Columns:
        """The rows of candidates.parquet of one detector, which all callers share: not to be written to."""
        if detector not in self._rows:
            keep = self.candidates["detector"] == detector
            self._rows[detector] = {name: column[keep] for name, column in self.candidates.items()}
        return self._rows[detector]


def load_run(run_dir: Path) -> Run:
    """Read config.json, metrics.json and candidates.parquet of a run folder.

    Raises:
        RescoreError: a file is missing, damaged, or lacks a column or figure.
    """
    root = Path(run_dir)
    for name in ("config.json", "metrics.json", "candidates.parquet"):
        if not (root / name).is_file():
            raise RescoreError(
                f"{root}: expected a run folder with {name}, found none; run `rescore evaluate` first"
            )
    columns = read_candidates(root / "candidates.parquet", _NEEDED)
    metrics = _read_object(root / "metrics.json")
    lacking = [key for key in ("n_images", "n_cars", "n_candidates", "rows") if key not in metrics]
    if lacking:
        raise RescoreError(
            f"{root / 'metrics.json'}: expected key {lacking[0]!r}, found none; run `rescore evaluate` again"
        )
    n = len(columns["rank"])
    if n != metrics["n_candidates"]:
        raise RescoreError(
            f"{root}: expected {metrics['n_candidates']} candidates in candidates.parquet, as metrics.json "
            f"says, got {n}: the two are of different runs; run `rescore evaluate` again"
        )
    return Run(root, _read_object(root / "config.json"), metrics, columns)


def boxes_px(rows: Columns) -> FloatArray:
    """Boxes (n, 4) of table rows: left, top, right, bottom pixel edges."""
    return np.stack([rows[k] for k in ("x0", "y0", "x1", "y1")], axis=1).astype(float)


def _read_object(path: Path) -> Mapping[str, Any]:
    value = read_json(path, "the results of a run")
    if not isinstance(value, dict):
        raise RescoreError(f"{path}: expected a JSON object, got {type(value).__name__}; evaluate again")
    return value


EVIDENCE_TABLE = "candidates.json"
"""Name of the file in a folder of evidence that holds the candidates with the outcome of eq. 6, before w."""


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
        """Path of a trained detector."""
        return self.root / "models" / f"{name}.npz"

    def scaling(self, name: str) -> Path:
        """Path of the Platt scaling of a detector."""
        return self.root / "models" / f"{name}.platt.json"

    def detections(self, name: str, split: str) -> Path:
        """Path of the candidates of a detector on a split."""
        return self.root / "detections" / f"{name}_{split}.json"

    def evidence_table(self, name: str, split: str) -> Path:
        """Path of a detector's candidates on a split with depth evidence, before w; of the test set they lie
        beside their reconstructions."""
        if split == "test":
            return self.evidence(name) / EVIDENCE_TABLE
        return self.root / "rescored" / f"{name}_{split}_evidence.json"

    def evidence(self, name: str) -> Path:
        """Folder of the reconstructions of a detector's candidates on the test set, a file a frame."""
        return self.root / "evidence" / name

    def evidence_model(self, name: str) -> Path:
        """Path of the models that turn the depth cues of a detector's candidates into D."""
        return self.root / "models" / f"{name}.evidence.json"

    def tuned(self, name: str, mode: str) -> Path:
        """Path of the weight w of a detector in a mode, with the curve it was chosen from."""
        return self.root / "tuned" / f"{name}{_suffix(mode)}.json"

    def rescored(self, name: str, mode: str) -> Path:
        """Path of a detector's candidates on the test set, rescored in a mode."""
        return self.root / "rescored" / f"{name}_test{_suffix(mode)}.json"


def _suffix(mode: str) -> str:
    return "" if mode == Registration.PAPER else f"_{mode}"
