"""Whether a grasp held: the only place that looks at the true object."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from rescore.grasping.act import Record
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.solids import Solid

LIFTED_M = 0.15
"""Least height of the object above where it stood, at the end of the lift, of the hold and of the shake."""
GENTLE_N = 20.0
"""A gentle grasp pushes the object with less than this before the hand closes."""
_TOUCH_N = 0.2
"""A side touches the object with at least this force."""
_MOVED_M = 0.010
"""An object that moved more before the hand closed was pushed."""
_CRUSHES = ("close", "lift", "hold", "shake", "down")


class Ending(StrEnum):
    """How a trial ended; the value is what files show."""

    GENTLE = "gentle"
    """Held, and not pushed with more than ``GENTLE_N`` before the hand closed."""
    PUSHED = "pushed"
    """Held, after the hand had pushed it."""
    FAILED = "failed"


@dataclass(frozen=True)
class Verdict:
    """How one trial ended."""

    ending: Ending
    cause: Cause | None = None
    """Why it failed; None where it did not."""
    detail: str = ""
    """What was expected and what came, of a refusal."""
    pushed_n: float = 0.0
    """Largest force on the object before the hand closed."""
    most_n: float = 0.0
    """Largest force of one side on the object."""
    lifted_m: float = 0.0
    """Height above where it stood, the least of those after lift, hold and shake."""
    moved_m: float = 0.0
    """How far from where it stood it was put down, on the table."""
    table_n: float = 0.0
    """Largest force between the table and hand or arm."""

    @property
    def held(self) -> bool:
        """Whether the object was lifted and held, gently or not."""
        return self.ending != Ending.FAILED


def refused(refusal: Refusal) -> Verdict:
    """The verdict on a trial that ended before the arm moved."""
    return Verdict(Ending.FAILED, refusal.cause, refusal.detail)


def judge(record: Record, solid: Solid) -> Verdict:
    """The verdict on an executed motion."""
    before = record.during("way", "line")
    still = record.object_m[0]
    pushed = float(record.forces_n[before].sum(axis=1).max())
    ends = [record.during(phase)[-1] for phase in ("lift", "hold", "shake")]
    lifted = float(min(record.object_m[k, 2] - still[2] for k in ends))
    sides = record.forces_n[:, :2]
    both = bool((sides[record.during("close")[-1]] > _TOUCH_N).all())
    most = float(record.forces_n.max())
    held = lifted >= LIFTED_M and bool(all((sides[k] > _TOUCH_N).all() for k in ends))
    if bool((record.forces_n[record.during("way", "line", *_CRUSHES)] > solid.breaks_at_n).any()):
        cause = Cause.CRUSHED
    elif held:
        cause = None
    elif float(np.linalg.norm(record.object_m[before[-1], :2] - still[:2])) > _MOVED_M:
        cause = Cause.PUSHED_AWAY
    else:
        cause = Cause.SLIPPED if both else Cause.MISSED
    ending = Ending.FAILED if cause else Ending.GENTLE if pushed < GENTLE_N else Ending.PUSHED
    return Verdict(
        ending,
        cause,
        "",
        pushed,
        most,
        lifted,
        float(np.linalg.norm(record.object_m[-1, :2] - still[:2])),
        float(record.table_n.max()),
    )


def wilson(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Lower and upper end of Wilson's interval for a share of successes; (0, 1) of no trials.

    After E. B. Wilson, "Probable inference, the law of succession, and statistical inference", J. Am. Stat.
    Assoc. 22, 1927; ``z`` 1.96 is for 95 %.
    """
    if not trials:
        return 0.0, 1.0
    share = successes / trials
    width = z * np.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2))
    middle, scale = share + z**2 / (2 * trials), 1 + z**2 / trials
    return float(max(0.0, (middle - width) / scale)), float(min(1.0, (middle + width) / scale))


def count_causes(verdicts: Sequence[Verdict]) -> dict[Cause, int]:
    """How often each cause made a trial fail, in the order of ``Cause``, without those that never did."""
    counts = {c: sum(v.cause == c for v in verdicts) for c in Cause}
    return {c: n for c, n in counts.items() if n}
