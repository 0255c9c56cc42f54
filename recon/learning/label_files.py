"""Labelled views from files: rendered ones, or polygons of parts from a labelling tool.

Polygons come as COCO segmentation JSON, or as a folder of LabelMe JSON. In both, later polygons lie over
earlier ones, and coordinates are pixel edges.

COCO: categories are the parts, and their ``supercategory`` may name the class. Each image has, beside COCO's
own keys, ``view_bin`` (or ``azimuth_deg``), and ``instance_id`` where several pictures show one object.

LabelMe: one JSON a picture. View bin and instance are picture flags, which the tool offers as check boxes
when it is started with ``labelme PHOTOS --labels labels.txt --flags
view_bin_00,view_bin_01,instance_a,instance_b``; the box of the bin and that of the instance are ticked. The
keys ``view_bin`` and ``instance_id`` at the top of the JSON, written with an editor, serve as well; LabelMe
keeps them. A file ``labels.txt`` in the folder (a name a line) fixes names and order of the parts.
"""

import json
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.learning.label_polygons import (
    LabelledImage,
    LabelledViews,
    PartPolygon,
    views_of_polygons,
    warnings_of,
)
from recon.part_views import LABELS_FILE, load_part_views
from recon.reading import read_text, reading
from recon.view_bins import ViewBins

LABELS_TXT = "labels.txt"
_NOT_PARTS = {"__ignore__", "_background_"}
"""Names that LabelMe's own examples put into labels.txt."""
_BIN_FLAG, _INSTANCE_FLAG = "view_bin_", "instance_"
_MAX_PIXELS = 400_000_000
_KINDS: dict[type, str] = {int: "whole number", str: "text", list: "list"}
T = TypeVar("T")


def read_labelled_views(path: Path, bins: ViewBins | None = None) -> LabelledViews:
    """The part-labelled views at a path, which may be one of four.

    - a folder with ``part_views.json``, or a data set with such a folder ``part_views`` in it;
    - a COCO segmentation file (see ``recon.learning.label_files``);
    - a folder of LabelMe files (see there).

    Args:
        path: the file or folder.
        bins: view bins of polygons, None for the defaults; ``part_views.json`` names its own.

    Raises:
        RescoreError: nothing is there, or it is none of these; or something in it cannot be used.
    """
    bins = bins or ViewBins()
    if path.is_file():
        return read_coco_polygons(path, bins)
    for folder in (path, path / "part_views"):
        if (folder / LABELS_FILE).is_file():
            views = load_part_views(folder)
            return LabelledViews(views, None, warnings_of(views))
    if any(path.glob("[!.]*.json")):
        return read_labelme_polygons(path, bins)
    raise RescoreError(
        f"{path}: expected {LABELS_FILE}, a COCO segmentation file or a folder of LabelMe files, found none; "
        "check the path"
    )


def read_coco_polygons(path: Path, bins: ViewBins) -> LabelledViews:
    """The part-labelled views of a COCO segmentation file.

    Raises:
        RescoreError: the file has another shape, or a picture or polygon cannot be used; it is named.
    """
    data = _read_object(path, "images", "COCO segmentation JSON; of LabelMe files give the folder")
    rows = {_get(row, "id", int, f"{path}: images"): row for row in _rows(data, "images", str(path))}
    part_of, class_name = _categories(data, path)
    polygons: dict[int, list[PartPolygon]] = {image_id: [] for image_id in rows}
    for row in _rows(data, "annotations", str(path)):
        where = f"{path}: annotation {row.get('id', '?')}"
        image_id, category_id = _get(row, "image_id", int, where), _get(row, "category_id", int, where)
        if image_id not in rows:
            raise RescoreError(f"{where}: expected a listed image, got image_id {image_id}; mend it")
        where = f"{path}: image {_file_name(rows[image_id], path)!r}"
        if category_id not in part_of:
            raise RescoreError(
                f"{where}: expected a category_id of {', '.join(map(str, part_of))}, got {category_id}; "
                "mend it or list its category"
            )
        polygons[image_id] += _coco_polygons(row, part_of[category_id], where)
    if not any(polygons.values()):
        raise RescoreError(f"{path}: expected polygons of parts, got none; label the pictures first")
    images = [_coco_image(row, path, polygons[image_id], bins) for image_id, row in rows.items()]
    used = {p.part for image in images for p in image.polygons}
    return views_of_polygons(images, [n for n in part_of.values() if n in used], bins, class_name)


def read_labelme_polygons(folder: Path, bins: ViewBins) -> LabelledViews:
    """The part-labelled views of a folder of LabelMe files; parts as in labels.txt, else by alphabet.

    Raises:
        RescoreError: a file has another shape, or a picture or polygon cannot be used; it is named.
    """
    files = sorted(folder.glob("[!.]*.json"))
    if not files:
        raise RescoreError(f"{folder}: expected LabelMe files (*.json), found none; check the path")
    images = [_labelme_image(path) for path in files]
    used = {p.part for image in images for p in image.polygons}
    return views_of_polygons(images, _listed_names(folder / LABELS_TXT) or sorted(used), bins, None)


def _categories(data: dict[str, Any], path: Path) -> tuple[dict[int, str], str | None]:
    """Names of the parts by category id, and the class that they are said to belong to."""
    rows = _rows(data, "categories", str(path))
    part_of = {
        _get(r, "id", int, f"{path}: categories"): _get(r, "name", str, f"{path}: categories") for r in rows
    }
    if len(set(part_of.values())) < len(rows):
        raise RescoreError(f"{path}: categories: expected each id and name once, got one twice; rename it")
    # tools that know no class write nothing, "none" or the name itself
    classes = sorted({str(r.get("supercategory") or "none") for r in rows} - {"none", *part_of.values()})
    if len(classes) > 1:
        raise RescoreError(
            f"{path}: expected parts of one class, got supercategories {', '.join(classes)}; "
            "export each class to a file of its own"
        )
    return part_of, classes[0] if classes else None


def _coco_polygons(row: dict[str, Any], part: str, where: str) -> list[PartPolygon]:
    where = f"{where}: part {part!r}"
    segmentation = row.get("segmentation")
    if isinstance(segmentation, dict):
        raise RescoreError(
            f"{where}: expected polygons, got a run-length mask (RLE); export polygons instead"
        )
    if not isinstance(segmentation, list) or not segmentation:
        raise RescoreError(f"{where}: expected a list of polygons as segmentation, got none; draw one")
    found = []
    for flat in segmentation:
        if not isinstance(flat, list) or len(flat) % 2:
            raise RescoreError(
                f"{where}: expected polygons [x1, y1, x2, y2, ...], got {_short(flat)}; mend it"
            )
        found.append(PartPolygon(part, _points([flat[i : i + 2] for i in range(0, len(flat), 2)], where)))
    return found


def _coco_image(
    row: dict[str, Any], path: Path, polygons: list[PartPolygon], bins: ViewBins
) -> LabelledImage:
    name = _file_name(row, path)
    place = f"{path}: image {name!r}"
    if "view_bin" in row:
        view_bin = _get(row, "view_bin", int, place)
    elif "azimuth_deg" in row:
        view_bin = bins.containing(float(np.deg2rad(_number(row["azimuth_deg"], "azimuth_deg", place))))
    else:
        raise RescoreError(f"{place}: expected view_bin or azimuth_deg, got neither; add one")
    height, width = _size(row, "height", "width", place)
    return _image(place, height, width, view_bin, _instance(row, name), polygons)


def _file_name(row: dict[str, Any], path: Path) -> str:
    return _get(row, "file_name", str, f"{path}: image {row['id']}")


def _labelme_image(path: Path) -> LabelledImage:
    data = _read_object(path, "shapes", "LabelMe JSON alone; of COCO JSON give the file")
    place = str(path)
    polygons = []
    for shape in _rows(data, "shapes", place):
        part = _get(shape, "label", str, f"{place}: shape")
        where = f"{place}: part {part!r}"
        kind = shape.get("shape_type", "polygon")
        if kind != "polygon":
            raise RescoreError(f"{where}: expected shape_type 'polygon', got {kind!r}; draw it as a polygon")
        polygons.append(PartPolygon(part, _points(_get(shape, "points", list, where), where)))
    height, width = _size(data, "imageHeight", "imageWidth", place)
    flags = data.get("flags") or {}
    ticked = sorted(k for k, on in flags.items() if on is True) if isinstance(flags, dict) else []
    instance = _instance(data, _ticked(ticked, _INSTANCE_FLAG, place) or path.stem)
    view_bin = _labelme_bin(data, ticked, place)
    return _image(place, height, width, view_bin, instance, polygons)


def _labelme_bin(data: dict[str, Any], ticked: list[str], place: str) -> int:
    if "view_bin" in data:
        return _get(data, "view_bin", int, place)
    flag = _ticked(ticked, _BIN_FLAG, place)
    if flag is None:
        raise RescoreError(
            f"{place}: expected a view bin, got none; tick a flag such as {_BIN_FLAG}03, or add view_bin"
        )
    if not (flag.isascii() and flag.isdigit()):
        raise RescoreError(
            f"{place}: expected a flag such as {_BIN_FLAG}03, got {_BIN_FLAG + flag!r}; rename it"
        )
    return int(flag)


def _ticked(ticked: list[str], prefix: str, place: str) -> str | None:
    """What follows the prefix in the one ticked flag that has it; None where none has."""
    found = [name.removeprefix(prefix) for name in ticked if name.startswith(prefix)]
    if len(found) > 1:
        raise RescoreError(
            f"{place}: expected one ticked flag {prefix}..., got {', '.join(prefix + f for f in found)}; "
            "untick one"
        )
    return found[0] if found else None


def _listed_names(path: Path) -> list[str]:
    """The part names of LabelMe's labels.txt; empty where there is no such file."""
    lines = read_text(path, "names of parts").split("\n") if path.is_file() else []
    return list(dict.fromkeys(name for line in lines if (name := line.strip()) and name not in _NOT_PARTS))


def _image(
    place: str, height: int, width: int, view_bin: int, instance_id: str, polygons: list[PartPolygon]
) -> LabelledImage:
    if not polygons:
        raise RescoreError(f"{place}: expected at least one polygon, got none; label it or leave it out")
    return LabelledImage(place, height, width, view_bin, instance_id, tuple(polygons))


def _read_object(path: Path, key: str, what: str) -> dict[str, Any]:
    """The JSON object of a file, which must have a key; ``what`` says what is expected and what to do."""
    with reading(path, "JSON", "export it again"):
        data = json.loads(path.read_bytes())
    if not isinstance(data, dict) or key not in data:
        came = (
            f"an object with {', '.join(sorted(data)) or 'no keys'}"
            if isinstance(data, dict)
            else _short(data)
        )
        raise RescoreError(f"{path}: got {came}; expected {what}")
    return data


def _rows(data: dict[str, Any], key: str, place: str) -> list[dict[str, Any]]:
    rows = _get(data, key, list, place)
    wrong = [row for row in rows if not isinstance(row, dict)]
    if wrong:
        raise RescoreError(f"{place}: {key}: expected a list of objects, got {_short(wrong[0])}; mend it")
    return rows


def _get(row: dict[str, Any], key: str, kind: type[T], place: str) -> T:
    """The value of a key, of a given type; a whole number is no truth value."""
    value = row.get(key)
    if not isinstance(value, kind) or isinstance(value, bool):
        came = "none" if key not in row else _short(value)
        raise RescoreError(f"{place}: expected {key} of type {_KINDS[kind]}, got {came}; mend it")
    return value


def _instance(row: dict[str, Any], otherwise: str) -> str:
    """The key instance_id, a name or a number; where there is none, the picture is alone of its instance."""
    value = row.get("instance_id")
    return otherwise if value is None else str(value)


def _size(row: dict[str, Any], height: str, width: str, place: str) -> tuple[int, int]:
    h, w = _get(row, height, int, place), _get(row, width, int, place)
    if not (h > 0 and w > 0 and h * w <= _MAX_PIXELS):
        raise RescoreError(
            f"{place}: expected the size of a picture, got {w} x {h}; mend {width} and {height}"
        )
    return h, w


def _number(value: object, key: str, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
        raise RescoreError(f"{place}: expected a finite number as {key}, got {_short(value)}; mend it")
    return float(value)


def _points(pairs: list[Any], where: str) -> FloatArray:
    """Points (m, 2); numbers that are not finite are for the check of the polygon."""
    try:
        return np.array(pairs, dtype=float).reshape(len(pairs), 2)
    except (TypeError, ValueError, OverflowError) as error:
        raise RescoreError(
            f"{where}: expected points as pairs of numbers, got {_short(pairs)}; mend it"
        ) from error


def _short(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."
