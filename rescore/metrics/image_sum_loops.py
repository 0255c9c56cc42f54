"""Compiled loops of ``rescore.metrics.image_sums``."""

import numpy as np

from recon.arrays import Int32Array, IntArray
from recon.compiled import exact


@exact
def by_image(image: IntArray, cell: Int32Array, n_images: int) -> tuple[Int32Array, IntArray]:
    """The cells of candidates (k,) by image, and the place of the first of each image, (n_images + 1,)."""
    first = np.zeros(n_images + 1, np.int64)
    for i in image:
        first[i + 1] += 1
    first = np.cumsum(first)
    free, sorted_cell = first.copy(), np.empty_like(cell)
    for k in range(len(cell)):
        sorted_cell[free[image[k]]] = cell[k]
        free[image[k]] += 1
    return sorted_cell, first


@exact
def add_weighted(sums: Int32Array, cell: Int32Array, first: IntArray, weight: Int32Array) -> None:
    """Add to the sums (c, r) of the cell of each candidate the weights (m, r) of its image; those of image i
    are ``first[i]`` to ``first[i + 1]``."""
    for i in range(len(weight)):
        own = weight[i]
        for k in range(first[i], first[i + 1]):
            row = sums[cell[k]]
            for r in range(len(row)):
                row[r] += own[r]
