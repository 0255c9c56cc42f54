"""One candidate of a recording: crops, the registered model in 3D, parts of the evidence, why it moved."""

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.spatial.transform import Rotation

from recon.class_model import ClassModel
from reports.palette import NIGHT, NIGHT_AXIS, ORANGE, SKY, WHITE, on_dark, part_colour, rgb
from reports.recording.boxes3d import log_fit
from reports.recording.crop import (
    Crop,
    depth_range,
    log_picture,
    residual_limit,
)
from reports.recording.entities import (
    OUTCOME_CLASSES,
    class_colour,
    crop_path,
    models_path,
    object_path,
    outcome_class,
    picture,
    text,
    values,
    why_path,
)
from reports.recording.fit_crops import log_fit_crops
from reports.recording.frame import in_metres, log_depth
from reports.recording.story import Story
from reports.recording.words import MAX_BARS, Bar, ColourRange, evidence_bars, why
from reports.run.candidate_panels import colourise
from reports.run.frame_view import CandidateView, FrameView
from reports.run.overlay import (
    PartMesh,
    apply_transform,
    merge_meshes,
    oriented_box,
    part_mesh,
    points_of_depth,
    world_from_camera,
)

SHOWN_MODELS = 3
"""Number of best candidates that show their models in the 3D view of a frame."""
_OUTLINE_POINTS = 90
_VIEWED_WIDTH_M = 4.4
_CAR_SIZE = 2.0
"""Scale of the view of a fitted car, with room for another one beside it."""
_BARS_WIDTH, _BAR_HEIGHT = 640.0, 48.0
_BARS_ZERO, _BARS_REACH = _BARS_WIDTH / 2, 0.46 * _BARS_WIDTH
_BAR_AT, _NAME_AT = 0.8, 0.06
"""Places of a bar and its line of words in their row; the line keeps its size on screen."""
_SHORTEST_SCALE = 0.5
"""Log odds of the longest bar are taken to be at least this."""
_PART_COLOURS = np.array([rgb(part_colour(i)) for i in range(256)], np.uint8)
"""Colour of each part label."""


def shown_models(candidates: tuple[CandidateView, ...]) -> tuple[CandidateView, ...]:
    """The best candidates after rescoring that have a model to show."""
    able = sorted((c for c in candidates if c.registered is not None), key=lambda c: c.new_rank)
    return tuple(able[:SHOWN_MODELS])


def log_models(rec: rr.RecordingStream, story: Story, view: FrameView, model: ClassModel | None) -> None:
    """Log the registered models of the best candidates of a frame, and their boxes, in 3D."""
    for detector, candidates in view.candidates.items():
        root, top = models_path(detector), shown_models(candidates)
        accepted = story.accepted(detector, story.mode_of(detector))
        _log_mesh(rec, f"{root}/parts", [_mesh(c, view, 600) for c in top], view)
        colours = [
            class_colour(OUTCOME_CLASSES[outcome_class(c.outcome, bool(accepted[c.row]))]) for c in top
        ]
        _log_boxes(rec, f"{root}/boxes", top, colours, view, model)


def log_candidate(
    rec: rr.RecordingStream,
    story: Story,
    detector: str,
    view: FrameView,
    c: CandidateView,
    model: ClassModel | None,
) -> None:
    """Log one candidate at the time that is set."""
    colour = class_colour(OUTCOME_CLASSES[outcome_class(c.outcome, accepted=True)])
    root = object_path(detector)
    if story.shows_fits(detector):
        colours_m = log_fit_crops(rec, crop_path(detector), c, view, colour)
        log_fit(rec, f"{root}/fit", c, colour, view)
    else:
        colours_m = _log_crops(rec, crop_path(detector), c, view, colour)
    _log_mesh(rec, f"{root}/parts", [_mesh(c, view, 450)], view)
    _log_boxes(rec, f"{root}/box", (c,), [colour], view, model)
    _log_place(rec, f"{root}/place", c, view)
    rec.log(f"{why_path(detector)}/text", text(why(story, detector, view, c, colours_m)))
    _log_bars(rec, f"{why_path(detector)}/bars", evidence_bars(story, detector, c))


def bars_view(story: Story, detector: str) -> rrb.Spatial2DView:
    """The blueprint's view of the bars."""
    known = detector in story.models
    name = "what the depth says (log odds that it is a car)" if known else "terms of eq. 7 (log of the score)"
    return rrb.Spatial2DView(
        origin=f"{why_path(detector)}/bars",
        name=name,
        background=rgb(NIGHT),
        visual_bounds=rrb.VisualBounds2D(
            x_range=[0, _BARS_WIDTH], y_range=[-0.1 * _BAR_HEIGHT, (MAX_BARS + 1.2) * _BAR_HEIGHT]
        ),
    )


def _log_crops(
    rec: rr.RecordingStream, root: str, c: CandidateView, view: FrameView, colour: tuple[int, int, int]
) -> ColourRange:
    """Log the crops of a candidate; returns what their colours mean."""
    crop = log_picture(rec, root, c, view, colour)
    _log_outline(rec, f"{root}/outline", c, crop)
    labels = np.zeros(view.measured.shape, np.uint8)
    fitted = np.full(view.measured.shape, np.nan, np.float32)
    if c.instance is not None:
        labels[c.instance.depth.window] = c.instance.part_labels
    if c.predicted is not None and c.registered is not None:
        fitted[c.predicted.window] = c.registered
    rec.log(
        f"{root}/parts",
        rr.SegmentationImage(np.asarray(crop.cut(labels, cv2.INTER_NEAREST, 0), np.uint8), opacity=0.75),
    )
    measured, fitted = (
        np.asarray(crop.cut(in_metres(d, view), cv2.INTER_NEAREST, np.nan), np.float32)
        for d in (view.measured, fitted)
    )
    near, far = depth_range(measured, fitted)
    log_depth(rec, f"{root}/measured_depth", measured, range_m=(near, far))
    log_depth(rec, f"{root}/predicted_depth", fitted, range_m=(near, far))
    limit = residual_limit(fitted)
    rec.log(f"{root}/residual", picture(colourise(measured - fitted, -limit, limit, "RdBu"), quality=90))
    return ColourRange(near, far, limit)


def _log_outline(rec: rr.RecordingStream, path: str, c: CandidateView, crop: Crop) -> None:
    # pixel centres to pixel edges, and back to the first point to close the line
    ring = np.zeros((0, 2)) if c.instance is None else c.instance.outline_px
    ring = ring[:: max(1, len(ring) // _OUTLINE_POINTS)]
    strips = [crop.points(ring[[*range(len(ring)), 0]] + 0.5)] if len(ring) else []
    rec.log(
        path,
        rr.LineStrips2D(
            strips, colors=[rgb(WHITE)] * len(strips), radii=rr.Radius.ui_points(0.9), draw_order=21
        ),
    )


def _mesh(c: CandidateView, view: FrameView, max_vertices: int) -> PartMesh | None:
    """The registered prediction of a candidate as a surface in the camera frame; None without one."""
    if c.predicted is None or c.registered is None:
        return None
    corner = (c.predicted.x0_px, c.predicted.y0_px)
    # another system has no parts: its surface is of one colour
    labels = np.ones(c.registered.shape, np.uint8) if c.instance is None else c.instance.part_labels
    return part_mesh(in_metres(c.registered, view), labels, view.seen_from.camera, corner, max_vertices)


def _log_mesh(rec: rr.RecordingStream, path: str, meshes: list[PartMesh | None], view: FrameView) -> None:
    some = [m for m in meshes if m is not None and len(m.triangles)]
    if not some:
        # a mesh without triangles is refused; clearing removes that of the time before
        rec.log(path, rr.Clear(recursive=False))
        return
    mesh = merge_meshes(some)
    rec.log(
        path,
        rr.Mesh3D(
            vertex_positions=apply_transform(world_from_camera(view.seen_from.ground), mesh.xyz_m),
            triangle_indices=mesh.triangles,
            vertex_colors=_PART_COLOURS[mesh.label],
        ),
    )


def _log_boxes(
    rec: rr.RecordingStream,
    path: str,
    some: tuple[CandidateView, ...],
    colours: list[tuple[int, int, int]],
    view: FrameView,
    model: ClassModel | None,
) -> None:
    """Log the oriented boxes of candidates with a registered 3D model; another system's depth has none."""
    world = world_from_camera(view.seen_from.ground)
    centres, halves, turns, shown = [], [], [], []
    for c, colour in zip(some, colours, strict=True):
        if c.instance is None or c.registered is None:
            continue
        points = points_of_depth(
            in_metres(c.registered, view),
            view.seen_from.camera,
            c.instance.depth.x0_px,
            c.instance.depth.y0_px,
        )
        points = points[np.isfinite(points[..., 2])]
        turn = c.instance.cam_from_object
        extents = None if model is None else model.extents
        centre, half = oriented_box(points, turn, extents, points.mean(axis=0))
        centres.append(apply_transform(world, centre))
        halves.append(half)
        shown.append(colour)
        turns.append(rr.Quaternion(xyzw=Rotation.from_matrix(world[:3, :3] @ turn).as_quat()))
    rec.log(
        path,
        rr.Boxes3D(
            centers=np.array(centres).reshape(-1, 3),
            half_sizes=np.array(halves).reshape(-1, 3),
            quaternions=turns,
            colors=shown,
            radii=rr.Radius.ui_points(1.2),
            fill_mode="MajorWireframe",
        ),
    )


def _log_place(rec: rr.RecordingStream, path: str, c: CandidateView, view: FrameView) -> None:
    """Log where the candidate stands: a frame at the foot of its box that looks along the ray to it."""
    world = world_from_camera(view.seen_from.ground)
    x0, y0, x1, y1 = c.xyxy_px
    ray = view.seen_from.camera.rays(np.array([(x0 + x1) / 2, y1]) - 0.5)
    seen = in_metres(view.measured, view)[
        max(int(y0), 0) : max(int(y1), 1), max(int(x0), 0) : max(int(x1), 1)
    ]
    distance = float(np.nanmedian(seen)) if np.isfinite(seen).any() else 12.0
    if c.registered is not None and np.isfinite(c.registered).any():
        distance = float(np.nanmedian(in_metres(c.registered, view)))
    # small things come nearer, so that what fills the box fills the view
    size = float(np.clip((x1 - x0) / view.seen_from.camera.fx_px * distance / _VIEWED_WIDTH_M, 0.1, 4.0))
    spot = apply_transform(world, ray * distance)
    if c.fit is not None:
        # both cars, however far apart
        both = [one.box.centre_cam_m[0] for one in (c.fit.framed, c.fit.seen)]
        apart_m = float(np.linalg.norm(both[0] - both[1]))
        size = _CAR_SIZE * float(np.clip(apart_m / _VIEWED_WIDTH_M, 1.0, 4.0))
        spot = apply_transform(world, np.mean(both, axis=0)) * [1, 1, 0]
    forward = (world[:3, :3] @ ray) * [1, 1, 0]
    forward /= np.linalg.norm(forward)
    axes = np.stack([np.cross(forward, [0, 0, 1]), forward, [0, 0, 1]], axis=1)
    rec.log(path, rr.Transform3D(translation=spot, mat3x3=axes * size))


def _log_bars(rec: rr.RecordingStream, path: str, bars: tuple[Bar, ...]) -> None:
    """Horizontal bars from the middle, each below its value and its name: beside it there may be no room."""
    if not bars:
        bars = (Bar("no evidence", 0.0),)
    y = (np.arange(len(bars)) + _BAR_AT) * _BAR_HEIGHT
    amount = np.array([b.value for b in bars], float)
    longest = max(float(np.abs(amount).max(initial=0.0)), _SHORTEST_SCALE)
    ends = _BARS_ZERO + amount / longest * _BARS_REACH
    colours = [rgb(on_dark(SKY if v >= 0 else ORANGE)) for v in amount]
    strips = np.stack([np.full(len(y), _BARS_ZERO), y, ends, y], axis=1).reshape(-1, 2, 2)
    rec.log(
        f"{path}/bars",
        rr.LineStrips2D(strips, colors=colours, radii=[0.08 * _BAR_HEIGHT] * len(strips)),
        *values(log_odds=amount),
    )
    half = 0.12 * _BAR_HEIGHT
    zero = [[(_BARS_ZERO, row - half), (_BARS_ZERO, row + half)] for row in y]
    rec.log(f"{path}/zero", rr.LineStrips2D(zero, colors=[rgb(NIGHT_AXIS)] * len(zero)))
    rec.log(
        f"{path}/names",
        rr.Points2D(
            [(_BARS_ZERO, (row + _NAME_AT) * _BAR_HEIGHT) for row in range(len(bars))],
            labels=[f"{'−' if b.value < 0 else '+'}{abs(b.value):.2f}  {b.name}" for b in bars],
            colors=colours,
            radii=rr.Radius.ui_points(0),
            show_labels=True,
        ),
    )
