"""What is kept of the instances fitted to a box, so that pictures can show them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray
from recon.localization.disparity_fit import BoxFit, PlacedInstance
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import Frame
from rescore.evidence.instance_fits import placed_boxes


@dataclass(frozen=True, eq=False)
class FittedInstance:
    """One fitted instance, as pictures show it."""

    box: Boxes3D
    """The 3D box of one instance with its deviations."""
    silhouette_px: FloatArray
    """Box around the silhouette, cut off at the picture's edge, pixel edges, shape (4,)."""
    disparity_px: Float32Array
    """Predicted at the samples, shape (rows, columns); NaN beside the silhouette."""


@dataclass(frozen=True, eq=False)
class FitSummary:
    """The instances fitted to one box, with the samples that they were fitted to."""

    column_px: FloatArray
    """Picture column of each column of samples, pixel centres, shape (columns,), rising."""
    row_px: FloatArray
    """Picture row of each row of samples, pixel centres, shape (rows,), rising."""
    framed: FittedInstance
    """The instance that the box frames."""
    seen: FittedInstance
    """The instance that fits the disparity best, in the box or near it."""
    overlap: float
    """See ``BoxFit.overlap``."""


def summarise_fits(fits: Sequence[BoxFit | None], frame: Frame) -> tuple[FitSummary | None, ...]:
    """What is kept of each fit; None where nothing was fitted."""
    framed = placed_boxes([None if f is None else f.framed for f in fits], frame)
    seen = placed_boxes([None if f is None else f.seen for f in fits], frame)
    return tuple(
        None
        if fit is None or framed is None or seen is None
        else FitSummary(
            fit.samples.uv_px[0, :, 0],
            fit.samples.uv_px[:, 0, 1],
            _instance(fit.framed, framed[i : i + 1]),
            _instance(fit.seen, seen[i : i + 1]),
            fit.overlap,
        )
        for i, fit in enumerate(fits)
    )


def _instance(placed: PlacedInstance, box: Boxes3D) -> FittedInstance:
    return FittedInstance(box, placed.silhouette_px, placed.disparity_px)


_INSTANCES = ("framed", "seen")


def fit_arrays(fit: FitSummary) -> dict[str, NDArray[Any]]:
    """The arrays of a fit for a file, by name.

    The disparity is kept in half precision (relative error below 0.05 %), which serves for looking.
    """
    arrays: dict[str, NDArray[Any]] = {
        "column_px": fit.column_px.astype(np.int32),
        "row_px": fit.row_px.astype(np.int32),
        "overlap": np.array(fit.overlap),
    }
    for name in _INSTANCES:
        one: FittedInstance = getattr(fit, name)
        deviations = one.box.deviations
        arrays |= {
            f"{name}_box3d": one.box.values[0],
            f"{name}_box3d_sd": np.full(7, np.nan) if deviations is None else deviations[0],
            f"{name}_silhouette_px": one.silhouette_px,
            f"{name}_disparity_px": one.disparity_px.astype(np.float16),
        }
    return arrays


def fit_of_arrays(arrays: dict[str, NDArray[Any]]) -> FitSummary:
    """The fit of ``fit_arrays``.

    Raises:
        KeyError: an array is missing.
    """
    instances = {
        name: FittedInstance(
            Boxes3D.of_values(arrays[f"{name}_box3d"][None], arrays[f"{name}_box3d_sd"][None]),
            arrays[f"{name}_silhouette_px"].astype(float),
            arrays[f"{name}_disparity_px"].astype(np.float32),
        )
        for name in _INSTANCES
    }
    return FitSummary(
        arrays["column_px"].astype(float),
        arrays["row_px"].astype(float),
        **instances,
        overlap=float(arrays["overlap"]),
    )
