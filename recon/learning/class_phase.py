"""The class phase (section 3.2): which primitive explains how the boundary of a part changes across views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from recon.arrays import FloatArray
from recon.learning.primitives import PrimitiveLibrary, affine_transform, apply_projective, nearest_on_outline
from recon.shapes.shape_matching import ShapeContextConfig, match, shape_contexts

MIN_FACING = 0.07
"""A plane turned to a view by a smaller cosine is seen edge-on, and explains no boundary there."""


MATCHED_PAIRS = 12
"""Pairs in which boundaries are matched by shape contexts, the slowest step."""


@dataclass(frozen=True, eq=False)
class BoundaryPair:
    """Boundaries of one part in two views of one instance, as offsets from their means in object units."""

    bin_a: int
    bin_b: int
    rotation_a: FloatArray
    """T_alpha of the first view, shape (3, 3)."""
    rotation_b: FloatArray
    """T_alpha of the second view, shape (3, 3)."""
    a: FloatArray
    """Shape (m, 2)."""
    b: FloatArray
    """Shape (m, 2)."""
    weight: float
    """Weight of the pair in the cost of a primitive."""

    @property
    def size(self) -> float:
        """Root-mean-square radius in the second view, object units."""
        return float(np.sqrt((self.b**2).sum(axis=1).mean()))


def primitive_costs(pairs: Sequence[BoundaryPair], library: PrimitiveLibrary, outlier: float) -> FloatArray:
    """How badly each primitive of the library accounts for what turning does to a part, shape (k,).

    The first boundary of each pair is carried to the second view by the learned transform of each primitive.
    The cost is the mean squared distance between it and the boundary seen there, both ways, in part sizes,
    capped at ``outlier`` squared; which is also the cost where a primitive is seen edge-on.
    """
    total = np.zeros(len(library.normals))
    for pair in pairs:
        carried = library.carried(pair.a, pair.bin_a, pair.bin_b)
        total += pair.weight * _boundary_distance(carried, pair, outlier)
    return np.asarray(total / sum(p.weight for p in pairs))


def _boundary_distance(carried: FloatArray, pair: BoundaryPair, outlier: float) -> FloatArray:
    """Capped mean squared distance of carried boundaries (k, m, 2) from the one seen, and back; (k,)."""
    cap = outlier**2
    # |c - b|^2 written out, so that the products of all primitives are one matrix product
    squared = (carried**2).sum(axis=2)[:, :, None] + (pair.b**2).sum(axis=1) - 2 * carried @ pair.b.T
    squared = np.nan_to_num(np.maximum(squared, 0) / pair.size**2, nan=cap)
    there, back = np.minimum(squared.min(axis=2), cap), np.minimum(squared.min(axis=1), cap)
    return np.asarray((there.mean(axis=1) + back.mean(axis=1)) / 2)


def heaviest(pairs: Sequence[BoundaryPair], count: int) -> list[BoundaryPair]:
    """The ``count`` pairs of most weight, fewer where there are fewer, in their given order."""
    order = np.argsort([-p.weight for p in pairs], kind="stable")[:count]
    return [pairs[i] for i in sorted(order)]


def best_primitive(
    pairs: Sequence[BoundaryPair],
    library: PrimitiveLibrary,
    outlier: float,
    candidates: int,
    config: ShapeContextConfig,
) -> int:
    """Index of the primitive that best accounts for the observed cross-view transforms of a part.

    Of the ``candidates`` with the smallest ``primitive_costs``, the one whose transforms are nearest to those
    that shape contexts find.
    """
    best = np.argsort(primitive_costs(pairs, library, outlier), kind="stable")[:candidates]
    matched = heaviest(pairs, MATCHED_PAIRS)
    error = [_transform_error(matched, library, int(k), outlier, config) for k in best]
    return int(best[int(np.argmin(error))])


def observed_transform(pair: BoundaryPair, carried: FloatArray, config: ShapeContextConfig) -> FloatArray:
    """The cross-view transform (3, 3) of a part that matching its boundaries by shape contexts gives.

    Affine: boundaries of labelled views are too coarse for the two perspective entries.

    Args:
        pair: the boundaries.
        carried: the first boundary as a primitive carries it to the second view, shape (m, 2). Contexts
            change as a part turns; a match that starts from a primitive bridges only what that leaves.
        config: settings of the shape contexts.
    """
    partner, _ = match(
        carried, shape_contexts(carried, config), pair.b, shape_contexts(pair.b, config), config
    )
    return affine_transform(pair.a, pair.b[partner])


def _transform_error(
    pairs: Sequence[BoundaryPair],
    library: PrimitiveLibrary,
    primitive: int,
    outlier: float,
    config: ShapeContextConfig,
) -> float:
    """Mean squared distance between boundaries under a primitive's and under the observed transforms."""
    cap = outlier**2
    total = 0.0
    for pair in pairs:
        transform = library.transform[primitive, pair.bin_a, pair.bin_b]
        error = cap
        if np.isfinite(transform).all():
            carried = apply_projective(transform, pair.a)
            seen = apply_projective(observed_transform(pair, carried, config), pair.a)
            squared = ((carried - seen) ** 2).sum(axis=1) / pair.size**2
            error = float(np.minimum(squared, cap).mean())
        total += pair.weight * error
    return total


def fitted_normal(
    starts: FloatArray, pairs: Sequence[BoundaryPair], outlier: float, rounds: int
) -> FloatArray:
    """The unit normal (3,) whose plane carries boundaries to boundaries best, near one of some (k, 3).

    The last step of section 3.2: with the correspondences of a primitive the points of the outline have 3D
    positions, and the plane through them is that of the part. A thin part fits several primitives alike, so
    several are tried.
    """
    found = [_refined(start, pairs, outlier, rounds) for start in starts]
    cost = [
        sum(
            p.weight * float(_boundary_distance(c[None], p, outlier)[0])
            for p, c in zip(pairs, carried, strict=True)
        )
        for carried in (_Stack(pairs).carried(n) for n in found)
    ]
    return found[int(np.argmin(cost))]


def _refined(normal: FloatArray, pairs: Sequence[BoundaryPair], outlier: float, rounds: int) -> FloatArray:
    """The normal turned to fit. Points may slide along the outline: shape contexts do not fix them to better
    than their spacing."""
    stack = _Stack(pairs)
    for _ in range(rounds):
        across = np.linalg.svd(normal[None])[2][1:]
        nearest, outward = stack.nearest(normal)

        def residual(
            turn: FloatArray,
            start: FloatArray = normal,
            across: FloatArray = across,
            nearest: FloatArray = nearest,
            outward: FloatArray = outward,
        ) -> FloatArray:
            distance = ((stack.carried(_turned(start, turn @ across)) - nearest) * outward).sum(axis=2)
            return np.asarray(np.nan_to_num(distance * stack.factor, nan=outlier).ravel())

        fit = least_squares(
            residual, np.zeros(2), loss="soft_l1", f_scale=outlier / 3, bounds=(-0.3, 0.3), max_nfev=20
        )
        normal = _turned(normal, fit.x @ across)
    return normal


def _turned(normal: FloatArray, offset: FloatArray) -> FloatArray:
    n = normal + offset
    return np.asarray(n / np.linalg.norm(n))


class _Stack:
    """All pairs of a part as arrays, since the fit carries them many times."""

    def __init__(self, pairs: Sequence[BoundaryPair]) -> None:
        self.a = np.stack([p.a for p in pairs])
        self.b = [p.b for p in pairs]
        self.rotation_a = np.stack([p.rotation_a for p in pairs])
        self.rotation_b = np.stack([p.rotation_b for p in pairs])
        self.factor = np.array([np.sqrt(p.weight) / p.size for p in pairs])[:, None]

    def carried(self, normal: FloatArray) -> FloatArray:
        """First boundaries as a plane carries them to the second views, (p, m, 2); NaN where seen edge-on."""
        facing = np.minimum(np.abs(self.rotation_a[:, 2] @ normal), np.abs(self.rotation_b[:, 2] @ normal))
        system = self.rotation_a.copy()
        system[:, 2] = normal
        system[facing < MIN_FACING] = np.eye(3)
        transform = self.rotation_b[:, :2] @ np.linalg.inv(system)[:, :, :2]
        transform[facing < MIN_FACING] = np.nan
        return np.asarray(self.a @ np.swapaxes(transform, 1, 2))

    def nearest(self, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (p, m, 2) of the second boundaries to the carried ones, and unit normals there."""
        found = [nearest_on_outline(c, b) for c, b in zip(self.carried(normal), self.b, strict=True)]
        return np.stack([n for n, _ in found]), np.stack([n for _, n in found])
