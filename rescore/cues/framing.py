"""What a fitted instance of the class says of a box: whether what the box frames is one whole object.

A modern detector's false alarms are mostly boxes on objects that frame them badly: a part, two at once, one
with much around it. ``recon.localization.disparity_fit`` finds the instance that the disparity shows and the
one that the box would frame; these cues compare both with the box, and the latter with other explanations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray, median
from recon.boxes import paired_overlap
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


def framing(
    fits: Sequence[BoxFit], xyxy_px: FloatArray, picture: tuple[int, int], config: FramingConfig
) -> FloatArray:
    """The cues of boxes, shape (n, 15), in the order of ``FRAMING``; NaN where one cannot be had.

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
        fits: What the class and the disparity say of each box.
        xyxy_px: The boxes, shape (n, 4), pixel edges.
        picture: Width and height of the picture in pixels.
        config: Settings.
    """
    samples = _Samples.of([fit.samples for fit in fits])
    framed, seen = _Placed.of([fit.framed for fit in fits]), _Placed.of([fit.seen for fit in fits])
    ends = _ends(seen.silhouette_px, xyxy_px, picture, config.most)
    beside, above = _around(framed, samples)
    at_depth = _at_depth(framed, samples, config)
    values = {
        "overlap": np.array([fit.overlap for fit in fits]),
        "framed_overlap": paired_overlap(framed.silhouette_px, xyxy_px)[0],
        **dict(zip(("end_left", "end_top", "end_right", "end_bottom"), ends.T, strict=True)),
        "gap": _attained(seen.total - framed.total, seen, config),
        "explained": _attained(framed.total, framed, config),
        "seen_explained": _attained(seen.total, seen, config),
        "over_plane": _over_plane(framed, samples, config),
        "seen_through": _share(framed.residual < -config.outlier_sd, framed.on, config),
        "hidden": _share(framed.residual > config.outlier_sd, framed.on, config),
        "beyond_box": _share(~samples.inside, np.abs(seen.residual) < config.outlier_sd, config),
        "goes_on_beside": _share(at_depth, beside & samples.standing, config),
        "goes_on_above": _share(at_depth, above & samples.standing, config),
    }
    return np.stack([values[name] for name in FRAMING], axis=1)


@dataclass(frozen=True, eq=False)
class _Samples:
    """``BoxSamples`` of boxes (n,), each array (n, rows, columns)."""

    uv_px: FloatArray
    disparity_px: Float32Array
    inside: BoolArray
    standing: BoolArray

    @staticmethod
    def of(samples: Sequence[BoxSamples]) -> "_Samples":
        return _Samples(*(np.stack([getattr(s, f.name) for s in samples]) for f in fields(_Samples)))


@dataclass(frozen=True, eq=False)
class _Placed:
    """``PlacedInstance`` of boxes (n,); what is said of samples is of shape (n, rows, columns)."""

    silhouette_px: FloatArray
    total: FloatArray
    attainable: FloatArray
    disparity_px: Float32Array
    spread_px: Float32Array
    residual: Float32Array
    weight: Float32Array
    on: BoolArray
    """Whether something is measured on the instance."""

    @staticmethod
    def of(placed: Sequence[PlacedInstance]) -> "_Placed":
        residual = np.stack([p.explained.residual for p in placed])
        return _Placed(
            np.stack([p.silhouette_px for p in placed]),
            np.array([p.total for p in placed]),
            np.array([p.attainable for p in placed]),
            np.stack([p.explained.disparity_px for p in placed]),
            np.stack([p.explained.spread_px for p in placed]),
            residual,
            np.stack([p.explained.weight for p in placed]),
            np.isfinite(residual),
        )


def resolved(fit: BoxFit, config: FramingConfig) -> float:
    """How much disparity can tell of where a car stands and ends, in [0, 1].

    It is a reliability: the square of the disparity that the length of a car spans along the line of sight,
    at the distance of the framed instance, over the sum of it and the square of the matcher's noise. Near 0 a
    car, its neighbour and the hedge behind it are measured alike.
    """
    length, distance = fit.framed.box.size_m[0], fit.framed.pose.place[0, 0]
    spanned_px = fit.samples.seen_from.stereo.focal_baseline * length / distance**2
    return float(spanned_px**2 / (spanned_px**2 + config.sd_px**2))


def _share(what: BoolArray, of: BoolArray, config: FramingConfig) -> FloatArray:
    whole, part = (np.count_nonzero(mask, axis=(1, 2)) for mask in (of, what & of))
    return np.where(whole >= config.fewest, part / np.maximum(whole, 1), np.nan)


def _ends(
    silhouette_px: FloatArray, xyxy_px: FloatArray, picture: tuple[int, int], most: float
) -> FloatArray:
    """How far silhouettes' boxes reach beyond boxes on each side, shape (n, 4), in extents of the box."""
    extent = np.tile(xyxy_px[:, 2:] - xyxy_px[:, :2], 2)
    beyond = np.clip((silhouette_px - xyxy_px) * [-1, -1, 1, 1] / extent, -most, most)
    limits = np.array([0.0, 0.0, *picture])
    cut = np.abs(xyxy_px - limits) < _AT_THE_EDGE_PX
    return np.where(cut, np.nan, beyond)


_AT_THE_EDGE_PX = 2.0
"""A box that ends this near to the edge of the picture is cut off there."""


def _attained(nats: FloatArray, placed: _Placed, config: FramingConfig) -> FloatArray:
    """Nats as a share of what instances attain."""
    enough = (np.count_nonzero(placed.on, axis=(1, 2)) >= config.fewest) & (placed.attainable > 0)
    share = nats / np.where(enough, placed.attainable, 1.0)
    return np.where(enough, np.clip(share, -config.most_share, config.most_share), np.nan)


def _at_depth(placed: _Placed, samples: _Samples, config: FramingConfig) -> BoolArray:
    """Mask of the samples that lie at the middle depth of their instance."""
    on = np.isfinite(placed.disparity_px)
    middle = [median(d[o]) if o.any() else np.nan for d, o in zip(placed.disparity_px, on, strict=True)]
    tolerance = np.maximum(config.same_px, config.same_share * np.array(middle))
    off = np.abs(samples.disparity_px - np.array(middle)[:, None, None])
    return np.asarray(off < tolerance[:, None, None])


def _around(placed: _Placed, samples: _Samples) -> tuple[BoolArray, BoolArray]:
    """Masks of the samples beside and above the silhouettes."""
    left, top, right, bottom = placed.silhouette_px.T[..., None, None]
    off = ~np.isfinite(placed.disparity_px)
    width, height = right - left, bottom - top
    u, v = samples.uv_px[..., 0] + 0.5, samples.uv_px[..., 1] + 0.5
    out = np.maximum(left - u, u - right)
    beside = (out > 2) & (out < 0.25 * width) & (v > top + 0.2 * height) & (v < bottom - 0.15 * height)
    middle = (u > left + 0.1 * width) & (u < right - 0.1 * width)
    above = (v < top - 1) & (v > top - 0.35 * height) & middle
    return beside & off, above & off


def _over_plane(framed: _Placed, samples: _Samples, config: FramingConfig) -> FloatArray:
    """Signed log(1 + nats) by which instances explain their samples better than the best planes do, (n,).

    A plane is any in space, so linear in (u, v, disparity); its errors are taken to be spread as those of
    the instance, with the same share of other things.
    """
    n = len(framed.on)
    use = (framed.on & (framed.weight > 0)).reshape(n, -1)
    count = np.count_nonzero(use, axis=1)
    weight = np.where(use, framed.weight.reshape(n, -1), 0.0)
    seen, spread, own = (
        np.where(use, values.reshape(n, -1), filled).astype(float)
        for values, filled in ((samples.disparity_px, 0.0), (framed.spread_px, 1.0), (framed.residual, 0.0))
    )
    uv = samples.uv_px.reshape(n, -1, 2)
    uv = uv - (uv * use[..., None]).sum(axis=1, keepdims=True) / np.maximum(count, 1)[:, None, None]
    basis = np.concatenate([np.ones((*use.shape, 1)), uv], axis=2)
    residual = own
    for _ in range(config.plane_rounds):
        pull = weight / spread**2 / (1 + (residual / config.outlier_sd) ** 2) ** 2
        weighted = (basis * pull[..., None]).swapaxes(1, 2)
        system = weighted @ basis + 1e-9 * np.eye(3)
        plane = np.linalg.solve(system, weighted @ seen[..., None])
        residual = (seen - (basis @ plane)[..., 0]) / spread
    nats = (weight * (_log_density(own) - _log_density(residual))).sum(axis=1)
    enough = count >= max(config.fewest, 4)
    return np.where(enough, np.sign(nats) * np.log1p(np.abs(nats)), np.nan)


def _log_density(residual: FloatArray) -> FloatArray:
    """Log density of residuals, a normal one beside a flat one, up to what is the same for all."""
    return np.asarray(np.log(0.9 * np.exp(-0.5 * residual**2) + 0.001))
