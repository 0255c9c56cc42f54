"""What messages of pictures, cameras and detections hold, in this package's terms."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from recon.reading import refuse_large_picture
from rescore.data.pictures import PNG_END, PNG_HEAD
from rescore.formats.calibrations.numbers import Values, numbers_of
from rescore.formats.calibrations.tools import FISHEYE, is_fisheye
from rescore.formats.labels import ClassMap, LabelRow

_BAYER = {
    "bayer_rggb8": cv2.COLOR_BayerRGGB2BGR,
    "bayer_bggr8": cv2.COLOR_BayerBGGR2BGR,
    "bayer_gbrg8": cv2.COLOR_BayerGBRG2BGR,
    "bayer_grbg8": cv2.COLOR_BayerGRBG2BGR,
}
_ENCODINGS: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "mono8": (1, None),
    "8UC1": (1, None),
    **{name: (1, code) for name, code in _BAYER.items()},
}
"""Values of a pixel, and how OpenCV takes them to blue, green and red where they are not those or grey."""


def stamp_ns(message: Any) -> int:
    """Nanoseconds of the time stamp in the header of a message; 0 where nobody set it."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def picture_file(where: str, message: Any) -> tuple[str, bytes] | None:
    """The suffix and the bytes of a file with the picture of a message; None if it is damaged.

    Compressed pictures keep their bytes, but those of a colour mosaic.

    Raises:
        RescoreError: the pixels are of a kind that is not read; ``where`` names the topic.
    """
    if hasattr(message, "format"):
        return _of_compressed(where, str(message.format), np.asarray(message.data, np.uint8))
    encoding = str(message.encoding)
    if encoding not in _ENCODINGS:
        raise RescoreError(
            f"{where}: expected pictures as {', '.join(_ENCODINGS)}, got {encoding[:40]!r}; "
            "record one of these"
        )
    channels, code = _ENCODINGS[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.asarray(message.data, np.uint8)
    if not width or not height or step < width * channels or data.size != step * height:
        return None
    pixels = data.reshape(height, step)[:, : width * channels].reshape(height, width, channels)
    return _png(pixels, code)


def _of_compressed(where: str, form: str, data: UInt8Array) -> tuple[str, bytes] | None:
    content = data.tobytes()
    is_jpeg, is_png = content.startswith(b"\xff\xd8"), content.startswith(PNG_HEAD)
    if not is_jpeg and not is_png:
        if any(name in form.lower() for name in ("jpeg", "jpg", "png")):
            return None
        raise RescoreError(
            f"{where}: expected JPEG or PNG in compressed pictures, got {form[:40]!r}; record one of these"
        )
    if (b"\xff\xd9" if is_jpeg else PNG_END) not in content:
        return None
    mosaic = next((code for name, code in _BAYER.items() if name in form), None)
    if mosaic is not None:
        try:
            refuse_large_picture(Path(where), content)
            pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        except (OSError, SyntaxError, ValueError, cv2.error):
            return None
        if pixels is None:
            return None
        if pixels.ndim == 2 and pixels.dtype == np.uint8:
            return _png(pixels[..., None], mosaic)
    return (".jpg" if is_jpeg else ".png"), content


def _png(pixels: NDArray[Any], code: int | None) -> tuple[str, bytes]:
    pixels = np.ascontiguousarray(pixels)
    bgr = pixels if code is None else cv2.cvtColor(pixels, code)
    return ".png", cv2.imencode(".png", bgr)[1].tobytes()


def camera_values(path: Path, left: Any, right: Any) -> Values:
    """The two cameras of messages of camera_info, by the names that OpenCV gives to the parts of a pair.

    Raises:
        RescoreError: a number is not finite, or the two differ in size or distortion model.
    """
    size = (int(left.width), int(left.height))
    if size != (int(right.width), int(right.height)):
        raise RescoreError(
            f"{path}: expected camera_info of pictures of one size, got {size[0]} x {size[1]} and "
            f"{right.width} x {right.height}; calibrate both cameras for one size"
        )
    if is_fisheye(left.distortion_model) != is_fisheye(right.distortion_model):
        raise RescoreError(
            f"{path}: expected camera_info of one distortion model, got {left.distortion_model!r} and "
            f"{right.distortion_model!r}; calibrate both cameras with one"
        )
    values: Values = {"width": np.array([float(size[0])]), "height": np.array([float(size[1])])}
    for number, info in ((1, left), (2, right)):
        for name, shape in (("K", (3, 3)), ("D", (-1,)), ("R", (3, 3)), ("P", (3, 4))):
            listed = getattr(info, name.lower()).tolist()
            if listed:
                key = f"{name}{number}"
                values[key] = numbers_of(path, f"camera_info: {key}", listed).reshape(shape)
    if is_fisheye(left.distortion_model):
        values[FISHEYE] = np.ones(1)
    return values


def rows_of(message: Any, classes: ClassMap) -> tuple[list[LabelRow], int]:
    """The boxes of a message of detections, and how many were left out for want of a size or a score.

    Each is of the class of the data set where one of its hypotheses is, else of its best one.
    """
    rows, gone = [], 0
    for detection in message.detections:
        told = [_hypothesis(result) for result in detection.results]
        name, score = max(
            [h for h in told if classes.takes(h[0])] or told or [("", np.nan)], key=lambda h: h[1]
        )
        box = _box(detection.bbox)
        if np.isfinite([*box, score]).all() and box[2] > box[0] and box[3] > box[1]:
            rows.append(LabelRow(name, box, score=score))
        else:
            gone += 1
    return rows, gone


def _hypothesis(result: Any) -> tuple[str, float]:
    # vision_msgs before 3 has both in the result itself, and calls the class id
    told = getattr(result, "hypothesis", result)
    return str(told.class_id if hasattr(told, "class_id") else told.id), float(told.score)


def _box(box: Any) -> tuple[float, float, float, float]:
    """Left, top, right, bottom around a box that may be turned."""
    # vision_msgs before 4 has geometry_msgs/Pose2D here
    middle = getattr(box.center, "position", box.center)
    along, across = abs(np.cos(box.center.theta)), abs(np.sin(box.center.theta))
    half_x = float(box.size_x * along + box.size_y * across) / 2
    half_y = float(box.size_x * across + box.size_y * along) / 2
    x, y = float(middle.x), float(middle.y)
    return x - half_x, y - half_y, x + half_x, y + half_y
