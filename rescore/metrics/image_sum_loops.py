"""Compiled loops of ``rescore.metrics.image_sums``."""

from recon.arrays import Int32Array
from recon.compiled import exact


@exact
def add_weighted(sums: Int32Array, cell: Int32Array, image: Int32Array, weight: Int32Array) -> None:
    """Add to the sums (c, r) of the cell of each candidate (k,) the weights (m, r) of its image."""
    for k in range(len(cell)):
        own, row = weight[image[k]], sums[cell[k]]
        for r in range(len(row)):
            row[r] += own[r]
