"""Is everything installed, and does the stereo matcher measure what it should?"""

import platform
import re
from importlib import metadata
from importlib.util import find_spec

import cv2
import numpy as np

from recon.arrays import UInt8Array
from recon.stereo.sgbm import SgbmConfig, compute_disparity
from rescore.doctor.findings import Finding, Level

SHIFT_PX = 6
"""Disparity of the pair of the self-test."""


def examine_installation() -> list[Finding]:
    """Python, the libraries that the package asks for, optional ones, and the stereo matcher."""
    return [_python(), *_libraries(), _open3d(), _sgbm()]


def _python() -> Finding:
    return Finding(Level.OK, "python", f"{platform.python_version()} on {platform.platform(terse=True)}")


def _libraries() -> list[Finding]:
    try:
        wanted = metadata.requires("rescore") or []
    except metadata.PackageNotFoundError:
        return [Finding(Level.WARNING, "rescore", "not installed as a package", "run `make setup`")]
    names = [re.split(r"[^\w.-]", text, maxsplit=1)[0] for text in wanted if "extra ==" not in text]
    found = {name: _version(name) for name in names}
    missing = [
        Finding(Level.ERROR, name, "not installed", "run `make setup`") for name, v in found.items() if not v
    ]
    there = ", ".join(f"{name} {version}" for name, version in sorted(found.items()) if version)
    return [Finding(Level.OK, "libraries", there), *missing]


def _version(name: str) -> str | None:
    # OpenCV comes under several names, with the same module
    if name.startswith("opencv-python"):
        return cv2.__version__
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _open3d() -> Finding:
    if find_spec("open3d") is None:
        return Finding(
            Level.WARNING, "open3d", "not installed", "needed to render (`rescore synth`), not to rescore"
        )
    return Finding(Level.OK, "open3d", _version("open3d") or _version("open3d-cpu") or "unknown version")


def shifted_pair(rng: np.random.Generator) -> tuple[UInt8Array, UInt8Array]:
    """A pair (120, 160, 3) of smoothed noise with disparity ``SHIFT_PX`` everywhere."""
    noise = rng.integers(0, 255, (120, 160 + SHIFT_PX), dtype=np.uint8)
    wide = np.repeat(cv2.GaussianBlur(noise, (0, 0), 1.0)[..., None], 3, axis=2)
    return np.ascontiguousarray(wide[:, :160]), np.ascontiguousarray(wide[:, SHIFT_PX:])


def _sgbm() -> Finding:
    left, right = shifted_pair(np.random.default_rng(0))
    disparity = compute_disparity(left, right, SgbmConfig(num_disparities=16))
    share = float(np.isfinite(disparity).mean())
    median = float(np.nanmedian(disparity)) if share else np.nan
    what = (
        f"OpenCV {cv2.__version__} SGBM measures {median:.2f} px of {SHIFT_PX} at {share:.0%} of the pixels"
    )
    good = abs(median - SHIFT_PX) < 0.1 and share > 0.8
    advice = "" if good else "reinstall opencv-python-headless 4.13 or newer"
    return Finding(Level.OK if good else Level.ERROR, "stereo matcher", what, advice)
