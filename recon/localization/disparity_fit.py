"""An instance of a class fitted to a box and to measured disparity: its place, its heading, its shape.

Poses on the ground are tried on a grid, looked up in maps of the class's depth (``depth_views``), and the
best are moved until nothing near is better. It is done twice. The framed instance is the one that a good box
around it would be this box; the seen instance is the one that the disparity shows, wherever the box ends. For
a whole car that is framed well both are the same; a box on a part of a car, or on two, tears them apart.
"""

from dataclasses import dataclass, field

import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, median
from recon.boxes import paired_overlap
from recon.camera import GroundedStereo
from recon.localization.box_samples import BoxSamples, DisparityNoise, SampleGrid, box_samples
from recon.localization.depth_views import DepthViews, DepthViewsConfig
from recon.localization.poses import Explained, PoseLikelihood, Poses, SurfaceNoise, attainable
from recon.localization.standing_box import StandingBox, cam_from_ground, wrapped


@dataclass(frozen=True)
class BoxNoise:
    """How the box of a detector differs from the one around the silhouette."""

    sd_share: float = 0.06
    """Standard deviation of an edge as a share of the box's extent, beside ``sd_px``."""
    sd_px: float = 1.5
    framed: float = 10.0
    """Weight of the box's log density where it is taken to frame the instance."""
    seen: float = 0.03
    """Weight where it is only taken to be near it."""


@dataclass(frozen=True)
class SearchConfig:
    """The poses that are tried."""

    headings: int = 16
    bearings: int = 7
    """Bearings across the box, or across ``reach`` of the length where that is wider."""
    reach: float = 0.28
    insets: tuple[float, ...] = (0.9, 0.5, 0.05)
    """Ways the middle lies behind the nearest surface, from half the length (0) to half the width (1)."""
    depths: int = 3
    """Number of surfaces in the box that are tried, by how much of it they fill."""
    farthest: float = 17.0
    """No instance is looked for beyond this many lengths."""
    step: int = 3
    """Only every ``step``-th row and column of the samples is looked at on the grid."""
    kept: int = 3
    """Number of best poses of the grid that are moved."""
    rounds: int = 8
    fine_rounds: int = 4
    """Last rounds, which go between the headings of the maps."""
    shrink: float = 0.66
    """Steps shrink by this from round to round."""
    scale_sd: float = 0.04
    """Standard deviation of the logarithm of an instance's size over that of its shape."""
    unknown_sd: tuple[float, float, float, float] = (3.0, 1.0, 1.8, 0.12)
    """Standard deviations of distance, place across it, heading and logarithm of the size of an instance of
    which nothing is measured."""
    probe: tuple[float, float, float, float] = (0.25, 0.12, 0.12, 0.03)
    """Steps in which the curvature of the posterior is measured."""


@dataclass(frozen=True)
class DisparityFitConfig:
    """Settings of the fit."""

    views: DepthViewsConfig = field(default_factory=DepthViewsConfig)
    grid: SampleGrid = field(default_factory=SampleGrid)
    noise: DisparityNoise = field(default_factory=DisparityNoise)
    surface: SurfaceNoise = field(default_factory=SurfaceNoise)
    axis_weight: float = 8.0
    """Weight of what the looks of the box say of the axis, beside the disparity, whose nats are too many: how
    an instance differs from its shape is alike all over it."""
    sense_weight: float = 25.0
    """Weight of what they say of the nose's end of the axis, of which disparity knows little."""
    box: BoxNoise = field(default_factory=BoxNoise)
    search: SearchConfig = field(default_factory=SearchConfig)


@dataclass(frozen=True, eq=False)
class PlacedInstance:
    """One instance with what it explains of the samples of its box."""

    pose: Poses
    """One pose."""
    box: StandingBox
    """The 3D box in the ground frame."""
    place_sd: FloatArray
    """Standard deviations of the distance and of the place across it in metres, of the heading in radians,
    and of the logarithm of the size, shape (4,), from the curvature of the posterior; what the disparity does
    not tell is as uncertain as ``SearchConfig.unknown_sd`` says."""
    silhouette_px: FloatArray
    """Box around the silhouette, cut off at the picture's edge, pixel edges, shape (4,)."""
    explained: Explained
    """What it says of the samples, each array of their shape (rows, columns)."""
    attainable: float
    """Log likelihood ratio if its surface lay exactly where all is measured, nats."""

    @property
    def total(self) -> float:
        """Log likelihood ratio of the instance against a place without objects, nats."""
        return float(self.explained.log_ratio.sum())


@dataclass(frozen=True, eq=False)
class BoxFit:
    """What a class and measured disparity say of one box."""

    samples: BoxSamples
    framed: PlacedInstance
    """The instance that the box frames."""
    seen: PlacedInstance
    """The instance that the disparity shows in the box or near it."""
    overlap: float
    """Expected intersection over union of the box with the box around the instance that the disparity shows,
    over all poses of the grid, in [0, 1]."""
    heading_log_mass: FloatArray
    """Logarithm of what the poses of the grid weigh as the instance that the box frames, for headings
    (``Poses.place``) that are evenly spaced from 0 on, shape (headings,), nats up to a constant."""
    framed_log_mass: float
    """Logarithm of what ``framed`` alone weighs, which lies between the poses of the grid, nats as there."""


class DisparityFit:
    """The fit of a class to boxes of one frame."""

    def __init__(
        self,
        disparity_px: Float32Array,
        seen_from: GroundedStereo,
        views: DepthViews,
        config: DisparityFitConfig,
    ) -> None:
        self.disparity_px, self.seen_from, self.views, self.config = disparity_px, seen_from, views, config
        self.cam_from_ground = cam_from_ground(seen_from.ground)
        # the steps of a round: along the line of sight and across, the heading, the size, and pairs of these
        self.steps = _steps() * [0.083 * views.size_m[0, 0], 0.053 * views.size_m[0, 0], 0.13, 0.03]

    def fit(self, xyxy_px: FloatArray, looks: FloatArray | None = None) -> tuple[BoxFit | None, ...]:
        """The instances that each box frames and shows; None where nothing is measured in it.

        Boxes are fitted side by side and know nothing of each other.

        Args:
            xyxy_px: Boxes, shape (n, 4), pixel edges.
            looks: Log probability of headings that are evenly spaced from 0 on, by how each box looks, shape
                (n, headings); None where that says nothing.
        """
        c = self.config
        samples = box_samples(self.disparity_px, xyxy_px, self.seen_from, c.noise, c.grid)
        grids = [self._grid(s, box) for s, box in zip(samples, xyxy_px, strict=True)]
        fitted = np.array([s.known.any() and len(g) > 0 for s, g in zip(samples, grids, strict=True)], bool)
        found: list[BoxFit | None] = [None] * len(xyxy_px)
        if not fitted.any():
            return tuple(found)
        rows = np.flatnonzero(fitted).tolist()
        boxes = _Boxes(
            xyxy_px[fitted],
            np.zeros((len(rows), 1)) if looks is None else self._weighed(looks[fitted]),
            [samples[i] for i in rows],
            PoseLikelihood(self.views, [samples[i] for i in rows], c.noise, c.surface),
        )
        for i, fit in zip(rows, self._fitted(boxes, [grids[i] for i in rows]), strict=True):
            found[i] = fit
        return tuple(found)

    def _fitted(self, boxes: "_Boxes", grids: list[Poses]) -> list[BoxFit]:
        """The fits of boxes in which something is measured, from the poses that are tried for each."""
        c, n = self.config, len(grids)
        sizes = [len(g) for g in grids]
        grid, owner = Poses.concatenate(grids), np.repeat(np.arange(n), sizes)
        silhouettes, ratio = boxes.likelihood.scan(grid, owner, c.search.step)
        ratio = ratio + _between(boxes.looks[owner], grid.place[:, 2])
        density = self._box_density(silhouettes, boxes.xyxy_px[owner])
        overlap = paired_overlap(silhouettes, boxes.xyxy_px[owner])[0]
        parts = [slice(end - size, end) for size, end in zip(sizes, np.cumsum(sizes).tolist(), strict=True)]
        weights = (c.box.framed, c.box.seen)
        starts = [
            grids[i][_apart(grids[i], (ratio + weight * density)[parts[i]], c.search.kept, self.views)]
            for weight in weights
            for i in range(n)
        ]
        targets = _Targets(np.tile(np.arange(n), 2), np.repeat(weights, n))
        placed = self._placed(starts, boxes, targets)
        framed_mass = self._score(
            Poses.concatenate([p.pose for p in placed[:n]]), boxes, targets[np.arange(n)], fine=False
        )
        score = ratio + c.box.framed * density
        return [
            BoxFit(
                boxes.samples[i],
                placed[i],
                placed[n + i],
                float(np.exp(ratio[parts[i]] - np.logaddexp.reduce(ratio[parts[i]])) @ overlap[parts[i]]),
                # headings change fastest on the grid
                np.logaddexp.reduce(score[parts[i]].reshape(-1, c.search.headings)),
                float(framed_mass[i]),
            )
            for i in range(n)
        ]

    def _weighed(self, looks: FloatArray) -> FloatArray:
        """Log probabilities of headings with the axis and its sense weighed apart, shape (n, headings)."""
        axis = np.logaddexp(looks, np.roll(looks, looks.shape[1] // 2, axis=1))
        return self.config.axis_weight * axis + self.config.sense_weight * (looks - axis)

    def _grid(self, samples: BoxSamples, xyxy_px: FloatArray) -> Poses:
        """The poses that are tried for a box; none where no distance is known."""
        c, camera = self.config.search, self.seen_from.left
        left, right, bottom = xyxy_px[0] - 0.5, xyxy_px[2] - 0.5, xyxy_px[3] - 0.5
        foot = np.array([[left, bottom], [(left + right) / 2, bottom], [right, bottom]])
        ray = camera.camera.rays(foot) @ self.cam_from_ground[:3, :3]
        bearing = np.arctan2(ray[:, 0], ray[:, 1])
        surface = self._surfaces(samples, xyxy_px, ray[1])
        length, width, _ = self.views.size_m[0]
        middle = (surface[:, None] + length / 2 + (width - length) / 2 * np.array(c.insets)).ravel()
        half = np.maximum((bearing[2] - bearing[0]) / 2, c.reach * length / middle)
        across = bearing[1] + half[:, None] * np.linspace(-1, 1, c.bearings)
        turn = np.arange(c.headings) * (2 * np.pi / c.headings)
        shape = (len(middle), c.bearings, c.headings)
        place = np.stack(
            [
                np.broadcast_to(middle[:, None, None], shape),
                np.broadcast_to(across[:, :, None], shape),
                np.broadcast_to(turn, shape),
                np.zeros(shape),
            ],
            axis=-1,
        ).reshape(-1, 4)
        return Poses(place, np.zeros(len(place), np.int64))

    def _surfaces(self, samples: BoxSamples, xyxy_px: FloatArray, foot_ray: FloatArray) -> FloatArray:
        """Distances along the ground at which the nearest surface of an instance may be."""
        length, _, height = self.views.size_m[0]
        camera, ground = self.seen_from.stereo.left, self.seen_from.ground
        found = _main_distances(samples, height, self.config.search.depths)
        if xyxy_px[3] < camera.height_px - 1 and foot_ray[2] < -1e-3:
            found.append(ground.height_m / -foot_ray[2] * float(np.hypot(*foot_ray[:2])))
        found.append(camera.fy_px * height / float(xyxy_px[3] - xyxy_px[1]))
        kept: list[float] = []
        for distance in found:
            near = 0.4 * length < distance < self.config.search.farthest * length
            if near and all(abs(np.log(distance / k)) > _SAME_DISTANCE for k in kept):
                kept.append(distance)
        return np.array(kept)

    def _box_density(self, silhouettes_px: FloatArray, xyxy_px: FloatArray) -> FloatArray:
        """Log density (m,) of a detector's box (m, 4) around each silhouette, up to a constant."""
        extent = np.tile(xyxy_px[:, 2:] - xyxy_px[:, :2], 2)
        off = (silhouettes_px - xyxy_px) / (self.config.box.sd_share * extent + self.config.box.sd_px)
        return np.asarray(-0.5 * (off**2).sum(axis=1))

    def _score(self, poses: Poses, boxes: "_Boxes", targets: "_Targets", *, fine: bool) -> FloatArray:
        """Log posterior of poses (m,) up to a constant, each fitted to a target of its own."""
        silhouettes, ratio = boxes.likelihood.scan(poses, targets.box, fine=fine)
        coefficients = np.array([np.square(s).sum() for s in self.config.views.coefficients])
        prior = (poses.place[:, 3] / self.config.search.scale_sd) ** 2 + coefficients[poses.shape]
        density = self._box_density(silhouettes, boxes.xyxy_px[targets.box])
        looks = _between(boxes.looks[targets.box], poses.place[:, 2])
        return np.asarray(ratio + targets.box_weight * density + looks - prior / 2)

    def _moved(self, starts: list[Poses], boxes: "_Boxes", targets: "_Targets") -> Poses:
        """The best pose near the best ones of the grid, one for each target."""
        c, count = self.config.search, len(starts)
        # where fewer poses lie apart, the last one stands in for more, and never counts
        spare = np.array([[k >= len(s) for k in range(c.kept)] for s in starts])
        best = Poses.concatenate([s[np.minimum(np.arange(c.kept), len(s) - 1)] for s in starts])
        for k in range(c.rounds):
            near = self._near(best, self.steps * c.shrink**k, other_shapes=k in _SHAPE_ROUNDS)
            target = np.repeat(np.arange(count), len(near) // count)
            value = self._score(near, boxes, targets[target], fine=k >= c.rounds - c.fine_rounds)
            value = value.reshape(len(best), -1)
            first = np.arange(0, value.size, value.shape[1])
            best = near[first + value.argmax(axis=1)]
            if k == _HALVING_ROUND:
                best, spare = _best(best, value.max(axis=1), spare, c.kept // 2)
        return _best(best, value.max(axis=1), spare, 1)[0]

    def _near(self, poses: Poses, steps: FloatArray, other_shapes: bool) -> Poses:
        """For each pose a row of itself and its neighbours, and itself with all shapes if asked for."""
        ahead = np.ones((len(poses), 1, 4))
        ahead[:, 0, 1] = 1 / poses.place[:, 0]
        place = poses.place[:, None] + steps * ahead
        shape = np.repeat(poses.shape[:, None], len(steps), axis=1)
        if other_shapes:
            count = len(self.views.size_m)
            place = np.concatenate([place, np.repeat(poses.place[:, None], count, axis=1)], axis=1)
            shape = np.concatenate([shape, np.tile(np.arange(count), (len(poses), 1))], axis=1)
        return Poses(place.reshape(-1, 4), shape.ravel())

    def _placed(self, starts: list[Poses], boxes: "_Boxes", targets: "_Targets") -> list[PlacedInstance]:
        """The instance that the best poses of the grid lead to, for each target."""
        poses = self._moved(starts, boxes, targets)
        deviations = self._deviations(poses, boxes, targets)
        silhouettes, _ = boxes.likelihood.scan(poses, targets.box)
        placed = []
        for i, owner in enumerate(targets.box.tolist()):
            pose = poses[i : i + 1]
            explained = boxes.likelihood.explained(pose, owner)
            attained = attainable(explained, boxes.samples[owner], self.config.surface)
            box = pose.standing_box(0, self.views)
            placed.append(PlacedInstance(pose, box, deviations[i], silhouettes[i], explained, attained))
        return placed

    def _deviations(self, poses: Poses, boxes: "_Boxes", targets: "_Targets") -> FloatArray:
        """See ``PlacedInstance.place_sd``, shape (m, 4): each unknown with the others held."""
        c = self.config.search
        probe = np.concatenate([np.zeros((1, 4)), np.diag(c.probe), -np.diag(c.probe)])
        near = self._near(poses, probe, other_shapes=False)
        owner = np.repeat(np.arange(len(poses)), len(probe))
        value = self._score(near, boxes, targets[owner], fine=True).reshape(len(poses), -1)
        curvature = (2 * value[:, :1] - value[:, 1:5] - value[:, 5:]) / np.square(c.probe)
        return np.asarray(1 / np.sqrt(np.maximum(curvature, 0) + 1 / np.square(c.unknown_sd)))


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes (n,) of a frame in which something is measured."""

    xyxy_px: FloatArray
    """Shape (n, 4)."""
    looks: FloatArray
    """Log probability of evenly spaced headings, shape (n, headings)."""
    samples: list[BoxSamples]
    likelihood: PoseLikelihood


@dataclass(frozen=True, eq=False)
class _Targets:
    """What instances (t,) are fitted to."""

    box: IntArray
    """Index of the box, shape (t,)."""
    box_weight: FloatArray
    """Weight of the box's log density, shape (t,)."""

    def __getitem__(self, chosen: IntArray) -> "_Targets":
        return _Targets(self.box[chosen], self.box_weight[chosen])


def _best(poses: Poses, value: FloatArray, spare: BoolArray, count: int) -> tuple[Poses, BoolArray]:
    """The poses of highest value of each target, and which of them stand in for others.

    Args:
        poses: As many of each target, those of one after those of another.
        value: Shape (m,).
        spare: Those that never count, shape (targets, m / targets).
        count: Number that is kept of each target.
    """
    ranked = np.where(spare, -np.inf, value.reshape(spare.shape))
    left = np.argsort(-ranked, axis=1, kind="stable")[:, :count]
    row = np.arange(len(spare))[:, None] * spare.shape[1]
    return poses[(row + left).ravel()], np.take_along_axis(spare, left, axis=1)


def _between(looks: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """Log probabilities of headings (m,), between those that are given (m, headings)."""
    at = (heading_rad * (looks.shape[1] / (2 * np.pi))) % looks.shape[1]
    low = np.floor(at).astype(np.int64)
    row, share = np.arange(len(looks)), at - low
    low = low % looks.shape[1]
    return np.asarray((1 - share) * looks[row, low] + share * looks[row, (low + 1) % looks.shape[1]])


_SAME_DISTANCE = 0.04
"""Distances whose logarithms differ by less are tried once."""
_SHAPE_ROUNDS = (1, 3, 6)
"""Rounds in which all shapes are tried."""
_HALVING_ROUND = 2
"""After this round only the better half of the poses goes on."""


def _steps() -> FloatArray:
    """Neighbours (17, 4) in units of a step: none, each unknown both ways, place and heading in pairs."""
    single = np.concatenate([np.zeros((1, 4)), np.kron(np.eye(4), [[1], [-1]])])
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    pairs = [np.insert(signs, 2, 0, axis=1), np.insert(signs, 0, 0, axis=1)]
    return np.concatenate([single, *(np.pad(p, ((0, 0), (0, 1))) for p in pairs)])


def _main_distances(samples: BoxSamples, class_height_m: float, count: int) -> list[float]:
    """Distances along the ground of the main surfaces in the box that stand on it, most of it first."""
    height = samples.height_m
    standing = samples.inside & (height > 0.15 * class_height_m) & (height < 1.6 * class_height_m)
    if standing.sum() < _FEWEST:
        standing = samples.inside & samples.known
    if standing.sum() < _FEWEST:
        return []
    distance = np.log(samples.forward_m[standing])
    edges = np.arange(distance.min(), distance.max() + 2 * _BIN, _BIN)
    counts = np.convolve(np.histogram(distance, edges)[0], [0.5, 1, 0.5], "same")
    found = []
    for _ in range(count):
        best = int(counts.argmax())
        if counts[best] < 0.1 * len(distance):
            break
        middle = edges[best] + _BIN / 2
        found.append(float(np.exp(median(distance[np.abs(distance - middle) < 1.7 * _BIN]))))
        counts[max(0, best - 3) : best + 4] = 0
    return found


_BIN = 0.06
"""Width of a bin of logarithms of distance."""
_FEWEST = 12
"""Fewer samples tell no distance."""


def _apart(poses: Poses, score: FloatArray, count: int, views: DepthViews) -> IntArray:
    """Indices of the best poses, no two of them close to each other."""
    far, turned = 0.26 * views.size_m[0, 0], 0.6
    left = np.argsort(-score, kind="stable")[:_LOOKED_AT]
    kept: list[int] = []
    while len(left) and len(kept) < count:
        kept.append(int(left[0]))
        distance, _, heading, _ = (poses.place[left] - poses.place[left[0]]).T
        left = left[(np.abs(wrapped(heading)) > turned) | (np.abs(distance) > far)]
    return np.array(kept)


_LOOKED_AT = 400
"""Best poses of the grid among which those that differ are looked for."""
