"""Detections, rescoring with stereo depth (eqs. 6 and 7) and evaluation.

The names of ``__all__`` are the library (docs/library.md); they are imported when they are asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recon.camera import GroundPlane
    from recon.errors import RescoreError
    from rescore.detectors.platt import PlattScaling
    from rescore.evidence.model import EvidenceModel
    from rescore.evidence.predicted_depth import BoxPrediction, PredictedDepth
    from rescore.evidence.registration import Registration
    from rescore.evidence.settings import CameraChoice, RescoreConfig
    from rescore.library.inputs import Boxes, Camera, StereoFrame
    from rescore.library.rescorer import Rescored, Rescorer
    from rescore.library.single_picture import FoundObject, Photo, find_object

__all__ = [
    "BoxPrediction",
    "Boxes",
    "Camera",
    "CameraChoice",
    "EvidenceModel",
    "FoundObject",
    "GroundPlane",
    "Photo",
    "PlattScaling",
    "PredictedDepth",
    "Registration",
    "RescoreConfig",
    "RescoreError",
    "Rescored",
    "Rescorer",
    "StereoFrame",
    "find_object",
]

_HOMES = {
    "recon.camera": ("GroundPlane",),
    "recon.errors": ("RescoreError",),
    "rescore.detectors.platt": ("PlattScaling",),
    "rescore.evidence.model": ("EvidenceModel",),
    "rescore.evidence.predicted_depth": ("BoxPrediction", "PredictedDepth"),
    "rescore.evidence.registration": ("Registration",),
    "rescore.evidence.settings": ("CameraChoice", "RescoreConfig"),
    "rescore.library.inputs": ("Boxes", "Camera", "StereoFrame"),
    "rescore.library.rescorer": ("Rescored", "Rescorer"),
    "rescore.library.single_picture": ("FoundObject", "Photo", "find_object"),
}


def __getattr__(name: str) -> Any:
    """Import what is asked for: `rescore --help` and modules of this package need none of it."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
