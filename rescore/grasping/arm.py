"""The arm: seven joints after the kinematics that Barrett Technology publishes of the WAM, built in code.

Frames follow the table of Denavit and Hartenberg: joint i turns about z of frame i - 1, and frame i is
carried by it. The tool frame is frame 7: z points out of the wrist, the hand is mounted on its origin.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from recon.arrays import FloatArray

if TYPE_CHECKING:
    import mujoco

JOINTS = tuple(f"arm_{i}" for i in range(1, 8))
"""Names of the joints from the base to the wrist."""

# WAM Arm User's Manual, D1001 version AH.00, table 5: a and d in metres, alpha in quarter turns
_DH = (
    (0.0, -1, 0.0),
    (0.0, 1, 0.0),
    (0.045, -1, 0.55),
    (-0.045, 1, 0.0),
    (0.0, -1, 0.3),
    (0.0, 1, 0.0),
    (0.0, 0, 0.06),
)
LIMITS_RAD: FloatArray = np.array(
    # the same manual, table 6
    [(-2.6, 2.6), (-2.0, 2.0), (-2.8, 2.8), (-0.9, 3.1), (-4.76, 1.24), (-1.6, 1.6), (-3.0, 3.0)]
)
"""Lower and upper limit of each joint, shape (7, 2)."""
TORQUE_NM: FloatArray = np.array([62.6, 84.2, 50.1, 26.8, 6.7, 6.7, 1.36])
"""Largest torque of each joint, shape (7,): the motors' continuous torque (1.49, 0.356 and 0.091 N m, the
maker's page of specifications) times the transmission ratios of the manual (42, 28.25, 18, 9.48, 14.93); two
motors share joints 2 and 3, and joints 5 and 6."""
SPEED_RAD_S: FloatArray = np.full(7, 1.5)
"""Largest speed on a planned path, shape (7,). Chosen, well below what the motors can do."""
ACCELERATION_RAD_S2: FloatArray = np.full(7, 3.0)
"""Largest acceleration on a planned path, shape (7,). Chosen."""
SHOULDER_M = 0.346
"""Height of the shoulder, where the first three axes meet, above the arm's foot (the manual, fig. 35)."""
PARKED_RAD: FloatArray = np.array([0.0, -1.2, 0.0, 2.6, 0.0, 0.3, 0.0])
"""Where the arm waits, shape (7,): drawn back, so that it hides nothing on the table from the camera."""

_STIFFNESS = (4000.0, 4000.0, 3000.0, 2000.0, 600.0, 600.0, 120.0)
"""Servo stiffness, N m a radian."""
# link masses in kg, rounded from the maker's mass properties
_MASS_KG = (8.0, 3.9, 1.8, 1.1, 0.5, 0.5, 0.1)
_ARMATURE = (0.16, 0.16, 0.12, 0.06, 0.01, 0.01, 0.003)
_GREY, _DARK = (0.78, 0.79, 0.80, 1.0), (0.22, 0.23, 0.25, 1.0)


@dataclass(frozen=True)
class Mount:
    """Where the arm stands in the ground frame."""

    xy_m: tuple[float, float]
    yaw_rad: float
    """Direction in which the arm faces, from x."""


def add_arm(spec: "mujoco.MjSpec", mount: Mount) -> Any:
    """The body of the last link, for a hand, after the arm with its servos was added to the spec."""
    import mujoco  # noqa: PLC0415 - of the extra

    body = spec.worldbody.add_body(
        name="arm_base",
        pos=[*mount.xy_m, SHOULDER_M],
        quat=_quaternion((0.0, 0.0, 1.0), mount.yaw_rad),
    )
    _geom(body, "cylinder", (0, 0, -SHOULDER_M - 0.4), (0, 0, -0.09), 0.11, _DARK)
    parent, position, turn = body, (0.0, 0.0, 0.0), 0
    for i, (a, alpha, d) in enumerate(_DH):
        parent = parent.add_body(
            name=f"link_{i + 1}",
            pos=position,
            quat=_quaternion((1.0, 0.0, 0.0), turn * np.pi / 2),
            gravcomp=1.0,
        )
        joint = parent.add_joint(
            name=JOINTS[i],
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 0, 1],
            range=LIMITS_RAD[i].tolist(),
            armature=_ARMATURE[i],
        )
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        _link(parent, i + 1)
        _servo(spec, i)
        position, turn = (a, 0.0, d), alpha
    return parent.add_body(name="tool", pos=position, gravcomp=1.0)


def _servo(spec: "mujoco.MjSpec", i: int) -> None:
    import mujoco  # noqa: PLC0415

    stiffness = _STIFFNESS[i]
    damping = 0.12 * stiffness
    servo = spec.add_actuator(
        name=JOINTS[i],
        target=JOINTS[i],
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        forcerange=[-TORQUE_NM[i], TORQUE_NM[i]],
        gainprm=[stiffness] + [0] * 9,
        biasprm=[0, -stiffness, -damping] + [0] * 7,
    )
    servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE


_SHAPES: dict[int, tuple[tuple[str, tuple[float, ...], tuple[float, ...], float], ...]] = {
    # by link: kind, ends of its axis, radius
    1: (("capsule", (0, 0, -0.08), (0, 0, 0.03), 0.10),),
    2: (("capsule", (0, 0, -0.09), (0, 0, 0.09), 0.085),),
    3: (("capsule", (0, 0, 0.06), (0, 0, 0.48), 0.052),),
    4: (("capsule", (0, 0, -0.05), (0, 0, 0.05), 0.058),),
    5: (("capsule", (0, 0, 0.03), (0, 0, 0.25), 0.045),),
    6: (("capsule", (0, 0, -0.03), (0, 0, 0.03), 0.045),),
    7: (("cylinder", (0, 0, 0.02), (0, 0, 0.06), 0.045),),
}


def _link(body: Any, number: int) -> None:
    shapes = _SHAPES[number]
    for kind, start, end, radius in shapes:
        geom = _geom(body, kind, start, end, radius, _GREY if number % 2 else _DARK)
        geom.mass = _MASS_KG[number - 1] / len(shapes)


def _geom(
    body: Any,
    kind: str,
    start: tuple[float, ...],
    end: tuple[float, ...],
    radius: float,
    rgba: tuple[float, ...],
) -> Any:
    import mujoco  # noqa: PLC0415

    kinds = {"capsule": mujoco.mjtGeom.mjGEOM_CAPSULE, "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER}
    return body.add_geom(
        type=kinds[kind],
        fromto=[*start, *end],
        size=[radius, 0, 0],
        rgba=rgba,
        contype=ARM,
        conaffinity=TOUCHES_ARM,
    )


ARM, HAND, THING, TABLE = 1, 2, 4, 8
"""Bits of what may touch what."""
TOUCHES_ARM = THING | TABLE | HAND


def _quaternion(axis: tuple[float, float, float], angle_rad: float) -> list[float]:
    return [float(np.cos(angle_rad / 2)), *(np.sin(angle_rad / 2) * np.array(axis)).tolist()]
