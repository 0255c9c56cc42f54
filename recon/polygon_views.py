"""Part-labelled views from polygons that a person drew on photos; the photos themselves are not needed."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray, UInt8Array
from recon.errors import RescoreError
from recon.part_views import PartView, PartViews
from recon.polygons import polygon_mask, polygon_problem
from recon.view_bins import ViewBins

MAX_PARTS = 255
"""Labels are 8-bit."""


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
    """In the order of painting: later ones lie over earlier ones."""


@dataclass(frozen=True, eq=False)
class LabelledViews:
    """Part-labelled views with what a user should know of them."""

    part_views: PartViews
    class_name: str | None
    """The class that the file names, if it names one."""
    warnings: tuple[str, ...]
    """One line each."""


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
