"""Settings of a rendered data set, and the named presets."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from recon.errors import RescoreError
from recon.stereo.sgbm import SgbmConfig


@dataclass(frozen=True)
class SplitSize:
    """How many frames a split has, and how many annotated cars stand in them, exactly."""

    n_images: int
    n_cars: int | None = None
    """None where each frame shows as many cars as its street happens to hold."""

    def __post_init__(self) -> None:
        if self.n_images < 1 or not 0 <= (self.n_cars or 0) <= MAX_CARS * self.n_images:
            raise RescoreError(
                f"split size: expected at least one image and at most {MAX_CARS} cars an image, "
                f"got {self}; mend the preset"
            )


MAX_CARS = 3
"""Most annotated cars in one frame whose cars are planned."""


@dataclass(frozen=True)
class CameraConfig:
    """The stereo head; ranges are drawn once a frame."""

    width_px: int = 640
    height_px: int = 480
    focal_px: float = 620.0
    """Focal length in pixels at the full width of 640; scaled with the width."""
    baseline_m: tuple[float, float] = (0.30, 0.40)
    height_m: tuple[float, float] = (1.2, 1.7)
    pitch_deg: tuple[float, float] = (-1.0, 4.0)
    """Pitch of the camera in degrees; positive looks down."""
    yaw_deg: float = 11.0
    """The camera looks across the street within plus and minus this."""


@dataclass(frozen=True)
class CarConfig:
    """Where the cars stand."""

    near_m: float = 8.0
    far_m: float = 45.0
    bin_half_width_deg: float = 14.0
    """Every car is seen within this many degrees of azimuth 90 degrees."""
    heading_jitter_deg: float = 3.0
    min_visibility: float = 0.3
    """Cars with a smaller visible share are annotated with ignore = 1."""
    max_truncation: float = 0.25
    """Cars of which more than this share lies outside the picture are annotated with ignore = 1."""
    other_view_share: float = 0.12
    """Share of frames with a car seen from its front or rear, annotated with ignore = 1."""


@dataclass(frozen=True)
class ClutterConfig:
    """How much of everything else there is.

    Counts are means of the number tried a frame, which is the whole number below or above, whatever the
    depth of the street: a detector keeps few candidates, and a crowded frame would fill them all. Where a
    street has no room, fewer stand.
    """

    pictures: float = 3.2
    """Flat pictures of cars: boards, hoardings, sides of trucks and buses."""
    wheeled: float = 3.3
    """Trucks, buses, caravans, trailers, boats, tractors."""
    boxes: float = 2.7
    """Kiosks, stalls, shelters, containers, skips, carts."""
    furniture: float = 7.5
    """Bins, hedges, walls, crates, trees, poles, people."""
    mural_share: float = 0.25
    """Share of the house fronts that show a picture of a car."""
    occluder_share: float = 0.4
    """Share of cars that something small is put in front of; other things hide little of a car."""


@dataclass(frozen=True)
class LightConfig:
    """Weights of the weather, and how dark the pictures are."""

    sunny: float = 0.34
    overcast: float = 0.33
    dusk: float = 0.33
    level: tuple[float, float] = (0.25, 1.0)
    """Brightness of the picture by day; 1 is well exposed."""
    dusk_level: tuple[float, float] = (0.16, 0.5)
    haze_per_m: tuple[float, float] = (0.0, 0.008)


@dataclass(frozen=True)
class SensorConfig:
    """The cameras of a stereo head, by default a cheap one; ranges are drawn once a frame."""

    blur_sigma_px: tuple[float, float] = (0.6, 1.2)
    read_noise: tuple[float, float] = (0.003, 0.009)
    shot_noise: tuple[float, float] = (0.01, 0.03)
    vignetting: tuple[float, float] = (0.1, 0.4)
    eye_gain_spread: float = 0.12
    """Relative spread of the exposure of the right eye against the left."""
    row_error_px: float = 0.3
    """Spread of the vertical rectification error."""
    roll_error_px: float = 0.25
    """Spread of its growth over half the width."""
    contrast: float = 1.0
    """Exponent of the signal around middle grey, before sRGB's curve."""


@dataclass(frozen=True)
class PartViewConfig:
    """The part-labelled views for the class model."""

    n_instances: int = 6
    """Training shapes that are labelled in all view bins."""
    size_px: int = 256


@dataclass(frozen=True)
class RigConfig:
    """A stereo head on a car; ranges are drawn once a frame."""

    name: str
    width_px: int
    height_px: int
    focal_px: float
    baseline_m: tuple[float, float]
    height_m: tuple[float, float]
    """Above the road."""
    horizon_share: float = 0.5
    """Row of the principal point as a share of the picture's height."""
    sensor: SensorConfig = SensorConfig()


RIGS = (
    RigConfig(
        "kitti",
        1242,
        375,
        721.5,
        (0.53, 0.55),
        (1.60, 1.72),
        horizon_share=0.46,
        # smooth places of KITTI's lossless frames have a noise of half a grey level
        sensor=SensorConfig(
            blur_sigma_px=(0.45, 0.65),
            read_noise=(0.0008, 0.002),
            shot_noise=(0.003, 0.008),
            vignetting=(0.0, 0.15),
            eye_gain_spread=0.03,
            row_error_px=0.1,
            roll_error_px=0.1,
            contrast=1.4,
        ),
    ),
    RigConfig("report", 640, 480, 620.0, (0.30, 0.40), (1.20, 1.70)),
    RigConfig("consumer", 960, 540, 525.0, (0.118, 0.122), (1.20, 1.60)),
)
"""KITTI's head, the one of side views, and a narrow one for consumers at three quarters of its 1280 x 720."""


@dataclass(frozen=True)
class AlongConfig:
    """A street seen along its length, as from a car that drives or stands on it."""

    rigs: tuple[RigConfig, ...] = RIGS
    """Stereo heads that take turns from frame to frame."""
    pitch_deg: tuple[float, float] = (-2.0, 3.0)
    """Pitch of the camera against the road; positive looks down."""
    roll_deg: float = 2.5
    """Roll of the camera against the road, within plus and minus this."""
    slope: float = 0.05
    """Rise of the road over its length, within plus and minus this."""
    bend: float = 0.04
    """Change of the slope on the way, in half of the streets within plus and minus this."""
    curved_share: float = 0.4
    """Share of streets that curve to the left or to the right."""
    curve_radius_m: tuple[float, float] = (90.0, 300.0)
    crossfall: float = 0.025
    """Rise of the road across, within plus and minus this."""
    stated_share: float = 0.5
    """Share of frames of each rig whose camera record states height, pitch and roll.

    The others state no ground.
    """
    far_m: float = 58.0
    """Cars stand up to this far along the street."""
    min_height_px: float = 18.0
    """Cars whose box is lower are annotated with ignore = 1."""
    min_visibility: float = 0.3
    """Cars with a smaller visible share are annotated with ignore = 1."""
    max_truncation: float = 0.5
    """Cars of which more than this share lies outside the picture are annotated with ignore = 1."""
    nearest_m: float = 2.7
    """The disparity search reaches surfaces from this depth on."""


@dataclass(frozen=True)
class SynthConfig:
    """Everything that decides what a rendered data set looks like."""

    splits: Mapping[str, SplitSize] = field(
        default_factory=lambda: {
            "train": SplitSize(45, 50),
            "calibration": SplitSize(50, 56),
            "validation": SplitSize(20, 22),
            "test": SplitSize(109, 127),
        }
    )
    camera: CameraConfig = CameraConfig()
    cars: CarConfig = CarConfig()
    clutter: ClutterConfig = ClutterConfig()
    light: LightConfig = LightConfig()
    sensor: SensorConfig = SensorConfig()
    part_views: PartViewConfig = PartViewConfig()
    sgbm: SgbmConfig = field(default_factory=SgbmConfig)
    n_pictures: int = 10
    """Different pictures of cars that the posters of one split show."""
    layout: Literal["across", "along"] = "across"
    """Whether the camera looks across its street, at the sides of cars, or along it, at all views.
    ``camera``, ``cars`` and ``clutter`` are of streets seen across, ``along`` of those seen along."""
    along: AlongConfig = AlongConfig()

    def __post_init__(self) -> None:
        for split, size in self.splits.items():
            if (size.n_cars is None) != (self.layout == "along"):
                wanted = "a number of cars" if self.layout == "across" else "no number of cars"
                raise RescoreError(
                    f"split {split}: expected {wanted} for streets seen {self.layout}, got {size.n_cars}; "
                    "mend the preset"
                )


def synth_preset(name: str) -> SynthConfig:
    """The settings of a named preset.

    ``paper`` has the sizes of the report, section 6 (109 test images with 127 cars, 20 validation images);
    ``demo`` is the same street with fewer frames; ``tiny`` is for tests, a few small frames;
    ``weight-study`` has many validation frames of the same street and no others, to draw subsets from.
    ``streets`` looks along streets, at cars in all views, with three kinds of stereo heads.

    Raises:
        RescoreError: No such preset.
    """
    if name not in _PRESETS:
        raise RescoreError(
            f"preset: expected one of {', '.join(sorted(_PRESETS))}, got {name!r}; choose one of these"
        )
    return _PRESETS[name]


_PAPER = SynthConfig()
_PRESETS = {
    "paper": _PAPER,
    "weight-study": replace(_PAPER, splits={"validation": SplitSize(500, 550)}),
    "demo": replace(
        _PAPER,
        splits={
            "train": SplitSize(24, 29),
            "calibration": SplitSize(14, 16),
            "validation": SplitSize(12, 14),
            "test": SplitSize(24, 28),
        },
    ),
    "streets": SynthConfig(
        splits={
            "train": SplitSize(80),
            "calibration": SplitSize(40),
            "validation": SplitSize(20),
            "test": SplitSize(60),
        },
        layout="along",
        # a shape space is learned from all training shapes
        part_views=PartViewConfig(n_instances=24),
        # a long view bears less haze, and those who drive with a camera do so by day
        light=LightConfig(sunny=0.5, overcast=0.35, dusk=0.15, level=(0.5, 1.15), haze_per_m=(0.0, 0.004)),
    ),
    "tiny": replace(
        _PAPER,
        splits={
            "train": SplitSize(3, 4),
            "calibration": SplitSize(2, 2),
            "validation": SplitSize(2, 2),
            "test": SplitSize(3, 4),
        },
        camera=CameraConfig(width_px=320, height_px=240),
        cars=CarConfig(far_m=22.0),
        part_views=PartViewConfig(n_instances=2, size_px=128),
        sgbm=SgbmConfig(num_disparities=32),
        n_pictures=2,
    ),
}
