"""The scene in the physics engine: the table, the arm with a hand, and one object."""

from typing import TYPE_CHECKING

import numpy as np

from datasets_synth.photos.table_scene import SCALE, SEEN_FROM, TABLE_M, TABLE_MIDDLE_M
from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.localization.standing_box import StandingBox
from rescore.grasping.arm import ARM, HAND, TABLE, THING, Mount, add_arm
from rescore.grasping.hands import Hand
from rescore.grasping.solids import Solid

if TYPE_CHECKING:
    import mujoco

__all__ = ["SCALE", "SEEN_FROM", "TABLE_M", "TABLE_MIDDLE_M"]

MOUNT = Mount((0.0, float(TABLE_MIDDLE_M[1]) + TABLE_M[1] / 2 + 0.14), -float(np.pi) / 2)
"""Behind the table, facing the camera across it: parked, the arm hides nothing on the table."""
STEP_S = 0.0025
TOUCHES = " touches "
"""Between the names of the two bodies in the name of a sensor of their force."""
OBJECT = "object"
"""Name of the body of the object."""
_OBJECT_FRICTION = (0.4, 0.005, 0.0001)
"""Friction of tyres and paint on the table top; the pads have their own."""
_BLACK, _PAINT = (0.16, 0.16, 0.17, 1.0), (0.75, 0.16, 0.13, 1.0)


def require_robot() -> None:
    """Nothing, where the packages of the extra are installed.

    Raises:
        RescoreError: they are not.
    """
    try:
        import mink  # noqa: F401, PLC0415
        import mujoco  # noqa: F401, PLC0415
        import ompl  # noqa: F401, PLC0415
    except ImportError as error:
        raise RescoreError(
            f"rescore grasp: expected the packages of the robot, got no {error.name}; "
            "call pip install 'rescore[robot]'"
        ) from None


def world(hand: Hand, solid: Solid | None = None) -> "mujoco.MjModel":
    """The compiled scene; with a solid as a free body, else without an object."""
    spec = _base(hand)
    if solid is not None:
        _add_solid(spec, solid)
        _add_sensors(spec)
    return spec.compile()


def bare_arm() -> "mujoco.MjModel":
    """The compiled arm without a hand, for its kinematics."""
    import mujoco  # noqa: PLC0415

    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    add_arm(spec, MOUNT)
    return spec.compile()


def planning_world(hand: Hand) -> "mujoco.MjModel":
    """The compiled scene with a box on a mocap body in place of the object, whose size is set later."""
    import mujoco  # noqa: PLC0415

    spec = _base(hand)
    body = spec.worldbody.add_body(name=OBJECT, mocap=True)
    body.add_geom(
        name=OBJECT,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.1, 0.1, 0.1],
        contype=THING,
        conaffinity=ARM | HAND,
    )
    return spec.compile()


def _base(hand: Hand) -> "mujoco.MjSpec":
    import mujoco  # noqa: PLC0415

    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.worldbody.add_geom(
        name="table",
        # the engine finds contacts with a plane faster than with a box; beside the table it has no end
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[*TABLE_MIDDLE_M, 0.0],
        size=[TABLE_M[0] / 2, TABLE_M[1] / 2, 0.1],
        rgba=_BLACK,
        contype=TABLE,
        conaffinity=ARM | HAND | THING,
        friction=_OBJECT_FRICTION,
    )
    hand.add(spec, add_arm(spec, MOUNT))
    _exclude_neighbours(spec)
    return spec


def _exclude_neighbours(spec: "mujoco.MjSpec") -> None:
    """Links that are joined, or joined to one that is, do not touch."""
    bodies = [b for b in spec.bodies if b.name not in ("world", OBJECT)]
    for body in bodies:
        up = body.parent
        for _ in range(2):
            up = up.parent if up is not None else None
            if up is None or up.name in ("", "world"):
                break
            spec.add_exclude(bodyname1=body.name, bodyname2=up.name)
    fingers = [b.name for b in bodies if b.name.startswith(("left", "right"))]
    for name in fingers:
        for other in ("link_5", "link_6", "link_7"):
            spec.add_exclude(bodyname1=name, bodyname2=other)


def _add_solid(spec: "mujoco.MjSpec", solid: Solid) -> None:
    import mujoco  # noqa: PLC0415

    body = spec.worldbody.add_body(name=OBJECT)
    body.add_freejoint(name=OBJECT)
    for k, corners in enumerate(solid.hulls_m):
        mesh = spec.add_mesh(name=f"piece_{k}", uservert=corners.ravel().tolist())
        mesh.maxhullvert = 40
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh.name,
            rgba=_PAINT,
            contype=THING,
            conaffinity=ARM | HAND | TABLE,
            friction=_OBJECT_FRICTION,
            mass=0.0,
        )
    body.mass, body.ipos, body.inertia = solid.mass_kg, solid.middle_m, solid.inertia_kg_m2
    body.explicitinertial = True


def _add_sensors(spec: "mujoco.MjSpec") -> None:
    """Sensors of the force between the object, or the table, and each body of arm and hand."""
    import mujoco  # noqa: PLC0415

    force, net = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3
    bodies = [b.name for b in spec.bodies if b.name and b.name not in ("world", OBJECT, "arm_base")]
    for name in bodies:
        for what, kind, key in (
            (OBJECT, mujoco.mjtObj.mjOBJ_BODY, OBJECT),
            ("table", mujoco.mjtObj.mjOBJ_GEOM, "table"),
        ):
            spec.add_sensor(
                name=f"{what}{TOUCHES}{name}",
                type=mujoco.mjtSensor.mjSENS_CONTACT,
                objtype=mujoco.mjtObj.mjOBJ_BODY,
                objname=name,
                reftype=kind,
                refname=key,
                intprm=[force, net, 1],
            )


def pose_of(box: StandingBox) -> FloatArray:
    """Place and quaternion (7,) of an object frame whose box stands like this."""
    half = box.yaw_rad / 2
    return np.array([*box.xy_m, 0.0, np.cos(half), 0.0, 0.0, np.sin(half)])
