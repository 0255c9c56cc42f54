"""Where is the ground? The estimate from stereo beside what the data set states."""

import numpy as np

from recon.camera import DEFAULT_GROUND, GroundPlane
from recon.stereo.ground import GroundEstimate, estimate_ground
from rescore.data.frames import Frame
from rescore.doctor.findings import Finding, Level

HEIGHT_SHARE = 0.15
"""Heights that differ by less than this share agree: a kerb is 8 per cent."""
PITCH_DEG = 2.0
"""Pitches that differ by less agree: a car that brakes and a street that climbs make a degree each."""


def examine_ground(frame: Frame, where: str) -> list[Finding]:
    """The ground plane that stereo finds in a frame; nothing where there is no camera to find it with."""
    if frame.camera is None:
        return []
    if frame.ground_estimate is not None:
        return [_unstated(frame.ground_estimate, where)]
    assert frame.ground is not None
    found = estimate_ground(frame.disparity_px, frame.camera, np.random.default_rng(0))
    return [_beside(frame.ground, found, where)]


def _unstated(found: GroundEstimate, where: str) -> Finding:
    if found.ground is not None and found.trusted:
        return Finding(Level.OK, where, f"ground from stereo: {_told(found)}, none is stated")
    default = f"{DEFAULT_GROUND.height_m:g} m and level are assumed"
    advice = "state height_m and pitch_rad of the camera where they are known"
    text = f"no ground is stated, and that of stereo is not trusted ({_doubt(found)}): {default}"
    return Finding(Level.WARNING, where, text, advice)


def _beside(stated: GroundPlane, found: GroundEstimate, where: str) -> Finding:
    pitch, roll = (float(np.degrees(a)) for a in (stated.pitch_rad, stated.roll_rad))
    said = f"stated {stated.height_m:.2f} m, {pitch:.1f}{f' and {roll:.1f}' if roll else ''} degrees"
    if found.ground is None or not found.trusted:
        return Finding(Level.OK, where, f"ground {said}; stereo cannot tell ({_doubt(found)})")
    height = found.ground.height_m / stated.height_m - 1
    pitch = _degrees(found.ground.pitch_rad - stated.pitch_rad)
    roll = _degrees(found.ground.roll_rad - stated.roll_rad)
    text = f"ground from stereo: {_told(found)}, {said}"
    if abs(height) <= HEIGHT_SHARE and max(abs(pitch), abs(roll)) <= PITCH_DEG:
        return Finding(Level.OK, where, f"{text}: they agree")
    advice = (
        "a slope where it is this frame alone; else check height_m, pitch_rad, roll_rad and the baseline, or "
        "leave the first three out to have them from stereo"
    )
    differs = f"height differs {height:+.0%}, pitch {pitch:+.1f}, roll {roll:+.1f}"
    return Finding(Level.WARNING, where, f"{text}: {differs}", advice)


def _told(found: GroundEstimate) -> str:
    ground = found.ground
    assert ground is not None
    pitch, roll = (_degrees(a) for a in (ground.pitch_rad, ground.roll_rad))
    return f"height {ground.height_m:.2f} m, pitch {pitch:.1f}, roll {roll:.1f} degrees"


def _doubt(found: GroundEstimate) -> str:
    return f"{found.doubt}: {found.detail}"


def _degrees(angle_rad: float) -> float:
    """In tenths of a degree, without a minus before a zero."""
    return round(float(np.degrees(angle_rad)), 1) + 0.0
