"""Detections, rescoring with stereo depth (eqs. 6 and 7) and evaluation.

``Rescorer``, ``StereoFrame``, ``Boxes`` and what they take and give are the library (docs/library.md).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recon.camera import GroundPlane
    from recon.errors import RescoreError
    from rescore.inputs import Boxes, Camera, StereoFrame
    from rescore.predicted import PredictedDepth
    from rescore.rescorer import Rescored, Rescorer

__all__ = [
    "Boxes",
    "Camera",
    "GroundPlane",
    "PredictedDepth",
    "RescoreError",
    "Rescored",
    "Rescorer",
    "StereoFrame",
]

_HOMES = {
    "Boxes": "rescore.inputs",
    "Camera": "rescore.inputs",
    "GroundPlane": "recon.camera",
    "PredictedDepth": "rescore.predicted",
    "RescoreError": "recon.errors",
    "Rescored": "rescore.rescorer",
    "Rescorer": "rescore.rescorer",
    "StereoFrame": "rescore.inputs",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for: `rescore --help` and modules of this package need none of it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
