"""The modes in which predicted and measured depth are compared.

The cues that a mode is made of stand in ``rescore.evidence.cues``.
"""

from enum import StrEnum

from recon.errors import RescoreError


class Registration(StrEnum):
    """How predicted and measured depth are compared."""

    PAPER = "paper"
    """Eq. 6 as printed: free scale and offset, D is the root mean square of what is left."""
    GUARDED = "guarded"
    """Scale and offset as in eq. 6, the scale positive and bounded, by a robust fit judged against a flat
    surface. Needs no calibration."""
    METRIC = "metric"
    """The guarded fit, and what a calibrated camera tells: size, depth edges, ground contact, the planes' own
    depths."""
    INSTANCE = "instance"
    """An instance of the class fitted to the box and the disparity: whether the box frames one whole object.
    Needs a class model with a shape space, a calibrated camera and a ground plane."""

    @property
    def learned(self) -> bool:
        """Whether D is a probability that is fitted to labelled candidates; that of eq. 6 has a formula."""
        return self is not Registration.PAPER

    @property
    def needs_calibration(self) -> bool:
        """Whether a candidate has evidence only where the camera is calibrated."""
        return self in (Registration.METRIC, Registration.INSTANCE)

    @property
    def predicts(self) -> bool:
        """Whether it looks at the depth that is predicted in a box."""
        return self is not Registration.INSTANCE

    @property
    def needs(self) -> str | None:
        """The cue without which a candidate has no evidence; None where any will do."""
        return _NEEDED.get(self)

    @property
    def even_odds(self) -> bool:
        """Whether D is fitted as if half of the candidates were cars, so that it does not depend on how many
        of a detector's candidates are."""
        return self.needs_calibration

    @property
    def weighed_by(self) -> str | None:
        """The cue in [0, 1] by which the others count; None where they count in full."""
        return "resolved" if self is Registration.INSTANCE else None


_NEEDED = {Registration.METRIC: "measured", Registration.INSTANCE: "overlap"}
LEARNED = tuple(mode for mode in Registration if mode.learned)
"""Modes whose D is fitted."""

CLASS_MODEL = "the class model"
"""Whose depth w or D was fitted with, where it is not another system's."""


def check_depth_of(where: str, fitted_with: str, used: str) -> None:
    """Raises RescoreError where what was fitted with one prediction of depth is to be used with another."""
    if fitted_with != used:
        raise RescoreError(
            f"{where}: expected what was fitted with depth of {used}, got what was fitted with depth of "
            f"{fitted_with}; fit it again with the predictions that it is used with"
        )
