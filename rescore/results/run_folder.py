"""A run folder: where its files lie, and what they hold."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.reading import reading
from recon.stores import located
from rescore.evidence.registration import Registration
from rescore.files import read_json_object
from rescore.results.candidate_file import ALONE, REQUIRED_COLUMNS, Columns, read_candidates
from rescore.results.metrics_file import Metrics, ReliabilityRow, Row, TunedWeight, read_metrics
from rescore.results.run_config_file import RunConfigFile, read_run_config

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
    def config(self) -> Path:
        """What it was made with."""
        return self.root / "config.json"

    @property
    def candidates(self) -> Path:
        """The table of its candidates."""
        return self.root / "candidates.parquet"

    @property
    def metrics(self) -> Path:
        """Content of metrics.json."""
        return self.root / "metrics.json"

    @property
    def curves(self) -> Path:
        """The curves as pictures."""
        return self.root / "curves"

    @property
    def sweep(self) -> Path:
        """The study of a spoilt input, where it was made."""
        return self.root / "sweep" / "sweep.json"

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


@dataclass(frozen=True, eq=False)
class Run:
    """A run folder in memory, without its pictures."""

    root: Path
    config: RunConfigFile
    metrics: Metrics
    candidates: Columns
    """candidates.parquet, a row a candidate."""
    _rows: dict[str, Columns] = field(default_factory=dict, init=False, repr=False)
    """The rows of each detector that was asked for: every picture looks them up."""

    @property
    def folder(self) -> RunFolder:
        """Where the files of the run lie."""
        return RunFolder(self.root)

    @property
    def detectors(self) -> tuple[str, ...]:
        """Detectors in the order of metrics.json."""
        return self.metrics.detectors

    @property
    def modes(self) -> tuple[str, ...]:
        """Ways of scoring in the order of metrics.json; "detector" is the detector alone."""
        return self.metrics.modes

    @property
    def data_dir(self) -> Path:
        """The folder of the data set: ``data`` of the run folder, or the one that config.json names."""
        return self.folder.data if self.config.data is None else located(self.config.data)

    @property
    def class_name(self) -> str:
        """The class of the run, as the data set names it."""
        return self.config.config.class_name

    @property
    def split(self) -> str:
        """The split that was evaluated; "all" for the whole data set."""
        return self.config.config.split

    @property
    def other_system(self) -> bool:
        """Whether depth that another system predicted led to scores of the run."""
        return bool(self.config.config.predicted)

    def tuning(self) -> dict[str, TunedWeight]:
        """The choice of w in the last mode, by detector; may be empty."""
        return {name: t.of(self.modes[-1]) for name, t in self.metrics.tuning.items()}

    def reliability(self) -> tuple[ReliabilityRow, ...]:
        """The reliability curves of the detectors alone and of the last mode; may be empty."""
        return tuple(r for r in self.metrics.reliability if r.mode in {ALONE, self.modes[-1]})

    def part_names(self) -> tuple[str, ...]:
        """Names of the parts of the class model, label 1 first; empty where the run folder holds no model."""
        path = self.class_model_path()
        if path is None:
            return ()
        with reading(path, "a class model with names of its parts", "learn the model again"):
            return tuple(str(n) for n in read_json_object(path, "a model")["part_names"])

    def class_model_path(self) -> Path | None:
        """The class model of the run; None where the run folder holds none."""
        found = sorted((self.root / "models").glob("[!.]*.json"))
        return next((p for p in found if read_json_object(p, "a model").get("part_names")), None)

    def row(self, detector: str, mode: str) -> Row:
        """The row of metrics.json of one detector and mode."""
        for row in self.metrics.rows:
            if (row.detector, row.mode) == (detector, mode):
                return row
        raise RescoreError(
            f"{self.folder.metrics}: expected a row {detector}/{mode}, got none; evaluate again"
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
    folder = RunFolder(located(run_dir))
    for file in (folder.config, folder.metrics, folder.candidates):
        if not file.is_file():
            raise RescoreError(
                f"{folder.root}: expected a run folder with {file.name}, found none; run `rescore evaluate` "
                "first"
            )
    columns = read_candidates(folder.candidates, REQUIRED_COLUMNS)
    metrics = read_metrics(folder.metrics)
    n = len(columns["rank"])
    if n != metrics.n_candidates:
        raise RescoreError(
            f"{folder.root}: expected {metrics.n_candidates} candidates in candidates.parquet, as "
            f"metrics.json says, got {n}: the two are of different runs; run `rescore evaluate` again"
        )
    return Run(folder.root, read_run_config(folder.config), metrics, columns)


def missing_evidence(run: Run) -> tuple[str, ...]:
    """What to tell of evidence files that are not there though others of their detector are, a line each."""
    told = []
    for detector in run.detectors:
        folder = run.folder.evidence(detector)
        if not folder.is_dir():
            continue
        images = np.unique(run.of(detector)["image_id"]).tolist()
        lost = [i for i in images if not (folder / f"{i}.npz").is_file()]
        if lost:
            told.append(
                f"{folder}: expected evidence of {len(images)} frames, {len(lost)} are missing, such as "
                f"{lost[0]}.npz: their candidates are shown without it; find the evidence again"
            )
    return tuple(told)


def boxes_px(rows: Columns) -> FloatArray:
    """Boxes (n, 4) of table rows: left, top, right, bottom pixel edges."""
    return np.stack([rows[k] for k in ("x0", "y0", "x1", "y1")], axis=1).astype(float)
