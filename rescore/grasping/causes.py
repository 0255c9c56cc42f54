"""Why a grasp did not hold, and what a step returns in place of a result."""

from dataclasses import dataclass
from enum import StrEnum


class Cause(StrEnum):
    """Why a trial failed; the value is what files and tables show."""

    NOT_CLOSED = "mesh_not_closed"
    """The surface of the mesh encloses no volume, so that it cannot be touched from all sides."""
    NOT_LOCALISED = "not_localised"
    """The method found no object in the picture."""
    BELOW_TABLE = "below_table"
    """The estimated box lies in or under the table."""
    TOO_WIDE = "too_wide"
    """The estimated box is wider than the hand opens."""
    OUT_OF_REACH = "out_of_reach"
    """The arm has no joint angles with which the hand gets there."""
    NO_PATH = "no_path"
    """No way to the grasp was found that touches neither table nor object."""
    CRUSHED = "crushed"
    """The object broke under the force of one touch."""
    PUSHED_AWAY = "pushed_away"
    """The hand moved the object before it closed, and does not hold it."""
    MISSED = "missed"
    """After closing, the object is not touched from both sides."""
    SLIPPED = "slipped"
    """The object was touched from both sides, and fell while it was lifted, held or shaken."""


@dataclass(frozen=True)
class Refusal:
    """Returned in place of a grasp or a motion."""

    cause: Cause
    detail: str
    """What was expected and what came, for a person."""
