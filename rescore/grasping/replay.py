"""A finished trial once more, from its stored estimate: the same motion, now with all that was recorded."""

from dataclasses import dataclass

from datasets_synth.meshes.mesh import Mesh
from recon.arrays import UInt8Array
from recon.errors import Failure, RescoreError
from rescore.grasping.act import Record, execute
from rescore.grasping.cars import TableCar, solid_of
from rescore.grasping.causes import Refusal
from rescore.grasping.hands import HANDS
from rescore.grasping.judge import Verdict, judge
from rescore.grasping.plan import Motion
from rescore.grasping.result_file import GraspRow
from rescore.grasping.solids import Solid
from rescore.grasping.trial import placed_car, planned


@dataclass(frozen=True, eq=False)
class Replay:
    """One executed trial."""

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
