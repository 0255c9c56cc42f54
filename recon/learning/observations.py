"""What part-labelled views show of each part: centroids, areas and boundaries (section 3.2)."""

from collections.abc import Sequence

import numpy as np

from recon.arrays import FloatArray
from recon.outlines import largest_outline, resample
from recon.part_views import PartView
from recon.view_bins import ViewBins

MIN_BOUNDARY_PX = 12
"""A region with a shorter border says nothing of how its part is turned."""
MIN_AREA_PX = 20
"""A part that shows fewer pixels in a view says nothing of how it is turned; it counts as not seen there."""


class Observations:
    """Parts in labelled views, in units of the larger side of the object in each view."""

    def __init__(
        self,
        views: Sequence[PartView],
        part_count: int,
        bins: ViewBins,
        *,
        boundary_points: int,
        min_part_share: float,
    ) -> None:
        self.views = views
        self.bins = bins
        self.rotation = np.stack([bins.view_from_object(v.view_bin) for v in views])
        """Shape (v, 3, 3)."""
        self.centroid = np.full((len(views), part_count, 2), np.nan)
        """Shape (v, n, 2); NaN where a view does not show a part."""
        self.area = np.full((len(views), part_count), np.nan)
        """Shape (v, n): share of the squared unit."""
        self.boundary: dict[tuple[int, int], FloatArray] = {}
        """Points (m, 2) evenly spaced along the boundary of a part's largest region, by (view, label)."""
        for i, view in enumerate(views):
            self._observe(i, view, boundary_points, min_part_share)

    def _observe(self, i: int, view: PartView, boundary_points: int, min_part_share: float) -> None:
        rows, cols = np.nonzero(view.labels)
        size = max(np.ptp(rows), np.ptp(cols)) + 1
        for label in (int(x) for x in np.unique(view.labels) if x):
            mask = view.labels == label
            ring = largest_outline(mask)
            area_px = int(mask.sum())
            too_small = area_px < max(MIN_AREA_PX, min_part_share * len(rows))
            if too_small or ring is None or len(ring) < MIN_BOUNDARY_PX:
                continue
            part_rows, part_cols = np.nonzero(mask)
            self.centroid[i, label - 1] = part_cols.mean() / size, part_rows.mean() / size
            self.area[i, label - 1] = area_px / size**2
            self.boundary[i, label] = resample(ring, boundary_points) / size

    def views_of(self, label: int) -> list[int]:
        """Indices of the views that show a part."""
        return [i for i in range(len(self.views)) if (i, label) in self.boundary]

    def pairs_of(self, label: int, max_bin_step: int) -> list[tuple[int, int]]:
        """Pairs of views of one instance, at most ``max_bin_step`` view bins apart, that both show a part."""
        shown = self.views_of(label)
        count = self.bins.count
        pairs = []
        for a in shown:
            for b in shown[shown.index(a) + 1 :]:
                apart = (self.views[a].view_bin - self.views[b].view_bin) % count
                near = 0 < min(apart, count - apart) <= max_bin_step
                if near and self.views[a].instance_id == self.views[b].instance_id:
                    pairs.append((a, b))
        return pairs

    def shown_share(self, scale: FloatArray) -> FloatArray:
        """How much each view shows of each part, against the view that shows most, shape (v, n), in (0, 1].

        Areas are compared in object units, with the scale (v,) of each view. A part that turns away, or hides
        behind others, is seen on a small share, whose centroid is no longer that of the part.
        """
        area = self.area * scale[:, None] ** 2
        most = np.nanmax(np.where(np.isnan(area), -np.inf, area), axis=0, keepdims=True)
        return np.asarray(area / most)
