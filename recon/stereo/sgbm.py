"""Measured depth: OpenCV's semi-global matching on a rectified pair, and KITTI's disparity files.

The matcher is Hirschmüller's semi-global matching (PAMI 2008) as OpenCV builds it, with 5 paths.
"""

import io
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from recon.arrays import Float32Array, UInt8Array
from recon.camera import StereoCamera
from recon.errors import RescoreError
from recon.files import atomic_path
from recon.reading import reading, refuse_large_picture

PNG_SCALE = 256.0
"""Value of a disparity file for one pixel of disparity (KITTI's convention)."""


@dataclass(frozen=True)
class SgbmConfig:
    """Settings of StereoSGBM. The defaults are the preset for grey 640 x 480 pairs.

    ``p1`` and ``p2`` are 8 and 32 times the block area, as OpenCV's documentation advises for one channel.
    Blocks of 5 pixels keep the wheels and pillars of far cars; larger ones are smoother and fatten outlines.
    """

    num_disparities: int = 64
    """Disparities 0 to this less one are searched; a positive multiple of 16."""
    block_size: int = 5
    """Side of the matched block in pixels; odd."""
    p1: int = 200
    """Penalty of a disparity change of one between neighbours."""
    p2: int = 800
    """Penalty of a larger change; above p1."""
    pre_filter_cap: int = 31
    """Truncation of the horizontal derivative that is matched."""
    uniqueness_percent: int = 10
    """The best cost must beat the second best by this many per cent."""
    speckle_window: int = 100
    """Blobs of fewer pixels than this are dropped; 0 keeps all."""
    speckle_range: int = 2
    """Largest disparity step within a blob, in pixels."""
    left_right_max_difference: int = 1
    """Largest disagreement of the left and the right map in pixels; -1 switches the check off."""

    def __post_init__(self) -> None:
        if self.num_disparities <= 0 or self.num_disparities % 16:
            raise RescoreError(
                f"stereo: num_disparities must be a positive multiple of 16, got {self.num_disparities}; "
                f"try {max(16, -(-self.num_disparities // 16) * 16)}"
            )
        if self.block_size < 1 or self.block_size % 2 == 0:
            raise RescoreError(f"stereo: block_size must be odd and positive, got {self.block_size}; try 5")
        if not 0 <= self.p1 < self.p2:
            raise RescoreError(f"stereo: expected 0 <= p1 < p2, got p1={self.p1}, p2={self.p2}; raise p2")


KITTI_SGBM = SgbmConfig(num_disparities=208)
"""The preset for KITTI's pairs: surfaces from 2 m on.

Focal length times baseline is 380 to 385 px m in KITTI's recordings, so 2 m is up to 193 pixels of disparity.
All else is as for rendered streets; nothing was tuned on KITTI. ``disparities_to_reach`` computes the same
range from a calibration.
"""


def disparities_to_reach(camera: StereoCamera, nearest_m: float, offset_px: float = 0.0) -> int:
    """The smallest legal ``num_disparities`` that still measures surfaces at ``nearest_m`` metres.

    That is fx baseline / nearest less the offset, plus one, rounded up to a multiple of 16.

    Args:
        camera: The rectified pair.
        nearest_m: Depth of the nearest surface wanted, above 0.
        offset_px: cx of the right picture less cx of the left (Middlebury's doffs); matched disparities are
            smaller by it.
    """
    largest_px = max(0.0, float(camera.exact_disparity_px(nearest_m)) - offset_px)
    return disparities_beyond(largest_px)


def disparities_beyond(largest_px: float) -> int:
    """The smallest legal ``num_disparities`` whose search goes beyond a disparity of ``largest_px``."""
    return 16 * (int(largest_px) // 16 + 1)


_SEARCHED_WHOLE = 64
"""A search of as many disparities takes little longer than finding out how many would do."""
_COARSE = 4
"""The scene's nearest surface is looked for in pictures smaller by this."""
_NEAR_SHARE = 1000
"""One pixel in as many of these may be nearer than the search reaches: so many are wrong matches."""
_COARSE_ERROR_PX = 12.0
"""A disparity of the small pictures may be wrong by three of their pixels."""


def disparity_of_scene(left_rgb: UInt8Array, right_rgb: UInt8Array, config: SgbmConfig) -> Float32Array:
    """Left disparity as of ``compute_disparity``, searched no farther than the nearest surface of the scene.

    How far that is is told by the pictures at a quarter of their size. Searches of up to 64 disparities stay
    as they are. A wider one hardly changes: fewer wrong matches compete, so a little more is measured.

    Args:
        left_rgb: Left picture, shape (h, w, 3) uint8.
        right_rgb: Right picture, rectified, of the same shape.
        config: Settings with the most disparities that are searched.

    Raises:
        RescoreError: as ``compute_disparity``.
    """
    _check_pair(left_rgb, right_rgb)
    return compute_disparity(left_rgb, right_rgb, _search_of_scene(left_rgb, right_rgb, config))


def _search_of_scene(left_rgb: UInt8Array, right_rgb: UInt8Array, config: SgbmConfig) -> SgbmConfig:
    n, (height, width) = config.num_disparities, left_rgb.shape[:2]
    if n <= _SEARCHED_WHOLE or width < 2 * n or height < _COARSE * config.block_size:
        return config
    size = (width // _COARSE, height // _COARSE)
    left, right = (
        np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
        for rgb in (left_rgb, right_rgb)
    )
    few, speckle = -(-n // (16 * _COARSE)) * 16, config.speckle_window // _COARSE
    coarse = compute_disparity(left, right, replace(config, num_disparities=few, speckle_window=speckle))
    known = np.sort(coarse[np.isfinite(coarse)])
    beyond = coarse.size // _NEAR_SHARE
    if len(known) <= beyond:
        return config
    asked = disparities_beyond(_COARSE * float(known[-1 - beyond]) + _COARSE_ERROR_PX)
    return replace(config, num_disparities=min(n, max(asked, _SEARCHED_WHOLE)))


def compute_disparity(left_rgb: UInt8Array, right_rgb: UInt8Array, config: SgbmConfig) -> Float32Array:
    """Left disparity in pixels, shape (h, w), steps of 1/16; NaN where there is no measurement.

    StereoSGBM leaves the first ``num_disparities`` columns empty, because some of the searched matches fall
    outside the right picture. Here both pictures are padded on the left by repeating their first column, so
    that these columns are matched too, with the smaller disparities that still have a match. A winner that
    lies in the padding is no measurement and becomes NaN. So does a disparity of zero: it is infinitely far,
    and KITTI's files cannot tell it from a hole.

    Args:
        left_rgb: Left picture, shape (h, w, 3) uint8.
        right_rgb: Right picture, rectified, of the same shape.
        config: Settings of the matcher.

    Raises:
        RescoreError: Not a pair of equal (h, w, 3) uint8 pictures; or the picture is so narrow for the search
            that OpenCV's result would depend on the thread timing (half a block wider than the width less
            the disparities, opencv#25828).
    """
    _check_pair(left_rgb, right_rgb)
    width = left_rgb.shape[1]
    if config.block_size // 2 > width - config.num_disparities:
        raise RescoreError(
            f"stereo: half a block ({config.block_size // 2} px) must fit into the width less the "
            f"disparities ({width} - {config.num_disparities} px), or the result is not repeatable; "
            "lower num_disparities or block_size"
        )
    pad = config.num_disparities
    left, right = (
        cv2.copyMakeBorder(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), 0, 0, pad, 0, cv2.BORDER_REPLICATE)
        for rgb in (left_rgb, right_rgb)
    )
    fixed_point = _matcher(config).compute(left, right)[:, pad:]
    disparity = fixed_point.astype(np.float32) / 16
    match_column = np.arange(width, dtype=np.float32) - disparity
    disparity[(fixed_point <= 0) | (match_column < 0)] = np.nan
    return np.asarray(disparity, np.float32)


def _matcher(config: SgbmConfig) -> cv2.StereoSGBM:
    return cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=config.num_disparities,
        blockSize=config.block_size,
        P1=config.p1,
        P2=config.p2,
        disp12MaxDiff=config.left_right_max_difference,
        preFilterCap=config.pre_filter_cap,
        uniquenessRatio=config.uniqueness_percent,
        speckleWindowSize=config.speckle_window,
        speckleRange=config.speckle_range,
        mode=cv2.STEREO_SGBM_MODE_SGBM,
    )


def _check_pair(left_rgb: UInt8Array, right_rgb: UInt8Array) -> None:
    for eye, rgb in (("left", left_rgb), ("right", right_rgb)):
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
            raise RescoreError(
                f"stereo: the {eye} picture must be (h, w, 3) uint8 RGB, "
                f"got {rgb.shape} {rgb.dtype}; convert it"
            )
    if left_rgb.shape != right_rgb.shape:
        raise RescoreError(
            f"stereo: left and right must have one size, got {left_rgb.shape[1]} x {left_rgb.shape[0]} and "
            f"{right_rgb.shape[1]} x {right_rgb.shape[0]} pixels; rectify the pair"
        )


def read_disparity(path: Path, width_px: int, height_px: int) -> Float32Array:
    """Disparity in pixels from a 16-bit PNG, value = 256 x pixels, 0 = none; NaN where there is none.

    Args:
        path: The file.
        width_px: Expected width.
        height_px: Expected height.

    Raises:
        RescoreError: No such file, not a whole PNG, not 16-bit grey, or of another size.
    """
    disparity_px = read_png16(path, width_px, height_px, "disparity", PNG_SCALE)
    disparity_px[disparity_px == 0] = np.nan
    return disparity_px


def read_png16(path: Path, width_px: int, height_px: int, what: str, factor: float) -> Float32Array:
    """Value / factor of a 16-bit grey PNG, shape (h, w); what 0 means is for the caller to say.

    ``what`` is "disparity" or "depth", for the errors.

    Raises:
        RescoreError: as ``read_disparity``.
    """
    if not path.is_file():
        raise RescoreError(
            f"{path}: expected a {what} PNG, found no file; check {what}_file_name in annotations.json"
        )
    with reading(path, f"a whole {what} PNG", "write it again"):
        # a small file may claim any size: compared before it is unpacked
        width, height = refuse_large_picture(path, data := path.read_bytes())
        if (width, height) != (width_px, height_px):
            raise RescoreError(
                f"{path}: expected {width_px} x {height_px} pixels, got {width} x {height}; "
                f"the {what} must be that of the left picture"
            )
        # Pillow, since OpenCV gives back the first rows of a truncated PNG as if nothing were wrong
        picture = Image.open(io.BytesIO(data), formats=("PNG",))
        _refuse_mode(path, picture.mode, what, factor)
        picture.load()
        value = np.asarray(picture)
    return np.asarray(value.astype(np.float32) / np.float32(factor))


def _refuse_mode(path: Path, mode: str, what: str, factor: float) -> None:
    if mode not in ("I;16", "I;16B", "I"):
        raise RescoreError(
            f"{path}: expected 16-bit grey with value = {factor:g} x {what}, got a PNG of mode {mode}; "
            "8-bit files lose the fractions: write 16 bits"
        )


def write_disparity(path: Path, disparity_px: Float32Array) -> None:
    """Write disparity as a 16-bit PNG (KITTI's convention), beside its place and then moved into it.

    NaN is written as 0, no measurement; so is a disparity below 1/512 pixel.

    Raises:
        RescoreError: Not an (h, w) array of floats, or a value outside [0, 256) pixels.
    """
    if disparity_px.ndim != 2 or not np.issubdtype(disparity_px.dtype, np.floating):
        raise RescoreError(
            f"{path}: expected an (h, w) float disparity, got {disparity_px.shape} {disparity_px.dtype}"
        )
    known = disparity_px[~np.isnan(disparity_px)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    if low < 0 or high * PNG_SCALE > np.iinfo(np.uint16).max:
        raise RescoreError(
            f"{path}: disparities must lie in [0, 256) pixels, got {low:g} to {high:g}; mark holes as NaN"
        )
    value = np.rint(np.nan_to_num(disparity_px.astype(np.float64), nan=0.0) * PNG_SCALE)
    done, encoded = cv2.imencode(".png", value.astype(np.uint16))
    if not done:
        raise RescoreError(f"{path}: could not encode a disparity of shape {disparity_px.shape} as PNG")
    with atomic_path(path) as beside:
        beside.write_bytes(encoded.tobytes())
