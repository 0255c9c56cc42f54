"""One frame of a recording: pictures, depth, candidates, and the 3D scene with the registered predictions."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from recon.camera import GroundPlane
from reports.evidence_view import CandidateView, FrameView
from reports.overlay import (
    PartMesh,
    apply_transform,
    merge_meshes,
    part_mesh,
    stereo_points,
    world_from_camera,
)
from reports.palette import OUTCOME_COLOUR, OUTCOME_NAME, PART_COLOURS, on_dark, part_colour, rgb

WORLD = "world"
CAMERA = f"{WORLD}/camera"
IMAGE = f"{CAMERA}/image"
OUTCOME_CLASSES = tuple(OUTCOME_COLOUR)
"""Class id of a box: its index here."""
DEPTH_UNIT = 100.0
"""Stored depth a metre: centimetres, finer than stereo resolves and far smaller on disk than millimetres."""
DEPTH_RANGE_M = (2.0, 40.0)
HOLE_CLASS = 255
"""Class id of pixels without depth: Rerun would paint their 0 like the nearest depth."""
SHOWN_MODELS = 3
"""So many best candidates show their label from the start, and so many best of those with a model show it."""
JPEG_QUALITY = 85


def candidates_path(detector: str) -> str:
    """Entity path of the boxes of a detector."""
    return f"{IMAGE}/{rr.escape_entity_path_part(detector)}/candidates"


def models_path(detector: str) -> str:
    """Entity path of the registered models of a detector, in 3D."""
    return f"{WORLD}/{rr.escape_entity_path_part(detector)}/models"


def log_static(rec: rr.RecordingStream, detectors: Sequence[str], part_names: Sequence[str]) -> None:
    """Log what holds for all frames: axes, and the names and colours of classes."""
    rec.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    parts = [
        rr.AnnotationInfo(id=i + 1, label=name.replace("_", " "), color=rgb(part_colour(i + 1)))
        for i, name in enumerate(part_names or [f"part {i + 1}" for i in range(PART_COLOURS)])
    ]
    hole = rr.AnnotationInfo(id=HOLE_CLASS, label="no depth", color=(12, 12, 14))
    rec.log(
        WORLD, rr.AnnotationContext([hole, rr.AnnotationInfo(id=0, color=(0, 0, 0, 0)), *parts]), static=True
    )
    outcomes = [
        rr.AnnotationInfo(id=i, label=OUTCOME_NAME[name], color=rgb(on_dark(OUTCOME_COLOUR[name])))
        for i, name in enumerate(OUTCOME_CLASSES)
    ]
    for detector in detectors:
        rec.log(candidates_path(detector), rr.AnnotationContext(outcomes), static=True)


def log_frame(rec: rr.RecordingStream, view: FrameView, packed: bool = True) -> None:
    """Log one frame at the time that is set.

    Args:
        rec: the recording.
        view: the frame.
        packed: whether pictures are stored as JPEG and depth as PNG. Rerun takes the files of an entity for
            one video stream, whose frames must have one size; pictures of several sizes are stored plain.
    """
    camera, (h, w) = view.camera, view.measured.shape
    world = world_from_camera(view.ground)
    # Rerun's pinhole has its origin at the corner of the first pixel, ours in its middle
    matrix = camera.matrix + np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    rec.log(CAMERA, rr.Transform3D(translation=world[:3, 3], mat3x3=world[:3, :3]))
    rec.log(
        IMAGE,
        rr.Pinhole(
            image_from_camera=matrix,
            resolution=[w, h],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=1.0,
            color=[255, 200, 0],
        ),
    )
    left = rr.EncodedImage(contents=jpeg(view.rgb), media_type="image/jpeg") if packed else rr.Image(view.rgb)
    rec.log(f"{IMAGE}/left", left)
    depth = in_metres(view.measured, view)
    log_depth(rec, f"{IMAGE}/measured_depth", depth, packed)
    xyz, colours = stereo_points(depth, view.rgb, camera)
    rec.log(f"{WORLD}/stereo_points", rr.Points3D(apply_transform(world, xyz), colors=colours, radii=0.03))
    rec.log(f"{WORLD}/ground", _ground_grid(view.ground))
    for detector, candidates in view.candidates.items():
        _log_detector(rec, detector, candidates, view, packed)


def in_metres(depth: NDArray[np.float32], view: FrameView) -> NDArray[np.float32]:
    """Depth for 3D: as it is where it is in metres, else scaled so that the median of the frame is 10 m."""
    if view.metric:
        return depth
    middle = np.nanmedian(view.measured) if np.isfinite(view.measured).any() else 1.0
    return (depth * (10.0 / middle)).astype(np.float32)


def jpeg(rgb_image: NDArray[np.uint8], quality: int = JPEG_QUALITY) -> bytes:
    """A picture as JPEG bytes."""
    _, data = cv2.imencode(".jpg", rgb_image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes()


def log_depth(rec: rr.RecordingStream, path: str, depth_m: NDArray[np.float32], packed: bool = True) -> None:
    """Log depth at ``path/depth``, and above it at ``path/holes`` a mask that shows holes as dark pixels."""
    rec.log(f"{path}/depth", depth_picture(depth_m, packed))
    holes = np.where(np.isfinite(depth_m) & (depth_m > 0), 0, HOLE_CLASS).astype(np.uint8)
    rec.log(f"{path}/holes", rr.SegmentationImage(holes, opacity=1.0, draw_order=5))


def depth_picture(depth_m: NDArray[np.float32], packed: bool) -> rr.EncodedDepthImage | rr.DepthImage:
    """A depth picture of 16 bits, as PNG where it is packed; holes are 0."""
    steps = np.nan_to_num(depth_m * DEPTH_UNIT, nan=0.0, posinf=0.0, neginf=0.0)
    steps = np.where(steps < np.iinfo(np.uint16).max, np.clip(np.rint(steps), 0, None), 0).astype(np.uint16)
    shown = [v * DEPTH_UNIT for v in DEPTH_RANGE_M]
    if not packed:
        return rr.DepthImage(steps, meter=DEPTH_UNIT, colormap="viridis", depth_range=shown)
    _, png = cv2.imencode(".png", steps)
    return rr.EncodedDepthImage(
        png.tobytes(), media_type="image/png", meter=DEPTH_UNIT, colormap="viridis", depth_range=shown
    )


def candidate_label(c: CandidateView) -> str:
    """The label of a box: rank, l, D, and the score before and after."""
    d = f"D {c.depth_difference:.3f}" if np.isfinite(c.depth_difference) else f"no D ({c.status})"
    moved = f"#{c.rank + 1}" if c.rank == c.new_rank else f"#{c.rank + 1} → #{c.new_rank + 1}"
    return f"{moved}   l {c.likelihood:.2f} → {c.posterior:.2f}   {d}"


def frame_table(view: FrameView, detector: str) -> str:
    """The candidates of a frame as Markdown, best after rescoring first."""
    found = {c.annotation_id for c in view.candidates[detector] if c.outcome == "hit"}
    cars = [int(i) for i in view.truth.annotation_id[~view.truth.ignore]]
    n_hit = sum(i in found for i in cars)
    lines = [
        f"**Image {view.image_id}**: annotated cars: {len(cars)}, hit: {n_hit}.\n\n",
        "| place | before | after | D | outcome | shows | why no D |\n",
        "| ---: | ---: | ---: | ---: | --- | --- | --- |\n",
    ]
    for c in sorted(view.candidates[detector], key=lambda c: c.new_rank):
        d = f"{c.depth_difference:.3f}" if np.isfinite(c.depth_difference) else c.status.replace("_", " ")
        why = c.reason_detail.replace("|", "/")
        lines.append(
            f"| {c.rank + 1} → {c.new_rank + 1} | {c.likelihood:.3f} | {c.posterior:.3f} | {d} | "
            f"{OUTCOME_NAME[c.outcome]} | {c.kind.replace('_', ' ')} | {why} |\n"
        )
    return "".join(lines)


def shown_models(candidates: Sequence[CandidateView]) -> tuple[CandidateView, ...]:
    """The best candidates after rescoring that have a model to show."""
    able = sorted((c for c in candidates if c.registered is not None), key=lambda c: c.new_rank)
    return tuple(able[:SHOWN_MODELS])


def label_spots(xyxy_px: NDArray[np.float64], width_px: int, height_px: int) -> NDArray[np.float64]:
    """Where labels (n, 2) stand: under their boxes, moved down where they would lie on an earlier label.

    The size of a label in picture pixels depends on the zoom; assumed is a picture as wide as its view.
    """
    w, h = 0.36 * width_px, 0.042 * width_px
    spots: list[tuple[float, float]] = []
    for x0, _, x1, y1 in xyxy_px:
        x = float(np.clip((x0 + x1) / 2, w / 2, width_px - w / 2))
        y = float(min(y1, height_px - 1.5 * h))
        while any(abs(x - ox) < w and abs(y - oy) < h for ox, oy in spots):
            y += h / 4
        spots.append((x, y))
    return np.array(spots).reshape(-1, 2)


def _log_detector(
    rec: rr.RecordingStream,
    detector: str,
    candidates: Sequence[CandidateView],
    view: FrameView,
    packed: bool,
) -> None:
    root = f"{IMAGE}/{rr.escape_entity_path_part(detector)}"
    boxes = candidates_path(detector)
    first = [c for c in candidates if c.new_rank < SHOWN_MODELS or c.outcome == "hit"]
    rest = [c for c in candidates if c not in first]
    _log_boxes(rec, f"{boxes}/first", first, thick=True)
    _log_boxes(rec, f"{boxes}/rest", rest, thick=False)
    _log_labels(rec, f"{boxes}/labels", first, view)
    _log_cars(rec, f"{boxes}/cars", candidates, view)
    worst_first = sorted(candidates, key=lambda c: -c.new_rank)
    depth, labels = compose(worst_first, view.measured.shape)
    log_depth(rec, f"{root}/predicted_depth", in_metres(depth, view), packed)
    rec.log(f"{root}/parts", rr.SegmentationImage(labels, opacity=0.5))
    _log_outlines(rec, f"{boxes}/outlines", candidates)
    top = shown_models(candidates)
    others = [c for c in candidates if c not in top]
    for name, some, size in (("first", top, 600), ("rest", others, 200)):
        meshes = [mesh for c in some if (mesh := candidate_mesh(c, view, size)) is not None]
        _log_models(rec, f"{models_path(detector)}/{name}", meshes, view.ground)
    table = rr.TextDocument(frame_table(view, detector), media_type=rr.MediaType.MARKDOWN)
    rec.log(f"tables/{rr.escape_entity_path_part(detector)}", table)


def _log_boxes(rec: rr.RecordingStream, path: str, some: Sequence[CandidateView], thick: bool) -> None:
    boxes = np.array([c.xyxy_px for c in some]).reshape(-1, 4)
    rec.log(
        path,
        rr.Boxes2D(
            array=boxes,
            array_format=rr.Box2DFormat.XYXY,
            class_ids=[OUTCOME_CLASSES.index(c.outcome) for c in some],
            labels=[candidate_label(c) for c in some],
            show_labels=False,
            radii=rr.Radius.ui_points(1.8 if thick else 0.9),
            draw_order=20 if thick else 15,
        ),
        # values of no candidate are no batch at all, and rerun warns of them
        *_values(
            rank=np.array([c.rank for c in some], np.int64),
            new_rank=np.array([c.new_rank for c in some], np.int64),
            likelihood=np.array([c.likelihood for c in some], np.float64),
            posterior=np.array([c.posterior for c in some], np.float64),
            depth_difference=np.array([c.depth_difference for c in some], np.float64),
            annotation_id=np.array([c.annotation_id for c in some], np.int64),
        ),
    )


def _values(**columns: NDArray[Any]) -> tuple[rr.AnyValues, ...]:
    """The columns as values for tests and tables to read; none where the columns are empty."""
    some = any(len(column) for column in columns.values())
    return (rr.AnyValues(drop_untyped_nones=True, **columns),) if some else ()


def _log_labels(rec: rr.RecordingStream, path: str, some: Sequence[CandidateView], view: FrameView) -> None:
    """Labels apart from the boxes, for the viewer would break them into lines as wide as the box."""
    h, w = view.measured.shape
    lowest_first = sorted(some, key=lambda c: c.xyxy_px[3])
    spots = label_spots(np.array([c.xyxy_px for c in lowest_first]).reshape(-1, 4), w, h)
    rec.log(
        path,
        rr.Points2D(
            spots,
            class_ids=[OUTCOME_CLASSES.index(c.outcome) for c in lowest_first],
            labels=[candidate_label(c) for c in lowest_first],
            show_labels=True,
            radii=rr.Radius.ui_points(0),
            draw_order=30,
        ),
    )


def _log_cars(
    rec: rr.RecordingStream, path: str, candidates: Sequence[CandidateView], view: FrameView
) -> None:
    truth = view.truth
    found = {c.annotation_id for c in candidates if c.outcome == "hit"}
    names = [
        "ignored_car" if ignore else "found" if int(i) in found else "missed"
        for i, ignore in zip(truth.annotation_id, truth.ignore, strict=True)
    ]
    rec.log(
        path,
        rr.Boxes2D(
            array=truth.xyxy_px,
            array_format=rr.Box2DFormat.XYXY,
            class_ids=[OUTCOME_CLASSES.index(n) for n in names],
            labels=["missed car" if n == "missed" else "" for n in names],
            show_labels=False,
            radii=rr.Radius.ui_points(1.2),
            draw_order=10,
        ),
        *_values(annotation_id=truth.annotation_id),
    )


def _log_outlines(rec: rr.RecordingStream, path: str, candidates: Sequence[CandidateView]) -> None:
    # another system predicts no outline
    some = [c for c in shown_models(candidates) if c.instance]
    # pixel centres to Rerun's pixel edges, and back to the first point to close the line
    strips = [
        c.instance.outline_px[[*range(len(c.instance.outline_px)), 0]] + 0.5 for c in some if c.instance
    ]
    ids = [OUTCOME_CLASSES.index(c.outcome) for c in some]
    rec.log(
        path,
        rr.LineStrips2D(
            strips, class_ids=ids, show_labels=False, radii=rr.Radius.ui_points(1.0), draw_order=12
        ),
    )


def compose(
    worst_first: Sequence[CandidateView], shape: tuple[int, ...]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Registered depth and part labels (h, w) of candidates; where they overlap, the later one is on top."""
    depth = np.full(shape, np.nan, np.float32)
    labels = np.zeros(shape, np.uint8)
    for c in worst_first:
        if c.predicted is None or c.registered is None:
            continue
        window = c.predicted.window
        seen = np.isfinite(c.registered)
        depth[window][seen] = c.registered[seen]
        labels[window][seen] = c.instance.part_labels[seen] if c.instance else 0
    return depth, labels


def _log_models(rec: rr.RecordingStream, path: str, meshes: list[PartMesh], ground: GroundPlane) -> None:
    if not any(len(m.triangles) for m in meshes):
        # a mesh without triangles is refused; clearing removes that of the frame before
        rec.log(path, rr.Clear(recursive=False))
        return
    mesh = merge_meshes(meshes)
    colours = np.array([rgb(part_colour(i)) for i in range(256)], np.uint8)[mesh.label]
    rec.log(
        path,
        rr.Mesh3D(
            vertex_positions=apply_transform(world_from_camera(ground), mesh.xyz_m),
            triangle_indices=mesh.triangles,
            vertex_colors=colours,
        ),
    )


def candidate_mesh(c: CandidateView, view: FrameView, max_vertices: int) -> PartMesh | None:
    """The registered prediction of a candidate as a surface in the camera frame; None without evidence."""
    if c.predicted is None or c.registered is None:
        return None
    corner = (c.predicted.x0_px, c.predicted.y0_px)
    # another system has no parts: its surface is of one colour
    labels = c.instance.part_labels if c.instance else np.ones(c.registered.shape, np.uint8)
    return part_mesh(in_metres(c.registered, view), labels, view.camera, corner, max_vertices)


def _ground_grid(
    ground: GroundPlane, half_width_m: int = 12, far_m: int = 48, step_m: int = 4
) -> rr.LineStrips3D:
    """A patch of the ground plane as a grid of lines, z = 0 in the world frame."""
    across = [[(-half_width_m, y, 0), (half_width_m, y, 0)] for y in range(0, far_m + 1, step_m)]
    along = [[(x, 0, 0), (x, far_m, 0)] for x in range(-half_width_m, half_width_m + 1, step_m)]
    return rr.LineStrips3D(across + along, colors=[(120, 150, 120)], radii=rr.Radius.ui_points(0.6))
