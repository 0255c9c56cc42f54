"""Why an object has no result, and the base class of every error that a user can cause and can mend."""

from dataclasses import dataclass
from enum import StrEnum


class Reason(StrEnum):
    """Why a candidate has no depth evidence; the value is what files and reports show."""

    NO_OUTLINE = "no_outline"
    """The level set vanished, filled the window or left the box."""
    REGISTRATION_FAILED = "registration_failed"
    """The labelled outline could not be matched to the outline of the candidate."""
    NO_GROUND_CONTACT = "no_ground_contact"
    """No registered part touches the lower outline, so there is no ground line."""
    ABOVE_HORIZON = "above_horizon"
    """The ground line lies on or above the horizon, so its rays never meet the ground plane."""
    PARTS_NOT_PLACED = "parts_not_placed"
    """The planes of the placed parts cover too little of the object."""
    NO_STEREO = "no_stereo"
    """Too few pixels of the predicted depth region have a measured depth."""
    STEREO_NOT_BELIEVED = "stereo_not_believed"
    """Measurements are fewer, or agree less with each other or the ground, than where D was learned."""
    VIEW_NOT_LEARNED = "view_not_learned"
    """The side from which it is taken to be seen is none of those on which D was learned."""
    RELIEF_TOO_SMALL = "relief_too_small"
    """The relief that the class has here is less than what D can tell from what the matcher measures."""
    NO_CALIBRATION = "no_calibration"
    """The camera's focal length or baseline is unknown, so nothing can be measured in metres."""
    NO_GROUND = "no_ground"
    """No ground plane is stated and that of stereo is not trusted, so no object can be stood on it."""
    NO_PREDICTION = "no_prediction"
    """Another system was to predict depth, and gives none in the box, or its mask has no object there."""
    BOX_OUTSIDE_IMAGE = "box_outside_image"
    """Too little of the box lies inside the image."""
    FRAME_FAILED = "frame_failed"
    """The frame could not be read or worked on, and a run in parts went on without it."""
    SECOND_BOX = "second_box"
    """There is evidence, but a better box shows the same car in 3D, and this one was suppressed."""


@dataclass(frozen=True)
class Failure:
    """Returned in place of a result."""

    reason: Reason
    detail: str
    """What was expected and what came, for a person."""


class RescoreError(Exception):
    """Bad input. The message says what was expected, what came and what to do, in one line."""
