"""Image fragments and their features (Murphy, Torralba and Freeman, NIPS 2003; Torralba et al., PAMI 2007).

A fragment is a small patch cut from a filtered training crop, with the place where it was cut. Its feature
in a window is the greatest normalised correlation of the patch with the filtered picture near that place.
Correlations are taken on a grid of pixels, once for all windows of a level.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from recon.arrays import Float32Array, IntArray, UInt8Array
from recon.errors import RescoreError
from rescore.detectors.windows import WindowGeometry
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_blas_thread

FILTERS = ("identity", "x_derivative", "y_derivative", "laplacian")
"""The filter bank. The last three are rectified: a dark car on light ground has the edges of a light one."""
FILTER_RADIUS_PX = 1
MIN_CONTRAST = 1.0
"""Grey levels of contrast that a patch of the dictionary has at least."""


@dataclass(frozen=True)
class FragmentConfig:
    """The dictionary of fragments."""

    count: int = 600
    """Fragments in the dictionary, before boosting picks some."""
    sizes_px: tuple[int, ...] = (9, 15)
    """Sides of the square patches."""
    grid_px: int = 2
    """Step in pixels of the grid on which correlations are taken."""
    mask_radius: int = 2
    """How far from its place a fragment may be found, in grid steps."""
    noise_floor: float = 0.7
    """Contrast in grey levels below which a patch counts as flat: its correlation goes to zero. Cars in low
    light have little more, so it is small."""


@dataclass(frozen=True, eq=False)
class Dictionary:
    """Fragments of one patch size stay apart: ``patches[i]`` holds those of ``config.sizes_px[i]``."""

    patches: tuple[Float32Array, ...]
    """One (count, size, size) array a size; each patch has mean 0 and norm 1."""
    filter_index: tuple[IntArray, ...]
    """One (count,) array a size: which filter the patch was cut from."""
    place: tuple[IntArray, ...]
    """One (count, 2) array a size: grid (x, y) of the patch's corner in the window."""
    config: FragmentConfig

    def __post_init__(self) -> None:
        if not len(self.patches) == len(self.filter_index) == len(self.place) == len(self.config.sizes_px):
            raise ValueError("dictionary: one group of fragments a size")
        for patch, which, place, size in zip(
            self.patches, self.filter_index, self.place, self.config.sizes_px, strict=True
        ):
            if (
                patch.shape[1:] != (size, size)
                or which.shape != (len(patch),)
                or place.shape != (len(patch), 2)
            ):
                raise ValueError(
                    f"dictionary: {patch.shape}, {which.shape}, {place.shape} do not fit size {size}"
                )

    def __len__(self) -> int:
        return sum(len(p) for p in self.patches)

    def chosen(self, index: IntArray) -> "Dictionary":
        """The fragments at ascending indices; groups are kept, and some may be empty."""
        ends = np.cumsum([0, *(len(p) for p in self.patches)])
        parts = [index[(index >= a) & (index < b)] - a for a, b in pairwise(ends)]
        return Dictionary(
            tuple(p[i] for p, i in zip(self.patches, parts, strict=True)),
            tuple(p[i] for p, i in zip(self.filter_index, parts, strict=True)),
            tuple(p[i] for p, i in zip(self.place, parts, strict=True)),
            self.config,
        )

    @staticmethod
    def joined(parts: "Sequence[Dictionary]") -> "Dictionary":
        """The fragments of dictionaries of one config, size by size."""
        groups = range(len(parts[0].patches))
        return Dictionary(
            tuple(np.concatenate([p.patches[i] for p in parts]) for i in groups),
            tuple(np.concatenate([p.filter_index[i] for p in parts]) for i in groups),
            tuple(np.concatenate([p.place[i] for p in parts]) for i in groups),
            parts[0].config,
        )

    @staticmethod
    def empty(config: FragmentConfig) -> "Dictionary":
        """A dictionary without fragments."""
        return Dictionary(
            tuple(np.zeros((0, size, size), np.float32) for size in config.sizes_px),
            tuple(np.zeros(0, np.int64) for _ in config.sizes_px),
            tuple(np.zeros((0, 2), np.int64) for _ in config.sizes_px),
            config,
        )

    def as_arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of a detector file."""
        arrays: dict[str, NDArray[Any]] = {}
        for i, (patches, filters, places) in enumerate(
            zip(self.patches, self.filter_index, self.place, strict=True)
        ):
            arrays |= {f"patches_{i}": patches, f"filter_index_{i}": filters, f"place_{i}": places}
        return arrays

    @staticmethod
    def of_arrays(arrays: Mapping[str, NDArray[Any]], config: FragmentConfig) -> "Dictionary":
        """The dictionary of a detector file."""
        groups = range(len(config.sizes_px))
        return Dictionary(
            tuple(arrays[f"patches_{i}"] for i in groups),
            tuple(arrays[f"filter_index_{i}"] for i in groups),
            tuple(arrays[f"place_{i}"] for i in groups),
            config,
        )


def filter_responses(picture: UInt8Array) -> Float32Array:
    """Responses (4, h - 2, w - 2) of the filter bank; the border that would need outside pixels is left off.

    All kernels are integers, so that responses are exact and a crop has those of the picture it is cut from.
    """
    r = FILTER_RADIUS_PX
    inside = (slice(r, -r), slice(r, -r))
    # gains bring noise in all responses near that of the picture
    edges = (
        cv2.Sobel(picture, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 4),
        cv2.Sobel(picture, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 4),
        cv2.Laplacian(picture, cv2.CV_32F, ksize=3, scale=1 / 8),
    )
    bank = np.empty((len(FILTERS), picture.shape[0] - 2 * r, picture.shape[1] - 2 * r), np.float32)
    np.subtract(picture[inside], np.float32(128), out=bank[0])
    for response, edge in zip(bank[1:], edges, strict=True):
        np.abs(edge[inside], out=response)
    return bank


def grid_size(height_px: int, width_px: int, size_px: int, grid_px: int) -> tuple[int, int]:
    """Rows and columns of correlations of a patch in a picture of that size."""
    reach = size_px + 2 * FILTER_RADIUS_PX
    return max(0, (height_px - reach) // grid_px + 1), max(0, (width_px - reach) // grid_px + 1)


def cut_dictionary(
    crops: UInt8Array, window: WindowGeometry, config: FragmentConfig, rng: np.random.Generator
) -> Dictionary:
    """Fragments cut at random from canonical crops (n, height, width) of cars.

    A fragment lies where its mask stays inside the window, so that a crop tells all of its features.
    Patches without contrast are drawn again.

    Raises:
        RescoreError: the window is too small for the patches, or the crops have no contrast.
    """
    quota = np.diff(np.linspace(0, config.count, len(config.sizes_px) + 1).astype(int))
    groups = [
        _cut_group(crops, window, config, size, n, rng)
        for size, n in zip(config.sizes_px, quota, strict=True)
    ]
    patches, filters, places = zip(*groups, strict=True)
    return Dictionary(patches, filters, places, config)


def _cut_group(
    crops: UInt8Array,
    window: WindowGeometry,
    config: FragmentConfig,
    size: int,
    count: int,
    rng: np.random.Generator,
) -> tuple[Float32Array, IntArray, IntArray]:
    rows, columns = grid_size(window.height_px, window.width_px, size, config.grid_px)
    r = config.mask_radius
    if rows <= 2 * r or columns <= 2 * r:
        raise RescoreError(
            f"fragments: a window of {window.width_px} x {window.height_px} px has no room for "
            f"patches of {size} px that move by {r * config.grid_px} px; take smaller patches"
        )
    patches = np.empty((count, size, size), np.float32)
    filters, places = np.empty(count, np.int64), np.empty((count, 2), np.int64)
    done = 0
    for _ in range(50 * count):
        if done == count:
            return patches, filters, places
        responses = filter_responses(crops[rng.integers(len(crops))])
        which = int(rng.integers(len(FILTERS)))
        gx, gy = int(rng.integers(r, columns - r)), int(rng.integers(r, rows - r))
        x, y = gx * config.grid_px, gy * config.grid_px
        patch = responses[which, y : y + size, x : x + size]
        patch = patch - patch.mean()
        norm = float(np.linalg.norm(patch))
        if norm > max(4 * config.noise_floor, MIN_CONTRAST) * size:
            patches[done], filters[done], places[done] = patch / norm, which, (gx, gy)
            done += 1
    raise RescoreError(
        "fragments: the crops of cars have hardly any contrast; check the pictures of the train split"
    )


def correlations(
    responses: Float32Array, patches: Float32Array, grid_px: int, noise_floor: float
) -> Float32Array:
    """Absolute normalised correlations (rows, k, columns) of patches (k, s, s) with responses (h, w).

    They are taken on a grid and lie in [0, 1]. The norm of a picture patch is raised by that of noise, so
    that flat ground correlates with nothing. Without it, these are cv2.TM_CCOEFF_NORMED, absolute.
    """
    count, size, _ = patches.shape
    windows = _windows(responses, size, grid_px)
    contrast = _contrast(responses, size, grid_px)[: windows.shape[0], : windows.shape[2]]
    norm = contrast + np.float32(noise_floor * size + 1e-6)
    out = np.empty((windows.shape[0], count, windows.shape[2]), np.float32)
    step = max(1, 250_000 // max(1, out[0].size))  # values that fit in the processor's cache
    for start in range(0, len(out), step):
        rows = slice(start, start + step)
        # patches have mean 0, so pictures need not be centred for them
        found = np.matmul(patches.reshape(count, -1), windows[rows], out=out[rows])
        np.abs(found, out=found)
        found /= norm[rows, None]
    return out


def _windows(responses: Float32Array, size: int, grid_px: int) -> Float32Array:
    """The square windows of a grid, shape (rows, size * size, columns), a view that cannot be written.

    For each column of a window the responses are copied once. The rows lie one after the other in the copies,
    so that the windows of one row of the grid are a matrix, which overlaps with that of the next.
    """
    height, width = responses.shape
    columns = (width - size) // grid_px + 1
    copies = np.empty((height, size, columns), np.float32)
    for x in range(size):
        copies[:, x] = responses[:, x : x + (columns - 1) * grid_px + 1 : grid_px]
    stacked = copies.reshape(height * size, columns)
    return sliding_window_view(stacked, size * size, axis=0)[:: grid_px * size].transpose(0, 2, 1)


def _contrast(responses: Float32Array, size: int, grid_px: int) -> Float32Array:
    """Norms (rows, columns) of the centred square windows with their first corners on a grid."""
    box, corner = (size, size), (0, 0)
    total = cv2.boxFilter(responses, cv2.CV_32F, box, anchor=corner, normalize=False)
    squares = cv2.sqrBoxFilter(responses, cv2.CV_32F, box, anchor=corner, normalize=False)
    total, squares = total[::grid_px, ::grid_px], squares[::grid_px, ::grid_px]
    return np.asarray(np.sqrt(np.maximum(squares - total**2 / (size * size), 0)), np.float32)


def level_features(
    picture: UInt8Array, dictionary: Dictionary, window: WindowGeometry, stride: int
) -> Float32Array:
    """Features (f, rows, columns) of all windows of a picture, ``stride`` grid steps apart.

    Each fragment is correlated once; its mask is a maximum filter, and the place in the window a shift.
    """
    config = dictionary.config
    g = config.grid_px
    n_rows = max(0, (picture.shape[0] - window.height_px) // (g * stride) + 1)
    n_columns = max(0, (picture.shape[1] - window.width_px) // (g * stride) + 1)
    out = np.empty((len(dictionary), n_rows, n_columns), np.float32)
    if not out.size:
        return out
    responses = filter_responses(picture)
    mask = np.ones((2 * config.mask_radius + 1,) * 2, np.uint8)
    first = 0
    for patches, filters, places in zip(
        dictionary.patches, dictionary.filter_index, dictionary.place, strict=True
    ):
        for which in np.unique(filters):
            members = np.flatnonzero(filters == which)
            maps = correlations(responses[which], patches[members], g, config.noise_floor)
            side_by_side = maps.reshape(len(maps), -1)
            # masks stay inside their windows, so none reads what crosses from the next
            near = cv2.dilate(side_by_side, mask, dst=side_by_side).reshape(maps.shape)
            for i, k in enumerate(members):
                gx, gy = places[k]
                out[first + k] = near[gy::stride, i, gx::stride][:n_rows, :n_columns]
        first += len(patches)
    return out


def crop_features(crops: UInt8Array, dictionary: Dictionary) -> Float32Array:
    """Features (f, n) of canonical crops (n, height, width): those that a scan finds in such a window."""
    n, height, width = crops.shape
    g = dictionary.config.grid_px
    # side by side, each from a place of the grid on, crops are one picture
    pitch = -(-width // g) * g
    strip = np.zeros((height, n, pitch), np.uint8)
    strip[:, :, :width] = crops.transpose(1, 0, 2)
    window = WindowGeometry(width, height, 0, 0)
    features = level_features(strip.reshape(height, n * pitch), dictionary, window, stride=1)
    return features[:, 0, :: pitch // g]


def features_of_crops(crops: UInt8Array, dictionary: Dictionary, jobs: int) -> Float32Array:
    """Features (f, n) of canonical crops (n, height, width), as ``crop_features``, by several processes."""
    chunks = [crops[i : i + 128] for i in range(0, len(crops), 128)]
    parts = map_frames(_chunk_features, chunks, dictionary, jobs)
    return np.concatenate([np.empty((len(dictionary), 0), np.float32), *parts], axis=1)


def _chunk_features(crops: UInt8Array, dictionary: Dictionary) -> Float32Array:
    with one_blas_thread():
        return crop_features(crops, dictionary)
