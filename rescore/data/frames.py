"""Data sets: what is known of each frame and its cars, before any pixel is read; and loaded frames."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array
from recon.camera import DepthCamera, GroundedStereo, GroundPlane, StereoCamera
from recon.errors import RescoreError
from recon.stereo.depth_noise import equivalent_pair
from recon.stereo.ground import GroundEstimate, estimate_ground
from recon.stereo.sgbm import PNG_SCALE, SgbmConfig, disparity_of_scene
from rescore.data.boxes3d import Boxes3D
from rescore.data.depth_files import MeasuredFile, Quantity, read_measured
from rescore.data.pictures import read_rgb

SPLITS = ("train", "calibration", "validation", "test")
"""train: detectors and class model; calibration: Platt scaling; validation: w; test: the curves."""

MAX_FRAME_NAME_BYTES = 240
"""Longest name of a frame: that of a file with an end has 255 bytes at most."""


def refuse_split(where: Path, image_id: int, split: str) -> None:
    """Raises RescoreError where an image is of no split of ``SPLITS``."""
    if split not in SPLITS:
        raise RescoreError(
            f"{where}: image {image_id}: expected split {', '.join(SPLITS)}, got {split!r}; mend it"
        )


def refuse_twice(where: Path, what: str, ids: Iterable[int]) -> None:
    """Raises RescoreError where a number stands twice among the ids of things of one kind."""
    twice = [i for i, count in Counter(ids).items() if count > 1]
    if twice:
        raise RescoreError(f"{where}: expected each {what} once, got {twice[0]} twice; number them anew")


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """One frame of a data set on disk."""

    image_id: int
    left_path: Path
    right_path: Path | None
    disparity_path: Path | None
    split: str
    width_px: int
    height_px: int
    camera: StereoCamera | DepthCamera | None
    """The pair, or the camera alone where depth is measured and no baseline is stated."""
    ground: GroundPlane | None
    """Ground plane as the data set states it; None where it states none."""
    instance_path: Path | None = None
    """16-bit picture of instance numbers on rendered scenes, 0 where there is none."""
    instance_kinds: Mapping[int, str] = field(default_factory=dict)
    """What each instance number is, on rendered scenes."""
    measured: MeasuredFile | None = None
    """Measured depth or disparity in another form than ``disparity_path``, KITTI's."""
    disparity_offset_px: float = 0.0
    """cx of the right picture less cx of the left (Middlebury's doffs). Disparities, measured or matched, get
    it added as they are loaded, so that all that follows has depth = fx baseline / disparity."""
    name: str = ""
    """Name by which files of boxes know the frame, where it is not that of its left picture."""

    @property
    def measurement(self) -> MeasuredFile | None:
        """The file of measured depth or disparity, if there is one."""
        if self.disparity_path is not None:
            return MeasuredFile(self.disparity_path, Quantity.DISPARITY, PNG_SCALE)
        return self.measured

    @property
    def pair(self) -> StereoCamera | None:
        """The pair, where its baseline is stated."""
        return self.camera if isinstance(self.camera, StereoCamera) else None


@dataclass(frozen=True, eq=False, slots=True)
class Truth:
    """The annotated objects of one image."""

    annotation_id: IntArray
    """Shape (n,)."""
    xyxy_px: FloatArray
    """Shape (n, 4), pixel edges."""
    ignore: BoolArray
    """Shape (n,): neither a hit nor a false alarm when found, not missed when not (iscrowd or ignore)."""
    visibility: FloatArray
    """Shape (n,): visible share in [0, 1], NaN where unknown."""
    shape_id: tuple[str, ...]
    """Length n: name of the car shape on rendered scenes, else empty."""
    azimuth_deg: FloatArray | None = None
    """Shape (n,), from where the object is seen, counter-clockwise from above: 0 its front, 90 its left side;
    NaN where unknown. None where no object of the image has one."""
    truncated: FloatArray | None = None
    """Shape (n,), share outside the picture as KITTI gives it, NaN where unknown; None as above."""
    occluded: IntArray | None = None
    """Shape (n,), KITTI's level: 0 visible, 1 partly, 2 largely occluded, 3 unknown; None as above."""
    boxes3d: Boxes3D | None = None
    """The 3D boxes, NaN rows where an object has none; None as above."""


@dataclass(frozen=True, eq=False)
class DataSet:
    """Frames with their truth, in the order of the file."""

    root: Path
    category_id: int
    category: str
    frames: tuple[FrameRecord, ...]
    truth: Mapping[int, Truth]
    """Annotated objects by image id; every frame has an entry, empty where it holds no car."""
    notes: tuple[str, ...] = ()
    """What the reader left out, mapped or doubts, a line each, for the user to see."""
    category_names: Mapping[int, str] = field(default_factory=dict)
    """Name of each category number, where the layout numbers them."""
    class_ids: frozenset[int] = frozenset()
    """Numbers of the categories whose boxes are the truth, where there are others beside ``category_id``."""
    renamed: Mapping[str, str] = field(default_factory=dict)
    """Classes by the names of others, in lower case, that are taken for them
    (``rescore.formats.labels.ClassMap``)."""

    @property
    def n_cars(self) -> int:
        """Annotated objects that count."""
        return int((~self._ignored).sum())

    @property
    def n_ignored(self) -> int:
        """Annotated objects and regions that count neither for nor against."""
        return int(self._ignored.sum())

    @property
    def _ignored(self) -> BoolArray:
        return np.concatenate([np.zeros(0, np.bool_), *(t.ignore for t in self.truth.values())])

    def split(self, name: str) -> "DataSet":
        """The frames of one split."""
        frames = tuple(f for f in self.frames if f.split == name)
        return replace(self, frames=frames, truth={f.image_id: self.truth[f.image_id] for f in frames})


def none_counts(n_ignored: int) -> str:
    """Why no object counts, where ``n_ignored`` are annotated and all ignored."""
    boxes = "1 box is" if n_ignored == 1 else f"{n_ignored} boxes are"
    return (
        f"{boxes} annotated and none counts: all are ignored (iscrowd or ignore in COCO, difficult in VOC, "
        "DontCare and neighbouring classes in KITTI)"
    )


class GroundSource(StrEnum):
    """Where the ground plane of a frame comes from."""

    STATED = "stated"
    """Height and pitch of the camera come with the picture."""
    STEREO = "stereo"
    """No ground plane is stated, and the one fitted to the measured disparity is trusted."""
    DEFAULT = "default"
    """No ground plane is stated or trusted: ``recon.camera.DEFAULT_GROUND`` predicts depth, and nothing is
    asked of the ground."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One loaded frame."""

    image_id: int
    left_rgb: UInt8Array
    """Shape (h, w, 3)."""
    disparity_px: Float32Array
    """Measured, shape (h, w); NaN where there is no measurement."""
    camera: StereoCamera | None
    """The pair; for depth without a stated baseline the one that ``recon.stereo.depth_noise`` finds in it."""
    ground: GroundPlane | None
    """The stated ground plane, else the one of ``ground_estimate`` where it is trusted; None where neither is
    there."""
    ground_estimate: GroundEstimate | None = None
    """Ground plane fitted to the measured disparity, where none is stated and the camera is known."""

    @property
    def seen_from(self) -> GroundedStereo | None:
        """Where the pair is seen from: camera and ground plane; None where one of them is missing."""
        if self.camera is None or self.ground is None:
            return None
        return GroundedStereo(self.camera, self.ground)

    @property
    def ground_source(self) -> GroundSource:
        """Where ``ground`` comes from."""
        if self.ground is None:
            return GroundSource.DEFAULT
        return GroundSource.STATED if self.ground_estimate is None else GroundSource.STEREO

    def with_stereo_ground(self) -> "Frame":
        """The frame with the ground plane of its disparity, trusted or not, where none is stated.

        What is stated is kept: it was measured once with care, and holds where no ground is in view.
        """
        if self.ground is not None or self.camera is None:
            return self
        # one seed for all frames, so that a frame has one ground plane wherever it comes from
        estimate = estimate_ground(self.disparity_px, self.camera, np.random.default_rng(0))
        ground = estimate.ground if estimate.trusted else None
        return replace(self, ground=ground, ground_estimate=estimate)


def load_frame(record: FrameRecord, stereo: SgbmConfig) -> Frame:
    """Read the left picture and the disparity, which is computed from the pair where no file is given.

    The ground plane is that of the record, else that of the disparity where it can be trusted.
    """
    left = read_rgb(record.left_path, record.width_px, record.height_px)
    file, camera = record.measurement, record.pair
    if file is not None:
        disparity = read_measured(file, record.width_px, record.height_px)
        if file.quantity is Quantity.DISPARITY:
            disparity = disparity + np.float32(record.disparity_offset_px)
        elif record.camera is None:
            raise RescoreError(
                f"{file.path}: expected a calibration to use depth in metres, got none; give the frame a "
                "camera"
            )
        else:
            disparity, camera = disparity_of_depth(disparity, record.camera)
    elif record.right_path is not None:
        right = read_rgb(record.right_path, record.width_px, record.height_px)
        disparity = _pair_disparity(left, right, stereo, record.disparity_offset_px)
    else:
        raise RescoreError(
            f"image {record.image_id}: expected right_file_name or disparity_file_name, got neither; "
            "rescoring needs measured depth"
        )
    return Frame(record.image_id, left, disparity, camera, record.ground).with_stereo_ground()


def disparity_of_depth(
    depth_m: Float32Array, camera: StereoCamera | DepthCamera
) -> tuple[Float32Array, StereoCamera]:
    """Measured depth (h, w) in metres as the disparity of a pair, (h, w) in pixels, and that pair.

    It is the stated pair; where none is stated, the one whose disparity would be as noisy as a matcher's.
    """
    pair = camera if isinstance(camera, StereoCamera) else equivalent_pair(depth_m, camera.left)
    return pair.disparity_px(depth_m), pair


def _pair_disparity(
    left: UInt8Array, right: UInt8Array, stereo: SgbmConfig, offset_px: float
) -> Float32Array:
    """Disparity of a pair plus its offset, (h, w).

    The right picture is moved by the whole pixels of the offset before matching: the search begins at
    disparity 0, which is then infinitely far, as for a pair without offset.
    """
    columns, width = round(offset_px), left.shape[1]
    if columns == 0:
        return disparity_of_scene(left, right, stereo) + np.float32(offset_px)
    if abs(columns) >= width:
        raise RescoreError(
            f"camera: expected a disparity offset below the width of {width} px, got {offset_px:g}; "
            "check the principal points of the calibration"
        )
    source = np.clip(np.arange(width) + columns, 0, width - 1)
    disparity = disparity_of_scene(left, np.ascontiguousarray(right[:, source]), stereo)
    matched = np.arange(width, dtype=np.float32) - disparity + columns
    # a match in the columns that were repeated to fill the moved picture is none
    disparity[(matched < 0) | (matched > width - 1)] = np.nan
    return disparity + np.float32(offset_px - columns)


def frame_names(data: DataSet) -> dict[int, str]:
    """The name of each frame's file of boxes: its own or that of its left picture, its number where names
    repeat."""
    names = {f.image_id: f.name or f.left_path.stem for f in data.frames}
    if len(set(names.values())) == len(data.frames):
        return names
    return {f.image_id: f"{f.image_id:06d}" for f in data.frames}
