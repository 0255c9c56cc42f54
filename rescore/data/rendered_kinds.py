"""What a box shows on rendered scenes, by their pictures of instance numbers: for the analysis of errors."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray, rows_by_value
from recon.errors import RescoreError
from rescore.data.frames import FrameRecord
from rescore.data.pictures import decode_picture

GROUND_KINDS = frozenset({"ground", "road", "kerb", "pavement", "verge", "square"})
"""Kinds that cars stand on."""
BACKGROUND_KINDS = GROUND_KINDS | {"", "sky"}
"""Kinds that lie under or behind what a detector may mean."""
VEHICLE_KINDS = frozenset({"car", "van", "truck", "bus", "tram"})
"""Kinds that rendered scenes annotate, cars to be found and others to be ignored."""
UNKNOWN = ""
PICTURE_KINDS = frozenset(
    {
        *("banner", "billboard", "hoarding", "mural", "showroom"),
        *("bus_picture", "container_picture", "trailer_picture", "truck_picture"),
    }
)
"""Kinds that show a flat picture of a car, as rendered scenes name them."""


def read_instances(record: FrameRecord) -> NDArray[np.uint16] | None:
    """Instance number of each pixel, shape (h, w), 0 for sky; None where the data set has no such picture.

    Raises:
        RescoreError: the file is missing, no 16-bit picture, or of another size.
    """
    path = record.instance_path
    if path is None:
        return None
    if not path.is_file():
        raise RescoreError(
            f"{path}: expected a picture of instance numbers, found no file; build the data set again"
        )
    picture = decode_picture(path, cv2.IMREAD_UNCHANGED)
    if picture is None or picture.dtype != np.uint16 or picture.shape != (record.height_px, record.width_px):
        came = "no picture" if picture is None else f"{picture.shape} {picture.dtype}"
        raise RescoreError(
            f"{path}: expected 16-bit grey, {record.width_px} x {record.height_px} pixels, got {came}; "
            "build the data set again"
        )
    return np.asarray(picture, np.uint16)


def kinds_in_boxes(
    instances: NDArray[np.uint16], kind_of: Mapping[int, str], xyxy_px: FloatArray
) -> list[str]:
    """The kind that fills most of each box (n, 4), ground and sky left out; "" where nothing else is."""
    names = sorted(set(kind_of.values()) - BACKGROUND_KINDS)
    code = np.full(int(max([*kind_of, int(instances.max(initial=0))], default=0)) + 1, len(names))
    for number, kind in kind_of.items():
        if kind not in BACKGROUND_KINDS:
            code[number] = names.index(kind)
    kinds = code[instances]
    height, width = instances.shape
    found = []
    for box in xyxy_px:
        x0, y0, x1, y1 = (np.clip(np.round(box), 0, [width, height, width, height])).astype(int)
        counts = np.bincount(kinds[y0:y1, x0:x1].ravel(), minlength=len(names) + 1)[: len(names)]
        found.append(names[int(counts.argmax())] if counts.any() else UNKNOWN)
    return found


def kinds_of_candidates(record: FrameRecord, xyxy_px: FloatArray) -> list[str]:
    """The kind that fills most of each box (n, 4) of a frame; "" where the data set does not say."""
    instances = read_instances(record)
    if instances is None:
        return [UNKNOWN] * len(xyxy_px)
    return kinds_in_boxes(instances, record.instance_kinds, xyxy_px)


def kinds_of_table(
    frames: Sequence[FrameRecord], image_id: IntArray, xyxy_px: FloatArray
) -> NDArray[np.object_]:
    """The kind that fills most of each box (n, 4) of the images (n,) of some frames, shape (n,).

    "" where the data set does not say.
    """
    kinds = np.full(len(image_id), UNKNOWN, dtype=object)
    rendered = [f for f in frames if f.instance_path is not None]
    rows_of_image = rows_by_value(image_id) if rendered else {}
    for record in rendered:
        if record.image_id in rows_of_image:
            rows = rows_of_image[record.image_id]
            kinds[rows] = kinds_of_candidates(record, xyxy_px[rows])
    return kinds
