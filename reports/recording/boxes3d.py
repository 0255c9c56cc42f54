"""The 3D boxes of candidates and of annotated cars in the world of a recording, with a mark at each nose."""

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from recon.arrays import BoolArray
from recon.camera import GroundPlane
from reports.palette import WHITE, rgb
from reports.recording.entities import (
    OUTCOME_CLASSES,
    boxes3d_path,
    class_colour,
    outcome_class,
    values,
)
from reports.recording.story import Story
from reports.run.fitted_cars import box_axes, nose_marks
from reports.run.frame_view import CandidateView, FrameView
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import Truth

Colour = tuple[int, int, int]


def log_boxes3d(rec: rr.RecordingStream, story: Story, view: FrameView) -> None:
    """Log the 3D boxes of all candidates, coloured as their boxes in the picture, and those of the cars."""
    ground = view.seen_from.ground
    for detector, candidates in view.candidates.items():
        root = boxes3d_path(detector)
        accepted = story.accepted(detector, story.mode_of(detector))
        for name, bright in (("accepted", True), ("rejected", False)):
            some = [c for c in candidates if c.box3d is not None and bool(accepted[c.row]) is bright]
            colours = [class_colour(OUTCOME_CLASSES[outcome_class(c.outcome, bright)]) for c in some]
            log_solid(rec, f"{root}/{name}", _boxes(some), colours, ground, 1.6 if bright else 0.7)
        found = {c.annotation_id for c in candidates if accepted[c.row] and c.outcome == "hit"}
        _log_cars(rec, f"{root}/cars", view.truth, found, ground)


def log_fit(rec: rr.RecordingStream, path: str, c: CandidateView, colour: Colour, view: FrameView) -> None:
    """Log the instance that a box frames in its colour, and in white the one that fits the depth best."""
    ground, fit = view.seen_from.ground, c.fit
    none = Boxes3D.none(0)
    log_solid(rec, f"{path}/framed", none if fit is None else fit.framed.box, [colour], ground, 1.6)
    log_solid(rec, f"{path}/seen", none if fit is None else fit.seen.box, [rgb(WHITE)], ground, 1.0)


def log_solid(
    rec: rr.RecordingStream,
    path: str,
    boxes: Boxes3D,
    colours: list[Colour],
    ground: GroundPlane,
    line_points: float,
) -> None:
    """Log boxes as wires at ``path/box``, and at ``path/nose`` a triangle before each front."""
    colours = colours[: len(boxes)]
    centre, axes = box_axes(boxes, ground)
    radii = rr.Radius.ui_points(line_points)
    turns = [rr.Quaternion(xyzw=Rotation.from_matrix(a).as_quat()) for a in axes]
    wires = rr.Boxes3D(
        centers=centre,
        half_sizes=boxes.size_m / 2,
        quaternions=turns,
        colors=colours,
        radii=radii,
        fill_mode="MajorWireframe",
    )
    rec.log(f"{path}/box", wires, *values(rotation_y_rad=boxes.rotation_y_rad))
    rec.log(f"{path}/nose", rr.LineStrips3D(nose_marks(boxes, ground), colors=colours, radii=radii))


def _boxes(some: list[CandidateView]) -> Boxes3D:
    return Boxes3D.concatenate([c.box3d for c in some if c.box3d is not None])


def _log_cars(rec: rr.RecordingStream, path: str, truth: Truth, found: set[int], ground: GroundPlane) -> None:
    """Log the true boxes where the data set has them, coloured as the cars in the picture."""
    boxes = Boxes3D.none(0)
    known: BoolArray = np.zeros(len(truth.annotation_id), bool)
    if truth.boxes3d is not None:
        known = truth.boxes3d.known
        boxes = truth.boxes3d[known]
    names = [
        "ignored_car" if ignore else "found" if int(i) in found else "missed"
        for i, ignore in zip(truth.annotation_id[known], truth.ignore[known], strict=True)
    ]
    log_solid(rec, path, boxes, [class_colour(n) for n in names], ground, 1.0)
