"""Folders of pictures as two cameras took them, made a data set of rectified pairs."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from recon.files import atomic_path
from rescore.data.frames import DataSet, FrameRecord, Truth, frame_names
from rescore.data.pictures import read_rgb
from rescore.files import remove
from rescore.formats.calibrations.raw_pair import RawPair, Rectified, RectifiedPair
from rescore.formats.folders import calibration_notes
from rescore.formats.labels import ClassMap
from rescore.formats.pairs.plain import read_as_taken
from rescore.locks import locked
from rescore.speech import counted

SIDES = ("left", "right")
"""Names of the folders of rectified pictures."""


def rectified_dataset(root: Path, classes: ClassMap, out: Path) -> DataSet:
    """The data set of a folder with its pictures rectified, which are written to a folder.

    They go to ``left`` and ``right`` of ``out``. Each frame has the rectified camera, and boxes are those
    around the mapped ones.

    Boxes that rectification moves out of the picture are left out and counted, and so are 3D boxes, which are
    of the camera as it stands.

    Raises:
        RescoreError: the folder has no pairs, no calibration of two cameras as they stand or pictures of
            several sizes, or ``out`` has such pictures already.
    """
    refuse_pictures(out)
    return rectified(*read_as_taken(root, classes), out)


def rectified(data: DataSet, raw: RawPair, path: Path, out: Path) -> DataSet:
    """A data set of pictures as two cameras took them, rectified as ``rectified_dataset`` does.

    Args:
        data: The pictures, and boxes on them.
        raw: The cameras.
        path: What names the cameras in errors.
        out: Folder to write pictures to.

    Raises:
        RescoreError: as there.
    """
    refuse_pictures(out)
    sizes = sorted({(f.width_px, f.height_px) for f in data.frames})
    if len(sizes) != 1:
        raise RescoreError(
            f"{data.root}: expected pictures of one size, that of their calibration, got {len(sizes)} sizes; "
            "rectify each in a folder of its own"
        )
    pair = raw.rectified(path, *sizes[0])
    with locked(out):
        frames = _written(data, pair, out)
    truth = {f.image_id: _truth(data.truth[f.image_id], pair.left, f) for f in frames}
    notes = [n for n in data.notes if "no calibration" not in n]
    gone = sum(len(t.annotation_id) - len(truth[i].annotation_id) for i, t in data.truth.items())
    if gone:
        notes.append(
            f"{data.root}: left out {counted(gone, 'box')} that rectification moves out of the picture"
        )
    if any(t.boxes3d is not None for t in data.truth.values()):
        notes.append(f"{data.root}: left out 3D boxes, which are of the camera as it stands")
    notes += calibration_notes(frames, data.root)
    return replace(data, root=out, frames=frames, truth=truth, notes=tuple(notes))


def refuse_pictures(out: Path) -> None:
    """Raises RescoreError where a folder has a left or a right side already."""
    for side in SIDES:
        if (out / side).exists():
            raise RescoreError(
                f"{out / side}: expected no pictures here yet, found some; choose another --out"
            )


def _written(data: DataSet, pair: RectifiedPair, out: Path) -> tuple[FrameRecord, ...]:
    """The frames with their rectified pictures, which are written; none is left where one cannot be."""
    width, height = data.frames[0].width_px, data.frames[0].height_px
    camera, names = pair.camera(width, height), frame_names(data)
    places = [one.places(width, height) for one in (pair.left, pair.right)]
    found = []
    try:
        for frame in data.frames:
            assert frame.right_path is not None
            left, right = (
                _write(
                    out / side / f"{names[frame.image_id]}.png",
                    np.asarray(cv2.remap(read_rgb(source, width, height), *at, cv2.INTER_LINEAR), np.uint8),
                )
                for side, source, at in zip(SIDES, (frame.left_path, frame.right_path), places, strict=True)
            )
            offset = pair.disparity_offset_px
            found.append(
                replace(frame, left_path=left, right_path=right, camera=camera, disparity_offset_px=offset)
            )
    except BaseException:
        for side in SIDES:
            remove(out / side)
        raise
    return tuple(found)


def _write(path: Path, rgb: UInt8Array) -> Path:
    data = cv2.imencode(".png", rgb[..., ::-1])[1]
    with atomic_path(path) as beside:
        beside.write_bytes(data.tobytes())
    return path


def _truth(truth: Truth, left: Rectified, frame: FrameRecord) -> Truth:
    """The boxes of a frame around what they held, those of which nothing is left taken out."""
    boxes = left.boxes(truth.xyxy_px, frame.width_px, frame.height_px)
    kept = np.flatnonzero((boxes[:, 2] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 1]))
    return replace(
        truth,
        annotation_id=truth.annotation_id[kept],
        xyxy_px=boxes[kept],
        ignore=truth.ignore[kept],
        visibility=truth.visibility[kept],
        shape_id=tuple(truth.shape_id[i] for i in kept),
        azimuth_deg=None if truth.azimuth_deg is None else truth.azimuth_deg[kept],
        truncated=None if truth.truncated is None else truth.truncated[kept],
        occluded=None if truth.occluded is None else truth.occluded[kept],
        boxes3d=None,
    )
