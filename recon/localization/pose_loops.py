"""What poses of instances say of the samples of their boxes, a sample at a time (see ``poses``)."""

from math import ceil, cos, exp, floor, log, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from recon.arrays import Float32Array, FloatArray, IntArray
from recon.compiled import compiled, within


class Maps(NamedTuple):
    """``DepthViews`` as arrays."""

    relief_inset_m: Float32Array
    """Relief, NaN beside the silhouette, and inset, shape (shapes, distances, headings, rows, columns, 2)."""
    extent_m: FloatArray
    border_m: FloatArray
    """Distances at which the next maps begin to be the nearest, shape (distances - 1,)."""
    step_m: float
    ground_row: int


class Samples(NamedTuple):
    """``BoxSamples`` of boxes (b,) as arrays."""

    uv_px: FloatArray
    """Pixels of the corners of the grids, first and last, shape (b, 2, 2)."""
    ray: Float32Array
    disparity_px: Float32Array
    log_background: Float32Array
    weight: FloatArray


class Rig(NamedTuple):
    """``GroundedStereo`` as arrays and numbers."""

    cam_from_ground: FloatArray
    """Shape (4, 4)."""
    focal_px: FloatArray
    """Shape (2,)."""
    centre_px: FloatArray
    """Principal point, shape (2,)."""
    size_px: FloatArray
    """Width and height of the picture, shape (2,)."""
    focal_baseline: float
    height_m: float


class Noise(NamedTuple):
    """``DisparityNoise`` and ``SurfaceNoise`` as numbers."""

    sd_px: float
    bleeding_px: float
    shape_m: float
    peak: float
    """Density of a residual of 0, by the surface alone."""
    before: float
    """Density of what is nearer than the surface."""
    behind: float
    log_before: float
    log_behind: float


_NEAREST_M = 0.3
"""Points nearer to the camera than this are not projected."""
_MARGIN_SHARE = 0.08
"""A silhouette may reach beyond its box in the picture by this share of the box, as seen by a camera that
leans."""


@within
def _nearest_distance(maps: Any, distance_m: float) -> int:
    i = 0
    while i < len(maps.border_m) and maps.border_m[i] < distance_m:
        i += 1
    return i


@within
def _silhouette(place: Any, shape: int, maps: Any, rig: Any, box: Any) -> bool:
    """Write the box around a silhouette to ``box``; False where it reaches behind the camera."""
    distance, bearing, heading, scale = place[0], place[1], place[2], exp(place[3])
    headings = maps.relief_inset_m.shape[2]
    turn = int(np.rint(heading * (headings / (2 * pi)))) % headings
    extent = maps.extent_m[shape, _nearest_distance(maps, distance / scale), turn]
    left, right, foot, top = extent[0] * scale, extent[1] * scale, extent[2] * scale, extent[3] * scale
    middle_across, middle_up = (left + right) / 2, (foot + top) / 2
    s, c = sin(bearing), cos(bearing)
    pose = rig.cam_from_ground
    box[0], box[1], box[2], box[3] = 0.0, 0.0, rig.size_px[0], rig.size_px[1]
    ends = (box[0], box[1], box[2], box[3])
    for side in range(4):
        across = (left, middle_across, right, middle_across)[side]
        up = (middle_up, top, middle_up, foot)[side]
        x, y = distance * s + across * c, distance * c - across * s
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * up + pose[2, 3]
        if not depth > _NEAREST_M:
            box[0], box[1], box[2], box[3] = ends
            return False
        axis = side % 2
        at = pose[axis, 0] * x + pose[axis, 1] * y + pose[axis, 2] * up + pose[axis, 3]
        edge = rig.focal_px[axis] * at / depth + rig.centre_px[axis] + 0.5
        box[side] = min(max(edge, 0.0), rig.size_px[axis])
    return True


@within
def _cell(value: float, middle: int, count: int) -> int:
    """The sample of a map nearest to a place; its border, which is empty, for what lies beside it."""
    return int(min(max(np.rint(value) + middle, 0.0), count - 1.0))


class _Pose(NamedTuple):
    """What all samples of a pose share."""

    distance_m: float
    scale: float
    sine: float
    """Of the bearing."""
    cosine: float
    share: float
    """Of the map of the next higher heading; below 0 where the nearest one alone is looked at."""
    per_m: float
    """Samples of the map in a metre of the instance's plane."""
    ground_row: int
    margin_m: float
    """Inset from which on a sample counts in full."""
    weight: float
    """Of such a sample."""
    height_m: float
    """Of the camera above the ground."""
    focal_baseline: float


@within
def _turned(place: Any, shape: int, maps: Any, rig: Any, noise: Any, weight: float, fine: bool) -> Any:
    """A pose and its two maps."""
    distance, bearing, heading, scale = place[0], place[1], place[2], exp(place[3])
    headings = maps.relief_inset_m.shape[2]
    at, turn = _nearest_distance(maps, distance / scale), heading * (headings / (2 * pi))
    low = int(floor(turn)) if fine else int(np.rint(turn))
    pose = _Pose(
        distance,
        scale,
        sin(bearing),
        cos(bearing),
        turn - low if fine else -1.0,
        1 / (scale * maps.step_m),
        maps.ground_row,
        max(noise.bleeding_px * distance / rig.focal_px[0], 1e-3),
        weight,
        rig.height_m,
        rig.focal_baseline,
    )
    own = maps.relief_inset_m[shape, at]
    return pose, own[low % headings], own[(low + 1) % headings]


@within
def _sample(
    x: float,
    y: float,
    z: float,
    seen_px: float,
    log_background: float,
    pose: Any,
    low: Any,
    high: Any,
    noise: Any,
) -> tuple[float, float, float, float, float]:
    """Log ratio, prediction, spread, residual and weight of one sample, as ``Explained`` has them.

    Args:
        x: Viewing ray in the ground frame: to the right,
        y: away from the camera,
        z: and upwards.
        seen_px: Measured disparity.
        log_background: Its log density where no object stands.
        pose: The pose.
        low: Map of the nearest heading, or of the next lower one.
        high: Map of the next higher heading.
        noise: Of disparity and surface.
    """
    forward = x * pose.sine + y * pose.cosine
    if not forward > 0:
        return 0.0, np.nan, np.nan, np.nan, 0.0
    depth = pose.distance_m / forward
    row = _cell((depth * z + pose.height_m) * pose.per_m, pose.ground_row, low.shape[0])
    column = _cell(depth * (x * pose.cosine - y * pose.sine) * pose.per_m, low.shape[1] // 2, low.shape[1])
    relief, inset = float(low[row, column, 0]), float(low[row, column, 1])
    if pose.share >= 0:
        other, other_inset = float(high[row, column, 0]), float(high[row, column, 1])
        mixed = (1 - pose.share) * relief + pose.share * other
        nearer = relief if pose.share < 0.5 else other
        relief = nearer if np.isnan(mixed) else mixed
        inset = (1 - pose.share) * inset + pose.share * other_inset
    if np.isnan(relief):
        return 0.0, np.nan, np.nan, np.nan, 0.0
    predicted = pose.focal_baseline * forward / (pose.distance_m + relief * pose.scale)
    slack = predicted * noise.shape_m / pose.distance_m
    spread = sqrt(noise.sd_px * noise.sd_px + slack * slack)
    weight = min(max(inset * pose.scale / pose.margin_m, 0.0), 1.0) * pose.weight
    residual = (seen_px - predicted) / spread
    if np.isnan(residual):
        return 0.0, predicted, spread, residual, weight
    half = 0.5 * residual * residual
    if half < _NOTHING:
        other = noise.before if residual > 0 else noise.behind
        log_density = log(noise.peak * exp(-half) / spread + other)
    else:
        log_density = noise.log_before if residual > 0 else noise.log_behind
    return (log_density - log_background) * weight, predicted, spread, residual, weight


_NOTHING = 20.0
"""Half the square of a residual beyond which the surface adds nothing to the density: some millionths."""


@compiled
def scan(
    place: FloatArray,
    shape: IntArray,
    owner: IntArray,
    maps: Any,
    samples: Any,
    rig: Any,
    noise: Any,
    step: int,
    fine: bool,
    boxes: FloatArray,
    ratio: FloatArray,
) -> None:
    """Write the box around each silhouette (m, 4) and the sum of the log ratios (m,) of each pose.

    Args:
        place: ``Poses.place``, shape (m, 4).
        shape: ``Poses.shape``.
        owner: Whose samples each pose is asked about, shape (m,).
        maps: Of the class.
        samples: Of the boxes.
        rig: Where they are seen from.
        noise: Of disparity and surface.
        step: Only every ``step``-th row and column is looked at.
        fine: Whether to go between the headings of the maps.
        boxes: Written to.
        ratio: Written to.
    """
    rays, disparity_px, log_background = samples.ray, samples.disparity_px, samples.log_background
    rows, columns = disparity_px.shape[1:]
    for i in range(len(place)):
        box, b = boxes[i], owner[i]
        before_camera = _silhouette(place[i], shape[i], maps, rig, box)
        first, last = samples.uv_px[b, 0], samples.uv_px[b, 1]
        r0, r1, c0, c1 = 0, rows, 0, columns
        if before_camera:
            # samples that the silhouette cannot reach are left out
            du, dv = (last[0] - first[0]) / (columns - 1), (last[1] - first[1]) / (rows - 1)
            across, up = _MARGIN_SHARE * (box[2] - box[0]) + 2, _MARGIN_SHARE * (box[3] - box[1]) + 2
            c0 = max(0, int(floor((box[0] - across - first[0]) / du)) - 1)
            c1 = min(columns, int(ceil((box[2] + across - first[0]) / du)) + 2)
            r0 = max(0, int(floor((box[1] - up - first[1]) / dv)) - 1)
            r1 = min(rows, int(ceil((box[3] + up - first[1]) / dv)) + 2)
        pose, low, high = _turned(place[i], shape[i], maps, rig, noise, samples.weight[b], fine)
        total = 0.0
        for r in range(-(-r0 // step) * step, r1, step):
            for c in range(-(-c0 // step) * step, c1, step):
                seen = disparity_px[b, r, c]
                if not np.isnan(seen):
                    x, y, z = rays[b, r, c, 0], rays[b, r, c, 1], rays[b, r, c, 2]
                    background = log_background[b, r, c]
                    total += _sample(x, y, z, seen, background, pose, low, high, noise)[0]
        ratio[i] = total


@compiled
def look(
    place: FloatArray,
    shape: int,
    b: int,
    maps: Any,
    samples: Any,
    rig: Any,
    noise: Any,
    fine: bool,
    found: Float32Array,
) -> None:
    """Write what one pose says of each sample of box b, the fields of ``Explained`` (5, rows, columns)."""
    pose, low, high = _turned(place, shape, maps, rig, noise, samples.weight[b], fine)
    for r in range(found.shape[1]):
        for c in range(found.shape[2]):
            x, y, z = samples.ray[b, r, c, 0], samples.ray[b, r, c, 1], samples.ray[b, r, c, 2]
            seen, background = samples.disparity_px[b, r, c], samples.log_background[b, r, c]
            values = _sample(x, y, z, seen, background, pose, low, high, noise)
            for k in range(5):
                found[k, r, c] = values[k]
