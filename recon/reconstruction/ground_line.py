"""The ground line (section 4.3): where the object touches the ground in the image, and its points in 3D."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import hypot

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.camera import GroundedCamera, cross
from recon.errors import Failure, Reason
from recon.reconstruction.part_labels import PartLabels

_MIN_FACING = float(np.sin(np.deg2rad(8.0)))
"""A side of the footprint turned to the camera by less than this sine is seen end-on."""


@dataclass(frozen=True)
class GroundLineConfig:
    """Settings of the ground line."""

    contact_height: float = 0.06
    """Columns of a part whose lowest pixel is within this share of the object's height of the part's lowest
    are its contact; at least one pixel."""
    slope_from_view: float = 1.0
    """Weight of the view bin's slope in the slope of the line: 1 takes the direction in which the parts stand
    in the class model, seen on the ground at this place; 0 fits it to the contacts alone. A pixel of error in
    one contact is metres of depth far away, so that a free line tilts far objects at random."""
    line_tolerance: float = 0.08
    """Parts whose contact is within this share of the object's height of the line stand on it."""


@dataclass(frozen=True, eq=False)
class GroundLine:
    """The line l_g and the parts that stand on it, or on the second line of a corner view."""

    line_px: FloatArray
    """Ends of the ground line, shape (2, 2), left one first, pixel centres."""
    points_m: dict[int, FloatArray]
    """3D point (3,) of the contact of each part that stands on a line, by label, camera frame."""


def ground_line(
    parts: PartLabels,
    feet_cam: Mapping[int, FloatArray],
    seen_from: GroundedCamera,
    config: GroundLineConfig,
    bottom_px: float | None = None,
) -> GroundLine | Failure:
    """Line through the lower ends of the parts that touch the ground, and its points by eqs. 2 to 5.

    A corner view shows parts on two lines, the sides of the object's footprint that face the camera. l_g is
    the one whose feet show the most; the other starts at the corner that they share, and the view bin says
    where it leads on the ground. Parts on hidden sides get no point: what is seen of them is not their lower
    end.

    Args:
        parts: labels of the object's parts.
        feet_cam: where the parts that may touch the ground stand in the class model, by label, shape (3,),
            turned into the camera frame; any origin and scale.
        seen_from: the camera M and the ground plane Q_g.
        config: settings.
        bottom_px: row on which the object's lowest point is known to lie, to which the contacts are moved
            together; None takes them from the labels alone.
    """
    shown = _contacts(parts, list(feet_cam), config)
    if not shown:
        return Failure(
            Reason.NO_GROUND_CONTACT,
            f"one of the parts {list(feet_cam)} expected in the image, found none",
        )
    height = parts.rows[1] - parts.rows[0] + 1.0
    if bottom_px is not None:
        down = bottom_px - max(float(at[1]) for at in shown.values())
        shown = {k: at + np.array([0.0, down]) for k, at in shown.items()}
    sides = _facing_sides(feet_cam, shown, seen_from)
    sides.sort(key=lambda side: -min(parts.area_px[k] for k in side))
    first = list(sides[0]) if sides else [max(shown, key=lambda k: (shown[k][1], -k))]
    at = np.array([shown[k] for k in first])
    slope, offset, on_line = _fit(at, config.line_tolerance * height)
    first = [label for label, use in zip(first, on_line, strict=True) if use]
    at = at[on_line]
    expected = _view_slope(at, np.array([feet_cam[k] for k in first]), seen_from)
    if expected is not None:
        slope += config.slope_from_view * (expected - slope)
        offset = float(np.mean(at[:, 1] - slope * at[:, 0]))
    feet = np.stack([at[:, 0], slope * at[:, 0] + offset], axis=1)
    points = seen_from.ground_points_m(feet)
    if not np.isfinite(points).all():
        return Failure(
            Reason.ABOVE_HORIZON,
            f"ground contact below the horizon expected, got rows {np.round(feet[:, 1], 1).tolist()}",
        )
    # a line that ends at a corner is as long as its contacts; a single one goes under the whole object
    columns = np.array(parts.columns) + float(parts.x0_px)
    if len(sides) > 1:
        columns = np.array([at[:, 0].min(), at[:, 0].max()])
    line = np.stack([columns, slope * columns + offset], axis=1)
    known = dict(zip(first, points, strict=True))
    for side in sides[1:]:
        known |= _second_line(side, known, shown, feet_cam, seen_from)
    return GroundLine(line, known)


def _facing_sides(
    feet_cam: Mapping[int, FloatArray],
    shown: Mapping[int, FloatArray],
    seen_from: GroundedCamera,
) -> list[tuple[int, ...]]:
    """Labels of the contacts on each side of the footprint that faces the camera, two or more a side.

    The footprint is the convex hull of the feet on the ground.
    """
    forward = seen_from.level_direction(np.mean(list(shown.values()), axis=0))
    across = np.stack([cross(forward, seen_from.ground.up), forward], axis=1)
    flat: list[tuple[float, float]] = (np.array(list(feet_cam.values())) @ across).tolist()
    if len(flat) < 2:
        return []
    hull = _hull(flat)
    size = max(max(column) - min(column) for column in zip(*flat, strict=True))
    sides = []
    for a, b in zip(hull, hull[1:] + hull[:1], strict=True):
        (ax, ay), (bx, by) = flat[a], flat[b]
        length = max(hypot(bx - ax, by - ay), 1e-9)
        out_x, out_y = (by - ay) / length, (ax - bx) / length
        if length < 1e-6 * max(size, 1e-9) or out_y > -_MIN_FACING:
            continue
        members = tuple(
            k
            for k, (x, y) in zip(feet_cam, flat, strict=True)
            if k in shown and abs((x - ax) * out_x + (y - ay) * out_y) <= 0.1 * size
        )
        if len(members) >= 2:
            sides.append(members)
    return sides


def _hull(flat: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the convex hull of points, counter-clockwise; of two points or a line both ends."""
    order = sorted(range(len(flat)), key=lambda i: flat[i])

    def chain(indices: Sequence[int]) -> list[int]:
        out: list[int] = []
        for i in indices:
            while len(out) >= 2:
                (x0, y0), (ax, ay), (bx, by) = flat[out[-2]], flat[out[-1]], flat[i]
                if (ax - x0) * (by - y0) - (ay - y0) * (bx - x0) > 1e-9:
                    break
                out.pop()
            out.append(i)
        return out[:-1]

    return chain(order) + chain(order[::-1])


def _second_line(
    side: Sequence[int],
    known_m: Mapping[int, FloatArray],
    shown: Mapping[int, FloatArray],
    feet_cam: Mapping[int, FloatArray],
    seen_from: GroundedCamera,
) -> dict[int, FloatArray]:
    """Ground points (3,) of the contacts of a further side that have none yet, by label.

    Along the direction that the view bin gives from the corner, at the column of the contact; from the
    contact alone where the side has no corner yet or its direction is steep in the picture.
    """
    corner = next((k for k in side if k in known_m), None)
    found = {}
    for label in (k for k in side if k not in known_m):
        at = shown[label].copy()
        if corner is not None:
            start = seen_from.camera.project(known_m[corner])
            slope = _view_slope(
                np.stack([start, at]), np.stack([feet_cam[corner], feet_cam[label]]), seen_from
            )
            at[1] = at[1] if slope is None else start[1] + slope * (at[0] - start[0])
        point = seen_from.ground_points_m(at)
        if np.isfinite(point).all():
            found[label] = point
    return found


def _contacts(
    parts: PartLabels, ground_labels: Sequence[int], config: GroundLineConfig
) -> dict[int, FloatArray]:
    """Where each ground part touches, shape (2,), by label, image coordinates.

    That is the middle of the columns that touch, and the lower edge of the lowest pixel, where the object
    ends.
    """
    from recon.reconstruction.part_loops import contacts  # noqa: PLC0415 (half a second with Numba)

    if not parts.area_px:
        return {}
    tolerance = max(1.0, config.contact_height * (parts.rows[1] - parts.rows[0] + 1))
    wanted = [k for k in ground_labels if k in parts.area_px]
    found = contacts(parts.labels, np.array(wanted, np.int64), tolerance)
    found += np.array([parts.x0_px, parts.y0_px + 0.5])
    return dict(zip(wanted, found, strict=True))


def _view_slope(at: FloatArray, feet_cam: FloatArray, seen_from: GroundedCamera) -> float | None:
    """Slope in the image of the direction from the left to the right foot, at the middle of contacts (n, 2).

    None where there is one foot, the middle is not on the ground, or the direction points along the ray.
    """
    first, last = at[:, 0].argmin(), at[:, 0].argmax()
    if first == last:
        return None
    up, camera = seen_from.ground.up, seen_from.camera
    middle = seen_from.ground_points_m(at.mean(axis=0))
    along = feet_cam[last] - feet_cam[first]
    along = along - (along @ up) * up
    if not np.isfinite(middle).all() or along @ along < 1e-12:
        return None
    # how the pixel moves as the point moves, times the square of its depth
    (x, y, z), (dx, dy, dz) = middle.tolist(), along.tolist()
    du, dv = camera.fx_px * (dx * z - x * dz), camera.fy_px * (dy * z - y * dz)
    return dv / du if abs(du) > abs(dv) else None


def _fit(at: FloatArray, tolerance_px: float) -> tuple[float, float, BoolArray]:
    """Slope and offset of v = slope u + offset, and which contacts (n, 2) it is fitted to.

    The line is the one that most contacts agree with, the longer where several do; steep lines are no ground
    lines. A single contact gives a level line.
    """
    best: tuple[int, float] = (0, 0.0)
    on_line = np.zeros(len(at), bool)
    points: list[tuple[float, float]] = at.tolist()
    for (u0, v0), (u1, v1) in combinations(points, 2):
        du, dv = u1 - u0, v1 - v0
        if abs(dv) >= abs(du):
            continue
        use = [abs(v0 + (u - u0) * dv / du - v) <= tolerance_px for u, v in points]
        key = (sum(use), abs(du))
        if key > best:
            best, on_line = key, np.array(use)
    if best[0] < 2:
        on_line[np.argmax(at[:, 1])] = True
        return 0.0, float(at[:, 1].max()), on_line
    (mean_u, mean_v), (du, dv) = at[on_line].mean(axis=0), (at[on_line] - at[on_line].mean(axis=0)).T
    slope = float(du @ dv / (du @ du))
    return slope, float(mean_v - slope * mean_u), on_line
