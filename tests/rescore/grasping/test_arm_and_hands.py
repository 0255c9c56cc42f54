"""The arm against its published table, the hands against what they promise."""

from typing import Any

import numpy as np
import pytest

from recon.arrays import FloatArray
from rescore.grasping.arm import JOINTS, LIMITS_RAD, SHOULDER_M, TORQUE_NM
from rescore.grasping.hands import HANDS
from rescore.grasping.plan import hand_pose
from rescore.grasping.scene import MOUNT, bare_arm, world

mujoco = pytest.importorskip("mujoco")

# WAM Arm User's Manual, D1001, table 5
PUBLISHED = (
    (0, -np.pi / 2, 0),
    (0, np.pi / 2, 0),
    (0.045, -np.pi / 2, 0.55),
    (-0.045, np.pi / 2, 0),
    (0, -np.pi / 2, 0.3),
    (0, np.pi / 2, 0),
    (0, 0, 0.06),
)


def denavit_hartenberg(joints: FloatArray) -> FloatArray:
    """The tool in the arm's frame by equation 1 of the manual."""
    out = np.eye(4)
    for q, (a, alpha, d) in zip(joints, PUBLISHED, strict=True):
        c, s, ca, sa = np.cos(q), np.sin(q), np.cos(alpha), np.sin(alpha)
        out = out @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    return np.asarray(out)


def test_the_tool_is_where_the_published_table_puts_it() -> None:
    model = bare_arm()
    data = mujoco.MjData(model)
    base = np.eye(4)
    c, s = np.cos(MOUNT.yaw_rad), np.sin(MOUNT.yaw_rad)
    base[:2, :2], base[:3, 3] = [[c, -s], [s, c]], [*MOUNT.xy_m, SHOULDER_M]
    for joints in np.random.default_rng(0).uniform(LIMITS_RAD[:, 0], LIMITS_RAD[:, 1], (20, 7)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        expected = base @ denavit_hartenberg(joints)
        tool = model.body("tool").id
        np.testing.assert_allclose(data.xpos[tool], expected[:3, 3], atol=1e-9)
        np.testing.assert_allclose(data.xmat[tool].reshape(3, 3), expected[:3, :3], atol=1e-9)


def test_the_engine_keeps_the_limits_of_joints_and_motors() -> None:
    model = world(HANDS["parallel_jaw"])
    for i, name in enumerate(JOINTS):
        np.testing.assert_allclose(model.joint(name).range, LIMITS_RAD[i])
        np.testing.assert_allclose(model.actuator(name).forcerange, [-TORQUE_NM[i], TORQUE_NM[i]])


@pytest.mark.parametrize("name", HANDS)
def test_an_opening_is_the_distance_of_the_pads(name: str) -> None:
    hand = HANDS[name]
    for opening in (0.05, 0.09, 0.13):
        low, apart = pads(name, opening)
        assert apart == pytest.approx(opening, abs=5e-4)
        assert low == pytest.approx(hand.depth_m(opening), abs=5e-4)
        assert hand.lowest_m(opening) > hand.depth_m(opening)
    assert hand.narrowest_m < 0.05
    assert hand.widest_m >= 0.14


def pads(name: str, opening: float) -> tuple[float, float]:
    """Depth of the pads below the palm, and their distance, in the engine."""
    hand = HANDS[name]
    model = world(hand)
    data = mujoco.MjData(model)
    data.qpos[:] = hand_pose(model, hand, hand.opened(opening))
    mujoco.mj_kinematics(model, data)
    tool = model.body("tool").id
    turn, origin = data.xmat[tool].reshape(3, 3), data.xpos[tool]
    tips = [(g, *surface(model, data, g)) for g in range(model.ngeom) if is_pad(model, g)]
    in_hand = {g: ((p - origin) @ turn, r) for g, p, r in tips}
    ys = [p[1] - np.sign(p[1]) * r for p, r in in_hand.values()]
    depth = float(np.mean([p[2] for p, _ in in_hand.values()])) - hand.palm_m
    return depth, max(y for y in ys if y > 0) - min(y for y in ys if y < 0)


def is_pad(model: Any, g: int) -> bool:
    return model.body(model.geom_bodyid[g]).name.startswith(("left", "right")) and bool(
        np.allclose(model.geom_rgba[g, :3], [0.12, 0.12, 0.13])
    )


def surface(model: Any, data: Any, g: int) -> tuple[FloatArray, float]:
    """The middle of a pad and how far its rubber lies from it; of a finger the tip."""
    if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX:
        return data.geom_xpos[g], float(model.geom_size[g, 1])
    axis = data.geom_xmat[g].reshape(3, 3)[:, 2]
    body = data.xpos[model.geom_bodyid[g]]
    ends = [data.geom_xpos[g] + s * model.geom_size[g, 1] * axis for s in (1, -1)]
    return max(ends, key=lambda e: float(np.linalg.norm(e - body))), float(model.geom_size[g, 0])


def test_the_outer_joint_follows_the_inner_one() -> None:
    hand = HANDS["three_fingers"]
    model = world(hand)
    data = mujoco.MjData(model)
    data.qpos[:] = hand_pose(model, hand, hand.opened(0.1))
    for motor in hand.actuators:
        data.actuator(motor).ctrl = 1.6
    data.ctrl[:7] = data.qpos[:7]
    for _ in range(600):
        mujoco.mj_step(model, data)
    for number in (1, 2, 3):
        inner, outer = (data.joint(f"finger_{number}{k}").qpos[0] for k in ("", "_tip"))
        assert inner == pytest.approx(1.6, abs=0.02)
        assert outer == pytest.approx(inner / 3, abs=0.01)
