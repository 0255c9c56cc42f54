"""What measured depth says in and around a box, where the camera is calibrated: size, depth edges, ground.

The report compares predicted and measured depth inside the box alone, after a free scale and offset. A flat
picture of a car passes that test. With a calibrated camera a box and a depth say how large a thing is; the
pixels around the box say whether it stands apart from what is beside and above it; and its lower edge says
whether it stands on the ground. Disparity is looked at in place of depth: its noise is the same everywhere.
"""

from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.camera import GroundedStereo, StereoCamera
from recon.pixels import sample_nearest

SURROUNDINGS = (
    "width",
    "height",
    "foot",
    "compact",
    "left",
    "right",
    "above",
    "behind_above",
    "fill_left",
    "fill_right",
    "fill_top",
    "ground_below",
    "relief",
    "near",
    "support",
    "lower",
    "measured",
)
"""Cues of ``surroundings``, in the order of its columns (see there)."""


@dataclass(frozen=True)
class SurroundingsConfig:
    """What is taken as the thing in the box, and as lying behind it."""

    size_m: tuple[float, float, float] = (4.4, 1.75, 1.5)
    """Length, width and height of the class in metres: a passenger car."""
    size_tolerance: float = 0.2
    """Disparities within this of the one that the size of the class predicts (logarithm) may be the thing."""
    min_support: float = 0.25
    """Share of the box that must have such a disparity, or the median of the box is taken in its place."""
    apart_m: float = 1.2
    """Depth in metres before or behind the thing beyond which a pixel is not part of the thing."""
    apart_px: float = 1.0
    """A pixel counts as apart from the thing only if its disparity differs by more than this: the matcher can
    tell no less."""
    min_samples: int = 8
    """A region with fewer measured samples gives no cue."""


def surroundings(
    disparity_px: Float32Array,
    xyxy_px: FloatArray,
    azimuth_rad: FloatArray,
    seen_from: GroundedStereo | StereoCamera,
    config: SurroundingsConfig,
) -> FloatArray:
    """The cues of boxes, shape (n, 17), columns ``SURROUNDINGS``; NaN where one cannot be had.

    The disparity of the thing is the median of those in the box that the size of the class allows, or of all
    where they are few. Samples near it belong to the thing, smaller ones lie behind it, larger ones before.

    - ``width``, ``height``: logarithm of the box's size in metres over that of the class.
    - ``foot``: height in metres of the box's lower edge above the ground, clipped to -3 and 6.
    - ``compact``: share of the box's middle that belongs to the thing; ``lower``: of its lowest quarter.
    - ``left``, ``right``, ``above``: share of what is beside or above the box, and is not nearer, that goes
      on at the thing's depth; ``behind_above``: share of all above the box that lies behind.
    - ``fill_left``, ``fill_right``, ``fill_top``: share of the box's own rims that belongs to the thing.
    - ``ground_below``: share of what is below the box that lies on the ground plane.
    - ``relief``: depth in metres of the upper part less that of the lower part, clipped to 3.
    - ``near``: share of the box that is nearer than the thing.
    - ``support``: share of the box's middle at a disparity that the size of the class allows.
    - ``measured``: share of the box's middle with a measurement.

    Args:
        disparity_px: measured, shape (h, w), NaN in holes.
        xyxy_px: boxes, shape (n, 4), pixel edges.
        azimuth_rad: side from which each is taken to be seen, shape (n,) (``ViewBins.azimuth_rad``); NaN
            where nothing says it, which leaves ``width`` out.
        seen_from: the pair and the ground plane; the pair alone where the plane is unknown, which leaves
            ``foot`` and ``ground_below`` out.
        config: settings.
    """
    if not len(xyxy_px):
        return np.zeros((0, len(SURROUNDINGS)))
    samples, uv_px = sample_boxes(disparity_px, xyxy_px)
    view = _View(samples, uv_px, xyxy_px, expected_size_m(azimuth_rad, config.size_m), seen_from, config)
    cues = view.size() | view.extent() | view.around() | view.standing()
    return np.stack([cues[name] for name in SURROUNDINGS], axis=1)


def expected_size_m(azimuth_rad: FloatArray, size_m: tuple[float, float, float]) -> FloatArray:
    """Width and height in metres of the boxes of an object (length, width, height) seen from sides (n,).

    Shape (2, n); a width is NaN where the side is.
    """
    length, width, height = size_m
    wide = length * np.abs(np.sin(azimuth_rad)) + width * np.abs(np.cos(azimuth_rad))
    return np.stack([wide, np.full_like(wide, height)])


SAMPLES_U = (np.arange(56) + 0.5) / 56 * 1.6 - 0.3
"""Columns of the grid as fractions of the box's width from its left edge, (56,): 0.3 beyond each end."""
SAMPLES_V = (np.arange(44) + 0.5) / 44 * 1.6 - 0.35
"""Rows as fractions of the box's height from its top edge, shape (44,): 0.35 above, 0.25 below."""


def sample_boxes(picture: Float32Array, xyxy_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The values at the grid of each box, (n, 44, 56), NaN outside the picture; their pixels (n, 44, 56, 2).

    Args:
        picture: shape (h, w).
        xyxy_px: boxes, shape (n, 4), pixel edges.
    """
    size = xyxy_px[:, 2:] - xyxy_px[:, :2]
    x = np.floor(xyxy_px[:, :1] + SAMPLES_U * size[:, :1]).astype(int)
    y = np.floor(xyxy_px[:, 1:2] + SAMPLES_V * size[:, 1:]).astype(int)
    column, row = x[:, None, :], y[:, :, None]
    uv_px = np.stack(np.broadcast_arrays(column, row), axis=-1).astype(float)
    return sample_nearest(picture, column, row), uv_px


def _region(u: tuple[float, float], v: tuple[float, float]) -> BoolArray:
    """Samples between fractions of the box's width (from its left) and height (from its top), (gh, gw)."""
    in_u = (u[0] < SAMPLES_U) & (u[1] > SAMPLES_U)
    in_v = (v[0] < SAMPLES_V) & (v[1] > SAMPLES_V)
    return np.asarray(in_v[:, None] & in_u[None, :])


_MIDDLE = _region((0.12, 0.88), (0.3, 0.92))
_BOX = _region((0, 1), (0, 1))
_LOWEST = _region((0.1, 0.9), (0.75, 0.97))
_LEFT = _region((-0.3, -0.08), (0.15, 0.8))
_RIGHT = _region((1.08, 1.3), (0.15, 0.8))
_ABOVE = _region((0.1, 0.9), (-0.35, -0.1))
_RIM_LEFT = _region((0.03, 0.15), (0.4, 0.9))
_RIM_RIGHT = _region((0.85, 0.97), (0.4, 0.9))
_RIM_TOP = _region((0.3, 0.7), (0.05, 0.25))
_BELOW = _region((0.05, 0.95), (1.03, 1.2))
_LOWER_HALF = _region((0.1, 0.9), (0.5, 0.85))
_UPPER_PART = _region((0.3, 0.7), (0.08, 0.35))


class _View:
    """Samples of all boxes of a frame, sorted into thing, behind and before."""

    def __init__(
        self,
        samples: FloatArray,
        uv_px: FloatArray,
        xyxy_px: FloatArray,
        expected_m: FloatArray,
        seen_from: GroundedStereo | StereoCamera,
        config: SurroundingsConfig,
    ) -> None:
        self.samples, self.uv_px, self.boxes = samples, uv_px, xyxy_px
        self.known = np.isfinite(samples)
        self.seen_from, self.config = seen_from, config
        self.camera = camera = seen_from.stereo if isinstance(seen_from, GroundedStereo) else seen_from
        width_px, height_px = (xyxy_px[:, 2:] - xyxy_px[:, :2]).T
        self.expected_m = expected_m
        by_height = height_px / expected_m[1]
        by_width = np.where(np.isnan(expected_m[0]), by_height, width_px / expected_m[0])
        by_size = camera.baseline_m * (by_width + by_height) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            fits = self.known & (np.abs(np.log(samples / by_size[:, None, None])) < config.size_tolerance)
        self.support = self._share(fits, self.known, _MIDDLE)
        supported = np.nan_to_num(self.support) > config.min_support
        self.disparity_px = np.where(
            supported, _median(samples, fits & _MIDDLE), _median(samples, self.known & _MIDDLE)
        )
        self.depth_m = camera.exact_depth_m(self.disparity_px)
        apart = self.disparity_px - camera.exact_disparity_px(self.depth_m + config.apart_m)
        self.apart_px = np.maximum(config.apart_px, apart)[:, None, None]
        off = samples - self.disparity_px[:, None, None]
        self.thing = self.known & (np.abs(off) <= self.apart_px)
        self.behind = self.known & (off < -self.apart_px)
        self.before = self.known & (off > self.apart_px)
        self.close = self.known & (np.abs(off) <= 2 * self.apart_px)

    def size(self) -> dict[str, FloatArray]:
        size_px = (self.boxes[:, 2:] - self.boxes[:, :2]).T
        focal = np.array([self.camera.left.fx_px, self.camera.left.fy_px])
        ratio = size_px * self.depth_m / focal[:, None] / self.expected_m
        return {"width": np.log(ratio[0]), "height": np.log(ratio[1]), "support": self.support}

    def extent(self) -> dict[str, FloatArray]:
        fill = {
            name: self._share(self.thing, self.known, region)
            for name, region in (
                ("compact", _MIDDLE),
                ("lower", _LOWEST),
                ("fill_left", _RIM_LEFT),
                ("fill_right", _RIM_RIGHT),
                ("fill_top", _RIM_TOP),
            )
        }
        low, high = (
            _median(self.samples, self.thing & _LOWER_HALF),
            _median(self.samples, self.close & _UPPER_PART),
        )
        relief = np.clip(self.camera.exact_depth_m(high) - self.camera.exact_depth_m(low), -3, 3)
        measured = (self.known & _MIDDLE).sum(axis=(1, 2)) / _MIDDLE.sum()
        return fill | {
            "relief": relief,
            "near": self._share(self.before, self.known, _BOX),
            "measured": measured,
        }

    def around(self) -> dict[str, FloatArray]:
        not_before = self.thing | self.behind
        beside = {
            name: self._share(self.thing, not_before, region)
            for name, region in (("left", _LEFT), ("right", _RIGHT), ("above", _ABOVE))
        }
        return beside | {"behind_above": self._share(self.behind, self.known, _ABOVE)}

    def standing(self) -> dict[str, FloatArray]:
        seen_from = self.seen_from
        if not isinstance(seen_from, GroundedStereo):
            unknown = np.full(len(self.boxes), np.nan)
            return {"foot": unknown, "ground_below": unknown}
        lower_edge_px = np.stack([(self.boxes[:, 0] + self.boxes[:, 2]) / 2, self.boxes[:, 3]], axis=1) - 0.5
        foot = seen_from.left.height_above_ground_m(lower_edge_px, self.depth_m)
        of_ground = seen_from.ground_disparity_px(self.uv_px)
        tolerance = np.maximum(1.0, 0.06 * of_ground)
        on_ground = self.known & (np.abs(self.samples - of_ground) <= tolerance)
        return {
            "foot": np.clip(foot, -3, 6),
            "ground_below": self._share(on_ground, self.known, _BELOW),
        }

    def _share(self, what: BoolArray, of: BoolArray, region: BoolArray) -> FloatArray:
        part, whole = (what & region).sum(axis=(1, 2)), (of & region).sum(axis=(1, 2))
        enough = whole >= self.config.min_samples
        return np.where(enough, part / np.maximum(whole, 1), np.nan)


def _median(samples: FloatArray, use: BoolArray) -> FloatArray:
    """Median of the chosen samples of each box (n,); NaN where none is chosen."""
    flat = np.where(use, samples, np.inf).reshape(len(samples), -1)
    flat.sort(axis=1)
    count = use.sum(axis=(1, 2))
    row = np.arange(len(flat))
    upper, lower = count // 2, np.maximum(count - 1, 0) // 2
    middle = (flat[row, upper] + flat[row, lower]) / 2
    return np.where(count > 0, middle, np.nan)
