"""From an estimate to a motion: the rule of the opening, refusals, limits, and what it may not depend on."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rescore.grasping
from recon.arrays import FloatArray
from recon.localization.standing_box import StandingBox
from rescore.grasping.arm import ACCELERATION_RAD_S2, LIMITS_RAD, PARKED_RAD, SPEED_RAD_S
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.choose import MARGIN_M, Estimate, Grasp, choose_grasp
from rescore.grasping.hands import HANDS
from rescore.grasping.plan import Motion, _Room, _search, plan_motion, timed
from rescore.grasping.scene import MOUNT, STEP_S, bare_arm
from rescore.grasping.trial import REACH_M, planned

mujoco = pytest.importorskip("mujoco")
SIZE = np.array([0.25, 0.1, 0.08])


def estimate(ahead: float = 0.55, side: float = 0.0, yaw: float = 0.3, size: FloatArray = SIZE) -> Estimate:
    return Estimate(StandingBox(np.add(MOUNT.xy_m, (side, -ahead)), yaw, size))


def grasp_of(e: Estimate, hand: str = "three_fingers") -> Grasp:
    grasp = choose_grasp(e, HANDS[hand])
    assert isinstance(grasp, Grasp)
    return grasp


def motion_of(e: Estimate, hand: str = "three_fingers", seed: int = 0) -> Motion:
    motion = planned(e, HANDS[hand], seed)
    assert isinstance(motion, Motion)
    return motion


def test_the_hand_opens_by_the_estimated_width_and_the_margin() -> None:
    grasp = grasp_of(estimate())
    assert grasp.opening_m == pytest.approx(0.1 + MARGIN_M)
    assert grasp.xy_m == pytest.approx(estimate().box.xy_m)
    # the palm clears the roof, the fingers the table
    hand = HANDS["three_fingers"]
    assert grasp.palm_m > SIZE[2]
    assert grasp.palm_m - hand.lowest_m(grasp.opening_m) > 0


def test_a_method_without_a_width_opens_the_hand_as_wide_as_it_goes() -> None:
    for hand in HANDS.values():
        grasp = choose_grasp(replace(estimate(), width_known=False), hand)
        assert isinstance(grasp, Grasp)
        assert grasp.opening_m == hand.widest_m


@pytest.mark.parametrize(
    ("bad", "cause"),
    [
        (replace(estimate(), bottom_m=-0.1), Cause.BELOW_TABLE),
        (estimate(size=np.array([0.25, 0.2, 0.08])), Cause.TOO_WIDE),
        (estimate(ahead=1.05), Cause.OUT_OF_REACH),
        # the box reaches from the arm's foot over the place of the grasp
        (estimate(ahead=0.4, yaw=-np.pi / 2, size=np.array([1.0, 0.1, 0.7])), Cause.OUT_OF_REACH),
    ],
)
def test_what_cannot_be_grasped_is_refused_with_its_cause(bad: Estimate, cause: Cause) -> None:
    refusal = planned(bad, HANDS["parallel_jaw"], 0)
    assert isinstance(refusal, Refusal)
    assert refusal.cause is cause
    assert "expected" in refusal.detail


def test_a_box_that_the_arm_would_pass_through_has_no_path() -> None:
    # as high as the palm's way down, and longer than the distance to the arm
    wall = estimate(ahead=0.4, yaw=-np.pi / 2, size=np.array([0.9, 0.02, 0.3]))
    refusal = planned(wall, HANDS["parallel_jaw"], 0)
    assert isinstance(refusal, Refusal)
    assert refusal.cause is Cause.NO_PATH
    assert "touches object" in refusal.detail


def test_a_motion_keeps_the_limits_and_ends_at_the_grasp() -> None:
    hand = HANDS["three_fingers"]
    e = estimate(0.6, 0.15)
    motion = motion_of(e)
    np.testing.assert_array_equal(motion.way_rad[0], PARKED_RAD)
    np.testing.assert_allclose(motion.way_rad[-1], motion.line_rad[0], atol=1e-9)
    for joints in (motion.way_rad, motion.line_rad):
        assert (joints >= LIMITS_RAD[:, 0]).all()
        assert (joints <= LIMITS_RAD[:, 1]).all()
        speed = np.gradient(joints, STEP_S, axis=0)
        assert (np.abs(speed) <= SPEED_RAD_S * 1.001).all()
        assert (np.abs(np.gradient(speed, STEP_S, axis=0)) <= ACCELERATION_RAD_S2 * 1.001).all()
    model = bare_arm()
    data = mujoco.MjData(model)
    for k, up in ((0, 0.2), (-1, 0.0)):
        data.qpos[:] = motion.line_rad[k]
        mujoco.mj_kinematics(model, data)
        tool = model.body("tool").id
        wanted = [motion.grasp.tool_pose(hand, turned, up) for turned in (False, True)]
        off = [np.abs(data.xmat[tool].reshape(3, 3) - w[:3, :3]).max() for w in wanted]
        assert min(off) < 5e-3
        np.testing.assert_allclose(data.xpos[tool], wanted[0][:3, 3], atol=1e-3)


def test_all_of_the_stated_reach_is_reached() -> None:
    rng = np.random.default_rng(3)
    for hand in HANDS.values():
        for _ in range(12):
            distance, angle = rng.uniform(*REACH_M), rng.uniform(-0.8, 0.8)
            e = estimate(distance * np.cos(angle), distance * np.sin(angle), rng.uniform(-np.pi, np.pi))
            assert isinstance(planned(e, hand, 0), Motion)


def test_a_way_around_an_obstacle_is_found_and_is_the_same_every_time() -> None:
    hand = HANDS["parallel_jaw"]
    motion = motion_of(estimate(0.65, 0.2), "parallel_jaw")
    room = _Room.of(hand)
    # a block in the air, in the straight way from where the arm waits to above the object
    middle = motion.way_rad[len(motion.way_rad) // 2]
    model = bare_arm()
    data = mujoco.MjData(model)
    data.qpos[:] = middle
    mujoco.mj_kinematics(model, data)
    x, y, z = data.xpos[model.body("tool").id]
    cube = StandingBox(np.array([x, y]), 0.0, np.full(3, 0.05))
    room.place(Estimate(cube, bottom_m=z - 0.025), motion.grasp)
    assert room.touches(middle)
    assert not room.touches(PARKED_RAD)
    assert not room.touches(motion.way_rad[-1])
    ways = [_search(room, motion.way_rad[-1], seed) for seed in (7, 8, 7)]
    assert all(w is not None for w in ways)
    np.testing.assert_array_equal(ways[0], ways[2])
    assert not np.array_equal(ways[0], ways[1])
    assert len(ways[0]) > 2
    for a, b in zip(ways[0][:-1], ways[0][1:], strict=True):
        assert not any(room.touches(q) for q in np.linspace(a, b, 30))


def test_the_same_estimate_gives_the_same_motion_byte_for_byte() -> None:
    first, again = motion_of(estimate()), motion_of(estimate())
    other = motion_of(estimate(0.5501))
    assert first.way_rad.tobytes() == again.way_rad.tobytes()
    assert first.line_rad.tobytes() == again.line_rad.tobytes()
    assert first.line_rad.tobytes() != other.line_rad.tobytes()


def test_choosing_and_planning_import_nothing_that_knows_the_truth() -> None:
    folder = Path(rescore.grasping.__file__).parent
    for name in ("choose", "plan"):
        tree = ast.parse((folder / f"{name}.py").read_text())
        used = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module}
        own = {m.removeprefix("rescore.grasping.") for m in used if m.startswith("rescore.grasping")}
        assert own <= {"arm", "causes", "choose", "hands", "scene"}


def test_a_refusal_of_the_planner_needs_no_hand_that_fits() -> None:
    far = estimate(ahead=1.2)
    refusal = plan_motion(far, grasp_of(far), HANDS["three_fingers"], 0)
    assert isinstance(refusal, Refusal)
    assert refusal.cause is Cause.OUT_OF_REACH
    assert "1.20 m" in refusal.detail


def test_timing_takes_longer_where_a_joint_has_far_to_go() -> None:
    short = timed(np.stack([np.zeros(7), np.full(7, 0.01)]), 0.3)
    far = timed(np.stack([np.zeros(7), np.full(7, 2.0)]), 0.3)
    assert len(short) == round(0.3 / STEP_S) + 1
    # at an acceleration of at most 3 rad/s^2 two radians need 1.6 s at least
    assert len(far) * STEP_S > 1.6
    np.testing.assert_allclose(far[[0, -1]], [np.zeros(7), np.full(7, 2.0)])
