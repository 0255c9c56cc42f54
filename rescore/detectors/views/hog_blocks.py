"""Blocks of gradient histograms (Dalal and Triggs, CVPR 2005) on a dense grid, those of cv2.HOGDescriptor.

OpenCV counts a pixel anew in each block that it lies in: 16 at a stride of 4 px. What a pixel weighs in a
cell of a block is a weight across times a weight down, so here two products of matrices make the blocks.
"""

from functools import cache

import cv2
import numpy as np

from recon.arrays import Float32Array, UInt8Array

CELL_PX = 8
BLOCK_PX = 16
BINS = 9
LENGTH = 36
"""Numbers of a block: 2 x 2 cells of 9 bins each, down the left cells first."""
LARGEST = 0.2
"""Share of the norm of a block that one number of it has at most."""
TOGETHER = 8
"""Rows or columns of blocks made by one product of matrices."""


def block_features(picture: UInt8Array, stride_px: int) -> Float32Array:
    """Blocks (rows, columns, 36) of a grey picture, ``stride_px`` apart; what fills no cell is left off."""
    height, width = (n // CELL_PX * CELL_PX for n in picture.shape)
    rows, columns = (max(0, (n - BLOCK_PX) // stride_px + 1) for n in (height, width))
    # the numbers of a block lie columns apart: so do those that filters are multiplied with
    blocks = np.empty((rows, LENGTH, columns), np.float32)
    gradient = _gradient_numbers(np.ascontiguousarray(picture[:height, :width]))
    for first in range(0, rows if columns else 0, TOGETHER):
        some = blocks[first : first + TOGETHER]
        reach = slice(first * stride_px, (first + len(some) - 1) * stride_px + BLOCK_PX)
        votes = _votes().take(gradient[reach], axis=0)
        down = _cells(votes.reshape(len(votes), -1), len(some), stride_px)
        turned = down.reshape(2 * len(some), width, BINS).transpose(1, 0, 2)
        across = _cells(np.ascontiguousarray(turned).reshape(width, -1), columns, stride_px)
        cells = across.reshape(columns, 2, len(some), 2, BINS).transpose(2, 1, 3, 4, 0)
        some[:] = _normalised(cells.reshape(some.shape))
    return blocks.transpose(0, 2, 1)


def _gradient_numbers(picture: UInt8Array) -> np.ndarray[tuple[int, int], np.dtype[np.int32]]:
    """Rows of ``_votes`` (h, w): both differences of the neighbours of each pixel."""
    around = cv2.copyMakeBorder(picture, 1, 1, 1, 1, cv2.BORDER_REFLECT_101).astype(np.int32)
    down = around[2:, 1:-1] - around[:-2, 1:-1]
    return (down + 255) * 511 + (around[1:-1, 2:] - around[1:-1, :-2] + 255)


@cache
def _votes() -> Float32Array:
    """What a pixel adds to the bins, shape (511 * 511, 9), for each difference down and across."""
    down, across = np.meshgrid(*(np.arange(-255, 256, dtype=np.float32),) * 2, indexing="ij")
    length, angle_rad = cv2.cartToPolar(across, down)
    place = np.asarray(angle_rad) * np.float32(BINS / np.pi) - np.float32(0.5)
    low = np.floor(place)
    to_next = (place - low)[..., None]
    lower = low.astype(np.int64)[..., None] % BINS
    votes = np.zeros((*place.shape, BINS), np.float32)
    np.put_along_axis(votes, lower, np.asarray(length)[..., None] * (1 - to_next), axis=2)
    np.put_along_axis(votes, (lower + 1) % BINS, np.asarray(length)[..., None] * to_next, axis=2)
    return votes.reshape(-1, BINS)


def _cells(pixels: Float32Array, count: int, stride_px: int) -> Float32Array:
    """Weighted sums (count, 2, m) of pixels (n, m) over the two cells of each block along the first axis."""
    sums = np.empty((count, 2, pixels.shape[1]), np.float32)
    for first in range(0, count, TOGETHER):
        some = sums[first : first + TOGETHER]
        reach = slice(first * stride_px, (first + len(some) - 1) * stride_px + BLOCK_PX)
        np.matmul(_weights(len(some), stride_px), pixels[reach], out=some.reshape(2 * len(some), -1))
    return sums


@cache
def _weights(count: int, stride_px: int) -> Float32Array:
    """Weights (2 count, n) of n pixels in a row in the two cells of each of some blocks."""
    pixel = np.arange(BLOCK_PX)
    # OpenCV's: a Gaussian about a point half a pixel beside the middle, shared among cells by distance
    near_middle = np.exp(-((pixel - BLOCK_PX / 2) ** 2) / (2 * (BLOCK_PX / 4) ** 2))
    place = (pixel + 0.5) / CELL_PX - 0.5
    of_block = np.stack([np.maximum(0, 1 - np.abs(place - cell)) for cell in (0, 1)]) * near_middle
    weights = np.zeros((count, 2, (count - 1) * stride_px + BLOCK_PX), np.float32)
    for i in range(count):
        weights[i, :, i * stride_px : i * stride_px + BLOCK_PX] = of_block
    return weights.reshape(2 * count, -1)


def _normalised(cells: Float32Array) -> Float32Array:
    """Blocks (rows, 36, columns) of norm 1, in which no direction has more than its share (L2-Hys)."""
    cells = cells / (_norms(cells) + np.float32(0.1 * LENGTH))
    np.minimum(cells, np.float32(LARGEST), out=cells)
    cells /= _norms(cells) + np.float32(1e-3)
    return cells


def _norms(cells: Float32Array) -> Float32Array:
    return np.asarray(np.sqrt(np.einsum("ijk,ijk->ik", cells, cells))[:, None])
