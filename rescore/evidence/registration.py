"""The modes in which predicted and measured depth are compared, and the cues each is made of."""

from enum import StrEnum

from recon.errors import RescoreError
from rescore.evidence.guarded import GUARDED
from rescore.evidence.plausibility import CHECKS
from rescore.evidence.surroundings import SURROUNDINGS

_METRIC = (*GUARDED, *SURROUNDINGS, "depth_ratio")


CUES = (*_METRIC, *CHECKS)
"""Columns of ``CandidateTable.cues``. ``depth_ratio`` is the median logarithm of measured over predicted
depth: 0 where the thing stands where the ground line and the part planes put it. ``CHECKS`` say nothing for
or against a car, but whether the others can be believed."""


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

    @property
    def cues(self) -> tuple[str, ...]:
        """The parts of the evidence; none for ``PAPER``, whose D has a formula."""
        return {Registration.PAPER: (), Registration.GUARDED: GUARDED, Registration.METRIC: _METRIC}[self]

    @property
    def checks(self) -> tuple[str, ...]:
        """Columns that must not be lower than where the mode was fitted, or a candidate has no evidence."""
        return {
            Registration.PAPER: (),
            Registration.GUARDED: CHECKS[:1],
            Registration.METRIC: ("measured", *CHECKS),
        }[self]


CLASS_MODEL = "the class model"
"""Whose depth w or D was fitted with, where it is not another system's."""


def check_depth_of(where: str, fitted_with: str, used: str) -> None:
    """Raises RescoreError where what was fitted with one prediction of depth is to be used with another."""
    if fitted_with != used:
        raise RescoreError(
            f"{where}: expected what was fitted with depth of {used}, got what was fitted with depth of "
            f"{fitted_with}; fit it again with the predictions that it is used with"
        )


LEARNED = tuple(r for r in Registration if r.cues)
"""Modes whose D is calibrated."""
