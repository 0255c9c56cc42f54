"""Pictures of a trial by the project's own renderer, as figures 8 and 9 of the report: no graphics driver."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from datasets_synth.meshes.lofts import loft
from datasets_synth.meshes.mesh import Material, Mesh, Placed
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.photos.table_scene import SCALE, table_scene
from datasets_synth.render.render import render_rgb
from recon.arrays import FloatArray, UInt8Array
from recon.camera import PinholeCamera
from rescore.grasping.act import TRACE_STEPS, Record
from rescore.grasping.hands import Hand
from rescore.grasping.scene import world

if TYPE_CHECKING:
    import mujoco

_WIDTH_PX, _HEIGHT_PX = 300, 260
_FOCAL_PX = 430.0
_DISTANCE_M, _ELEVATION_RAD = 0.85, float(np.deg2rad(14.0))
_LOOKS_M = 0.17
"""Height above the table that the camera looks at."""
MOMENTS = (
    ("way", 0.6),
    ("line", 0.5),
    ("line", 1.0),
    ("close", 1.0),
    ("lift", 1.0),
    ("shake", 0.5),
    ("away", 1.0),
)
"""Moments of a strip: the phase, and which share of it is over."""
_AROUND = 20


@dataclass(frozen=True, eq=False)
class Seen:
    """A body of the scene as it is drawn."""

    mesh: Mesh
    geom: int
    """Geom of the engine that it stands for; -1 for the object."""


def strip(record: Record, hand: Hand, mesh: Mesh, scale: float = SCALE) -> UInt8Array:
    """Pictures (h, n w, 3) of the ``MOMENTS`` of an executed motion, one beside the other.

    Args:
        record: what was recorded.
        hand: the hand.
        mesh: the object as it looks.
        scale: size of the object on the table in units of its mesh.
    """
    import mujoco  # noqa: PLC0415 - of the extra

    model = world(hand)
    data = mujoco.MjData(model)
    drawn = [Seen(_geom_mesh(model, g), g) for g in range(model.ngeom) if model.geom(g).name != "table"]
    middle = record.object_m[0]
    pictures = []
    for phase, share in MOMENTS:
        steps = record.during(phase)
        k = min(int(steps[round(share * (len(steps) - 1))]) // TRACE_STEPS, len(record.qpos) - 1)
        qpos = record.qpos[k]
        # without the object, whose joint comes last
        data.qpos[:] = qpos[: model.nq]
        mujoco.mj_kinematics(model, data)
        items = [
            Placed(s.mesh, _pose(data.geom_xpos[s.geom], data.geom_xmat[s.geom]), "robot") for s in drawn
        ]
        items.append(Placed(mesh, _object_pose(qpos[-7:], scale), "car"))
        pictures.append(_picture(items, middle))
    gap = np.full((_HEIGHT_PX, 4, 3), 255, np.uint8)
    joined = [p for picture in pictures for p in (picture, gap)][:-1]
    return np.concatenate(joined, axis=1)


def _picture(items: Sequence[Placed], middle_m: FloatArray) -> UInt8Array:
    camera = PinholeCamera(
        _FOCAL_PX, _FOCAL_PX, (_WIDTH_PX - 1) / 2, (_HEIGHT_PX - 1) / 2, _WIDTH_PX, _HEIGHT_PX
    )
    return render_rgb(table_scene(items, camera, _camera_pose(middle_m)))


def _camera_pose(middle_m: FloatArray) -> FloatArray:
    """The pose (4, 4) of the ground frame in a camera that looks at what happens from the side."""
    c, s = np.cos(_ELEVATION_RAD), np.sin(_ELEVATION_RAD)
    azimuth = np.deg2rad(-125.0)
    back = np.array([c * np.cos(azimuth), c * np.sin(azimuth), s])
    forward = -back
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward])
    eye = np.array([*middle_m[:2], _LOOKS_M]) + _DISTANCE_M * back
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ eye
    return pose


def _pose(position: FloatArray, matrix: FloatArray) -> FloatArray:
    """world_from_object of a geom at the size of real cars, shape (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = matrix.reshape(3, 3) / SCALE
    pose[:3, 3] = position / SCALE
    return pose


def _object_pose(qpos: FloatArray, scale: float) -> FloatArray:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import

    turn = Rotation.from_quat(qpos[[4, 5, 6, 3]]).as_matrix()
    return _pose(qpos[:3], turn * scale)


def _geom_mesh(model: "mujoco.MjModel", geom: int) -> Mesh:
    """A geom of arm or hand as a mesh in its own frame, metres."""
    import mujoco  # noqa: PLC0415

    size, rgb = model.geom_size[geom], model.geom_rgba[geom, :3]
    red, green, blue = (float(c) ** 2.2 for c in rgb)
    material = Material("robot", (red, green, blue), specular=0.15, shininess=40.0)
    draft = MeshDraft()
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        draft.box((0, 0, 0), 2 * size, material)
    else:
        round_ends = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
        loft(draft, _rings(float(size[0]), float(size[1]), bool(round_ends)), material)
    return draft.mesh()


def _rings(radius_m: float, half_m: float, round_ends: bool) -> FloatArray:
    """Rings (r, k, 3) of a cylinder along z, with half spheres at its ends or flat."""
    around = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    if round_ends:
        rise = np.linspace(-np.pi / 2, np.pi / 2, 12)
        z = radius_m * np.sin(rise) + np.where(rise < 0, -half_m, half_m)
        r = radius_m * np.maximum(np.cos(rise), 1e-3)
    else:
        z, r = np.array([-half_m, half_m]), np.array([radius_m, radius_m])
    circle = np.stack([np.cos(around), np.sin(around)], axis=1)
    return np.concatenate(
        [r[:, None, None] * circle, np.broadcast_to(z[:, None, None], (len(z), _AROUND, 1))], axis=2
    )
