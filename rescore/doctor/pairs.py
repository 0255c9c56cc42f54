"""Do left and right fit together, and does the matcher measure enough? From the pixels of some frames."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import spearmanr

from recon.camera import DepthCamera
from recon.errors import RescoreError
from recon.stereo.features import PairMatches, match_pair
from recon.stereo.sgbm import SgbmConfig
from rescore.cues.surroundings import SurroundingsConfig
from rescore.data.depth_files import Quantity
from rescore.data.frames import DataSet, Frame, FrameRecord, load_frame
from rescore.data.pictures import read_rgb
from rescore.data.units import Things, size_doubt, unit_doubt
from rescore.doctor.findings import Finding, Level, graded
from rescore.doctor.ground import examine_ground
from rescore.evidence.settings import automatic_stereo

MIN_MATCHES = 12
CLEAR_TREND = 0.3
"""Rank correlation of disparity and row from which disparity rises or falls downwards."""


def examine_pairs(data: DataSet, frames: Sequence[FrameRecord]) -> list[Finding]:
    """Rectification, sides, disparity and ground of some frames; a file that cannot be read is a finding."""
    stereo = automatic_stereo(data)
    return [finding for frame in frames for finding in _frame(frame, stereo, _cars(data, frame))]


def _cars(data: DataSet, record: FrameRecord) -> Things | None:
    """The annotated cars, to judge their size; None for another class, whose size is not known here."""
    if data.category.casefold() != "car":
        return None
    truth = data.truth[record.image_id]
    return Things(truth.xyxy_px[~truth.ignore], SurroundingsConfig().size_m[2])


def _frame(record: FrameRecord, stereo: SgbmConfig, cars: Things | None) -> list[Finding]:
    where = f"image {record.image_id}"
    try:
        frame = load_frame(record, stereo)
        matched = _matched(record, frame, where)
    except RescoreError as error:
        return [Finding(Level.ERROR, where, str(error))]
    density = _density(record, frame, stereo, where)
    unit = [*_baseline(record, frame, where), *_unit(record, frame, cars, where)]
    return [*matched, density, *unit, *examine_ground(frame, where)]


def _matched(record: FrameRecord, frame: Frame, where: str) -> list[Finding]:
    if record.right_path is None:
        return []
    right = read_rgb(record.right_path, record.width_px, record.height_px)
    if np.array_equal(frame.left_rgb, right):
        text = f"{record.left_path} and {record.right_path} are one picture"
        return [Finding(Level.ERROR, where, text, "give the pictures of both cameras")]
    matches = match_pair(frame.left_rgb, right)
    n = len(matches.row_px)
    if n < MIN_MATCHES:
        text = f"{n} features of the left picture found in the right one, {MIN_MATCHES} wanted"
        return [Finding(Level.WARNING, where, text, "check that the pictures are of one moment and in focus")]
    return [_rows(matches, where), *_sides(record, matches, where)]


def _rows(matches: PairMatches, where: str) -> Finding:
    off = np.abs(matches.row_px)
    median, most = float(np.median(off)), float(np.percentile(off, 90))
    level = max(graded(median, 0.75, 2.0), graded(most, 2.0, 8.0), key=list(Level).index)
    text = f"rows of {len(off)} features differ by {median:.2f} px (median), {most:.2f} px (90th percentile)"
    return Finding(level, where, text, "" if level is Level.OK else "rectify the pair again")


def _sides(record: FrameRecord, matches: PairMatches, where: str) -> list[Finding]:
    disparity = matches.disparity_px + record.disparity_offset_px
    negative = float((disparity < -0.5).mean())
    if negative <= 0.1:
        return []
    text = f"{negative:.0%} of the features lie farther right in the right picture"
    # what lies low in a picture is near as a rule, and near things have the larger disparity
    downward = float(spearmanr(matches.left_uv_px[:, 1], disparity).statistic) if np.ptp(disparity) else 0.0
    if negative > 0.9 or (negative > 0.5 and not downward > CLEAR_TREND):
        return [Finding(Level.ERROR, where, text, "left and right are swapped: exchange them")]
    if downward < -CLEAR_TREND:
        return [
            Finding(Level.WARNING, where, f"{text}, most of them low in it", "left and right may be swapped")
        ]
    far = float(np.percentile(disparity, 5))
    text += f", far things by {-far:.1f} px"
    return [Finding(Level.WARNING, where, text, "check principal points and rectification")]


def _baseline(record: FrameRecord, frame: Frame, where: str) -> list[Finding]:
    """The baseline that stands in for one that is not stated."""
    if not isinstance(record.camera, DepthCamera) or frame.camera is None:
        return []
    text = f"depth without a baseline: as fine as that of a pair with {frame.camera.baseline_m:.2f} m"
    return [Finding(Level.OK, where, text, "state baseline_m where a pair measured it")]


def _unit(record: FrameRecord, frame: Frame, cars: Things | None, where: str) -> list[Finding]:
    """An error where what is measured cannot be in the unit that it is taken for."""
    quantity = Quantity.DISPARITY if record.measurement is None else record.measurement.quantity
    text = unit_doubt(frame, quantity)
    if not text and cars is not None:
        text = size_doubt(frame, quantity, cars)
    if not text:
        return []
    said = "baseline" if record.measurement is None else f"baseline and {record.measurement.quantity}_factor"
    return [Finding(Level.ERROR, where, text, f"check units and the calibration's {said}")]


def _density(record: FrameRecord, frame: Frame, stereo: SgbmConfig, where: str) -> Finding:
    """Range of the disparity, holes, and the share at the end of the search."""
    disparity = frame.disparity_px
    known = disparity[np.isfinite(disparity)]
    holes = 1 - known.size / disparity.size
    if not known.size:
        return Finding(Level.ERROR, where, "no pixel has a disparity", "check the right picture or the file")
    low, high = np.percentile(known, [2, 98])
    text = f"disparity {low:.1f} to {high:.1f} px, holes {holes:.0%}"
    level, advice = graded(holes, 0.6, 0.95), "check focus, exposure and rectification"
    if record.measurement is None:
        # the search ends at num_disparities - 1
        at_limit = float((known >= stereo.num_disparities - 2).mean())
        text += f", {at_limit:.1%} at the limit of {stereo.num_disparities}"
        if at_limit > 0.02 and level is Level.OK:
            level, advice = Level.WARNING, "search farther: --disparities"
    else:
        # a sparse file, as of a laser scanner, is no fault
        level = graded(holes, 0.99, 0.999)
    return Finding(level, where, text, "" if level is Level.OK else advice)
