"""Settings of depth evidence: camera, stereo matcher, view bin, and the settings of each stage."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Literal

from recon.camera import StereoCamera
from recon.errors import RescoreError
from recon.localization.disparity_fit import DisparityFitConfig
from recon.reconstruction.reconstruct import ReconstructConfig
from recon.stereo.sgbm import SgbmConfig, disparities_to_reach
from rescore.data.frames import DataSet
from rescore.evidence.align_depth import AlignConfig
from rescore.evidence.cues import CueConfig


class CameraChoice(StrEnum):
    """The choice of camera and ground plane that predict depth."""

    CALIBRATED = "calibrated"
    """The camera and ground of the frame, each where it is known; the default ones where it is not.

    The default: what is known is used, and a picture without calibration is treated as in the report.
    """
    DEFAULT = "default"
    """One assumed camera and ground for every picture, as in the report, whose cameras were not known.

    An assumed horizon that is too low loses far cars, which then seem to stand above it: nearly a third of
    them on rendered streets with a camera pitch of -1 to 4 degrees.
    """


@dataclass(frozen=True)
class RescoreConfig:
    """Settings of rescoring."""

    camera: CameraChoice = CameraChoice.CALIBRATED
    view_bin: int | Literal["fit", "model"] = "fit"
    """The bin that a candidate is taken to be seen from where its detector does not say. "fit": that of the
    instance of the class fitted to its box and disparity; where none is fitted, as in all frames without
    ground or with a class model without shape space, bin 3, the left side of a car. "model": the one that the
    class model explains it best with, tried one after another."""
    stereo: SgbmConfig = field(default_factory=SgbmConfig)
    """Used where a data set gives a right picture but no disparity."""
    nearest_m: float = 2.0
    """Depth in metres from which such pairs are measured where the camera is known: ``stereo`` then searches
    at least as many disparities as that takes. A search twice as far takes about twice as long."""
    reconstruct: ReconstructConfig = field(default_factory=ReconstructConfig)
    align: AlignConfig = field(default_factory=AlignConfig)
    fit: DisparityFitConfig = field(default_factory=DisparityFitConfig)
    """Settings of the instances that are fitted to boxes and disparity."""
    cues: CueConfig = field(default_factory=CueConfig)
    """Settings of the cues of the modes that go past eq. 6."""

    def __post_init__(self) -> None:
        if not self.nearest_m > 0:
            raise RescoreError(f"nearest_m: expected metres above 0, got {self.nearest_m:g}; try 2")


def automatic_stereo(data: DataSet, nearest_m: float = RescoreConfig.nearest_m) -> SgbmConfig:
    """Settings of the stereo matcher for the frames of a data set without a disparity file."""
    width = max((f.width_px for f in data.frames), default=640)
    return stereo_for(width, [(f.pair, f.disparity_offset_px) for f in data.frames if f.pair], nearest_m)


def stereo_for(
    width_px: int, cameras: Iterable[tuple[StereoCamera, float]], nearest_m: float = RescoreConfig.nearest_m
) -> SgbmConfig:
    """Settings of the stereo matcher for pictures of a width.

    Disparities up to a tenth of the picture's width are searched, rounded up to a multiple of 16, 64 at 640
    pixels; and where cameras are known at least as many as reach ``nearest_m``, which makes it
    ``recon.stereo.sgbm.KITTI_SGBM`` for KITTI's. What is nearer than the search reaches does not come out as
    a hole: much of it gets the largest disparity.

    Args:
        width_px: Of the widest picture.
        cameras: Pairs, each with the cx of its right picture less that of its left one, in pixels.
        nearest_m: Depth of the nearest surface wanted.
    """
    reach = [disparities_to_reach(camera, nearest_m, offset_px) for camera, offset_px in cameras]
    # OpenCV's result is not defined for searches nearly as wide as the picture
    most = max(16, width_px // 32 * 16)
    return SgbmConfig(num_disparities=min(max([-(-width_px // 160) * 16, *reach]), most))


def with_stereo_for(config: RescoreConfig, data: DataSet, num_disparities: int | None) -> RescoreConfig:
    """The config with the disparities asked for, or at least as many as ``automatic_stereo`` advises."""
    automatic = automatic_stereo(data, config.nearest_m)
    advised = max(config.stereo.num_disparities, automatic.num_disparities)
    chosen = advised if num_disparities is None else num_disparities
    return replace(config, stereo=replace(config.stereo, num_disparities=chosen))


def with_camera(config: RescoreConfig, camera: str | None) -> RescoreConfig:
    """The config with the camera of a name, unchanged for None.

    Raises:
        RescoreError: no such name.
    """
    if camera is None:
        return config
    if camera not in list(CameraChoice):
        raise RescoreError(
            f"camera: expected {' or '.join(CameraChoice)}, got {camera!r}; choose one of these"
        )
    return replace(config, camera=CameraChoice(camera))
