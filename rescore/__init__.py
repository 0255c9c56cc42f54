"""Detections, rescoring with stereo depth (eqs. 6 and 7) and evaluation.

``Rescorer``, ``StereoFrame``, ``Boxes`` and what they take and give are the library (docs/library.md).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recon.camera import GroundPlane
    from recon.errors import RescoreError
    from rescore.evidence.predicted import PredictedDepth
    from rescore.library.inputs import Boxes, Camera, StereoFrame
    from rescore.library.rescorer import Rescored, Rescorer

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
    "Boxes": "rescore.library.inputs",
    "Camera": "rescore.library.inputs",
    "GroundPlane": "recon.camera",
    "PredictedDepth": "rescore.evidence.predicted",
    "RescoreError": "recon.errors",
    "Rescored": "rescore.library.rescorer",
    "Rescorer": "rescore.library.rescorer",
    "StereoFrame": "rescore.library.inputs",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for: `rescore --help` and modules of this package need none of it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
