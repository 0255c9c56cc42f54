"""What a fitted instance of the class says of a box: whether what the box frames is one whole object.

A modern detector's false alarms are mostly boxes on objects that frame them badly: a part, two at once, one
with much around it. ``recon.localization.disparity_fit`` finds the instance that the disparity shows and the
one that the box would frame; these cues compare both with the box, and the latter with other explanations.
"""

from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.boxes import iou_matrix
from recon.localization.box_samples import BoxSamples, DisparityNoise
from recon.localization.disparity_fit import BoxFit, PlacedInstance

FRAMING = (
    "overlap",
    "framed_overlap",
    "end_left",
    "end_top",
    "end_right",
    "end_bottom",
    "gap",
    "explained",
    "seen_explained",
    "over_plane",
    "seen_through",
    "hidden",
    "beyond_box",
    "goes_on_beside",
    "goes_on_above",
)
"""Cues of ``framing``, in the order of its columns (see there)."""


@dataclass(frozen=True)
class FramingConfig:
    """Settings of the cues."""

    fewest: int = 6
    """A region with fewer measured samples gives no cue."""
    outlier_sd: float = 2.5
    """A measurement farther than this from the surface, in standard deviations, is of something else."""
    same_px: float = 1.0
    same_share: float = 0.06
    """Disparities within ``same_px`` or this share of the instance's are at its depth."""
    most: float = 1.5
    """Ends of the instance beyond the box are clipped to this many extents of the box."""
    most_share: float = 2.0
    """Shares of the attainable log likelihood ratio are clipped to this, both ways."""
    plane_rounds: int = 5
    sd_px: float = DisparityNoise().sd_px
    """Standard deviation of a good measurement of disparity."""


def framing(fit: BoxFit, xyxy_px: FloatArray, picture: tuple[int, int], config: FramingConfig) -> FloatArray:
    """The cues of one box, shape (15,), in the order of ``FRAMING``; NaN where one cannot be had.

    - ``overlap``: expected intersection over union of the box with the instance that the disparity shows;
      ``framed_overlap``: with the one that it would frame.
    - ``end_left``, ``end_top``, ``end_right``, ``end_bottom``: how far the instance that the disparity shows
      reaches beyond the box, in extents of the box; silent at the edge of the picture.
    - ``explained``: nats by which the framed instance explains the disparity better than a place without
      objects does, as a share of what it attains where it fits exactly; so it is alike for all rigs and
      distances. ``seen_explained``: the same of the seen instance.
    - ``gap``: nats by which the seen instance explains the disparity better than the framed one, as a share
      of what the seen one attains.
    - ``over_plane``: nats by which the framed instance explains its disparity better than the best slanted
      plane does, as a signed log(1 + nats).
    - ``seen_through``, ``hidden``: share of the framed silhouette where something farther or nearer is seen.
    - ``beyond_box``: share of the seen instance's own measurements that lie outside the box.
    - ``goes_on_beside``, ``goes_on_above``: share of what stands beside or above the framed silhouette that
      is at its depth.

    Args:
        fit: What the class and the disparity say of the box.
        xyxy_px: The box, shape (4,), pixel edges.
        picture: Width and height of the picture in pixels.
        config: Settings.
    """
    framed, seen, samples = fit.framed, fit.seen, fit.samples
    on_framed, on_seen = (np.isfinite(placed.explained.residual) for placed in (framed, seen))
    ends = _ends(seen.silhouette_px, xyxy_px, picture, config.most)
    beside, above = _around(framed, samples)
    values = {
        "overlap": fit.overlap,
        "framed_overlap": float(iou_matrix(framed.silhouette_px[None], xyxy_px[None])[0, 0]),
        **dict(zip(("end_left", "end_top", "end_right", "end_bottom"), ends, strict=True)),
        "gap": _attained(seen.total - framed.total, seen, on_seen, config),
        "explained": _attained(framed.total, framed, on_framed, config),
        "seen_explained": _attained(seen.total, seen, on_seen, config),
        "over_plane": _over_plane(framed, samples, config),
        "seen_through": _share(framed.explained.residual < -config.outlier_sd, on_framed, config),
        "hidden": _share(framed.explained.residual > config.outlier_sd, on_framed, config),
        "beyond_box": _beyond(seen, samples, config),
        "goes_on_beside": _share(_at_depth(framed, samples, config), beside & samples.standing, config),
        "goes_on_above": _share(_at_depth(framed, samples, config), above & samples.standing, config),
    }
    return np.array([values[name] for name in FRAMING])


def resolved(fit: BoxFit, config: FramingConfig) -> float:
    """How much disparity can tell of where a car stands and ends, in [0, 1].

    It is a reliability: the square of the disparity that the length of a car spans along the line of sight,
    at the distance of the framed instance, over the sum of it and the square of the matcher's noise. Near 0 a
    car, its neighbour and the hedge behind it are measured alike.
    """
    length, distance = fit.framed.box.size_m[0], fit.framed.pose.place[0, 0]
    spanned_px = fit.samples.seen_from.stereo.focal_baseline * length / distance**2
    return float(spanned_px**2 / (spanned_px**2 + config.sd_px**2))


def _share(what: BoolArray, of: BoolArray, config: FramingConfig) -> float:
    whole = int(of.sum())
    return float((what & of).sum() / whole) if whole >= config.fewest else np.nan


def _ends(
    silhouette_px: FloatArray, xyxy_px: FloatArray, picture: tuple[int, int], most: float
) -> FloatArray:
    """How far a silhouette's box reaches beyond a box on each side, shape (4,), in extents of the box."""
    extent = np.tile(xyxy_px[2:] - xyxy_px[:2], 2)
    beyond = np.clip((silhouette_px - xyxy_px) * [-1, -1, 1, 1] / extent, -most, most)
    limits = np.array([0.0, 0.0, *picture])
    cut = np.abs(xyxy_px - limits) < _AT_THE_EDGE_PX
    return np.where(cut, np.nan, beyond)


_AT_THE_EDGE_PX = 2.0
"""A box that ends this near to the edge of the picture is cut off there."""


def _attained(nats: float, placed: PlacedInstance, on: BoolArray, config: FramingConfig) -> float:
    """Nats as a share of what an instance attains."""
    if on.sum() < config.fewest or placed.attainable <= 0:
        return np.nan
    return float(np.clip(nats / placed.attainable, -config.most_share, config.most_share))


def _at_depth(placed: PlacedInstance, samples: BoxSamples, config: FramingConfig) -> BoolArray:
    """Mask of the samples (rows, columns) that lie at the middle depth of an instance."""
    on = np.isfinite(placed.explained.disparity_px)
    middle = float(np.median(placed.explained.disparity_px[on])) if on.any() else np.nan
    tolerance = max(config.same_px, config.same_share * middle)
    return np.asarray(np.abs(samples.disparity_px - middle) < tolerance)


def _beyond(seen: PlacedInstance, samples: BoxSamples, config: FramingConfig) -> float:
    own = np.abs(seen.explained.residual) < config.outlier_sd
    return _share(~samples.inside, own, config)


def _around(placed: PlacedInstance, samples: BoxSamples) -> tuple[BoolArray, BoolArray]:
    """Masks of the samples (rows, columns) beside and above the silhouette."""
    (left, top, right, bottom), off = placed.silhouette_px, ~np.isfinite(placed.explained.disparity_px)
    width, height = right - left, bottom - top
    u, v = samples.uv_px[..., 0] + 0.5, samples.uv_px[..., 1] + 0.5
    out = np.maximum(left - u, u - right)
    beside = (out > 2) & (out < 0.25 * width) & (v > top + 0.2 * height) & (v < bottom - 0.15 * height)
    middle = (u > left + 0.1 * width) & (u < right - 0.1 * width)
    above = (v < top - 1) & (v > top - 0.35 * height) & middle
    return beside & off, above & off


def _over_plane(framed: PlacedInstance, samples: BoxSamples, config: FramingConfig) -> float:
    """Signed log(1 + nats) by which the instance explains its samples better than the best plane does.

    The plane is any in space, so linear in (u, v, disparity); its errors are taken to be spread as those of
    the instance, with the same share of other things.
    """
    use = np.isfinite(framed.explained.residual) & (framed.explained.weight > 0)
    if use.sum() < max(config.fewest, 4):
        return np.nan
    seen, weight = samples.disparity_px[use].astype(float), framed.explained.weight[use].astype(float)
    spread, own = framed.explained.spread_px[use].astype(float), framed.explained.residual[use].astype(float)
    u, v = (samples.uv_px[use] - samples.uv_px[use].mean(axis=0)).T
    basis = np.stack([np.ones_like(u), u, v], axis=1)
    residual = own
    for _ in range(config.plane_rounds):
        pull = weight / spread**2 / (1 + (residual / config.outlier_sd) ** 2) ** 2
        system = (basis * pull[:, None]).T @ basis + 1e-9 * np.eye(3)
        plane = np.linalg.solve(system, basis.T @ (pull * seen))
        residual = (seen - basis @ plane) / spread
    nats = float((weight * (_log_density(own) - _log_density(residual))).sum())
    return float(np.sign(nats) * np.log1p(abs(nats)))


def _log_density(residual: FloatArray) -> FloatArray:
    """Log density of residuals, a normal one beside a flat one, up to what is the same for all."""
    return np.asarray(np.log(0.9 * np.exp(-0.5 * residual**2) + 0.001))
