"""One trial in the order of the report: place, photograph, reconstruct, plan, grasp, judge; and once more."""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from datasets_synth.meshes.mesh import Mesh
from datasets_synth.photos.table_scene import Placement, photograph, place_at_random, visible_mesh
from recon.arrays import UInt8Array
from recon.errors import Failure, RescoreError
from recon.localization.standing_box import StandingBox
from rescore.grasping.act import Record, execute
from rescore.grasping.cars import TableCar, solid_of
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.choose import Estimate, choose_grasp
from rescore.grasping.hands import HANDS, Hand
from rescore.grasping.judge import Verdict, judge, refused
from rescore.grasping.perception import METHODS, TRUE_BOX, perceive
from rescore.grasping.plan import Motion, plan_motion
from rescore.grasping.result_file import BoxRow, GraspRow
from rescore.grasping.scene import MOUNT
from rescore.grasping.solids import Solid
from rescore.studies.localization.learned import TableClass
from rescore.studies.localization.trials import TrialConfig

REACH_M = (0.33, 0.76)
"""Distances of the middle of the car from the axis of the arm at which the hand gets to it from above."""
_TRIES = 1000


@dataclass(frozen=True, eq=False)
class PlacedCar:
    """A car on the table with its photograph."""

    placement: Placement
    rgb: UInt8Array
    """Shape (h, w, 3)."""
    mesh: Mesh
    """The car in the paint of the photograph."""


def placed_car(car: TableCar, index: int, number: int, seed: int) -> PlacedCar:
    """The ``number``-th placement of the ``index``-th car within reach, photographed."""
    rng = np.random.default_rng([seed, index, number])
    for _ in range(_TRIES):
        placement = place_at_random(car.model, rng)
        if within_reach(placement.box):
            break
    # the photograph draws the paint first
    mesh = visible_mesh(car.model, deepcopy(rng))
    return PlacedCar(placement, photograph([placement], rng), mesh)


def within_reach(box: StandingBox) -> bool:
    """Whether the middle of a box on the table lies where the hand gets from above."""
    distance = float(np.linalg.norm(box.xy_m - np.array(MOUNT.xy_m)))
    return REACH_M[0] <= distance <= REACH_M[1]


def run_trial(
    car: TableCar,
    index: int,
    number: int,
    table_class: TableClass,
    seed: int,
    methods: Sequence[str] = METHODS,
) -> GraspRow:
    """One placement of a car from its random draw to the verdicts on some methods."""
    placed = placed_car(car, index, number, seed)
    truth, solid = placed.placement.box, solid_of(car)
    estimates = perceive(placed.rgb, table_class, TrialConfig(), methods)
    if TRUE_BOX in methods:
        estimates[TRUE_BOX] = Estimate(truth)
    return GraspRow(
        car=car.name,
        index=index,
        placement=number,
        filled_from_outside=isinstance(solid, Solid) and solid.from_outside,
        truth=BoxRow.of(truth),
        estimates={
            m: e if isinstance(e, Failure) else BoxRow.of(e.box, e.width_known) for m, e in estimates.items()
        },
        verdicts={
            m: {h: grasp_and_judge(estimates[m], hand, solid, truth, seed) for h, hand in HANDS.items()}
            for m in methods
        },
    )


def planned(estimate: Estimate | Failure, hand: Hand, seed: int) -> Motion | Refusal:
    """The motion for an estimate, which depends on nothing else; a refusal where there is none."""
    if isinstance(estimate, Failure):
        return Refusal(Cause.NOT_LOCALISED, estimate.detail)
    grasp = choose_grasp(estimate, hand)
    return grasp if isinstance(grasp, Refusal) else plan_motion(estimate, grasp, hand, seed)


def grasp_and_judge(
    estimate: Estimate | Failure, hand: Hand, solid: Solid | Refusal, truth: StandingBox, seed: int
) -> Verdict:
    """The verdict on the grasp that an estimate leads to, of an object that stands at ``truth``."""
    if isinstance(solid, Refusal):
        return refused(solid)
    motion = planned(estimate, hand, seed)
    if isinstance(motion, Refusal):
        return refused(motion)
    return judge(execute(motion, hand, solid, truth), solid)


@dataclass(frozen=True, eq=False)
class Replay:
    """A finished trial once more, from its stored estimate: the same motion, with all that was recorded."""

    row: GraspRow
    method: str
    hand: str
    motion: Motion
    record: Record
    verdict: Verdict
    solid: Solid
    rgb: UInt8Array
    """The photograph, shape (h, w, 3)."""
    mesh: Mesh
    """The car as it looks."""


def replay(row: GraspRow, car: TableCar, seed: int, method: str, hand: str) -> Replay:
    """The trial of a row with one method and hand.

    Raises:
        RescoreError: there was no motion in this trial.
    """
    estimate, solid = row.estimates[method], solid_of(car)
    what = f"trial of {row.car}, placement {row.placement}"
    if isinstance(solid, Refusal):
        raise RescoreError(f"{what}: expected a motion, got {solid.cause}; choose another trial")
    motion = planned(estimate if isinstance(estimate, Failure) else estimate.estimate, HANDS[hand], seed)
    if isinstance(motion, Refusal):
        raise RescoreError(f"{what}: expected a motion, got {motion.cause}; choose another trial")
    placed = placed_car(car, row.index, row.placement, seed)
    record = execute(motion, HANDS[hand], solid, row.truth.box)
    return Replay(row, method, hand, motion, record, judge(record, solid), solid, placed.rgb, placed.mesh)
