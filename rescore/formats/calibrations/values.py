"""The named numbers of a calibration file of any form and tool."""

from pathlib import Path

import numpy as np

from recon.errors import RescoreError
from rescore.formats.calibrations import data_sets, tools
from rescore.formats.calibrations.file_forms import Named, named_values
from rescore.formats.calibrations.numbers import Values, matrix_of, numbers_of, pinhole

ONE_CAMERA = (
    "projection_matrix",
    "P",
    "K1",
    "cameraMatrix",
    "camera_matrix",
    "CameraMatrix",
    "K",
    "P1",
    "P2",
)
"""Names of the matrix of one camera, best first."""
UNITS = ("depth_factor", "DepthMapFactor", "depth_scale", "disparity_factor")
"""Names of the values that files of depth or disparity have for one metre or pixel."""
USUAL_DEPTH = (("intrinsic_matrix", "Open3D", 1000.0), (data_sets.TABLE, "Virtual KITTI", 100.0))
"""Forms of files by a name in them, and the value of one metre that each documents."""
ZERO = "disparity_zero"
"""Name of the value that files of disparity have for none."""
GROUND = ("height_m", "pitch_rad", "roll_rad")
"""Names of the camera's height over the ground and of its angles."""
_SAME = {
    **{"M1": "K1", "M2": "K2", "cameraMatrix1": "K1", "cameraMatrix2": "K2"},
    **{"distCoeffs1": "D1", "distCoeffs2": "D2", "distCoeffs": "D", "dist_coeffs": "D"},
    **{"distortion_coefficients": "D", "distortion_coeffs": "D", "Distortion_Coefficients": "D"},
    **{f"{side}.{k}": f"{k}{n}" for n, side in ((1, "LEFT"), (2, "RIGHT")) for k in "KDRP"},
    **{"LEFT.width": "width", "LEFT.height": "height", "Camera_Matrix": "cameraMatrix"},
    **{"image_Width": "image_width", "image_Height": "image_height"},
    # RealSense
    **{"ppx": "cx", "ppy": "cy", "coeffs": "D"},
}
"""Names that mean what another one does."""
_PAIR = [f"{k}{n}" for n in (1, 2) for k in "KDRP"]
_WANTED = frozenset(
    {
        *ONE_CAMERA,
        *_SAME,
        *_PAIR,
        *UNITS,
        *GROUND,
        *("P0", "P3", "Q", "R", "T", "D", "cam0", "doffs", "rectification_matrix"),
        *(f"P_rect_0{n}" for n in range(4)),
        *("baseline", "baseline_m", "fx", "fy", "cx", "cy", "ppx", "ppy", "T_BS", "intrinsics"),
        *("intrinsic_matrix", "coeffs"),
        *("width", "height", "image_width", "image_height", "imageSize", "image_size", "resolution"),
        *(f"{k}_{n}" for k in ("P_rect", "S_rect", "R", "T") for n in (101, 103)),
        *("Camera.bf", "Camera.width", "Camera.height", "Stereo.b", "Stereo.T_c1_c2"),
        *(
            f"{camera}.{k}"
            for camera in ("Camera", "Camera1", "Camera2")
            for k in ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
        ),
    }
)
"""Names of all that is read; under other names there may be anything."""


def calibration_values(
    path: Path, right: Path | None = None, size_px: tuple[int, int] | None = None
) -> Values:
    """Every number, list and matrix of a calibration that is wanted, by its name (see ``tools``).

    Numbers and lists have shape (n,), matrices (rows, n).

    Args:
        path: The file; that of the left camera, or of the cameras alone, where there are two.
        right: The right camera's file, or that of the pair.
        size_px: Width and height of the pictures, by which some files have their numbers.

    Raises:
        RescoreError: no such file, not of its form, or something else than numbers in it.
    """
    values = _of_file(path, size_px)
    if right is None:
        return values
    others = _of_file(right, size_px)
    if "T_BS" in values and "T_BS" in others:
        return tools.of_euroc(path, values, right, others)
    if "baseline_m" in others or ("K1" in values and "K1" not in others):
        return values | others
    return tools.of_ros(path, values, right, others)


def _of_file(path: Path, size_px: tuple[int, int] | None) -> Values:
    found = _merged(path, named_values(path))
    of_data_set = data_sets.of_data_set(path, found)
    return _of_tool(path, found, size_px) if of_data_set is None else of_data_set


def _of_tool(path: Path, found: Named, size_px: tuple[int, int] | None) -> Values:
    blocks = {k: block for k in ("cam0", "cam1") if isinstance(block := found.get(k), dict)}
    values = {
        k: numbers_of(path, k, v)
        for k, v in found.items()
        if k in _WANTED and k not in blocks and not (_SAME.get(k, k)[0] == "D" and _is_empty(v))
    }
    if blocks:
        return values | tools.of_kalibr(path, blocks)
    sections = {k: v for k, v in found.items() if isinstance(v, dict)}
    if any(name.startswith("LEFT_CAM") for name in sections):
        return values | tools.of_zed(path, sections, size_px)
    if any(tools.is_fisheye(found.get(k, "")) for k in ("distortion_model", "Camera.type")):
        values[tools.FISHEYE] = np.ones(1)
    values = {_SAME.get(k, k): v for k, v in values.items()}
    if "P_rect_101" in values and "P_rect_103" in values:
        return tools.of_driving_stereo(path, values)
    return _with_matrix(path, tools.of_orb_slam(path, values))


def _is_empty(value: object) -> bool:
    """Whether a value has no numbers, as distortions of rectified cameras have not."""
    listed = value.get("data", value) if isinstance(value, dict) else value
    return not isinstance(listed, int | float) and not listed


def _merged(path: Path, documents: list[Named]) -> Named:
    """The names and values of all documents of a file, each name with one value."""
    found: Named = {}
    for document in documents:
        told = document
        if "distortion_model" in document or "camera_name" in document:
            # ROS 2 writes the names of a camera_info small; R turns to the rectified camera there
            told = {_ROS.get(n, n): v for n, v in document.items()}
        for name, value in told.items():
            if found.setdefault(name, value) != value and name in _WANTED:
                raise RescoreError(
                    f"{path}: {name}: expected one value, got another in a further document; keep one camera"
                )
    return found


_ROS = {"k": "K", "p": "P", "d": "D", "r": "rectification_matrix", "R": "rectification_matrix"}


def _with_matrix(path: Path, values: Values) -> Values:
    """The values with K and the size where a file has fx, fy, cx and cy, one by one or in a list."""
    if "intrinsic_matrix" in values:
        values["K"] = tools.open3d_matrix(path, values)
    if "intrinsics" in values:
        values["K"] = pinhole(*matrix_of(path, values, "intrinsics", 1, 4)[0])
        values.setdefault("D", np.zeros(4))
    if all(k in values for k in ("fx", "fy", "cx", "cy")) and not any(k in values for k in ONE_CAMERA):
        values["K"] = pinhole(*(matrix_of(path, values, k, 1, 1)[0, 0] for k in ("fx", "fy", "cx", "cy")))
    if "resolution" in values:
        values["width"], values["height"] = matrix_of(path, values, "resolution", 2, 1)
    return values
