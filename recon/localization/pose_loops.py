"""What poses of instances say of the samples of their boxes: the loops of ``poses``.

A pose is looked up in the maps of the class (``depth_views``), which lie in the upright plane through the
middle of the instance: each ray of a sample meets that plane somewhere, and the map says there how far behind
or before it the surface lies. All samples that a silhouette can reach are laid one after the other, and each
loop over them does little, so that a processor does it for several at once.
"""

from math import ceil, cos, exp, floor, log, pi, sin
from typing import Any, NamedTuple

import numpy as np

from recon.arrays import Float32Array, FloatArray, IntArray
from recon.compiled import compiled, on_unit, within


class Maps(NamedTuple):
    """``DepthViews`` as flat arrays."""

    relief_m: Float32Array
    inset_m: Float32Array
    extent_m: FloatArray
    border_m: FloatArray
    """Distances at which the next maps begin to be the nearest, shape (distances - 1,)."""
    distances: int
    headings: int
    rows: int
    columns: int
    ground_row: int
    step_m: float


class Samples(NamedTuple):
    """``BoxSamples`` of boxes (b,) as flat arrays (b * rows * columns,)."""

    right: Float32Array
    """Viewing rays in the ground frame: to the right, away from the camera and upwards."""
    away: Float32Array
    up: Float32Array
    disparity_px: Float32Array
    log_background: Float32Array
    rows: int
    columns: int
    corners_px: FloatArray
    """Pixels of the first and of the last sample, shape (b, 4)."""
    weight: FloatArray
    """Number of independent measurements that a sample counts as, shape (b,)."""


class Rig(NamedTuple):
    """``GroundedStereo`` as numbers."""

    cam_from_ground: FloatArray
    """Shape (4, 4)."""
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: float
    height_px: float
    focal_baseline: float
    height_m: float
    """Height of the camera above the ground."""


class Noise(NamedTuple):
    """``DisparityNoise`` and ``SurfaceNoise`` as numbers."""

    sd_px: float
    bleeding_px: float
    shape_m: float
    peak: float
    """Density of a residual of 0, by the surface alone, where the spread is 1 px."""
    before: float
    """Density of something nearer than the surface."""
    behind: float


class _Plane(NamedTuple):
    """A pose as its plane's maps see it, in single precision."""

    sine: np.float32
    """Sine of the bearing."""
    cosine: np.float32
    distance_m: np.float32
    scale: np.float32
    distance: np.float32
    """In samples of the map."""
    ground: np.float32
    """Row of the map at the height of the camera."""
    focal_baseline: np.float32
    slack: np.float32
    """Standard deviation of the surface as a share of the distance."""
    per_margin: np.float32
    """Weight that a sample gains with each metre from the edge of the silhouette."""
    weight: np.float32
    """Weight of a sample that lies well within."""
    low: int
    """First sample of the map of the nearest heading, or of the next lower one."""
    high: int
    """First sample of the map of the next higher heading."""
    share: np.float32
    """Share of that map."""


class _Seen(NamedTuple):
    """The samples that a pose is asked about: some of the arrays of ``Samples``."""

    right: Float32Array
    away: Float32Array
    up: Float32Array
    disparity_px: Float32Array
    log_background: Float32Array


class _Said(NamedTuple):
    """What a pose says of samples: the fields of ``Explained``, and two steps on the way."""

    forward: Float32Array
    cell: IntArray
    predicted_px: Float32Array
    spread_px: Float32Array
    residual: Float32Array
    weight: Float32Array
    log_ratio: Float32Array


_F = np.float32
_NEAREST_M = 0.3
"""Points nearer to the camera than this are not projected."""
_WIDTHS_AWAY = 1.5
_MARGIN_SHARE, _MARGIN_PX = 0.08, 1.0
"""From so many widths away on, a silhouette reaches beyond its box by no more than this."""
_NOTHING = _F(20)
"""Half the square of a residual beyond which the surface adds nothing to the density: some millionths."""
_ROOT = on_unit(lambda t: np.exp(-t * 20 / 16), 8)
"""The 16th root of exp(-20 t), to 1e-7."""
_LOG, _LOG_2 = on_unit(np.log1p, 10), _F(log(2))
"""log(1 + t), to 1e-7."""


@within
def _map_of(shape: int, distance_m: float, turn: int, maps: Any) -> int:
    """Number of the map of a shape, of the nearest distance and of a heading."""
    at = 0
    while at < len(maps.border_m) and maps.border_m[at] < distance_m:
        at += 1
    return int((shape * maps.distances + at) * maps.headings + turn % maps.headings)


@within
def _projected(axis: int, x: float, y: float, z: float, rig: Any) -> tuple[float, float]:
    """Pixel edge, along one axis of the picture, of a point of the ground frame, and its depth."""
    pose = rig.cam_from_ground
    depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
    at = pose[axis, 0] * x + pose[axis, 1] * y + pose[axis, 2] * z + pose[axis, 3]
    focal, centre, size = rig.fx_px, rig.cx_px, rig.width_px
    if axis == 1:
        focal, centre, size = rig.fy_px, rig.cy_px, rig.height_px
    return min(max(focal * at / depth + centre + 0.5, 0.0), size), depth


@within
def _silhouette(place: Any, shape: int, maps: Any, rig: Any, box: Any) -> bool:
    """Write the box around a silhouette to ``box``; whether all of the silhouette lies about there.

    A box is that of the middles of the silhouette's four sides, which tell little where it is near; it is the
    whole picture for one that reaches behind the camera.
    """
    distance, bearing, scale = place[0], place[1], exp(place[3])
    turn = int(np.rint(place[2] * (maps.headings / (2 * pi))))
    first = 4 * _map_of(shape, distance / scale, turn, maps)
    left, right = maps.extent_m[first] * scale, maps.extent_m[first + 1] * scale
    foot, top = maps.extent_m[first + 2] * scale, maps.extent_m[first + 3] * scale
    s, c, middle, up = sin(bearing), cos(bearing), (left + right) / 2, (foot + top) / 2
    x, y = distance * s, distance * c
    box[0], depth = _projected(0, x + left * c, y - left * s, up, rig)
    box[2], other = _projected(0, x + right * c, y - right * s, up, rig)
    nearest = min(depth, other)
    box[1], depth = _projected(1, x + middle * c, y - middle * s, top, rig)
    box[3], other = _projected(1, x + middle * c, y - middle * s, foot, rig)
    if min(nearest, depth, other) > _NEAREST_M:
        return bool(distance > _WIDTHS_AWAY * (right - left))
    box[0], box[1], box[2], box[3] = 0.0, 0.0, rig.width_px, rig.height_px
    return False


@within
def _reached(low: float, high: float, first: float, last: float, count: int) -> tuple[int, int]:
    """Range of the samples, evenly spaced from ``first`` to ``last``, that a silhouette can reach."""
    step, margin = (last - first) / (count - 1), _MARGIN_SHARE * (high - low) + _MARGIN_PX
    begin, end = floor((low - margin - first) / step), ceil((high + margin - first) / step) + 1
    return min(max(0, int(begin)), count), max(0, min(count, int(end)))


@within
def _plane(place: Any, shape: int, maps: Any, rig: Any, noise: Any, weight: float, fine: bool) -> Any:
    distance, bearing, scale = place[0], place[1], exp(place[3])
    turn = place[2] * (maps.headings / (2 * pi))
    low = floor(turn) if fine else int(np.rint(turn))
    unit, size = 1 / (scale * maps.step_m), maps.rows * maps.columns
    margin = max(noise.bleeding_px * distance / rig.fx_px, 1e-3)
    return _Plane(
        _F(sin(bearing)),
        _F(cos(bearing)),
        _F(distance),
        _F(scale),
        _F(distance * unit),
        _F(rig.height_m * unit + maps.ground_row + 0.5),
        _F(rig.focal_baseline),
        _F(noise.shape_m / distance),
        _F(scale / margin),
        _F(weight),
        size * _map_of(shape, distance / scale, low, maps),
        size * _map_of(shape, distance / scale, low + 1, maps),
        _F(turn - low),
    )


@within
def _reach(b: int, r0: int, r1: int, c0: int, c1: int, samples: Any, seen: Any) -> int:
    """Write the samples of some rows and columns of box b to ``seen``; their number."""
    n = 0
    for r in range(r0, r1):
        first = (b * samples.rows + r) * samples.columns + c0
        for j in range(c1 - c0):
            seen.right[n + j], seen.away[n + j] = samples.right[first + j], samples.away[first + j]
            seen.up[n + j], seen.disparity_px[n + j] = samples.up[first + j], samples.disparity_px[first + j]
            seen.log_background[n + j] = samples.log_background[first + j]
        n += max(c1 - c0, 0)
    return n


@within
def _explain(count: int, seen: Any, plane: Any, maps: Any, noise: Any, fine: bool, said: Any) -> None:
    """Write what a pose says of ``count`` samples, but for their log ratios."""
    zero, one, half = _F(0), _F(1), _F(0.5)
    middle, last_row, last_column = _F(maps.columns // 2 + 0.5), _F(maps.rows - 1), _F(maps.columns - 1)
    for j in range(count):
        x, y, z = seen.right[j], seen.away[j], seen.up[j]
        # what lies behind the camera is cut off at the border of the map, which is empty
        forward = max(x * plane.sine + y * plane.cosine, _F(1e-6))
        depth = plane.distance / forward
        up = min(max(depth * z + plane.ground, zero), last_row)
        across = min(max(depth * (x * plane.cosine - y * plane.sine) + middle, zero), last_column)
        said.forward[j] = forward
        said.cell[j] = np.int32(up) * np.int32(maps.columns) + np.int32(across)
    if fine:
        share, rest = plane.share, one - plane.share
        for j in range(count):
            low, high = plane.low + said.cell[j], plane.high + said.cell[j]
            relief, other = maps.relief_m[low], maps.relief_m[high]
            mixed = rest * relief + share * other
            nearer = relief if share < half else other
            said.predicted_px[j] = nearer if np.isnan(mixed) else mixed
            said.weight[j] = rest * maps.inset_m[low] + share * maps.inset_m[high]
    else:
        for j in range(count):
            said.predicted_px[j] = maps.relief_m[plane.low + said.cell[j]]
            said.weight[j] = maps.inset_m[plane.low + said.cell[j]]
    variance = _F(noise.sd_px * noise.sd_px)
    for j in range(count):
        predicted = plane.focal_baseline * said.forward[j]
        predicted /= plane.distance_m + said.predicted_px[j] * plane.scale
        spread = np.sqrt(variance + predicted * predicted * plane.slack * plane.slack)
        said.predicted_px[j], said.spread_px[j] = predicted, spread
        said.residual[j] = (seen.disparity_px[j] - predicted) / spread
        said.weight[j] = min(said.weight[j] * plane.per_margin, one) * plane.weight


@within
def _log_ratios(count: int, seen: Any, noise: Any, said: Any) -> None:
    """Write the log ratios of samples, each times its weight; 0 where nothing is measured.

    Polynomials stand in for exp and log, which a processor does not do for several numbers at once.
    """
    peak, before, behind = _F(noise.peak), _F(noise.before), _F(noise.behind)
    bits = said.log_ratio.view(np.int32)
    for j in range(count):
        half = min(_F(0.5) * said.residual[j] * said.residual[j], _NOTHING)
        t = half * (_F(1) / _NOTHING)
        bell = ((_ROOT[0] * t + _ROOT[1]) * t + _ROOT[2]) * t + _ROOT[3]
        bell = (((bell * t + _ROOT[4]) * t + _ROOT[5]) * t + _ROOT[6]) * t + _ROOT[7]
        bell *= bell
        bell *= bell
        bell *= bell
        bell *= bell
        said.log_ratio[j] = peak * bell / said.spread_px[j] + (before if said.residual[j] > 0 else behind)
    for j in range(count):
        said.forward[j] = _F((bits[j] >> 23) - 127)
        bits[j] = (bits[j] & 0x7FFFFF) | 0x3F800000
    for j in range(count):
        t = said.log_ratio[j] - _F(1)
        above = ((_LOG[0] * t + _LOG[1]) * t + _LOG[2]) * t + _LOG[3]
        above = (((above * t + _LOG[4]) * t + _LOG[5]) * t + _LOG[6]) * t + _LOG[7]
        density = said.forward[j] * _LOG_2 + (above * t + _LOG[8]) * t + _LOG[9]
        ratio = (density - seen.log_background[j]) * said.weight[j]
        said.log_ratio[j] = _F(0) if np.isnan(said.residual[j]) else ratio


@compiled
def scan(
    place: FloatArray,
    shape: IntArray,
    owner: IntArray,
    maps: Any,
    samples: Any,
    rig: Any,
    noise: Any,
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
        fine: Whether to go between the headings of the maps.
        boxes: Written to.
        ratio: Written to.
    """
    size = samples.rows * samples.columns
    space, cell = np.empty((11, size), np.float32), np.empty(size, np.int32)
    seen = _Seen(space[0], space[1], space[2], space[3], space[4])
    said = _Said(space[5], cell, space[6], space[7], space[8], space[9], space[10])
    for i in range(len(place)):
        b, box = owner[i], boxes[i]
        r0, r1, c0, c1 = 0, samples.rows, 0, samples.columns
        if _silhouette(place[i], shape[i], maps, rig, box):
            u0, v0, u1, v1 = samples.corners_px[b]
            c0, c1 = _reached(box[0], box[2], u0, u1, samples.columns)
            r0, r1 = _reached(box[1], box[3], v0, v1, samples.rows)
        plane = _plane(place[i], shape[i], maps, rig, noise, samples.weight[b], fine)
        n = _reach(b, r0, r1, c0, c1, samples, seen)
        _explain(n, seen, plane, maps, noise, fine, said)
        _log_ratios(n, seen, noise, said)
        total = 0.0
        for j in range(n):
            total += said.log_ratio[j]
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
    found: Float32Array,
) -> None:
    """Write what one pose says of each sample of box b, the fields of ``Explained`` (5, rows, columns)."""
    size = samples.rows * samples.columns
    own = slice(b * size, (b + 1) * size)
    rays = (samples.right[own], samples.away[own], samples.up[own])
    seen = _Seen(rays[0], rays[1], rays[2], samples.disparity_px[own], samples.log_background[own])
    forward, cell, flat = np.empty(size, np.float32), np.empty(size, np.int32), found.reshape(5, size)
    said = _Said(forward, cell, flat[1], flat[2], flat[3], flat[4], flat[0])
    plane = _plane(place, shape, maps, rig, noise, samples.weight[b], True)
    _explain(size, seen, plane, maps, noise, True, said)
    _log_ratios(size, seen, noise, said)
