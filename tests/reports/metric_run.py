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


def evidence_model() -> EvidenceModel:
    """Two cues speak: height 0.7 and foot -0.5 log odds a unit, about 0; the others say nothing."""
    knots = {name: np.array([-1.0, 1.0]) for name in cues_of(Registration.METRIC)}
    log_odds = {name: np.zeros(2) for name in knots} | {
        "height": np.array([-0.7, 0.7]),
        "foot": np.array([0.5, -0.5]),
    }
    return EvidenceModel(Registration.METRIC, knots, log_odds, bias=-1.0, min_share=0.5, floors={})


def make_metric_run(source: Path, root: Path, seed: int = 5) -> Path:
    """A copy of a small run folder with mode ``metric``, its evidence models and its figures."""
    shutil.copytree(source, root)
    rng = np.random.default_rng(seed)
    folder = RunFolder(root)
    columns = read_candidates(folder.candidates, ())
    n = len(columns["rank"])
    cues = rng.uniform(-1, 1, (n, len(CUES)))
    d = evidence_model().difference(cues)
    posterior = fuse(columns["likelihood"], d, W)
    columns |= {f"cue_{name}": column for name, column in zip(CUES, cues.T, strict=True)}
    columns |= {"difference_metric": d, "posterior_metric": posterior, "w_metric": np.full(n, W)}
    columns |= {"status_metric": np.full(n, "ok", object), "outcome_metric": np.empty(n, object)}
    columns["annotation_id_metric"] = np.full(n, -1)
    truth = TruthTable.of(read_dataset(root / "data").split("test"))
    boxes = boxes_px(columns)
    metrics = read_metrics(folder.metrics)
    rows = list(metrics.rows)
    tuning = {}
    for detector in dict.fromkeys(columns["detector"]):
        own = columns["detector"] == detector
        ranking = ranking_of(posterior[own], columns["detector_score"][own])
        match = greedy_match(columns["image_id"][own], boxes[own], ranking, truth)
        columns["outcome_metric"][own] = [str(OUTCOMES[o]) for o in match.outcome]
        columns["annotation_id_metric"][own] = match.annotation_id
        rows.append(Row.of(detector, "metric", W, summarise(match), None))
        own_modes = metrics.tuning[detector].modes
        tuning[detector] = DetectorTuning.first_of(own_modes | {"metric": own_modes["paper"]})
        save_models(folder.evidence_model(detector), {Registration.METRIC: evidence_model()})
    order = {name: i for i, name in enumerate(dict.fromkeys(columns["detector"]))}
    rows.sort(key=lambda row: order[row.detector])
    write_metrics(folder.metrics, metrics.model_copy(update={"rows": tuple(rows), "tuning": tuning}))
    pq.write_table(pa.table(columns), folder.candidates)
    return root
