"""The recording of one trial of the robot: arm, hand, estimated and true car, forces, picture, plan."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.spatial.transform import Rotation

from recon.arrays import FloatArray
from recon.files import atomic_path
from recon.localization.standing_box import StandingBox, cam_from_ground
from reports.palette import BLUE, ESTIMATE, GREY, NIGHT_SKY, TRUTH, VERMILION, YELLOW, rgb
from reports.recording.entities import picture, pinhole, text
from rescore.grasping.act import TRACE_STEPS, motor_order
from rescore.grasping.hands import HANDS
from rescore.grasping.perception import METHOD_NAME
from rescore.grasping.scene import OBJECT, SCALE, SEEN_FROM, STEP_S, TABLE_M, TABLE_MIDDLE_M, world
from rescore.grasping.trial import Replay

if TYPE_CHECKING:
    import mujoco

TIME = "time"
"""The timeline, in seconds from the start of the motion."""
_PICTURE_SHARE = 0.5
_M_PER_N = 0.004
"""Length of the arrows of contact forces."""
_EYE_M, _LOOKS_M = (0.85, 0.55, 0.7), (0.0, 1.4, 0.15)
"""Where the view opens, and what it looks at, in the ground frame."""
_SIDES = (("left", BLUE), ("right", VERMILION), ("rest", GREY))


def write_grasp_recording(shown: Replay, out: Path) -> Path:
    """The path of the recording of a trial for the Rerun viewer, after it was written.

    Args:
        shown: the trial.
        out: the file to write.
    """
    with atomic_path(out) as beside:
        rec = rr.RecordingStream("rescore_grasp", recording_id=out.stem, send_properties=False)
        rr.set_log_time_enabled(False, recording=rec)
        rec.save(beside, default_blueprint=_blueprint())
        try:
            _log_still(rec, shown)
            _log_motion(rec, shown)
            rec.flush(timeout_sec=60.0)
        finally:
            rec.disconnect()
    return out


def _blueprint() -> rrb.Blueprint:
    views = rrb.Spatial3DView(
        origin="world",
        name="arm, hand and car",
        background=rgb(NIGHT_SKY),
        eye_controls=rrb.EyeControls3D(position=_EYE_M, look_target=_LOOKS_M),
    )
    side = rrb.Vertical(
        rrb.Spatial2DView(origin="world/camera/image", name="the camera's picture"),
        rrb.TimeSeriesView(origin="forces", name="forces on the car, newtons"),
        rrb.TimeSeriesView(origin="height", name="height of the car, metres"),
        rrb.TextDocumentView(origin="verdict", name="verdict"),
        row_shares=[3, 2, 2, 2],
    )
    return rrb.Blueprint(rrb.Horizontal(views, side, column_shares=[3, 2]), collapse_panels=True)


def _log_still(rec: rr.RecordingStream, shown: Replay) -> None:
    """Log what does not move: table, boxes, picture, plan, verdict."""
    rec.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    middle = [*TABLE_MIDDLE_M, -0.01]
    table = rr.Boxes3D(
        centers=[middle],
        half_sizes=[[TABLE_M[0] / 2, TABLE_M[1] / 2, 0.01]],
        colors=[(40, 40, 42)],
        fill_mode="Solid",
    )
    rec.log("world/table", table, static=True)
    row = shown.row
    _log_box(rec, "world/true_box", row.truth.box, TRUTH)
    estimate = row.estimates[shown.method]
    if hasattr(estimate, "box"):
        _log_box(rec, "world/estimated_box", estimate.box, ESTIMATE)
    _log_picture(rec, shown)
    rec.log("world/plan", _plan(shown), static=True)
    rec.log("verdict", text(_words(shown)), static=True)
    for side, colour in _SIDES:
        rec.log(f"forces/{side}", rr.SeriesLines(colors=[rgb(colour)], names=[side]), static=True)
    rec.log("height/car", rr.SeriesLines(colors=[rgb(TRUTH)], names=["car"]), static=True)


def _log_box(rec: rr.RecordingStream, path: str, box: StandingBox, colour: str) -> None:
    turn = Rotation.from_euler("z", box.yaw_rad).as_quat()
    wires = rr.Boxes3D(
        centers=[box.centroid_m],
        half_sizes=[box.size_m / 2],
        quaternions=[rr.Quaternion(xyzw=turn)],
        colors=[rgb(colour)],
        radii=rr.Radius.ui_points(1.5),
        fill_mode="MajorWireframe",
    )
    rec.log(path, wires, static=True)


def _log_picture(rec: rr.RecordingStream, shown: Replay) -> None:
    camera, ground = SEEN_FROM.camera, SEEN_FROM.ground
    pose = np.linalg.inv(cam_from_ground(ground))
    rec.log("world/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), static=True)
    small = cv2.resize(shown.rgb, None, fx=_PICTURE_SHARE, fy=_PICTURE_SHARE, interpolation=cv2.INTER_AREA)
    height, width = small.shape[:2]
    matrix = camera.matrix * _PICTURE_SHARE
    matrix[2, 2] = 1.0
    look = pinhole(matrix, width, height, image_plane_distance=0.25)
    rec.log("world/camera/image", look, static=True)
    rec.log("world/camera/image", picture(np.asarray(small, np.uint8)), static=True)


def _plan(shown: Replay) -> rr.LineStrips3D:
    """The way of the palm as it was planned."""
    import mujoco  # noqa: PLC0415 - of the extra

    hand = HANDS[shown.hand]
    model = world(hand)
    data = mujoco.MjData(model)
    tool = model.body("tool").id
    points = []
    for joints in np.concatenate([shown.motion.way_rad, shown.motion.line_rad])[::10]:
        data.qpos[:7] = joints
        mujoco.mj_kinematics(model, data)
        points.append(data.xpos[tool] + data.xmat[tool].reshape(3, 3)[:, 2] * hand.palm_m)
    return rr.LineStrips3D([points], colors=[rgb(YELLOW)], radii=rr.Radius.ui_points(1.2))


def _words(shown: Replay) -> str:
    verdict = shown.verdict
    cause = f", {verdict.cause.value.replace('_', ' ')}" if verdict.cause else ""
    lines = [
        f"**{shown.row.car}**, placement {shown.row.placement}: **{verdict.ending.value}{cause}**",
        f"{METHOD_NAME[shown.method]}; {HANDS[shown.hand].name}; "
        f"pushed before closing: {verdict.pushed_n:.1f} N, largest force of a side: {verdict.most_n:.1f} N",
        f"lifted {1000 * verdict.lifted_m:.0f} mm, put down {1000 * verdict.moved_m:.0f} mm beside its place",
        "boxes: orange estimated, green true; yellow: the planned way of the palm",
    ]
    return "\n\n".join(lines)


def _log_motion(rec: rr.RecordingStream, shown: Replay) -> None:
    """Log what moves, at every kept pose."""
    import mujoco  # noqa: PLC0415

    hand, record = HANDS[shown.hand], shown.record
    model = world(hand, shown.solid)
    data = mujoco.MjData(model)
    robot = [g for g in range(model.ngeom) if model.body(model.geom_bodyid[g]).name not in ("world", OBJECT)]
    for g in robot:
        rec.log(f"world/robot/{g:02d}", _geom(model, g), static=True)
    mesh = shown.mesh
    colours = np.array([m.rgb for m in mesh.materials]) ** (1 / 2.2)
    corners = mesh.faces.ravel()
    car = rr.Mesh3D(
        vertex_positions=mesh.vertices_m[corners] * SCALE,
        triangle_indices=np.arange(len(corners)).reshape(-1, 3),
        vertex_normals=mesh.corner_normals.reshape(-1, 3),
        vertex_colors=np.repeat(np.clip(colours[mesh.face_material], 0, 1), 3, axis=0),
    )
    rec.log("world/car", car, static=True)
    order = motor_order(model, hand)
    for k, qpos in enumerate(record.qpos):
        step = k * TRACE_STEPS
        rec.set_time(TIME, duration=step * STEP_S)
        data.qpos[:] = qpos
        data.ctrl[order] = record.commands[step]
        mujoco.mj_forward(model, data)
        for g in robot:
            _log_pose(rec, f"world/robot/{g:02d}", data.geom_xpos[g], data.geom_xmat[g])
        body = model.body(OBJECT).id
        _log_pose(rec, "world/car", data.xpos[body], data.xmat[body])
        rec.log("world/contacts", _contacts(model, data))
        forces = record.forces_n[step : step + TRACE_STEPS].max(axis=0)
        for (side, _), force in zip(_SIDES, forces, strict=True):
            rec.log(f"forces/{side}", rr.Scalars(float(force)))
        rec.log("height/car", rr.Scalars(float(record.object_m[step, 2])))


def _log_pose(rec: rr.RecordingStream, path: str, position: FloatArray, matrix: FloatArray) -> None:
    rec.log(path, rr.Transform3D(translation=position, mat3x3=matrix.reshape(3, 3)))


def _geom(model: "mujoco.MjModel", g: int) -> Any:
    """A piece of arm or hand in its own frame."""
    import mujoco  # noqa: PLC0415

    size, colour = model.geom_size[g], [tuple(np.round(255 * model.geom_rgba[g]).astype(int).tolist())]
    if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX:
        return rr.Boxes3D(half_sizes=[size], colors=colour, fill_mode="Solid")
    radius, half = float(size[0]), float(size[1])
    if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return rr.Cylinders3D(lengths=[2 * half], radii=[radius], colors=colour, fill_mode="Solid")
    # a capsule of Rerun starts at its origin
    return rr.Capsules3D(
        lengths=[2 * half], radii=[radius], translations=[[0, 0, -half]], colors=colour, fill_mode="Solid"
    )


def _contacts(model: "mujoco.MjModel", data: "mujoco.MjData") -> rr.Arrows3D:
    """The forces of hand and arm on the car where they touch it."""
    import mujoco  # noqa: PLC0415

    origins, vectors = [], []
    body = model.body(OBJECT).id
    for i in range(data.ncon):
        touch = data.contact[i]
        bodies = model.geom_bodyid[touch.geom]
        if body not in bodies or 0 in bodies:
            continue
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, wrench)
        # the frame's first row points from the first geom to the second
        force = touch.frame.reshape(3, 3).T @ wrench[:3]
        origins.append(np.array(touch.pos))
        vectors.append(_M_PER_N * force * (1.0 if bodies[1] == body else -1.0))
    return rr.Arrows3D(
        origins=origins,
        vectors=vectors,
        colors=[rgb(YELLOW)] if origins else [],
        radii=[0.002] if origins else [],
    )
