"""3D class models, learned from part-labelled views, and what they tell of a single picture or a stereo pair.

Needs no detector. The names of ``__all__`` are the library; they are imported when they are asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recon.camera import (
        DEFAULT_GROUND,
        GroundedCamera,
        GroundedStereo,
        GroundPlane,
        PinholeCamera,
        StereoCamera,
        default_camera,
    )
    from recon.class_model import ClassModel, ClassPart
    from recon.depth_map import DepthMap
    from recon.errors import Failure, Reason, RescoreError
    from recon.learning.label_files import read_labelled_views
    from recon.learning.label_polygons import LabelledViews
    from recon.learning.learn import LearnConfig, learn_class_model
    from recon.part_views import PartView, PartViews, load_part_views, save_part_views
    from recon.reconstruction.instance import Instance3D, InstancePart, InstanceQuality, build_instance
    from recon.reconstruction.reconstruct import ReconstructConfig, Reconstruction, reconstruct
    from recon.reconstruction.view_selection import ViewChoice, best_view_bin
    from recon.view_bins import ViewBins

__all__ = [
    "DEFAULT_GROUND",
    "ClassModel",
    "ClassPart",
    "DepthMap",
    "Failure",
    "GroundPlane",
    "GroundedCamera",
    "GroundedStereo",
    "Instance3D",
    "InstancePart",
    "InstanceQuality",
    "LabelledViews",
    "LearnConfig",
    "PartView",
    "PartViews",
    "PinholeCamera",
    "Reason",
    "ReconstructConfig",
    "Reconstruction",
    "RescoreError",
    "StereoCamera",
    "ViewBins",
    "ViewChoice",
    "best_view_bin",
    "build_instance",
    "default_camera",
    "learn_class_model",
    "load_part_views",
    "read_labelled_views",
    "reconstruct",
    "save_part_views",
]

_HOMES = {
    "recon.camera": (
        "DEFAULT_GROUND",
        "GroundPlane",
        "GroundedCamera",
        "GroundedStereo",
        "PinholeCamera",
        "StereoCamera",
        "default_camera",
    ),
    "recon.class_model": ("ClassModel", "ClassPart"),
    "recon.depth_map": ("DepthMap",),
    "recon.errors": ("Failure", "Reason", "RescoreError"),
    "recon.learning.label_files": ("read_labelled_views",),
    "recon.learning.label_polygons": ("LabelledViews",),
    "recon.learning.learn": ("LearnConfig", "learn_class_model"),
    "recon.part_views": ("PartView", "PartViews", "load_part_views", "save_part_views"),
    "recon.reconstruction.instance": ("Instance3D", "InstancePart", "InstanceQuality", "build_instance"),
    "recon.reconstruction.reconstruct": ("ReconstructConfig", "Reconstruction", "reconstruct"),
    "recon.reconstruction.view_selection": ("ViewChoice", "best_view_bin"),
    "recon.view_bins": ("ViewBins",),
}


def __getattr__(name: str) -> Any:
    """Import what is asked for: a module of this package needs none of the others."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
