"""What is kept of the instances fitted to a box, so that pictures can show them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray
from recon.localization.box_samples import SampleGrid, box_samples
from recon.localization.disparity_fit import BoxFit, DisparityFitConfig
from recon.localization.poses import PoseLikelihood
from recon.shape_space import ShapeSpace
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import Frame
from rescore.evidence.instance_fits import placed_boxes, views_of_space


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
    """The instances fitted to one box, on a grid over the part of the picture that shows them."""

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


def summarise_fits(
    fits: Sequence[BoxFit | None],
    xyxy_px: FloatArray,
    frame: Frame,
    space: ShapeSpace,
    config: DisparityFitConfig,
) -> tuple[FitSummary | None, ...]:
    """What is kept of each fit; None where nothing was fitted.

    Args:
        fits: of each box.
        xyxy_px: the boxes, shape (n, 4), pixel edges.
        frame: where they were found.
        space: the shapes that were fitted.
        config: settings of the fit.
    """
    framed = placed_boxes([None if f is None else f.framed for f in fits], frame)
    seen = placed_boxes([None if f is None else f.seen for f in fits], frame)
    if frame.seen_from is None or framed is None or seen is None:
        return (None,) * len(fits)
    views = views_of_space(space, frame.seen_from.ground.height_m, config.views)
    fitted = [(i, fit) for i, fit in enumerate(fits) if fit is not None]
    areas = np.stack([area_of_fit(xyxy_px[i], fit.seen.silhouette_px) for i, fit in fitted])
    samples = box_samples(frame.disparity_px, areas, frame.seen_from, config.noise, _GRID)
    likelihood = PoseLikelihood(views, samples, config.noise, config.surface)
    found: list[FitSummary | None] = [None] * len(fits)
    for k, (i, fit) in enumerate(fitted):
        instances = {
            name: FittedInstance(
                box[i : i + 1], one.silhouette_px, likelihood.explained(one.pose, k).disparity_px
            )
            for name, one, box in (("framed", fit.framed, framed), ("seen", fit.seen, seen))
        }
        uv = samples[k].uv_px
        found[i] = FitSummary(uv[0, :, 0], uv[:, 0, 1], **instances, overlap=fit.overlap)
    return tuple(found)


def area_of_fit(xyxy_px: FloatArray, silhouette_px: FloatArray) -> FloatArray:
    """The part of a picture that shows a box and where a fitted instance ends, pixel edges (4,)."""
    reach = _REACH * float((xyxy_px[2:] - xyxy_px[:2]).max())
    low, high = np.minimum(xyxy_px, silhouette_px), np.maximum(xyxy_px, silhouette_px)
    return np.asarray(np.clip(np.concatenate([low[:2], high[2:]]), xyxy_px - reach, xyxy_px + reach))


_REACH = 1.5
"""Nothing farther from a box than so many times its longer side is shown."""
_GRID = SampleGrid(rows=30, columns=48, beside=0.05, above=0.05, below=0.05)
"""Samples of the disparity that is kept: of what is shown."""


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
