"""Where to take hold of an object, from its estimate alone: from above, across its width."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray
from recon.localization.standing_box import StandingBox
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.hands import Hand

MARGIN_M = 0.030
"""The hand is opened by this much more than the estimated width: half of it on each side."""
GRIP_HEIGHT = 0.35
"""Height of the middle of the pads as a share of the estimated height."""
_ABOVE_M, _OVER_TABLE_M = 0.014, 0.005
"""Palm and fingers stay clear of the estimated top, and of the table, by this."""
_LOWEST_M = 0.015
"""An object that rises less above the table cannot be gripped from above."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """What perception says of an object on the table, and all that the motion may depend on."""

    box: StandingBox
    """The box, whose length lies along the object."""
    width_known: bool = True
    """Whether the method measures the width; the hand is opened as wide as it goes where it does not."""
    bottom_m: float = 0.0
    """Height of the bottom of the box above the table."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """A pose of the open hand at the object."""

    xy_m: FloatArray
    """Where the middle of the palm stands, shape (2,)."""
    yaw_rad: float
    """Direction along the object, which the hand's x axis has or its opposite."""
    palm_m: float
    """Height of the palm above the table."""
    opening_m: float
    """Distance of the pads."""

    def tool_pose(self, hand: Hand, turned: bool, up_m: float = 0.0) -> FloatArray:
        """The pose (4, 4) of the tool frame, ``up_m`` above the grasp.

        The same opening is there twice: ``turned`` is the hand turned by half a turn.
        """
        yaw = self.yaw_rad + np.pi * turned
        c, s = np.cos(yaw), np.sin(yaw)
        pose = np.eye(4)
        pose[:3, :3] = [[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]]
        pose[:3, 3] = [*self.xy_m, self.palm_m + hand.palm_m + up_m]
        return pose


def choose_grasp(estimate: Estimate, hand: Hand) -> Grasp | Refusal:
    """The grasp for an estimate; a refusal where the hand cannot hold such a box.

    The rule was fixed before any trial on the test cars.
    """
    box, top = estimate.box, estimate.bottom_m + float(estimate.box.size_m[2])
    if top < _LOWEST_M:
        return Refusal(
            Cause.BELOW_TABLE,
            f"a box that rises {1000 * _LOWEST_M:.0f} mm or more expected, got {1000 * top:.0f}",
        )
    width = float(box.size_m[1])
    if width >= hand.widest_m:
        return Refusal(
            Cause.TOO_WIDE, f"a width below {1000 * hand.widest_m:.0f} mm expected, got {1000 * width:.0f}"
        )
    opening = width + MARGIN_M if estimate.width_known else hand.widest_m
    opening = float(np.clip(opening, hand.narrowest_m, hand.widest_m))
    palm = max(
        GRIP_HEIGHT * top + hand.depth_m(opening),
        top + hand.over_m(width, opening) + _ABOVE_M,
        hand.lowest_m(opening) + _OVER_TABLE_M,
    )
    return Grasp(box.xy_m, box.yaw_rad, palm, opening)
