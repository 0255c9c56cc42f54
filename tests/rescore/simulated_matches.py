"""Match tables of made-up image sets, before and after a rescoring, whose true figures a large set shows.

Images differ: in one, all cars are easier to see, or there is more clutter, or depth is better. So candidates
of one image are correlated, as in streets.
"""

from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray, IntArray
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, MatchTable


@dataclass(frozen=True, eq=False)
class Simulated:
    """Match tables of one set of candidates, ranked twice."""

    before: MatchTable
    after: MatchTable
    cars_of_image: IntArray

    @property
    def tables(self) -> dict[str, MatchTable]:
        return {"before": self.before, "after": self.after}


def simulate(n_images: int, rng: np.random.Generator, gain: float = 0.6) -> Simulated:
    """About 1.3 cars and 8 candidates an image; ``gain`` is how far depth parts hits from false alarms.

    Nine in ten cars have a candidate.
    """
    mood, clutter = rng.normal(0, 0.7, n_images), rng.gamma(2.0, 0.5, n_images)
    cars = 1 + rng.binomial(2, 0.15, n_images)
    car_image = np.repeat(np.arange(n_images), cars)
    clarity = rng.normal(size=len(car_image)) + 0.8 * mood[car_image]
    found = clarity > -1.75
    false_image = np.repeat(np.arange(n_images), np.minimum(rng.poisson(9 * clutter), 14))
    n_hits, n_false = int(found.sum()), len(false_image)
    image = np.concatenate([car_image[found], false_image])
    kinds = rng.choice(np.array([FALSE_ALARM, DUPLICATE], np.int8), n_false)
    outcome = np.concatenate([np.full(n_hits, HIT, np.int8), kinds])
    hit_score = 1.3 + 0.7 * clarity[found] + 0.5 * rng.normal(size=n_hits)
    before = np.concatenate([hit_score, rng.normal(size=n_false) - 0.3 * mood[false_image]])
    noise = 0.6 * rng.normal(size=len(image)) + 0.4 * rng.normal(size=n_images)[image]
    after = before + np.where(outcome == HIT, gain, -gain) / 2 + noise
    nowhere = np.full(len(image), -1)

    def table(ranking: FloatArray) -> MatchTable:
        return MatchTable(n_images, len(car_image), image, ranking, outcome, nowhere)

    return Simulated(table(before), table(after), cars)
