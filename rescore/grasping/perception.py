"""From the camera's picture to estimates of the car, by every method of the localisation study."""

from collections.abc import Sequence

import numpy as np

from datasets_synth.photos.table_scene import SEEN_FROM
from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.errors import Failure
from recon.localization.single_plane import lower_edge, single_plane
from recon.localization.standing_box import StandingBox, cam_from_ground
from rescore.grasping.choose import Estimate
from rescore.parallel import one_thread
from rescore.studies.localization.learned import TableClass
from rescore.studies.localization.segment import TableRegion, empty_table, segment_table
from rescore.studies.localization.trials import TrialConfig, construct_region, fit_region

JOINT_FIT, TRUE_BOX = "3dp", "truth"
METHODS = (JOINT_FIT, "3dp_report", "single_plane", "single_plane_narrow", TRUE_BOX)
METHOD_NAME = {
    "3dp": "3DP, joint fit",
    "3dp_report": "3DP, the report's construction",
    "single_plane": "single plane, hand wide open",
    "single_plane_narrow": "single plane, opened by its own width",
    "truth": "true box",
}
_SHEET_M = 0.001
"""Thickness at which a surface without volume is handed on."""


def perceive(
    rgb: UInt8Array, table_class: TableClass, config: TrialConfig, methods: Sequence[str] = METHODS
) -> dict[str, Estimate | Failure]:
    """The estimates of the largest thing on the table in a picture (h, w, 3), by method but the truth."""
    methods = [m for m in methods if m != TRUE_BOX]
    with one_thread():
        regions = segment_table(rgb, empty_table(config.segment))
        if isinstance(regions, Failure):
            return dict.fromkeys(methods, regions)
        found = _localised(methods, rgb, regions[0], table_class, config)
    return {
        m: box if isinstance(box, Failure) else Estimate(box, width_known=m != "single_plane")
        for m, box in found.items()
    }


def _localised(
    methods: Sequence[str], rgb: UInt8Array, region: TableRegion, table_class: TableClass, config: TrialConfig
) -> dict[str, StandingBox | Failure]:
    fit = fit_region(rgb, region, table_class, config)
    found: dict[str, StandingBox | Failure] = {JOINT_FIT: fit if isinstance(fit, Failure) else fit.box}
    if "3dp_report" in methods:
        parts = construct_region(rgb, region, table_class, config, fit)
        found["3dp_report"] = parts if isinstance(parts, Failure) else parts.box
    sheet = _sheet(region.ring_px, region.mask)
    # both single planes are one surface
    return {m: found.get(m, sheet) for m in methods}


def _sheet(ring_px: FloatArray, mask: BoolArray) -> StandingBox | Failure:
    """The upright surface on the lower edge of a region as a box without thickness."""
    line = lower_edge(mask)
    if isinstance(line, Failure):
        return line
    plane = single_plane(ring_px, line, SEEN_FROM)
    if isinstance(plane, Failure):
        return plane
    surface = plane.on_ground(SEEN_FROM.ground)
    pose = cam_from_ground(SEEN_FROM.ground)
    outline = (plane.outline_m - pose[:3, 3]) @ pose[:3, :3]
    along = outline[:, :2] @ [np.cos(surface.yaw_rad), np.sin(surface.yaw_rad)]
    size = np.array([np.ptp(along), _SHEET_M, max(_SHEET_M, outline[:, 2].max())])
    return StandingBox(surface.centroid_m[:2], surface.yaw_rad, size)
