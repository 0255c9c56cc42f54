"""Two hands: three fingers after the BarrettHand BH8-280, and a parallel jaw.

Frames: the hand is mounted on the tool frame; z points out of the palm, y across the opening. The palm lies
at ``palm_m`` on z. Fingers are told apart as the two sides of the opening, ``LEFT`` at y > 0 and ``RIGHT``.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from recon.arrays import FloatArray
from rescore.grasping.arm import ARM, HAND, TABLE, THING

if TYPE_CHECKING:
    import mujoco

LEFT, RIGHT = "left", "right"
PAD_FRICTION = 0.9
"""Coulomb friction of the pads' rubber on painted metal."""
_STEEL, _RUBBER = (0.55, 0.57, 0.60, 1.0), (0.12, 0.12, 0.13, 1.0)


class Hand(Protocol):
    """What the rest needs to know of a hand."""

    def __hash__(self) -> int: ...

    @property
    def name(self) -> str:
        """Name in tables."""

    @property
    def palm_m(self) -> float:
        """Distance of the palm from the tool frame."""

    @property
    def widest_m(self) -> float:
        """Widest opening between the pads."""

    @property
    def narrowest_m(self) -> float:
        """Narrowest opening that is set beforehand."""

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the motors."""

    def depth_m(self, opening_m: float) -> float:
        """How far the middle of the pads lies below the palm at an opening."""

    def lowest_m(self, opening_m: float) -> float:
        """How far the lowest point lies below the palm at any opening from closed to this one."""

    def over_m(self, width_m: float, opening_m: float) -> float:
        """How far an object of a width has to stay below the palm at an opening, for the fingers' sake."""

    def opened(self, opening_m: float) -> FloatArray:
        """Targets of the motors at an opening, shape (motors,)."""

    def closed(self) -> FloatArray:
        """Targets of the motors that close the hand, shape (motors,)."""

    def add(self, spec: "mujoco.MjSpec", tool: Any) -> None:
        """Add the hand to a spec, mounted on the body of the tool frame."""


@dataclass(frozen=True)
class ThreeFingers:
    """Two fingers beside each other against one, each of two joints that one motor turns.

    Dimensions: BH8-Series User's Manual, D3000, section 9.5 (Aw 25 mm, A1 50 mm, A2 70 mm, A3 50 mm, Dw
    76 mm, Phi2 2.46 and Phi3 50 degrees). The outer joint turns a third of the inner one: the maker's page of
    conversion factors has 125 turns of the motor for one of the inner joint, 93.75 for one of the outer link.
    The breakaway of the maker's TorqueSwitch is left out. The spread is 0 for a grasp across: two fingers
    face one.
    """

    name: str = "three fingers"
    palm_m: float = 0.076
    spread_rad: float = 0.0
    """Angle by which the two fingers are turned apart about their axes."""
    force_n: float = 15.0
    """Force of the single finger at its tip; the other two press with half of it each."""
    pad_m: float = 0.009
    """Radius of the finger tips."""

    _CLOSED_RAD = 2.0
    _WIDEST_RAD = 0.55

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the motors."""
        return ("finger_1", "finger_2", "finger_3")

    def _tip(self, angle_rad: float) -> tuple[float, float]:
        """Distance of a tip from the middle, and below the palm, at an angle of the inner joint."""
        inner = angle_rad + _PHI2_RAD
        outer = angle_rad * (1 + _COUPLING) + _PHI2_RAD + _PHI3_RAD
        across = _A1_M + _A2_M * np.cos(inner) + _A3_M * np.cos(outer)
        return float(across), float(_A2_M * np.sin(inner) + _A3_M * np.sin(outer))

    @cached_property
    def _table(self) -> FloatArray:
        """Angle, opening and depth of the tips, shape (n, 3), by falling angle."""
        angles = np.linspace(self._CLOSED_RAD, self._WIDEST_RAD, 400)
        tips = np.array([self._tip(a) for a in angles])
        return np.stack([angles, 2 * (tips[:, 0] - self.pad_m), tips[:, 1]], axis=1)

    @property
    def widest_m(self) -> float:
        """Widest opening between the pads."""
        return float(self._table[-1, 1])

    @property
    def narrowest_m(self) -> float:
        """Narrowest opening that is set beforehand."""
        return 0.02

    def depth_m(self, opening_m: float) -> float:
        """How far the middle of the pads lies below the palm at an opening."""
        return float(np.interp(opening_m, self._table[:, 1], self._table[:, 2]))

    def lowest_m(self, opening_m: float) -> float:
        """How far the lowest point lies below the palm at any opening from closed to this one."""
        within = self._table[:, 1] <= opening_m
        return float(self._table[within, 2].max()) + self.pad_m

    def over_m(self, width_m: float, opening_m: float) -> float:
        """How far an object of a width has to stay below the palm: its inner links slant over its edges."""
        inner = float(self.opened(opening_m)[0]) + _PHI2_RAD
        beyond = max(0.0, width_m / 2 - _A1_M)
        return float(beyond * np.tan(inner) + _INNER_RADIUS_M / np.cos(inner))

    def opened(self, opening_m: float) -> FloatArray:
        """Targets of the motors at an opening, shape (3,)."""
        return np.full(3, np.interp(opening_m, self._table[:, 1], self._table[:, 0]))

    def closed(self) -> FloatArray:
        """Targets of the motors that close the hand, shape (3,)."""
        return np.full(3, self._CLOSED_RAD)

    def add(self, spec: "mujoco.MjSpec", tool: Any) -> None:
        """Add the hand to a spec, mounted on the body of the tool frame."""
        import mujoco  # noqa: PLC0415 - of the extra

        # masses: the maker's page "Mass properties by joint" (BH8-280)
        palm = tool.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            fromto=[0, 0, 0.004, 0, 0, self.palm_m - 0.002],
            size=[0.045, 0, 0],
        )
        _make(palm, _RUBBER, 0.589)
        for number, (x, side) in enumerate(((0.025, LEFT), (-0.025, LEFT), (0.0, RIGHT)), start=1):
            turned = {1: self.spread_rad, 2: -self.spread_rad, 3: np.pi}[number]
            # the finger's plane holds its own x, outwards, and the hand's z
            base = tool.add_body(
                name=f"{side}_{number}",
                pos=[x, 0, self.palm_m],
                quat=_about_z(np.pi / 2 + turned),
                gravcomp=1.0,
            )
            self._finger(spec, base, number, side)

    def _finger(self, spec: "mujoco.MjSpec", base: Any, number: int, side: str) -> None:
        import mujoco  # noqa: PLC0415

        knuckle = base.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0.012, 0, -0.012, _A1_M - 0.004, 0, -0.006],
            size=[0.011, 0, 0],
        )
        _make(knuckle, _STEEL, 0.08)
        lengths, starts = (_A2_M, _A3_M), (_PHI2_RAD, _PHI3_RAD)
        body, place = base, [_A1_M, 0.0, 0.0]
        for k, (length, start) in enumerate(zip(lengths, starts, strict=True)):
            body = body.add_body(
                name=f"{side}_{number}_{'io'[k]}", pos=place, quat=_about_minus_y(start), gravcomp=1.0
            )
            joint = body.add_joint(
                name=f"finger_{number}{('', '_tip')[k]}",
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=[0, -1, 0],
                range=[-0.05, 2.45] if k == 0 else [-0.05, 0.85],
                armature=0.002 if k == 0 else 0.0004,
                damping=0.02 if k == 0 else 0.004,
            )
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            radius = _INNER_RADIUS_M if k == 0 else self.pad_m
            geom = body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0.01 * (1 - k), 0, 0, length, 0, 0],
                size=[radius, 0, 0],
            )
            _make(geom, _STEEL if k == 0 else _RUBBER, 0.06 if k == 0 else 0.04)
            place = [length, 0.0, 0.0]
        _couple(spec, f"finger_{number}_tip", f"finger_{number}", _COUPLING)
        # the tip force acts on the inner joint's lever and, through the coupling, on the outer one's
        lever = 0.098 + _COUPLING * 0.046
        torque = lever * self.force_n * (1.0 if side == RIGHT else 0.5)
        _motor(spec, f"finger_{number}", stiffness=60.0, damping=1.2, force=torque)


_A1_M, _A2_M, _A3_M = 0.050, 0.070, 0.050
_PHI2_RAD, _PHI3_RAD = float(np.deg2rad(2.46)), float(np.deg2rad(50.0))
_COUPLING = 1 / 3
_INNER_RADIUS_M = 0.0085


@dataclass(frozen=True)
class ParallelJaw:
    """Two flat fingers on one slide each, which one motor moves against each other."""

    name: str = "parallel jaw"
    palm_m: float = 0.08
    widest_m: float = 0.140
    narrowest_m: float = 0.01
    force_n: float = 15.0
    """Force of each finger."""
    finger_m: float = 0.110
    """Length of the fingers below the palm."""
    pad_half_m: tuple[float, float] = (0.012, 0.014)
    """Half the width and height of the pads."""

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the motors."""
        return ("jaw",)

    def depth_m(self, opening_m: float) -> float:
        """How far the middle of the pads lies below the palm."""
        return self.finger_m - self.pad_half_m[1]

    def lowest_m(self, opening_m: float) -> float:
        """How far the lowest point lies below the palm."""
        return self.finger_m

    def over_m(self, width_m: float, opening_m: float) -> float:
        """How far an object has to stay below the palm; the fingers are straight."""
        return 0.0

    def opened(self, opening_m: float) -> FloatArray:
        """Target of the motor at an opening, shape (1,)."""
        return np.array([opening_m / 2])

    def closed(self) -> FloatArray:
        """Target of the motor that closes the hand, shape (1,)."""
        return np.array([0.0])

    def add(self, spec: "mujoco.MjSpec", tool: Any) -> None:
        """Add the hand to a spec, mounted on the body of the tool frame."""
        import mujoco  # noqa: PLC0415 - of the extra

        palm = tool.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[0, 0, self.palm_m / 2],
            size=[0.03, 0.085, self.palm_m / 2 - 0.002],
        )
        _make(palm, _RUBBER, 0.6)
        half, thick = self.pad_half_m, 0.006
        for side, sign in ((LEFT, 1.0), (RIGHT, -1.0)):
            body = tool.add_body(name=f"{side}_1", pos=[0, 0, self.palm_m], gravcomp=1.0)
            joint = body.add_joint(
                name="jaw" if side == LEFT else "jaw_other",
                type=mujoco.mjtJoint.mjJNT_SLIDE,
                axis=[0, sign, 0],
                range=[-0.002, self.widest_m / 2 + 0.002],
                armature=0.2,
                damping=4.0,
            )
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            long = self.finger_m - 2 * half[1]
            arm = body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=[0, sign * 1.4 * thick, long / 2],
                size=[half[0], thick / 2, long / 2],
            )
            _make(arm, _STEEL, 0.08)
            pad = body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=[0, sign * thick, self.finger_m - half[1]],
                size=[half[0], thick, half[1]],
            )
            _make(pad, _RUBBER, 0.03)
        _couple(spec, "jaw_other", "jaw", 1.0)
        _motor(spec, "jaw", stiffness=4000.0, damping=200.0, force=2 * self.force_n)


def _make(geom: Any, rgba: tuple[float, ...], mass_kg: float) -> None:
    """Give a piece of a hand its looks, mass and friction, and let it touch things and the table."""
    geom.rgba, geom.mass = rgba, mass_kg
    geom.friction = [PAD_FRICTION, 0.01, 0.0001]
    geom.condim, geom.priority = 4, 1
    geom.contype, geom.conaffinity = HAND, THING | TABLE | ARM


def _couple(spec: "mujoco.MjSpec", follower: str, leader: str, ratio: float) -> None:
    import mujoco  # noqa: PLC0415

    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=follower,
        name2=leader,
        data=[0, ratio, *([0] * 10)],
        solref=[0.006, 1.0],
    )


def _motor(spec: "mujoco.MjSpec", joint: str, stiffness: float, damping: float, force: float) -> None:
    import mujoco  # noqa: PLC0415

    motor = spec.add_actuator(
        name=joint,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        forcerange=[-force, force],
        gainprm=[stiffness] + [0] * 9,
        biasprm=[0, -stiffness, -damping] + [0] * 7,
    )
    motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE


def _about_z(angle_rad: float) -> list[float]:
    return [float(np.cos(angle_rad / 2)), 0.0, 0.0, float(np.sin(angle_rad / 2))]


def _about_minus_y(angle_rad: float) -> list[float]:
    return [float(np.cos(angle_rad / 2)), 0.0, -float(np.sin(angle_rad / 2)), 0.0]


HANDS: dict[str, Hand] = {"three_fingers": ThreeFingers(), "parallel_jaw": ParallelJaw()}
"""The hands by the names of files and options."""
