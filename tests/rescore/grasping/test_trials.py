"""Grasps in the physics engine, how they are judged, and what they may not depend on."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from recon.arrays import FloatArray
from recon.errors import Failure, Reason
from recon.localization.standing_box import StandingBox, turn
from rescore.grasping.act import PHASES, Record, execute
from rescore.grasping.cars import BREAKS_AT_N, experiment_cars, solid_of
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.choose import Estimate, Grasp, choose_grasp
from rescore.grasping.hands import HANDS
from rescore.grasping.judge import GENTLE_N, Ending, Verdict, count_causes, judge, wilson
from rescore.grasping.plan import Motion, _Room
from rescore.grasping.result_file import counted
from rescore.grasping.scene import MOUNT, OBJECT, world
from rescore.grasping.solids import Solid
from rescore.grasping.trial import grasp_and_judge, planned

mujoco = pytest.importorskip("mujoco")
HAND_NAMES = list(HANDS)


@lru_cache(maxsize=1)
def car() -> Solid:
    """A car that is none of the experiment's."""
    solid = solid_of(experiment_cars(8, "validation")[1])
    assert isinstance(solid, Solid)
    return solid


TRUTH = StandingBox(np.add(MOUNT.xy_m, (0.15, -0.5)), 2.0, np.array([0.27, 0.1, 0.08]))


def truth() -> StandingBox:
    return StandingBox(TRUTH.xy_m, TRUTH.yaw_rad, car().size_m)


def off(across_m: float = 0.0, along_m: float = 0.0) -> Estimate:
    true = truth()
    shift: FloatArray = turn(true.yaw_rad) @ [along_m, across_m]
    return Estimate(StandingBox(true.xy_m + shift, true.yaw_rad, true.size_m))


def motion_to(estimate: Estimate, hand: str) -> Motion:
    motion = planned(estimate, HANDS[hand], 0)
    assert isinstance(motion, Motion)
    return motion


@lru_cache(maxsize=4)
def record_of(hand: str, across_m: float) -> Record:
    return execute(motion_to(off(across_m), hand), HANDS[hand], car(), truth())


@pytest.mark.parametrize("hand", HAND_NAMES)
def test_a_car_is_lifted_held_shaken_and_put_down(hand: str) -> None:
    record = record_of(hand, 0.0)
    verdict = judge(record, car())
    assert verdict.ending is Ending.GENTLE
    assert verdict.cause is None
    assert 0.18 < verdict.lifted_m < 0.21
    assert verdict.pushed_n < 1.0
    assert verdict.moved_m < 0.01
    # it hangs level while it is held, and stands at the end
    assert np.rad2deg(record.tilt_rad[record.during("hold")].max()) < 5
    assert np.rad2deg(record.tilt_rad[-1]) < 1
    assert record.object_m[-1, 2] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("hand", HAND_NAMES)
def test_hand_and_arm_pass_through_neither_table_nor_car(hand: str) -> None:
    record = record_of(hand, 0.0)
    touching_table = np.count_nonzero(record.table_n > 0)
    touching_car = np.count_nonzero(record.forces_n[record.during("way", "line")].sum(axis=1) > 0)
    rest_on_car = np.count_nonzero(record.forces_n[:, 2] > 0)
    assert (touching_table, touching_car, rest_on_car) == (0, 0, 0)


@pytest.mark.parametrize("hand", HAND_NAMES)
@pytest.mark.parametrize(("across_m", "most_m"), [(0.0, 0.003), (0.045, 0.010)])
def test_bodies_give_way_by_millimetres_even_where_the_hand_lands_on_the_roof(
    hand: str, across_m: float, most_m: float
) -> None:
    record = record_of(hand, across_m)
    model = world(HANDS[hand], car())
    data = mujoco.MjData(model)
    deepest = {"table": 0.0, OBJECT: 0.0}
    for qpos in record.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for touch in data.contact:
            names = {model.body(model.geom_bodyid[g]).name.replace("world", "table") for g in touch.geom}
            if names != {"table", OBJECT}:
                for other in names & set(deepest):
                    deepest[other] = max(deepest[other], -float(touch.dist))
    assert deepest["table"] == 0.0
    assert 0.0 < deepest[OBJECT] < most_m


def test_the_planner_sees_arm_and_hand_in_table_and_box() -> None:
    room = _Room.of(HANDS["parallel_jaw"])
    grasp = choose_grasp(off(), HANDS["parallel_jaw"])
    assert isinstance(grasp, Grasp)
    room.place(off(), grasp)
    motion = motion_to(off(), "parallel_jaw")
    assert not room.touches(motion.line_rad[-1])
    # stretched out, level and a little down
    assert "the table" in room.touching(np.array([0.0, 1.9, 0.0, 0.0, 0.0, 0.0, 0.0]))
    room.place(Estimate(replace(truth(), size_m=np.array([0.27, 0.19, 0.08]))), grasp)
    assert "object" in room.touching(motion.line_rad[-1])


@pytest.mark.parametrize("hand", HAND_NAMES)
def test_the_hand_lands_on_a_car_that_stands_far_beside_the_estimate(hand: str) -> None:
    verdict = judge(record_of(hand, 0.045), car())
    assert verdict.pushed_n > GENTLE_N
    assert verdict.ending is not Ending.GENTLE


def test_the_same_seed_gives_the_same_record_byte_for_byte() -> None:
    first = record_of("three_fingers", 0.0)
    again = execute(motion_to(off(), "three_fingers"), HANDS["three_fingers"], car(), truth())
    for name in ("qpos", "forces_n", "object_m", "commands", "table_n"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()


def test_changing_the_truth_does_not_change_the_motion() -> None:
    hand = HANDS["three_fingers"]
    motion = motion_to(off(), "three_fingers")
    elsewhere = StandingBox(np.add(truth().xy_m, (0.03, -0.05)), truth().yaw_rad + 0.7, truth().size_m)
    other = replace(car(), mass_kg=3 * car().mass_kg)
    here, there = record_of("three_fingers", 0.0), execute(motion, hand, other, elsewhere)
    assert here.commands.tobytes() == there.commands.tobytes()
    assert here.phase.tobytes() == there.phase.tobytes()
    assert here.object_m.tobytes() != there.object_m.tobytes()


def test_the_fragile_car_breaks_above_its_force_and_not_below() -> None:
    record = record_of("three_fingers", 0.0)
    most = float(record.forces_n.max())
    weak = judge(record, replace(car(), breaks_at_n=0.9 * most))
    assert (weak.ending, weak.cause) == (Ending.FAILED, Cause.CRUSHED)
    assert judge(record, replace(car(), breaks_at_n=1.1 * most)).cause is None
    assert most < BREAKS_AT_N


def made_up(**changes: float) -> Record:
    """A record of two steps a phase in which a car is held, with changes."""
    given = {"push": 0.0, "shift": 0.0, "left": 5.0, "right": 5.0, "lift": 0.19, "after": 0.19} | changes
    n = 2 * len(PHASES)
    phase = np.repeat(np.arange(len(PHASES)), 2)
    forces, place = np.zeros((n, 3)), np.zeros((n, 3))
    index = {p: i for i, p in enumerate(PHASES)}
    forces[phase == index["line"], 2] = given["push"]
    place[phase >= index["line"], 0] = given["shift"]
    held = (phase >= index["close"]) & (phase <= index["down"])
    forces[held, 0], forces[held, 1] = given["left"], given["right"]
    place[(phase == index["lift"]) | (phase == index["hold"]), 2] = given["lift"]
    place[phase == index["shake"], 2] = given["after"]
    return Record(phase, forces, np.zeros(n), place, np.zeros(n), np.zeros((2, 30)), np.zeros((n, 10)))


@pytest.mark.parametrize(
    ("changes", "ending", "cause"),
    [
        ({}, Ending.GENTLE, None),
        ({"push": 19.9}, Ending.GENTLE, None),
        ({"push": 20.1}, Ending.PUSHED, None),
        ({"lift": 0.149, "after": 0.149}, Ending.FAILED, Cause.SLIPPED),
        ({"after": 0.0}, Ending.FAILED, Cause.SLIPPED),
        ({"left": 0.0}, Ending.FAILED, Cause.MISSED),
        ({"right": 0.0, "lift": 0.0, "after": 0.0}, Ending.FAILED, Cause.MISSED),
        ({"right": 0.0, "shift": 0.02, "lift": 0.0, "after": 0.0}, Ending.FAILED, Cause.PUSHED_AWAY),
        ({"shift": 0.02}, Ending.GENTLE, None),
        ({"push": 50.1}, Ending.FAILED, Cause.CRUSHED),
    ],
)
def test_verdicts_and_causes(changes: dict[str, float], ending: Ending, cause: Cause | None) -> None:
    verdict = judge(made_up(**changes), replace(car(), breaks_at_n=50.0))
    assert (verdict.ending, verdict.cause) == (ending, cause)


LOST = Failure(Reason.NO_OUTLINE, "a region expected, got none")


def test_what_perception_lost_is_a_failure_with_its_reason() -> None:
    verdict = grasp_and_judge(LOST, HANDS["parallel_jaw"], car(), truth(), 0)
    assert (verdict.cause, verdict.detail) == (Cause.NOT_LOCALISED, LOST.detail)


def standing(ahead_m: float, *size_m: float) -> Estimate:
    """An estimate straight before the arm, its length along the arm."""
    return Estimate(StandingBox(np.add(MOUNT.xy_m, (0.0, -ahead_m)), -np.pi / 2, np.array(size_m)))


def turned(estimate: Estimate, by_rad: float) -> Estimate:
    return replace(estimate, box=replace(estimate.box, yaw_rad=estimate.box.yaw_rad + by_rad))


LED_TO: dict[Cause, Callable[[], tuple[Estimate | Failure, Solid | Refusal]]] = {
    Cause.NOT_CLOSED: lambda: (off(), Refusal(Cause.NOT_CLOSED, "a surface around a body expected")),
    Cause.NOT_LOCALISED: lambda: (LOST, car()),
    Cause.BELOW_TABLE: lambda: (replace(off(), bottom_m=-0.1), car()),
    Cause.TOO_WIDE: lambda: (standing(0.55, 0.25, 0.2, 0.08), car()),
    Cause.OUT_OF_REACH: lambda: (standing(1.05, 0.25, 0.1, 0.08), car()),
    Cause.NO_PATH: lambda: (standing(0.4, 0.9, 0.02, 0.3), car()),
    Cause.CRUSHED: lambda: (off(), replace(car(), breaks_at_n=5.0)),
    Cause.PUSHED_AWAY: lambda: (turned(off(0.02, 0.08), 1.2), car()),
    Cause.MISSED: lambda: (off(along_m=0.2), car()),
    Cause.SLIPPED: lambda: (off(), replace(car(), mass_kg=15 * car().mass_kg)),
}
"""What leads to each cause in the engine."""


def test_every_cause_occurs_and_is_counted() -> None:
    assert set(LED_TO) == set(Cause)
    led = {c: grasp_and_judge(e, HANDS["parallel_jaw"], s, truth(), 0) for c, (e, s) in made_causes()}
    assert {c: v.cause for c, v in led.items()} == {c: c for c in Cause}
    assert count_causes(list(led.values())) == dict.fromkeys(Cause, 1)
    held, gentle, *_, failed_for = counted([*led.values(), Verdict(Ending.GENTLE)])
    assert (held, gentle) == ("1 of 11", "1 of 11")
    assert failed_for == ", ".join(f"{c.value} 1" for c in Cause)


def made_causes() -> list[tuple[Cause, tuple[Estimate | Failure, Solid | Refusal]]]:
    return [(c, make()) for c, make in LED_TO.items()]


def test_wilsons_interval_and_counts_of_causes() -> None:
    # R: prop.test(57, 60, correct = FALSE)
    assert wilson(57, 60) == pytest.approx((0.8630, 0.9829), abs=1e-4)
    assert wilson(60, 60) == pytest.approx((0.9398, 1.0), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)
    failed = [Verdict(Ending.FAILED, c) for c in (Cause.SLIPPED, Cause.MISSED, Cause.SLIPPED)]
    assert count_causes([*failed, Verdict(Ending.GENTLE)]) == {Cause.MISSED: 1, Cause.SLIPPED: 2}
