"""The small run folder with mode ``instance``: each candidate has fitted cars whose places are known."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rescore.data.boxes3d import BOX_NAMES, Boxes3D
from rescore.evidence.files import evidence_path, read_evidence, write_evidence
from rescore.evidence.fit_summaries import FitSummary, FittedInstance
from rescore.evidence.registration import Registration
from rescore.results.candidate_file import read_candidates
from rescore.results.run_folder import RunFolder, boxes_px
from tests.reports.metric_run import make_metric_run

SIZE_M = (4.2, 1.7, 1.5)
FRAMED_PX, SEEN_PX = 24.0, 30.0
"""Disparity of the two cars of each candidate."""
NO_FIT = 3
"""Rank of the candidates in which no car was placed."""
TRUE_BOX = [1.0, 1.2, 9.0, 4.0, 1.8, 1.4, 0.25]
"""3D box of the car of the first annotation."""


def box_of(rank: int) -> list[float]:
    """3D box of the car that fits a candidate best."""
    return [-3.0 + rank, 1.0, 8.0 + rank, *SIZE_M, 0.5 * rank]


def fit_of(xyxy_px: np.ndarray, rank: int) -> FitSummary | None:
    """The fit of a candidate: the car that fits the depth best reaches half a box beyond its right edge."""
    if rank == NO_FIT:
        return None
    x0, y0, x1, y1 = xyxy_px
    seen = np.array([x0, y0, x1 + (x1 - x0) / 2, y1])
    columns, rows = np.linspace(x0 - 4, seen[2] + 4, 40), np.linspace(y0 - 4, y1 + 4, 20)
    box = Boxes3D.of_values(np.array([box_of(rank)]), np.full((1, 7), 0.1))
    return FitSummary(
        columns,
        rows,
        FittedInstance(box, xyxy_px, _disparity(columns, rows, xyxy_px, FRAMED_PX)),
        FittedInstance(box, seen, _disparity(columns, rows, seen, SEEN_PX)),
        0.5,
    )


def _disparity(
    columns: np.ndarray, rows: np.ndarray, silhouette_px: np.ndarray, disparity_px: float
) -> np.ndarray:
    x0, y0, x1, y1 = silhouette_px
    x, y = np.meshgrid(columns + 0.5, rows + 0.5)
    return np.where((x > x0) & (x < x1) & (y > y0) & (y < y1), disparity_px, np.nan).astype(np.float32)


def make_instance_run(source: Path, root: Path) -> Path:
    """A copy of a small run folder with mode ``instance``, fits in its evidence, and 3D boxes."""
    make_metric_run(source, root, mode=Registration.INSTANCE)
    folder = RunFolder(root)
    columns = read_candidates(folder.candidates, ())
    boxes = boxes_px(columns)
    values = [box_of(r) if r != NO_FIT else [np.nan] * 7 for r in columns["rank"].tolist()]
    columns |= {f"box3d_{name}": v for name, v in zip(BOX_NAMES, np.array(values).T, strict=True)}
    fitted = columns["rank"] != NO_FIT
    columns |= {"view_bin": np.where(fitted, "left front", ""), "second_view": np.where(fitted, "rear", "")}
    columns["view_probability"] = np.where(fitted, 0.75, np.nan)
    pq.write_table(pa.table(columns), folder.candidates)
    for detector in dict.fromkeys(columns["detector"]):
        for image_id in np.unique(columns["image_id"]).tolist():
            own = np.flatnonzero((columns["detector"] == detector) & (columns["image_id"] == image_id))
            own = own[np.argsort(columns["rank"][own])]
            path = evidence_path(root / "evidence" / detector, image_id)
            fits = [fit_of(boxes[i], int(columns["rank"][i])) for i in own]
            write_evidence(path, read_evidence(path), fits)
    file = root / "data" / "annotations.json"
    content = json.loads(file.read_text())
    content["annotations"][0]["bbox3d"] = TRUE_BOX
    file.write_text(json.dumps(content))
    return root
