"""The plan of a street that is seen along its length: what lies side by side across it, and its crossing.

The world has x to the right of the middle of the carriageway, y along the street, z up. Traffic keeps to the
right, so lanes with x > 0 lead away from the camera.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from datasets_synth.meshes.grade import Grade
from datasets_synth.presets import AlongConfig
from datasets_synth.street.street import KERB_HEIGHT_M
from recon.arrays import FloatArray

SIDES = (-1, 1)
"""The left and the right side of the street, as signs of x."""
REAR_M = -9.0
"""The ground begins this far behind the camera."""
END_M = 190.0
"""The street ends here."""
WIDE_M = 95.0
"""The ground reaches this far to both sides."""
PARKING = ("none", "parallel", "square", "slanting")
"""How cars park: not at all, one behind the other, or side by side."""
_PARKING_SHARES = (0.26, 0.46, 0.16, 0.12)
INSIDE_M = 1e-6
"""A place this far from the edge of a band surely belongs to it."""


@dataclass(frozen=True)
class Band:
    """A band of ground along the street."""

    x0_m: float
    x1_m: float
    z0_m: float
    """Height at x0 above the grade."""
    z1_m: float
    role: str
    """"road", "lot" (parking), "tracks", "pavement", "verge" or "square"."""
    surface: str

    @property
    def side(self) -> int:
        """-1 left of the middle of the street, 1 right of it."""
        return -1 if self.x0_m + self.x1_m < 0 else 1


@dataclass(frozen=True)
class Crossing:
    """A side street that crosses at a right angle."""

    y_m: float
    half_width_m: float
    pavement_m: float
    """Width of the pavements along it."""

    @property
    def road_m(self) -> tuple[float, float]:
        """Lowest and highest y of its carriageway."""
        return self.y_m - self.half_width_m, self.y_m + self.half_width_m

    @property
    def gap_m(self) -> tuple[float, float]:
        """Lowest and highest y without houses."""
        low, high = self.road_m
        return low - self.pavement_m, high + self.pavement_m


@dataclass(frozen=True)
class Curve:
    """A street that is straight, curves with one radius, and is straight again, seen from above."""

    start_m: float
    """y where it begins to curve, 0 or more."""
    radius_m: float
    """Positive for a curve to the right."""
    turn: float
    """Tangent of the whole angle, 0 for a straight street, positive."""

    @property
    def end_m(self) -> float:
        """y where the street is straight again."""
        return self.start_m + self.turn * abs(self.radius_m)

    def shift_m(self, y_m: FloatArray | float) -> FloatArray:
        """How far to the right the middle of the street lies at y, any shape."""
        y = np.asarray(y_m, float)
        inside = np.clip(y - self.start_m, 0, self.end_m - self.start_m)
        bent = inside**2 / (2 * self.radius_m)
        return np.asarray(bent + np.maximum(y - self.end_m, 0) * self.slope_at(self.end_m))

    def slope_at(self, y_m: float) -> float:
        """Tangent of the angle between the street and its beginning at y."""
        return float(np.clip(y_m - self.start_m, 0, self.end_m - self.start_m) / self.radius_m)


@dataclass(frozen=True)
class Road:
    """A street before anything stands on it.

    Its x and y are those of a straight street. The world has y alike, and x is shifted by the curve, so that
    side streets stay level with the picture.
    """

    bands: tuple[Band, ...]
    """From left to right without gaps."""
    lanes_m: tuple[float, ...]
    """x of the middles of the lanes, oncoming ones below 0."""
    lane_width_m: float
    edge_m: tuple[float, float]
    """x of the left and the right edge of the lanes."""
    parking: tuple[str, str]
    """How cars park at the left and at the right, one of ``PARKING`` each."""
    crossing: Crossing | None
    grade: Grade
    curve: Curve = Curve(0.0, 1.0, 0.0)

    @property
    def frontage_m(self) -> tuple[float, float]:
        """x where the ground of the houses begins at the left and at the right."""
        squares = [b for b in self.bands if b.role == "square"]
        return squares[0].x1_m, squares[-1].x0_m

    def band_at(self, x_m: float) -> Band:
        """The band at x."""
        return next((b for b in self.bands if x_m < b.x1_m), self.bands[-1])

    def profile_m(self, x_m: float, y_m: float) -> float:
        """Height of the ground at (x, y) above the grade."""
        if self.crossing is not None and self.crossing.road_m[0] < y_m < self.crossing.road_m[1]:
            x_m = float(np.clip(x_m, self.edge_m[0] + INSIDE_M, self.edge_m[1] - INSIDE_M))
        band = self.band_at(x_m)
        share = np.clip((x_m - band.x0_m) / (band.x1_m - band.x0_m), 0, 1)
        return float(band.z0_m + share * (band.z1_m - band.z0_m))

    def height_m(self, x_m: float, y_m: float) -> float:
        """Height of the ground at (x, y) in the world."""
        return self.profile_m(x_m, y_m) + float(self.grade.height_m(y_m))

    def axes(self, x_m: float, y_m: float) -> FloatArray:
        """Columns (3, 3): right, ahead and up of the ground at (x, y) in the world, an orthonormal frame.

        Ahead is along the world's y, whatever the curve.
        """
        across = (self.profile_m(x_m + 0.05, y_m) - self.profile_m(x_m - 0.05, y_m)) / 0.1
        across = across if abs(across) < 0.2 else 0.0  # a kerb is no slope
        along = np.array([0.0, 1.0, self.grade.slope_at(y_m) - across * self.curve.slope_at(y_m)])
        along /= np.linalg.norm(along)
        right = np.array([1.0, 0.0, across])
        right -= (right @ along) * along
        right /= np.linalg.norm(right)
        return np.stack([right, along, np.cross(right, along)], axis=1)

    def world_m(self, x_m: float, y_m: float) -> FloatArray:
        """The place (3,) on the ground at (x, y) in the world."""
        return np.array([x_m + float(self.curve.shift_m(y_m)), y_m, self.height_m(x_m, y_m)])

    def heading_rad(self, yaw_rad: float, y_m: float) -> float:
        """Yaw in the world of what has a yaw in a straight street: what looks along it follows its curve."""
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        return float(np.arctan2(s, c + self.curve.slope_at(y_m) * s))

    def kerbs(self) -> list[tuple[float, float, float]]:
        """(x, low z, high z) of each step between two bands, heights above the grade."""
        return [
            (a.x1_m, min(a.z1_m, b.z0_m), max(a.z1_m, b.z0_m))
            for a, b in pairwise(self.bands)
            if abs(a.z1_m - b.z0_m) > 0.01
        ]


def sample_road(config: AlongConfig, rng: np.random.Generator) -> Road:
    """A street with one or two lanes each way, parking, verges, pavements and often a crossing."""
    width = float(rng.uniform(3.0, 3.5))
    per_side = 2 if rng.random() < 0.22 else 1
    tracks = 3.2 if rng.random() < 0.16 else 0.0
    half = width * per_side
    near = [tracks + width * (k + 0.5) for k in range(per_side)]
    lanes = tuple([-x for x in reversed(near)] + near)
    edge = tracks + half
    fall = float(rng.uniform(-1, 1) * config.crossfall)
    crowned = rng.random() < 0.3
    slopes = {side: (-abs(fall) * side / 2 if crowned else fall) for side in SIDES}
    skin = "cobbles" if rng.random() < 0.07 else "road"
    parking = {side: str(rng.choice(PARKING, p=_PARKING_SHARES)) for side in SIDES}
    left = _side_bands(-1, (tracks, edge), slopes[-1], parking[-1], skin, rng)
    right = _side_bands(1, (tracks, edge), slopes[1], parking[1], skin, rng)
    middle = []
    if tracks:
        middle = [
            Band(-tracks, 0.0, -tracks * slopes[-1], 0.0, "tracks", "lawn"),
            Band(0.0, tracks, 0.0, tracks * slopes[1], "tracks", "lawn"),
        ]
    return Road(
        bands=(*reversed(left), *middle, *right),
        lanes_m=lanes,
        lane_width_m=width,
        edge_m=(-edge, edge),
        parking=(parking[-1], parking[1]),
        crossing=_sample_crossing(rng),
        grade=_sample_grade(config, rng),
        curve=_sample_curve(config, rng),
    )


def _sample_crossing(rng: np.random.Generator) -> Crossing | None:
    if rng.random() >= 0.62:
        return None
    return Crossing(float(rng.uniform(9, 42)), float(rng.uniform(3.0, 4.8)), float(rng.uniform(1.8, 3.0)))


def _sample_grade(config: AlongConfig, rng: np.random.Generator) -> Grade:
    slope = float(rng.uniform(-1, 1) * config.slope) if rng.random() < 0.6 else 0.0
    bend = float(rng.uniform(-1, 1) * config.bend) if rng.random() < 0.5 else 0.0
    return Grade(slope, bend, float(rng.uniform(14, 50)), float(rng.uniform(3.5, 8.0)))


def _sample_curve(config: AlongConfig, rng: np.random.Generator) -> Curve:
    if rng.random() >= config.curved_share:
        return Curve(0.0, 1.0, 0.0)
    radius = float(rng.choice([-1, 1]) * rng.uniform(*config.curve_radius_m))
    return Curve(float(rng.uniform(0, 22)), radius, float(rng.uniform(0.12, 0.4)))


def _side_bands(
    side: int,
    carriageway_m: tuple[float, float],
    slope: float,
    parking: str,
    skin: str,
    rng: np.random.Generator,
) -> list[Band]:
    """The bands of one side from the middle of the street outwards."""
    out: list[Band] = []

    def add(width: float, z: float, rise: float, role: str, surface: str) -> float:
        """Append a band and give the height of its outer edge; ``rise`` is per metre outwards."""
        start = abs(out[-1].x1_m if side > 0 else out[-1].x0_m) if out else carriageway_m[0]
        end_z = z + rise * width
        ends = (start, start + width) if side > 0 else (-start - width, -start)
        heights = (z, end_z) if side > 0 else (end_z, z)
        out.append(Band(*ends, *heights, role, surface))
        return end_z

    outward = slope * side
    z = add(carriageway_m[1] - carriageway_m[0], carriageway_m[0] * outward, outward, "road", skin)
    if parking != "none":
        paved = skin if rng.random() < 0.6 else "cobbles"
        # places do not fall away from the road: water runs to its gutter
        z = add(2.15 if parking == "parallel" else 5.0, z, max(outward, 0.0), "lot", paved)
    z += KERB_HEIGHT_M
    if rng.random() < 0.4:
        z = add(float(rng.uniform(1.2, 3.5)), z, 0.01, "verge", "lawn")
    z = add(float(rng.uniform(1.7, 3.6)), z, 0.02, "pavement", "slabs" if rng.random() < 0.7 else "road")
    yard = str(rng.choice(["lawn", "lawn", "slabs"]))
    start = abs(out[-1].x1_m if side > 0 else out[-1].x0_m)
    add(WIDE_M - start, z, 0.0, "square", yard)
    return out
