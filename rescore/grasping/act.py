"""A planned motion in the physics engine: approach, close, lift, hold, shake, put down; and what is measured.

The commands to the motors come from the plan alone; nothing that the engine measures changes them.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from recon.arrays import FloatArray, IntArray
from recon.localization.standing_box import StandingBox
from rescore.grasping.arm import JOINTS
from rescore.grasping.hands import LEFT, RIGHT, Hand
from rescore.grasping.plan import Motion, hand_pose
from rescore.grasping.scene import OBJECT, STEP_S, TOUCHES, pose_of, world
from rescore.grasping.solids import Solid

if TYPE_CHECKING:
    import mujoco

CLOSE_S, HOLD_S, SHAKE_S, OPEN_S = 1.0, 2.0, 1.5, 0.5
_CLOSE_WITHIN_S = 0.6
"""In this time the motors' targets go from open to closed."""
SHAKE_RAD: FloatArray = np.array([0.03, 0.0, 0.0, 0.03, 0.0, 0.0, 0.0])
"""Amplitude of the shake by joint, shape (7,): the arm swings sidewards and up and down."""
SHAKE_HZ = 2.0
TRACE_STEPS = 16
"""Steps of the engine from one kept pose to the next."""

PHASES = ("way", "line", "close", "lift", "hold", "shake", "down", "open", "away")


@dataclass(frozen=True, eq=False)
class Record:
    """What was measured of an executed motion; n steps, of which every ``TRACE_STEPS``-th pose is kept."""

    phase: IntArray
    """Index into ``PHASES`` at every step, shape (n,)."""
    forces_n: FloatArray
    """Forces between the object and left, right, and the rest of hand and arm at every step, shape (n, 3)."""
    table_n: FloatArray
    """Force between the table and hand or arm at every step, shape (n,)."""
    object_m: FloatArray
    """Place of the object's frame at every step, shape (n, 3)."""
    tilt_rad: FloatArray
    """Angle between the object's up and the table's at every step, shape (n,)."""
    qpos: FloatArray
    """Kept joint angles and poses of the engine, shape (k, nq)."""
    commands: FloatArray = field(repr=False)
    """Targets of all motors at every step, shape (n, motors)."""

    def during(self, *phases: str) -> IntArray:
        """Steps of these phases."""
        return np.nonzero(np.isin(self.phase, [PHASES.index(p) for p in phases]))[0]


def commands(motion: Motion, hand: Hand) -> tuple[FloatArray, IntArray]:
    """Targets of all motors (n, 7 + motors) and the phase (n,) at every step, from the plan alone."""
    down, up = motion.line_rad, motion.line_rad[::-1]
    at, top = np.repeat(down[-1:], _steps(CLOSE_S), axis=0), up[-1:]
    t = np.arange(_steps(SHAKE_S))[:, None] * STEP_S
    # a window that starts and ends the shake at rest
    swell = np.minimum(1.0, np.minimum(t, SHAKE_S - t) / 0.25)
    shake = top + swell * SHAKE_RAD * np.sin(2 * np.pi * SHAKE_HZ * t)
    opened, closed = motion.opening, hand.closed()
    share = np.minimum(1.0, np.arange(_steps(CLOSE_S))[:, None] * STEP_S / _CLOSE_WITHIN_S)
    closing = opened + share * (closed - opened)
    held = np.repeat(top, _steps(HOLD_S), axis=0)
    release = np.repeat(down[-1:], _steps(OPEN_S), axis=0)
    opening = closed + np.minimum(1.0, 2 * share[: _steps(OPEN_S)]) * (opened - closed)
    arm = [motion.way_rad, down, at, up, held, shake, down, release, up]
    fingers = [opened, opened, closing, closed, closed, closed, closed, opening, opened]
    rows = [
        np.hstack([a, np.broadcast_to(f, (len(a), len(closed)))]) for a, f in zip(arm, fingers, strict=True)
    ]
    phase = np.concatenate([np.full(len(r), i) for i, r in enumerate(rows)])
    return np.concatenate(rows), phase


def _steps(seconds: float) -> int:
    return round(seconds / STEP_S)


@lru_cache(maxsize=64)
def _world_of(hand: Hand, solid: Solid) -> "mujoco.MjModel":
    return world(hand, solid)


def execute(motion: Motion, hand: Hand, solid: Solid, truth: StandingBox) -> Record:
    """What happens when a motion is carried out at an object that stands at ``truth``."""
    import mujoco  # noqa: PLC0415 - of the extra
    from mujoco import rollout  # noqa: PLC0415

    model = _world_of(hand, solid)
    data = mujoco.MjData(model)
    place = model.joint(OBJECT).qposadr[0]
    data.qpos[:] = hand_pose(model, hand, motion.opening)
    data.qpos[place : place + 7] = pose_of(truth)
    targets, phase = commands(motion, hand)
    columns = np.empty_like(targets)
    columns[:, motor_order(model, hand)] = targets
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, start, kind)
    states, sensors = rollout.rollout(model, data, start, columns)
    # a state begins with the time
    qpos = states[0][:, 1 : 1 + model.nq]
    poses = qpos[:, place : place + 7]
    forces, table = _forces(model, sensors[0])
    up = 1 - 2 * (poses[:, 4] ** 2 + poses[:, 5] ** 2)
    tilt = np.arccos(np.clip(up, -1.0, 1.0))
    return Record(phase, forces, table, poses[:, :3].copy(), tilt, qpos[::TRACE_STEPS].copy(), targets)


def motor_order(model: "mujoco.MjModel", hand: Hand) -> list[int]:
    """The engine's number of each motor, those of the arm first, then those of the hand."""
    return [model.actuator(name).id for name in (*JOINTS, *hand.actuators)]


def _forces(model: "mujoco.MjModel", sensors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Forces on the object (n, 3) from left, right and the rest, and on the table (n,), from sensors."""
    sums = {LEFT: np.zeros(len(sensors)), RIGHT: np.zeros(len(sensors))}
    rest, table = np.zeros(len(sensors)), np.zeros(len(sensors))
    for s in range(model.nsensor):
        name = model.sensor(s).name
        start = model.sensor_adr[s]
        force = np.linalg.norm(sensors[:, start : start + 3], axis=1)
        what, _, who = name.partition(TOUCHES)
        if what == "table":
            table += force
        else:
            side = next((k for k in sums if who.startswith(k)), None)
            if side:
                sums[side] += force
            else:
                rest += force
    return np.stack([sums[LEFT], sums[RIGHT], rest], axis=1), table
