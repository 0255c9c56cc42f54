"""The motion to a grasp: joint angles by inverse kinematics, a way there that touches nothing, its timing.

Nothing here knows the true object: the estimated box stands in its place.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from recon.arrays import FloatArray
from rescore.grasping.arm import ACCELERATION_RAD_S2, LIMITS_RAD, PARKED_RAD, SPEED_RAD_S
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.choose import Estimate, Grasp
from rescore.grasping.hands import Hand
from rescore.grasping.scene import MOUNT, STEP_S, bare_arm, planning_world, pose_of

if TYPE_CHECKING:
    import mujoco

LIFT_M = 0.20
"""The object is lifted by this; the hand comes down along the same line."""
_LINE_STEP_M = 0.02
_LINE_SPEED_M_S = 0.2
"""Mean speed along the line."""
_CLEAR_M = 0.004
"""The estimated box is taken this much larger on all sides where its hand moves freely."""
_POSITION_M, _ANGLE_RAD = 5e-4, 2e-3
"""How well joint angles have to reach a pose."""
_CHECKS = 20_000
"""Poses that a search for a way may check."""
_RANGE_RAD = 0.6
_RESOLUTION_RAD = 0.03
"""Greatest step of a joint between two poses that are checked."""
_SOLVE_ROUNDS, _STEP_RAD = 60, 0.5


@dataclass(frozen=True, eq=False)
class Motion:
    """A planned motion, in joint angles at every step of the engine."""

    grasp: Grasp
    way_rad: FloatArray
    """From where the arm waits to the top of the line, shape (n, 7)."""
    line_rad: FloatArray
    """From the top of the line down to the grasp, shape (m, 7)."""
    opening: FloatArray
    """Targets of the hand's motors on the way, shape (motors,)."""


def plan_motion(estimate: Estimate, grasp: Grasp, hand: Hand, seed: int) -> Motion | Refusal:
    """The motion to a grasp, the same for the same estimate, hand and seed; a refusal where there is none."""
    room = _Room.of(hand)
    room.place(estimate, grasp)
    refusals: list[Refusal] = []
    for turned in _nearer_turn_first(grasp):
        line = _line(room, grasp, turned)
        if isinstance(line, Refusal):
            refusals.append(line)
            continue
        hit = next((i for i, q in enumerate(line) if room.touches(q)), None)
        if hit is not None:
            refusals.append(Refusal(Cause.NO_PATH, f"a free line down expected, {room.touching(line[hit])}"))
            continue
        way = _way(room, line[0], seed)
        if isinstance(way, Refusal):
            refusals.append(way)
            continue
        # the line is bowed by less than a tenth of a millimetre between its points
        seconds = LIFT_M / _LINE_SPEED_M_S
        return Motion(grasp, _timed_way(way), timed(line, seconds), hand.opened(grasp.opening_m))
    return refusals[0]


@dataclass(eq=False)
class _Room:
    """The planning scene: arm, hand, table, and the estimated box."""

    hand: Hand
    model: "mujoco.MjModel"
    data: "mujoco.MjData"
    solver: "_Solver"
    box: int
    """Geom of the estimated box."""

    @staticmethod
    @lru_cache(maxsize=4)
    def of(hand: Hand) -> "_Room":
        """The scene for a hand, built once in a process."""
        import mujoco  # noqa: PLC0415 - of the extra

        model = planning_world(hand)
        return _Room(hand, model, mujoco.MjData(model), _Solver.of_arm(), model.geom("object").id)

    def place(self, estimate: Estimate, grasp: Grasp) -> None:
        """Put the estimated box and the opening of the hand into the scene."""
        import mujoco  # noqa: PLC0415

        pose = pose_of(estimate.box)
        height = float(estimate.box.size_m[2])
        pose[2] = estimate.bottom_m + height / 2
        self.data.mocap_pos[0], self.data.mocap_quat[0] = pose[:3], pose[3:]
        self.model.geom_size[self.box] = estimate.box.size_m / 2 + _CLEAR_M
        radius = float(np.linalg.norm(self.model.geom_size[self.box]))
        self.model.geom_rbound[self.box] = radius
        self.model.geom_aabb[self.box, 3:] = self.model.geom_size[self.box]
        self.data.qpos[:] = hand_pose(self.model, self.hand, self.hand.opened(grasp.opening_m))
        mujoco.mj_kinematics(self.model, self.data)

    def touches(self, joints_rad: FloatArray) -> bool:
        """Whether arm or hand touch anything at these joint angles, shape (7,)."""
        import mujoco  # noqa: PLC0415

        self.data.qpos[:7] = joints_rad
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        return bool(self.data.ncon > 0)

    def touching(self, joints_rad: FloatArray) -> str:
        """What touches what at these joint angles, in words."""
        if not self.touches(joints_rad):
            return "nothing touches"
        names = [self.model.body(self.model.geom_bodyid[g]).name for g in self.data.contact.geom[0]]
        return f"{names[0]} touches {names[1]}".replace("world", "the table")


def hand_pose(model: "mujoco.MjModel", hand: Hand, targets: FloatArray) -> FloatArray:
    """All joint angles (nq,) with the arm parked and the hand's joints where its motors' targets are."""
    out = np.array(model.qpos0)
    out[:7] = PARKED_RAD
    for name, target in zip(hand.actuators, targets, strict=True):
        out[model.joint(name).qposadr[0]] = target
    for k in range(model.neq):
        follower, leader = (model.jnt_qposadr[j] for j in (model.eq_obj1id[k], model.eq_obj2id[k]))
        out[follower] = model.eq_data[k, 1] * out[leader]
    return out


@dataclass(eq=False)
class _Solver:
    """Inverse kinematics of the arm by mink."""

    configuration: Any
    frame: Any
    posture: Any
    limits: list[Any]

    @staticmethod
    @lru_cache(maxsize=1)
    def of_arm() -> "_Solver":
        """The solver for the bare arm, built once in a process."""
        import mink  # noqa: PLC0415 - of the extra

        model = bare_arm()
        configuration = mink.Configuration(model)
        frame = mink.FrameTask("tool", "body", position_cost=1.0, orientation_cost=0.3, lm_damping=1e-6)
        posture = mink.PostureTask(model, cost=1e-4)
        return _Solver(configuration, frame, posture, [mink.ConfigurationLimit(model)])

    def solve(self, pose: FloatArray, start: FloatArray) -> FloatArray | None:
        """Joint angles (7,) that bring the tool frame to a pose (4, 4), from a start; None where none do."""
        import mink  # noqa: PLC0415

        self.configuration.update(start)
        self.frame.set_target(mink.SE3.from_matrix(pose))
        self.posture.set_target(start)
        for _ in range(_SOLVE_ROUNDS):
            error = self.frame.compute_error(self.configuration)
            if np.linalg.norm(error[:3]) < _POSITION_M and np.linalg.norm(error[3:]) < _ANGLE_RAD:
                return np.array(self.configuration.q)
            try:
                speed = mink.solve_ik(
                    self.configuration, [self.frame, self.posture], 1.0, "daqp", limits=self.limits
                )
            except mink.NoSolutionFound:
                return None
            largest = float(np.abs(speed).max())
            self.configuration.integrate_inplace(speed * min(1.0, _STEP_RAD / largest), 1.0)
        return None


def _nearer_turn_first(grasp: Grasp) -> tuple[bool, bool]:
    """The two ways in which the hand may be turned, first that which turns the wrist less."""
    away = (grasp.yaw_rad - MOUNT.yaw_rad + np.pi) % (2 * np.pi) - np.pi
    turned = abs(away) < np.pi / 2
    return turned, not turned


def _line(room: _Room, grasp: Grasp, turned: bool) -> FloatArray | Refusal:
    """Joint angles (n, 7) along the line from its top down to the grasp."""
    heights = np.arange(LIFT_M, -1e-9, -_LINE_STEP_M)
    for seed in _seeds(grasp, turned):
        found, joints = [], seed
        for up in heights:
            solved = room.solver.solve(grasp.tool_pose(room.hand, turned, float(up)), joints)
            if solved is None:
                break
            found.append(solved)
            joints = solved
        else:
            return np.array(found)
    distance = float(np.linalg.norm(grasp.xy_m - np.array(MOUNT.xy_m)))
    return Refusal(
        Cause.OUT_OF_REACH, f"a place within reach expected, got one {distance:.2f} m from the arm"
    )


def _seeds(grasp: Grasp, turned: bool) -> list[FloatArray]:
    """Joint angles (7,) to start from: facing the object, elbow up, folded more or less."""
    x, y = grasp.xy_m - np.array(MOUNT.xy_m)
    facing = float(np.arctan2(y, x)) - MOUNT.yaw_rad
    facing = (facing + np.pi) % (2 * np.pi) - np.pi
    yaw = grasp.yaw_rad + np.pi * turned - MOUNT.yaw_rad - facing
    # with the tool down, its x points back at the arm
    wrist = (np.pi - yaw + np.pi) % (2 * np.pi) - np.pi
    out = []
    for shoulder, elbow in ((0.3, 2.0), (0.9, 1.2), (-0.3, 2.6)):
        out.append(np.array([facing, shoulder, 0.0, elbow, 0.0, np.pi - shoulder - elbow, wrist]))
    return [np.clip(q, LIMITS_RAD[:, 0] + 0.01, LIMITS_RAD[:, 1] - 0.01) for q in out]


def _way(room: _Room, goal: FloatArray, seed: int) -> FloatArray | Refusal:
    """Corners (k, 7) of a way from where the arm waits to a goal: RRT-Connect (Kuffner and LaValle 2000)."""
    for end, where in ((PARKED_RAD, "where it waits"), (goal, "above the object")):
        if room.touches(end):
            return Refusal(Cause.NO_PATH, f"a free arm {where} expected, {room.touching(end)}")
    if not _blocked(room, PARKED_RAD, goal):
        return np.stack([PARKED_RAD, goal])
    corners = _search(room, goal, seed)
    if corners is None:
        return Refusal(Cause.NO_PATH, f"a way to the object expected, none was found among {_CHECKS} poses")
    return _shortened(room, corners, seed)


def _search(room: _Room, goal: FloatArray, seed: int) -> FloatArray | None:
    from ompl import base, geometric, util  # noqa: PLC0415 - of the extra

    # it warns that numbers were drawn before; each search makes its generators anew from this seed
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed + 1)
    space = base.RealVectorStateSpace(7)
    bounds = base.RealVectorBounds(7)
    for i, (low, high) in enumerate(LIMITS_RAD):
        bounds.setLow(i, float(low))
        bounds.setHigh(i, float(high))
    space.setBounds(bounds)
    info = base.SpaceInformation(space)
    checks = 0

    def free(state: Any) -> bool:
        nonlocal checks
        checks += 1
        return not room.touches(np.array([state[i] for i in range(7)]))

    info.setStateValidityChecker(free)
    info.setStateValidityCheckingResolution(_RESOLUTION_RAD / space.getMaximumExtent())
    info.setup()
    problem = base.ProblemDefinition(info)
    ends = space.allocState(), space.allocState()
    for end, joints in zip(ends, (PARKED_RAD, goal), strict=True):
        for i in range(7):
            end[i] = float(joints[i])
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(info)
    planner.setRange(_RANGE_RAD)
    planner.setProblemDefinition(problem)
    planner.setup()
    # a time limit would make results depend on the machine
    planner.solve(base.PlannerTerminationCondition(lambda: checks > _CHECKS))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    states = [path.getState(k) for k in range(path.getStateCount())]
    return np.array([[s[i] for i in range(7)] for s in states])


def _blocked(room: _Room, a: FloatArray, b: FloatArray) -> bool:
    steps = int(np.ceil(np.abs(b - a).max() / _RESOLUTION_RAD)) + 1
    return any(room.touches(q) for q in np.linspace(a, b, steps + 1))


def _shortened(room: _Room, corners: FloatArray, seed: int) -> FloatArray:
    """A way with detours cut off between corners drawn at random."""
    rng = np.random.default_rng(seed)
    way = list(corners)
    for _ in range(40):
        if len(way) < 3:
            break
        i, j = np.sort(rng.choice(len(way), 2, replace=False))
        if j - i > 1 and not _blocked(room, way[i], way[j]):
            way[i + 1 : j] = []
    return np.array(way)


def _timed_way(corners: FloatArray) -> FloatArray:
    """Joint angles (n, 7) at every step of the engine, at rest in every corner (k, 7)."""
    return np.concatenate([timed(np.stack([a, b]), 0.3) for a, b in pairwise(corners)])


def timed(points: Sequence[FloatArray] | FloatArray, least_s: float) -> FloatArray:
    """Joint angles (n, 7) at every step of the engine along points (k, 7), at rest at both ends.

    It takes ``least_s`` seconds, or longer where a joint would pass its largest speed or acceleration.
    """
    path = np.asarray(points)
    seconds = least_s
    while True:
        steps = int(np.ceil(seconds / STEP_S))
        t = np.linspace(0.0, 1.0, steps + 1)
        share = t**3 * (10 - 15 * t + 6 * t**2)
        joints = _along(path, share)
        speed = np.gradient(joints, STEP_S, axis=0)
        change = np.gradient(speed, STEP_S, axis=0)
        slower = max(
            float((np.abs(speed) / SPEED_RAD_S).max()),
            float(np.sqrt((np.abs(change) / ACCELERATION_RAD_S2).max())),
        )
        if slower <= 1.0 + 1e-6:
            return joints
        seconds *= slower * 1.001


def _along(path: FloatArray, share: FloatArray) -> FloatArray:
    """Points (n, 7) at shares (n,) of the length of a path (k, 7), smooth where it has more than two."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - slow to import

    if len(path) == 2:
        return np.asarray(path[0] + share[:, None] * (path[1] - path[0]))
    return np.asarray(CubicSpline(np.linspace(0.0, 1.0, len(path)), path, axis=0)(share))
