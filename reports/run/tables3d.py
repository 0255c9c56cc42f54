"""The tables of what 3D boxes are worth, for the terminal and the page."""

import math

from reports.palette import detector_name, mode_name
from reports.run.tables import SHORT_MODE, Table, number, percent
from rescore.results.metrics_file import Boxes3DRow, Metrics, PoseFigures, Precision3D

TERMINAL_CAPTION_3D = (
    "AOS: average orientation similarity of the boxes in the picture, IoU 70%. BEV, 3D: average precision of "
    "footprints and 3D boxes at this IoU in percent (– too few cars). place, turn: median error in m and "
    "degrees of the boxes within 2 m of a car. poses: share of the whole cars found up to 25 m whose box is "
    "within 0.75 m and 22.5 degrees."
)


def boxes3d_table(metrics: Metrics) -> Table | None:
    """What the 3D boxes of each detector are worth, a row a mode and level; None where there are none."""
    rows = tuple(
        (
            detector_name(row.detector),
            mode_name(row.mode),
            level.level,
            str(level.n_cars),
            number(level.in_picture["0.7"]),
            number(level.orientation["0.7"]),
            *(number(level.from_above[iou]) for iou in ("0.7", "0.5")),
            *(number(level.in_space[iou]) for iou in ("0.7", "0.5")),
        )
        for row in metrics.boxes3d
        for level in row.precision
    )
    head = ("detector", "scores", "cars", "number", "AP in the picture at 70%", "AOS at 70%")
    overlaps = ("BEV AP at 70%", "BEV AP at 50%", "3D AP at 70%", "3D AP at 50%")
    return Table("3D boxes against the true ones", (*head, *overlaps), rows, text_columns=3) if rows else None


def error_table(metrics: Metrics) -> Table | None:
    """Errors of the 3D boxes near a car as nuScenes has them, a row a detector and mode; None as above."""
    rows = tuple(
        (
            detector_name(row.detector),
            mode_name(row.mode),
            f"{e.n_found} of {e.n_cars}",
            _both(e.translation_m.mean, e.translation_m.median, 2),
            _both(e.scale.mean, e.scale.median, 2),
            _both(_degrees(e.orientation_rad.mean), _degrees(e.orientation_rad.median), 1),
        )
        for row in metrics.boxes3d
        for e in (row.errors,)
    )
    head = ("detector", "scores", "cars with a box within 2 m", "translation (m)", "scale", "orientation (°)")
    return Table("Errors of the 3D boxes, mean / median", head, rows, text_columns=2) if rows else None


def pose_table(metrics: Metrics) -> Table | None:
    """Poses of the cars that are found, right ones and their errors, by distance; None as above.

    Poses do not depend on how candidates are ranked, but which one is a car's hit does: a row a detector and
    distance, in the order of the last mode.
    """
    last = {row.detector: row for row in metrics.boxes3d}
    rows = tuple(
        (
            detector_name(row.detector),
            _cars_text(pose),
            str(pose.n_found),
            str(pose.n_boxes),
            percent(pose.correct_share),
            number(pose.median_translation_m, 2),
            number(_degrees(pose.median_orientation_rad), 1),
        )
        for row in last.values()
        for pose in row.poses
    )
    head = ("detector", "cars", "found", "with a 3D box", "correct pose", "median error (m)", "heading (°)")
    return Table("Poses of the cars that are found", head, rows, text_columns=2) if rows else None


def terminal_boxes3d(metrics: Metrics) -> Table | None:
    """What the 3D boxes are worth for 80 columns, at KITTI's middle level where it is known."""
    rows = tuple(_short_row(row, _middle(row)) for row in metrics.boxes3d)
    head = ("detector, scores", "AOS", "BEV70", "BEV50", "3D70", "3D50", "place", "turn", "poses")
    return Table(_short_title(metrics), head, rows) if rows else None


def _short_title(metrics: Metrics) -> str:
    level = _middle(metrics.boxes3d[0]) if metrics.boxes3d else None
    return "3D boxes" if level is None else f"3D boxes, {level.n_cars} cars ({level.level})"


def _short_row(row: Boxes3DRow, level: Precision3D) -> tuple[str, ...]:
    near = next(p for p in row.poses if p.whole)
    return (
        f"{detector_name(row.detector, short=True)}, {SHORT_MODE.get(row.mode, row.mode)}",
        number(level.orientation["0.7"]),
        *(number(level.from_above[iou]) for iou in ("0.7", "0.5")),
        *(number(level.in_space[iou]) for iou in ("0.7", "0.5")),
        number(row.errors.translation_m.median, 2),
        number(_degrees(row.errors.orientation_rad.median), 1),
        "–" if near.correct_share is None else f"{near.correct_share:.0%}",
    )


def _middle(row: Boxes3DRow) -> Precision3D:
    return next((p for p in row.precision if p.level == "moderate"), row.precision[-1])


def _cars_text(pose: PoseFigures) -> str:
    low, high = pose.distance_m
    if high is None:
        return "whole" if pose.whole else "all"
    return f"{'whole, ' if pose.whole else ''}{low:g} to {high:g} m"


def _both(mean: float | None, median: float | None, digits: int) -> str:
    return f"{number(mean, digits)} / {number(median, digits)}"


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)
