"""Part-labelled views from polygons that a person drew on photos, and what a polygon of a part may be.

The photos themselves are not needed.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.errors import RescoreError
from recon.outlines import fill_polygon
from recon.part_views import PartView, PartViews
from recon.view_bins import ViewBins

BORDER_TOLERANCE_PX = 1.0
"""Labelling tools round, and differ by half a pixel in where a picture ends."""
_BLOCK = 1024
"""Edges compared with all others at a time, which bounds memory for long polygons."""
MAX_PARTS = 255
"""Largest number of parts of a class, since labels are 8-bit."""


@dataclass(frozen=True, eq=False)
class PartPolygon:
    """One polygon of one part."""

    part: str
    points: FloatArray
    """Shape (m, 2), pixel edges: the picture spans [0, width] x [0, height]. Unchecked."""


@dataclass(frozen=True, eq=False)
class LabelledImage:
    """The polygons of one picture, as a file gives them."""

    place: str
    """File, and image where it holds several: what errors begin with."""
    height_px: int
    width_px: int
    view_bin: int
    instance_id: str
    polygons: tuple[PartPolygon, ...]
    """The polygons in the order of painting: later ones lie over earlier ones."""


@dataclass(frozen=True, eq=False)
class LabelledViews:
    """Part-labelled views with the warnings that a user should read."""

    part_views: PartViews
    class_name: str | None
    """The class that the file names, if it names one."""
    warnings: tuple[str, ...]
    """What a user should know of the views, one line a warning."""


def views_of_polygons(
    images: Sequence[LabelledImage],
    part_names: Sequence[str],
    bins: ViewBins,
    class_name: str | None,
) -> LabelledViews:
    """Labelled views of pictures with polygons.

    Args:
        images: at least one, each with at least one polygon.
        part_names: the names that polygons may have; label i is the part at index i - 1.
        bins: the view bins of the pictures.
        class_name: what the views are said to show, if it is known.

    Raises:
        RescoreError: a polygon that cannot be filled, an unknown part, a bin that does not exist, two
            pictures of one instance in one bin, or more than 255 parts.
    """
    if len(part_names) > MAX_PARTS:
        raise RescoreError(
            f"part names: expected at most {MAX_PARTS}, got {len(part_names)}; merge some parts"
        )
    _refuse_same_bin(images, bins)
    views = tuple(PartView(i.view_bin, _paint(i, part_names), i.instance_id) for i in images)
    part_views = PartViews(tuple(part_names), bins, views)
    return LabelledViews(part_views, class_name, warnings_of(part_views))


def _refuse_same_bin(images: Sequence[LabelledImage], bins: ViewBins) -> None:
    first: dict[tuple[str, int], LabelledImage] = {}
    for image in images:
        try:
            bins.check(image.view_bin)
        except RescoreError as error:
            raise RescoreError(f"{image.place}: {error}") from error
        other = first.setdefault((image.instance_id, image.view_bin), image)
        if other is not image:
            raise RescoreError(
                f"{image.place}: expected one picture of instance {image.instance_id!r} in view bin "
                f"{image.view_bin}, got {other.place} too; leave one out or mend its bin or instance"
            )


def _paint(image: LabelledImage, part_names: Sequence[str]) -> UInt8Array:
    """Part labels (h, w) of a picture, the painter's way."""
    labels = np.zeros((image.height_px, image.width_px), np.uint8)
    label_of = {name: i + 1 for i, name in enumerate(part_names)}
    for polygon in image.polygons:
        where = f"{image.place}: part {polygon.part!r}"
        if polygon.part not in label_of:
            raise RescoreError(f"{where}: expected one of {', '.join(part_names)}; rename it")
        problem = polygon_problem(polygon.points, image.height_px, image.width_px)
        if problem is not None:
            raise RescoreError(f"{where}: {problem}; draw it again")
        labels[polygon_mask(polygon.points, image.height_px, image.width_px)] = label_of[polygon.part]
    for part in dict.fromkeys(p.part for p in image.polygons):
        if not (labels == label_of[part]).any():
            raise RescoreError(
                f"{image.place}: part {part!r}: expected pixels of its own, got none, since later polygons "
                "cover it; draw it after them or leave it out"
            )
    return labels


def warnings_of(part_views: PartViews) -> tuple[str, ...]:
    """What makes learning from these views poor or impossible."""
    seen = Counter(int(label) for v in part_views.views for label in np.unique(v.labels) if label)
    counts = {name: seen[i + 1] for i, name in enumerate(part_views.part_names)}
    found = [
        f"part {name!r}: no view shows it; the model is learned without it"
        for name in counts
        if not counts[name]
    ]
    found += [
        f"part {name!r}: one view shows it; its plane will be taken to face that view"
        for name in counts
        if counts[name] == 1
    ]
    instances = [v.instance_id for v in part_views.views]
    if len(set(instances)) == len(instances):
        found.append(
            "no two views share an instance, and learning needs two of one; give pictures of one object the "
            "same instance_id"
        )
    return tuple(found)


def open_ring(points: FloatArray) -> FloatArray:
    """The polygon (m, 2) without points that repeat the one before; the first follows the last."""
    return points[(points != np.roll(points, 1, axis=0)).any(axis=1)] if len(points) > 1 else points


def polygon_problem(points: FloatArray, height_px: int, width_px: int) -> str | None:
    """What was expected and what came, where a polygon (m, 2) in pixel edges cannot be filled; else None."""
    if not np.isfinite(points).all():
        return f"expected finite coordinates, got {points[~np.isfinite(points).all(axis=1)][0].tolist()}"
    ring = open_ring(points)
    if len(ring) < 3:
        return f"expected at least 3 different points, got {len(ring)}"
    size = np.array([width_px, height_px])
    outside = ((ring < -BORDER_TOLERANCE_PX) | (ring > size + BORDER_TOLERANCE_PX)).any(axis=1)
    if outside.any():
        return f"expected points inside {width_px} x {height_px} pixels, got {_shown(ring[outside][0])}"
    crossing = first_crossing(ring)
    if crossing is not None:
        at = " and ".join(_shown(ring[i]) for i in crossing)
        return f"expected a polygon that does not cross itself, got edges that cross after {at}"
    if area_px(ring) < 1.0:
        return f"expected an area of at least one pixel, got {area_px(ring):.2g}"
    return None


def area_px(ring: FloatArray) -> float:
    """Area inside a polygon (m, 2)."""
    x, y = (ring - ring.mean(axis=0)).T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def first_crossing(ring: FloatArray) -> tuple[int, int] | None:
    """The first two edges of a polygon (m, 2) that cross; edge i goes from point i to the next.

    Edges cross where each has its ends strictly on both sides of the other. Touching, also of an end and the
    middle of an edge, is allowed: tools snap points to each other, and the inside is the same.
    """
    start, end = ring, np.roll(ring, -1, axis=0)
    low, high = np.minimum(start, end), np.maximum(start, end)
    slack = 1e-12 * float(np.ptp(ring, axis=0).max()) ** 2
    for first in range(0, len(ring), _BLOCK):
        block = slice(first, first + _BLOCK)
        # few edges come near each other, and only those that do can cross
        near = ((low[block, None] <= high[None]) & (low[None] <= high[block, None])).all(axis=2)
        i, j = np.nonzero(near)
        i += first
        a, b, c, d = start[i], end[i], start[j], end[j]
        cross = np.nonzero(_straddles(a, b, c, d, slack) & _straddles(c, d, a, b, slack))[0]
        if len(cross):
            return int(i[cross[0]]), int(j[cross[0]])
    return None


def _straddles(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, slack: float) -> BoolArray:
    """Whether c and d (n, 2) lie strictly on both sides of the line through a and b (n, 2), shape (n,)."""
    along = b - a
    side_c = along[:, 0] * (c - a)[:, 1] - along[:, 1] * (c - a)[:, 0]
    side_d = along[:, 0] * (d - a)[:, 1] - along[:, 1] * (d - a)[:, 0]
    strictly = (np.minimum(side_c, side_d) < -slack) & (np.maximum(side_c, side_d) > slack)
    return np.asarray(strictly, dtype=bool)


def polygon_mask(points: FloatArray, height_px: int, width_px: int) -> BoolArray:
    """The mask (h, w) inside a polygon (m, 2) in pixel edges."""
    return fill_polygon(points - 0.5, height_px, width_px)


def _shown(point: FloatArray) -> str:
    return f"({point[0]:g}, {point[1]:g})"
