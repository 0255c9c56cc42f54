"""Evidence files: what was predicted of the candidates of one frame, for the pictures; one npz a frame."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from recon.depth_map import DepthMap
from recon.errors import Failure, Reason, RescoreError
from recon.files import atomic_path
from recon.reading import arrays_of, reading
from recon.reconstruction.reconstruct import Reconstruction
from rescore.evidence.fit_summaries import FitSummary, fit_arrays, fit_of_arrays
from rescore.evidence.predicted_depth import BoxPrediction

Predicted = Reconstruction | BoxPrediction | Failure

_HEADER = "header_json"
_FIT = "fit/"
_T = TypeVar("_T")


def evidence_path(folder: Path, image_id: int) -> Path:
    """Where the evidence of one frame lies in a detector's folder of evidence files."""
    return folder / f"{image_id}.npz"


def write_evidence(path: Path, found: Sequence[Predicted], fits: Sequence[FitSummary | None] = ()) -> None:
    """Write the reconstructions of a frame, or what another system predicts, in the order of its candidates.

    ``fits`` are the instances fitted to each box, in the same order; empty where none was.

    The depth of reconstructions is kept in half precision (relative error below 0.05 %), which serves for
    looking; the numbers of eq. 6 come from full precision and lie in the table of candidates.
    """
    arrays: dict[str, NDArray[Any]] = {}
    header: list[dict[str, Any]] = []
    for i, one in enumerate(found):
        if isinstance(one, Failure):
            header.append({"reason": one.reason.value, "detail": one.detail})
            continue
        if isinstance(one, BoxPrediction):
            # relative numbers may have any size, which half precision has not
            arrays[f"{i}/depth"] = one.depth.depth
            kind = {"inverse": one.inverse, "metric": one.metric}
            header.append({"origin_px": [one.depth.x0_px, one.depth.y0_px], "predicted": kind})
            continue
        planes = np.array(list(one.part_planes.values()), dtype=float).reshape(-1, 4)
        arrays |= {
            f"{i}/outline_px": one.outline_px.astype(np.float32),
            f"{i}/initial_outline_px": one.initial_outline_px.astype(np.float32),
            f"{i}/part_labels": one.part_labels,
            f"{i}/part_planes": planes,
            f"{i}/depth": np.clip(one.depth.depth, None, np.finfo(np.float16).max).astype(np.float16),
            f"{i}/ground_line_px": one.ground_line_px,
            f"{i}/cam_from_object": one.cam_from_object,
        }
        header.append(
            {
                "origin_px": [one.x0_px, one.y0_px, one.depth.x0_px, one.depth.y0_px],
                "placed_parts": [int(k) for k in one.part_planes],
                "unplaced_parts": {str(k): text for k, text in one.unplaced_parts.items()},
                "registration_cost": float(one.registration_cost),
                "placed_share": float(one.placed_share),
            }
        )
    for i, fit in enumerate(fits):
        if fit is not None:
            arrays |= {f"{i}/{_FIT}{name}": array for name, array in fit_arrays(fit).items()}
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with atomic_path(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **{_HEADER: text}, **arrays)


def read_evidence(path: Path) -> tuple[Predicted, ...]:
    """What ``write_evidence`` wrote of a frame, in the order of its candidates.

    Raises:
        RescoreError: no such file, or not an evidence file.
    """
    return _read(path, _read_one)


def read_fits(path: Path) -> tuple[FitSummary | None, ...]:
    """The instances fitted to each candidate of a frame; None where none was.

    Raises:
        RescoreError: no such file, or not an evidence file.
    """
    return _read(path, _read_fit)


def _read(path: Path, read_one: Callable[[int, dict[str, Any], Any], _T]) -> tuple[_T, ...]:
    """What a function reads of each candidate of a file."""
    if not path.is_file():
        raise RescoreError(f"{path}: expected an evidence file, found none; run `rescore apply --evidence`")
    with reading(path, "an evidence file", "run `rescore apply --evidence` again"):
        stored = arrays_of(path)
        header = json.loads(stored[_HEADER].tobytes().decode())
        return tuple(read_one(i, row, stored) for i, row in enumerate(header))


def _read_fit(i: int, _row: dict[str, Any], stored: Any) -> FitSummary | None:
    prefix = f"{i}/{_FIT}"
    arrays = {n.removeprefix(prefix): stored[n] for n in stored if n.startswith(prefix)}
    return fit_of_arrays(arrays) if arrays else None


def _read_one(i: int, row: dict[str, Any], stored: Any) -> Predicted:
    if "reason" in row:
        return Failure(Reason(row["reason"]), row["detail"])
    if "predicted" in row:
        x0, y0 = row["origin_px"]
        return BoxPrediction(DepthMap(x0, y0, stored[f"{i}/depth"]), **row["predicted"])
    x0, y0, depth_x0, depth_y0 = row["origin_px"]
    return Reconstruction(
        outline_px=stored[f"{i}/outline_px"].astype(float),
        initial_outline_px=stored[f"{i}/initial_outline_px"].astype(float),
        x0_px=x0,
        y0_px=y0,
        part_labels=stored[f"{i}/part_labels"],
        part_planes=dict(zip(row["placed_parts"], stored[f"{i}/part_planes"], strict=True)),
        unplaced_parts={int(k): text for k, text in row["unplaced_parts"].items()},
        depth=DepthMap(depth_x0, depth_y0, stored[f"{i}/depth"].astype(np.float32)),
        ground_line_px=stored[f"{i}/ground_line_px"],
        cam_from_object=stored[f"{i}/cam_from_object"],
        registration_cost=row["registration_cost"],
        placed_share=row["placed_share"],
    )
