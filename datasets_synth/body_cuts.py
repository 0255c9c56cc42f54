"""Cutting and painting the lofted body of a car along level functions.

Every region is a level function over the surface, negative inside. The surface is cut along its outline, so
that outlines are sharp at any size.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from datasets_synth.car_body import BodyLines
from datasets_synth.car_paint import Finish
from datasets_synth.mesh_build import Soup, cut
from datasets_synth.parts import PART_LABEL
from recon.arrays import BoolArray, FloatArray

SEAM_M = 0.011
"""Width of a door gap."""


@dataclass(frozen=True, eq=False)
class Points:
    """Coordinates of the corners that a level function is asked about; each of shape (m, 3)."""

    t: FloatArray
    """Distance from the nose as built."""
    y: FloatArray
    z: FloatArray
    s: FloatArray
    """Station: distance from the nose before nose and tail were bent."""


Level = Callable[[Points], FloatArray]


def _points(soup: Soup, lines: BodyLines) -> Points:
    c = soup.corners_m
    return Points(0.5 * lines.shape.length - c[..., 0], c[..., 1], c[..., 2], soup.station)


def _values(soup: Soup, lines: BodyLines, zones: tuple[int, ...], level: Level) -> FloatArray:
    """Level at the corners of the faces in the zones, NaN elsewhere."""
    out = np.full(soup.corners_m.shape[:2], np.nan)
    where = np.flatnonzero(np.isin(soup.zone, zones))
    out[where] = level(_points(soup.take(where), lines))
    return out


def divide(soup: Soup, lines: BodyLines, zones: tuple[int, ...], *levels: Level) -> tuple[Soup, BoolArray]:
    """The surface cut along each level's outline in turn, and its faces inside all of them.

    Several levels keep a corner sharp that one level, being interpolated over a face, would bevel.
    """
    out = soup
    for level in levels:
        out = cut(out, _values(out, lines, zones, level))
    highest = np.maximum.reduce([_values(out, lines, zones, level).mean(1) for level in levels])
    return out, highest < 0


def paint(
    soup: Soup,
    lines: BodyLines,
    zones: tuple[int, ...],
    levels: Level | tuple[Level, ...],
    finish: Finish | None = None,
    *,
    part: str | None = None,
    only: Finish | None = None,
) -> Soup:
    """The surface with the region inside all levels painted; only: leave faces of other finishes alone."""
    out, inside = divide(soup, lines, zones, *(levels if isinstance(levels, tuple) else (levels,)))
    if only is not None:
        inside &= out.material == only
    return out.painted(
        inside, None if finish is None else int(finish), None if part is None else PART_LABEL[part]
    )


def band(soup: Soup, lines: BodyLines, zones: tuple[int, ...], level: Level, width: float = SEAM_M) -> Soup:
    """The surface with a dark line along the outline of a region, where there is paint or trim."""
    out = cut(soup, _values(soup, lines, zones, level))
    out = cut(out, _values(out, lines, zones, level), width)
    middle = _values(out, lines, zones, level).mean(1)
    inside = (middle > 0) & (middle < width) & np.isin(out.material, (Finish.PAINT, Finish.CLADDING))
    return out.painted(inside, int(Finish.SEAM))
