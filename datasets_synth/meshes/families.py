"""What all families of object shapes share: how their lists of shapes are drawn, and how objects stand."""

from collections.abc import Iterator, Mapping

import numpy as np

from datasets_synth.meshes.mesh import Mesh
from datasets_synth.meshes.solids import MeshDraft

Ranges = Mapping[str, tuple[float, float]]


def latin_hypercube(ranges: Ranges, count: int, seed: list[int]) -> list[dict[str, float]]:
    """`count` draws: each measure visits each of `count` equal cells of its range once.

    Args:
        ranges: Lowest and highest value of each measure.
        count: How many draws.
        seed: Of the one generator that serves all measures in order.
    """
    rng = np.random.default_rng(seed)
    draws = {
        name: low + (high - low) * (rng.permutation(count) + rng.uniform(0, 1, count)) / count
        for name, (low, high) in ranges.items()
    }
    return [{name: float(values[i]) for name, values in draws.items()} for i in range(count)]


def draws_by_style(
    ranges: Mapping[str, Ranges], per_style: int, seed: int
) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Name of the shape, style and measures of `per_style` shapes of each style, style by style.

    Args:
        ranges: Of the measures of each style.
        per_style: How many shapes of each.
        seed: Of the family; each style has a generator of its own.
    """
    for number, (style, own) in enumerate(ranges.items()):
        for i, measures in enumerate(latin_hypercube(own, per_style, [seed, number])):
            yield f"{style}_{i:02d}", style, measures


def standing_mesh(draft: MeshDraft) -> Mesh:
    """The mesh of a draft, moved so that the origin is on the ground under the middle of its footprint."""
    points = draft.mesh().vertices_m
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    draft.transform(np.eye(3), (-middle[0], -middle[1], -low[2]))
    return draft.mesh()
