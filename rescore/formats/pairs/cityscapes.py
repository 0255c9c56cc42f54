"""Boxes of Cityscapes: around the polygons of gtFine, a file a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, PositiveInt, TypeAdapter

from recon.errors import RescoreError
from rescore.formats.checked_json import Pixels, Rows, read_checked
from rescore.formats.folders import Layout
from rescore.formats.labels import LabelRow

FOLDER = "gtFine"
_GROUP = "group"
"""End of the label of things that are too close to each other to be told apart."""


class _Object(BaseModel):
    label: str
    polygon: Annotated[Rows[tuple[Pixels, Pixels]], Field(min_length=1)]


class _Polygons(BaseModel):
    width_px: Annotated[PositiveInt, Field(alias="imgWidth")]
    height_px: Annotated[PositiveInt, Field(alias="imgHeight")]
    objects: Rows[_Object]


_POLYGONS = TypeAdapter(_Polygons)


def polygon_files(layout: Layout) -> tuple[list[Path | None], tuple[str, ...]]:
    """The file of polygons of each frame, None where it has none, and what to say of those without."""
    paths: list[Path | None] = []
    for pictures in layout.pictures:
        between = pictures.left.parent.relative_to(layout.root).parts[1:]
        name = f"{pictures.left.stem.removesuffix('_leftImg8bit')}_{FOLDER}_polygons.json"
        path = layout.root.joinpath(FOLDER, *between, name)
        paths.append(path if path.is_file() else None)
    missing = paths.count(None)
    told = f"{layout.root / FOLDER}: {missing} of {len(paths)} frames have no polygons and count as empty"
    return paths, (told,) if missing else ()


def read_polygons(path: Path, width_px: int, height_px: int) -> list[LabelRow]:
    """The boxes around the polygons of a picture, all classes; a group of things is ``ignore``.

    Raises:
        RescoreError: another shape of JSON, or a size other than the picture's.
    """
    read = read_checked(path, _POLYGONS, "Cityscapes' polygons")
    if (read.width_px, read.height_px) != (width_px, height_px):
        raise RescoreError(
            f"{path}: expected polygons in a picture of {width_px} x {height_px} pixels, got one of "
            f"{read.width_px} x {read.height_px}; scale them"
        )
    return [_row(o.label, o.polygon, (width_px, height_px)) for o in read.objects]


def _row(label: str, polygon: Sequence[tuple[float, float]], size_px: tuple[int, int]) -> LabelRow:
    points = np.array(polygon)
    # corners are pixels, which belong to the thing
    (x0, y0), (x1, y1) = np.clip(points.min(0), 0, size_px), np.clip(points.max(0) + 1, 0, size_px)
    return LabelRow(
        label.removesuffix(_GROUP), (float(x0), float(y0), float(x1), float(y1)), label.endswith(_GROUP)
    )
