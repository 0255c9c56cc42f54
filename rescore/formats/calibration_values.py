"""The named numbers of a calibration file: YAML of OpenCV, ROS and Kalibr, and lines of ``name: numbers``."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.files import read_text
from rescore.formats.yaml_files import read_yaml

MAX_APART_PX = 0.5
"""Pictures whose rows are at most this far apart count as rectified."""
MAX_ASIDE = 0.01
"""Pictures count as rectified when the right camera lies at most this share of the baseline above, below or
behind the left one."""

ONE_CAMERA = (
    "projection_matrix",
    "P",
    "K1",
    "M1",
    "cameraMatrix",
    "camera_matrix",
    "CameraMatrix",
    "K",
    "P1",
    "P2",
)
"""Names of the matrix of one camera, best first."""
_WANTED = frozenset(
    {
        *ONE_CAMERA,
        *("P0", "P3", "P_rect_02", "P_rect_03", "Q", "T", "K2", "M2", "cam0", "doffs"),
        *("baseline", "baseline_m", "depth_factor", "DepthMapFactor"),
        *("width", "height", "image_width", "image_height", "imageSize", "image_size"),
    }
)
"""Names of all that is read; under other names there may be anything."""


def calibration_values(path: Path) -> dict[str, FloatArray]:
    """Every number, list and matrix of a calibration file that is wanted, by its name.

    Numbers and lists have shape (n,), matrices (rows, n). Blocks of Kalibr's become P1 and P2.

    Raises:
        RescoreError: no such file, neither text nor YAML, or something else than numbers in it.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a calibration, found no file; check the path")
    text = read_text(path, "a calibration")
    found = _of_lines(text) if path.suffix == ".txt" else _of_documents(path, text)
    blocks = {k: block for k in ("cam0", "cam1") if isinstance(block := found.get(k), dict)}
    values = {k: _numbers(path, k, v) for k, v in found.items() if k in _WANTED and k not in blocks}
    return values | _of_kalibr(path, blocks) if blocks else values


def _of_lines(text: str) -> dict[str, object]:
    pairs = (re.split(r"[=:]", line, maxsplit=1) for line in text.splitlines())
    return {p[0].strip(): p[1].strip(" []").replace(";", " ") for p in pairs if len(p) == 2}


def _of_documents(path: Path, text: str) -> dict[str, object]:
    """The names and values of all documents of a YAML file, each name with one value."""
    found: dict[str, object] = {}
    for document in read_yaml(path, text):
        # ROS 2 writes the names of a camera_info small
        small = {"k": "K", "p": "P"} if "distortion_model" in document else {}
        for name, value in ((small.get(n, n), v) for n, v in document.items()):
            if found.setdefault(name, value) != value and name in _WANTED:
                raise RescoreError(
                    f"{path}: {name}: expected one value, got another in a further document; keep one camera"
                )
    return found


def _numbers(path: Path, name: str, value: object) -> FloatArray:
    """The numbers of one, a list, rows, or a matrix with rows, cols and data."""
    matrix = value if isinstance(value, dict) else {}
    listed = matrix.get("data") if matrix else value
    try:
        numbers = np.atleast_1d(np.array(_parsed(listed), float))
        rows, columns = int(matrix.get("rows", 0)), int(matrix.get("cols", 0))
        # OpenCV writes "3d" where each place has three numbers
        channels = int(re.split(r"\D", str(matrix.get("dt", "")))[0] or 1)
    except (ValueError, TypeError) as error:
        raise RescoreError(f"{path}: {name}: expected numbers, got {_short(value)}; mend it") from error
    if not numbers.size or not np.isfinite(numbers).all():
        raise RescoreError(f"{path}: {name}: expected finite numbers, got {_short(listed)}; mend it")
    if not matrix or (rows, columns) == (0, 0):
        return numbers
    if numbers.size != rows * columns * channels:
        raise RescoreError(
            f"{path}: {name}: expected {rows} x {columns} numbers, got {numbers.size}; mend rows and cols"
        )
    return numbers.reshape(rows, columns * channels)


def _parsed(value: object) -> Any:
    """The number of a text, or the numbers of a text or a list, nested as they stand.

    Raises:
        ValueError: there is something else.
    """
    if isinstance(value, list):
        return [_parsed(v) for v in value]
    if not isinstance(value, str):
        raise ValueError("no text")
    # YAML writes .nan and .inf
    plain = re.sub(r"\.(nan|inf)", r"\1", value, flags=re.IGNORECASE)
    numbers = [float(v) for v in re.split(r"[\s,]+", plain.strip()) if v]
    return numbers[0] if len(numbers) == 1 else numbers


def _short(value: object) -> str:
    return repr(str(value).strip()[:40])


def matrix_of(path: Path, values: Mapping[str, FloatArray], name: str, rows: int, columns: int) -> FloatArray:
    """The matrix of a name, shape (rows, columns); a list of as many numbers is taken row by row.

    Raises:
        RescoreError: there is no such name, or its value has another shape.
    """
    value = values.get(name)
    # a matrix of one row or column is a list
    listed = value is not None and (value.ndim == 1 or 1 in value.shape)
    if value is not None and value.size == rows * columns and (listed or value.shape == (rows, columns)):
        return value.reshape(rows, columns)
    got = "no such entry" if value is None else f"{' x '.join(map(str, value.shape))} numbers"
    raise RescoreError(f"{path}: {name}: expected {rows} x {columns} numbers, got {got}; mend it")


def number_of(path: Path, values: Mapping[str, FloatArray], name: str) -> float:
    """The single number of a name.

    Raises:
        RescoreError: there is no such name, or its value is not one number.
    """
    return float(matrix_of(path, values, name, 1, 1)[0, 0])


def _of_kalibr(path: Path, blocks: Mapping[str, dict[str, object]]) -> dict[str, FloatArray]:
    """P1 and P2 of Kalibr's blocks of two cameras, or K of one, as OpenCV names them, and the size.

    Kalibr describes the pictures as the cameras take them. Such numbers are read only where the pictures are
    rectified already: without distortion, by cameras that stand side by side and look the same way.

    Raises:
        RescoreError: the blocks are of other pictures, or not as Kalibr writes them.
    """
    if "cam0" not in blocks:
        raise RescoreError(f"{path}: expected Kalibr's block cam0, got cam1 alone; add it")
    first = _kalibr_camera(path, "cam0", blocks["cam0"])
    size = {k: first[k] for k in ("width", "height") if k in first}
    if "cam1" not in blocks:
        return size | {"K": first["projection"][:, :3]}
    second = _kalibr_camera(path, "cam1", blocks["cam1"])
    left, right = first["projection"], second["projection"].copy()
    move = matrix_of(path, second, "cam1: T_cn_cnm1", 4, 4)
    if any(second.get(k, v) != v for k, v in size.items()):
        raise _unrectified(path, "cam1", "pictures of two sizes")
    apart = float(np.abs(right[1] - left[1]).max() + left[0, 0] * np.abs(move[:3, :3] - np.eye(3)).max())
    if apart > MAX_APART_PX:
        raise _unrectified(path, "cam1", f"rows that are about {apart:.1f} px apart")
    aside = float(np.abs(move[1:3, 3]).max())
    if aside > MAX_ASIDE * abs(move[0, 3]):
        raise _unrectified(path, "cam1", f"a camera that is {aside:g} m above, below or behind the other")
    right[0, 3] = right[0, 0] * move[0, 3]
    return size | {"P1": left, "P2": right}


def _kalibr_camera(path: Path, name: str, block: Mapping[str, object]) -> dict[str, FloatArray]:
    """The numbers of a block, with its projection matrix (3, 4), width and height."""
    read = ("intrinsics", "resolution", "T_cn_cnm1", *_DISTORTION)
    values = {f"{name}: {k}": _numbers(path, f"{name}: {k}", block[k]) for k in read if block.get(k)}
    model = block.get("camera_model", "pinhole")
    if model != "pinhole":
        raise _unrectified(path, name, f"the camera model {_short(model)}")
    bent = [k for k in _DISTORTION if values.get(f"{name}: {k}", np.zeros(1)).any()]
    if bent:
        raise _unrectified(path, name, f"{bent[0]} other than 0")
    fx, fy, cx, cy = matrix_of(path, values, f"{name}: intrinsics", 1, 4)[0]
    values["projection"] = np.array([[fx, 0, cx, 0], [0, fy, cy, 0], [0, 0, 1, 0]])
    if f"{name}: resolution" in values:
        values["width"], values["height"] = matrix_of(path, values, f"{name}: resolution", 2, 1)
    return values


_DISTORTION = ("distortion_coeffs", "distortion_coefficients")


def _unrectified(path: Path, name: str, got: str) -> RescoreError:
    return RescoreError(
        f"{path}: {name}: expected the cameras of rectified pictures, got {got}; rectify the pictures and "
        "write their P1 and P2"
    )
