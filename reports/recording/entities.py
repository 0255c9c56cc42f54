"""Entity paths, classes, times and small helpers that all parts of a recording share."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from recon.arrays import FloatArray, UInt8Array
from reports.palette import (
    NIGHT,
    NIGHT_HOLE,
    OUTCOME_COLOUR,
    OUTCOME_NAME,
    PART_COLOURS,
    on_dark,
    part_colour,
    rgb,
)

WORLD = "world"
CAMERA = f"{WORLD}/camera"
IMAGE = f"{CAMERA}/image"
RIGHT_CAMERA = f"{WORLD}/right_camera"
RIGHT_IMAGE = f"{RIGHT_CAMERA}/image"

FRAME_TIME, CANDIDATE_TIME, THRESHOLD_TIME, IMAGE_TIME = "frame", "candidate rank", "threshold", "image_id"
"""Timelines. What belongs to a frame is logged on the first two, and what belongs to a candidate too, so that
a step of either shows all of it."""
THRESHOLD_STEPS = 1000
"""Steps of the threshold's timeline from score 0 to 1."""

REJECTED = ("hit", "false_alarm", "duplicate", "ignored")
OUTCOME_CLASSES = (*OUTCOME_COLOUR, *(f"{name}, below the threshold" for name in REJECTED))
"""Class id of a box: its index here."""
HOLE_CLASS = 255
"""Class id of pixels without depth: Rerun would paint their 0 like the nearest depth."""
JPEG_QUALITY = 85
_DIM = 0.42


def part(name: str) -> str:
    """A name as one part of an entity path."""
    return str(rr.escape_entity_path_part(name))


def boxes_path(detector: str, mode: str) -> str:
    """Entity path of the candidates of a detector in a mode, over the picture."""
    return f"{IMAGE}/{part(detector)}/{part(mode)}"


def models_path(detector: str) -> str:
    """Entity path of the registered models of a frame, in 3D."""
    return f"{WORLD}/{part(detector)}/models"


def boxes3d_path(detector: str) -> str:
    """Entity path of the 3D boxes of a frame's candidates and cars."""
    return f"{WORLD}/{part(detector)}/boxes3d"


def crop_path(detector: str) -> str:
    """Entity path of the pinhole that looks at one candidate."""
    return f"{CAMERA}/{part(detector)}_candidate"


def object_path(detector: str) -> str:
    """Entity path of one candidate in 3D."""
    return f"{WORLD}/{part(detector)}/candidate"


def why_path(detector: str) -> str:
    """Entity path of the words and bars on one candidate."""
    return f"why/{part(detector)}"


def class_colour(name: str) -> tuple[int, int, int]:
    """Colour of a class of boxes; candidates below the threshold are dim."""
    bright = rgb(on_dark(OUTCOME_COLOUR[name.partition(",")[0]]))
    if name in OUTCOME_COLOUR:
        return bright
    r, g, b = (round(_DIM * c + (1 - _DIM) * d) for c, d in zip(bright, rgb(NIGHT), strict=True))
    return r, g, b


def outcome_class(outcome: str, accepted: bool) -> int:
    """Class id of a candidate."""
    return OUTCOME_CLASSES.index(outcome if accepted else f"{outcome}, below the threshold")


def outcome_context() -> rr.AnnotationContext:
    """Names and colours of the classes of boxes."""
    return rr.AnnotationContext(
        [
            rr.AnnotationInfo(
                id=i, label=OUTCOME_NAME.get(name, name.replace("_", " ")), color=class_colour(name)
            )
            for i, name in enumerate(OUTCOME_CLASSES)
        ]
    )


def part_context(part_names: Sequence[str]) -> rr.AnnotationContext:
    """Names and colours of the parts of the class model, and of holes in depth."""
    names = part_names or [f"part {i + 1}" for i in range(PART_COLOURS)]
    return rr.AnnotationContext(
        [
            rr.AnnotationInfo(id=HOLE_CLASS, label="no depth", color=rgb(NIGHT_HOLE)),
            rr.AnnotationInfo(id=0, color=(0, 0, 0, 0)),
            *(
                rr.AnnotationInfo(id=i + 1, label=name.replace("_", " "), color=rgb(part_colour(i + 1)))
                for i, name in enumerate(names)
            ),
        ]
    )


def values(**columns: NDArray[Any]) -> tuple[rr.AnyValues, ...]:
    """The columns as values for tests and tables to read; none where they are empty, which Rerun refuses."""
    some = any(len(column) for column in columns.values())
    return (rr.AnyValues(drop_untyped_nones=True, **columns),) if some else ()


def text(markdown: str) -> rr.TextDocument:
    """Markdown for a text panel."""
    return rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN)


def padded(image: NDArray[Any], size_px: tuple[int, int], fill: float) -> NDArray[Any]:
    """An image (h, w, ...) with room added at its right and lower side up to a width and height.

    Rerun takes the encoded files of an entity for one video, whose frames must have one size.
    """
    h, w = image.shape[:2]
    room = [(0, size_px[1] - h), (0, size_px[0] - w), *[(0, 0)] * (image.ndim - 2)]
    return np.pad(image, room, constant_values=fill)


def picture(rgb_image: UInt8Array, quality: int = JPEG_QUALITY) -> rr.EncodedImage:
    """A picture for the recording, as JPEG."""
    _, data = cv2.imencode(".jpg", rgb_image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg")


def pinhole(matrix: FloatArray, width_px: int, height_px: int, **look: Any) -> rr.Pinhole:
    """A pinhole for the recording of a camera matrix whose origin is the middle of the first pixel."""
    # Rerun's has its origin at the corner of that pixel
    corner = matrix + np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    return rr.Pinhole(
        image_from_camera=corner,
        resolution=[width_px, height_px],
        camera_xyz=rr.ViewCoordinates.RDF,
        **look,
    )
