"""Adds a mode with learned evidence to the small run folder, by an evidence model whose numbers are known."""

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rescore.evidence.cues import CUES, cues_of
from rescore.evidence.model import EvidenceModel, save_models
from rescore.evidence.registration import Registration
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.fuse import fuse
from rescore.metrics.curves import summarise
from rescore.metrics.matching import OUTCOMES, TruthTable, greedy_match, ranking_of
from rescore.results.candidate_file import read_candidates
from rescore.results.metrics_file import DetectorTuning, Row, read_metrics, write_metrics
from rescore.results.run_folder import RunFolder, boxes_px

W = 0.4


def evidence_model(mode: Registration = Registration.METRIC) -> EvidenceModel:
    """Two cues speak: height, or how far the car reaches to the right, 0.7 and foot -0.5 log odds a unit,
    about 0; the others say nothing."""
    knots = {name: np.array([-1.0, 1.0]) for name in cues_of(mode)}
    log_odds = {name: np.zeros(2) for name in knots} | {
        "height" if mode is Registration.METRIC else "end_right": np.array([-0.7, 0.7]),
        "foot": np.array([0.5, -0.5]),
    }
    return EvidenceModel(mode, knots, log_odds, bias=-1.0, min_share=0.5, floors={})


def make_metric_run(
    source: Path, root: Path, seed: int = 5, mode: Registration = Registration.METRIC
) -> Path:
    """A copy of a small run folder with a learned mode, its evidence models and its figures."""
    shutil.copytree(source, root)
    rng = np.random.default_rng(seed)
    folder = RunFolder(root)
    columns = read_candidates(folder.candidates, ())
    n = len(columns["rank"])
    cues = rng.uniform(-1, 1, (n, len(CUES)))
    d = evidence_model(mode).difference(cues)
    posterior = fuse(columns["likelihood"], d, W)
    columns |= {f"cue_{name}": column for name, column in zip(CUES, cues.T, strict=True)}
    columns |= {f"difference_{mode}": d, f"posterior_{mode}": posterior, f"w_{mode}": np.full(n, W)}
    columns |= {f"status_{mode}": np.full(n, "ok", object), f"outcome_{mode}": np.empty(n, object)}
    columns[f"annotation_id_{mode}"] = np.full(n, -1)
    truth = TruthTable.of(read_dataset(root / "data").split("test"))
    boxes = boxes_px(columns)
    metrics = read_metrics(folder.metrics)
    rows = list(metrics.rows)
    tuning = {}
    for detector in dict.fromkeys(columns["detector"]):
        own = columns["detector"] == detector
        ranking = ranking_of(posterior[own], columns["detector_score"][own])
        match = greedy_match(columns["image_id"][own], boxes[own], ranking, truth)
        columns[f"outcome_{mode}"][own] = [str(OUTCOMES[o]) for o in match.outcome]
        columns[f"annotation_id_{mode}"][own] = match.annotation_id
        rows.append(Row.of(detector, mode.value, W, summarise(match), None))
        own_modes = metrics.tuning[detector].modes
        tuning[detector] = DetectorTuning.first_of(own_modes | {mode.value: own_modes["paper"]})
        save_models(folder.evidence_model(detector), {mode: evidence_model(mode)})
    order = {name: i for i, name in enumerate(dict.fromkeys(columns["detector"]))}
    rows.sort(key=lambda row: order[row.detector])
    write_metrics(folder.metrics, metrics.model_copy(update={"rows": tuple(rows), "tuning": tuning}))
    pq.write_table(pa.table(columns), folder.candidates)
    return root
