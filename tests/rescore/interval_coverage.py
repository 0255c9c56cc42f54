"""How often bootstrap intervals hold the true figures, on simulated sets of correlated candidates.

``python tests/rescore/interval_coverage.py [sets] [images] [resamples]`` prints them all; 500 109 2000 where
nothing is given.
"""

import sys

import numpy as np

from recon.arrays import FloatArray
from rescore.metrics.bootstrap import Bootstrap, BootstrapConfig, Interval, bootstrap, reduction_factor
from rescore.metrics.resampled import Levels, weighted_figures
from tests.rescore.simulated_matches import Simulated, simulate

PAIR = ("before", "after")
TRUE_IMAGES = 200_000
"""Size of the set that stands for the truth: its own error is a fortieth of that of 109 images."""


def coverage(n_sets: int, n_images: int, n_resamples: int, seed: int) -> dict[str, float]:
    """Share of sets whose 95 % interval holds the true figure, by name of the figure."""
    config = BootstrapConfig(n_resamples=n_resamples)
    truth = true_figures(config.levels, seed)
    covered = dict.fromkeys(truth, 0)
    for i in range(n_sets):
        rng = np.random.default_rng([seed, 1, i])
        data = simulate(n_images, rng)
        found = named(bootstrap(data.tables, data.cars_of_image, [PAIR], rng, config))
        for name, value in truth.items():
            covered[name] += found[name].low <= value <= found[name].high
    return {name: count / n_sets for name, count in covered.items()}


def true_figures(levels: Levels, seed: int) -> dict[str, float]:
    """The figures of a very large set, by the names of ``named``."""
    data = simulate(TRUE_IMAGES, np.random.default_rng([seed, 0]))
    before, after = plain_figures(data, levels)
    first = 2 + len(levels.fppi)
    values = [*before, *after, *(after - before), *reduction_factor(before[first:], after[first:])]
    return dict(zip(names(levels), map(float, values), strict=True))


def plain_figures(data: Simulated, levels: Levels) -> tuple[FloatArray, FloatArray]:
    """The figures of both tables, every image once."""
    once = np.ones((1, len(data.cars_of_image)), np.int32)
    before, after = (weighted_figures(t, data.cars_of_image, once, levels)[0] for t in data.tables.values())
    return before, after


def names(levels: Levels) -> list[str]:
    """Names of all figures: each table's, their differences, the reduction factors."""
    readings = [f"recall at {v:g} FPPI" for v in levels.fppi] + [f"FPPI at {v:g}" for v in levels.recalls]
    figures = ["area", "AP", *readings]
    alone = [f"{of}: {figure}" for of in (*PAIR, "difference") for figure in figures]
    return alone + [f"factor at {v:g}" for v in levels.recalls]


def named(found: Bootstrap) -> dict[str, Interval]:
    """All intervals of a bootstrap of one pair, by name."""
    compared = found.comparisons[PAIR]
    levels = Levels(tuple(compared.difference.recall_at_fppi), tuple(compared.reduction))
    rows = [*(found.tables[name] for name in PAIR), compared.difference]
    intervals = [
        i
        for r in rows
        for i in (r.auc, r.average_precision, *r.recall_at_fppi.values(), *r.fppi_at_recall.values())
    ]
    return dict(zip(names(levels), [*intervals, *compared.reduction.values()], strict=True))


def main() -> None:
    """Print the table."""
    sizes = [int(a) for a in sys.argv[1:]]
    n_sets, n_images, n_resamples = sizes + [500, 109, 2000][len(sizes) :]
    truth = true_figures(Levels(), 0)
    print(f"{n_sets} sets of {n_images} images, {n_resamples} resamples")
    for name, share in coverage(n_sets, n_images, n_resamples, 0).items():
        print(f"{name:30s} true {truth[name]:7.3f}  covered {100 * share:5.1f} %")


if __name__ == "__main__":
    main()
