"""Data sets: what is known of each frame and its cars, before any pixel is read; and loaded frames."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngImageFile

from recon.camera import GroundPlane, StereoCamera
from recon.errors import RescoreError
from recon.stereo import PNG_SCALE, SgbmConfig, compute_disparity
from recon.stereo_ground import GroundEstimate, estimate_ground
from rescore.measured import MeasuredFile, Quantity, read_measured

PNG_HEAD = b"\x89PNG\r\n\x1a\n"
PNG_END = b"\x00\x00\x00\x00IEND\xae\x42\x60\x82"
SPLITS = ("train", "calibration", "validation", "test")
"""train: detectors and class model; calibration: Platt scaling; validation: w; test: the curves."""


@dataclass(frozen=True)
class FrameRecord:
    """One frame of a data set on disk."""

    image_id: int
    left_path: Path
    right_path: Path | None
    disparity_path: Path | None
    split: str
    width_px: int
    height_px: int
    camera: StereoCamera | None
    ground: GroundPlane | None
    """As the data set states it; None where it does not."""
    instance_path: Path | None = None
    """16-bit picture of instance numbers on rendered scenes, 0 where there is none."""
    instance_kinds: Mapping[int, str] = field(default_factory=dict)
    """What each instance number is, on rendered scenes."""
    measured: MeasuredFile | None = None
    """Measured depth or disparity in another form than ``disparity_path``, KITTI's."""
    disparity_offset_px: float = 0.0
    """cx of the right picture less cx of the left (Middlebury's doffs). Disparities, measured or matched, get
    it added as they are loaded, so that all that follows has depth = fx baseline / disparity."""

    @property
    def measurement(self) -> MeasuredFile | None:
        """The file of measured depth or disparity, if there is one."""
        if self.disparity_path is not None:
            return MeasuredFile(self.disparity_path, Quantity.DISPARITY, PNG_SCALE)
        return self.measured


@dataclass(frozen=True, eq=False)
class Truth:
    """The annotated objects of one image."""

    annotation_id: NDArray[np.int64]
    """Shape (n,)."""
    xyxy_px: NDArray[np.float64]
    """Shape (n, 4), pixel edges."""
    ignore: NDArray[np.bool_]
    """Shape (n,): neither a hit nor a false alarm when found, not missed when not (iscrowd or ignore)."""
    visibility: NDArray[np.float64]
    """Shape (n,): visible share in [0, 1], NaN where unknown."""
    shape_id: tuple[str, ...]
    """Length n: name of the car shape on rendered scenes, else empty."""
    azimuth_deg: NDArray[np.float64] | None = None
    """Shape (n,), from where the object is seen, counter-clockwise from above: 0 its front, 90 its left side;
    NaN where unknown. None where no object of the image has one."""
    truncated: NDArray[np.float64] | None = None
    """Shape (n,), share outside the picture as KITTI gives it, NaN where unknown; None as above."""
    occluded: NDArray[np.int64] | None = None
    """Shape (n,), KITTI's level: 0 visible, 1 partly, 2 largely occluded, 3 unknown; None as above."""


@dataclass(frozen=True, eq=False)
class DataSet:
    """Frames with their truth, in the order of the file."""

    root: Path
    category_id: int
    category: str
    frames: tuple[FrameRecord, ...]
    truth: Mapping[int, Truth]
    """By image id; every frame has an entry, empty where it holds no car."""
    notes: tuple[str, ...] = ()
    """What the reader left out, mapped or doubts, a line each, for the user to see."""

    def split(self, name: str) -> "DataSet":
        """The frames of one split."""
        frames = tuple(f for f in self.frames if f.split == name)
        return DataSet(
            self.root,
            self.category_id,
            self.category,
            frames,
            {f.image_id: self.truth[f.image_id] for f in frames},
            self.notes,
        )


@dataclass(frozen=True, eq=False)
class Splits:
    """Disjoint parts of one data set; built only where nothing leaks from one to another."""

    train: DataSet
    calibration: DataSet
    validation: DataSet
    test: DataSet

    def __post_init__(self) -> None:
        parts = {name: getattr(self, name) for name in SPLITS}
        _refuse_overlap("image", {k: {f.left_path for f in v.frames} for k, v in parts.items()})
        shapes = {k: {s for t in v.truth.values() for s in t.shape_id if s} for k, v in parts.items()}
        _refuse_overlap("car shape", shapes)

    @staticmethod
    def of(data: DataSet) -> "Splits":
        """The four splits of a data set."""
        return Splits(*(data.split(name) for name in SPLITS))

    @property
    def validation_set(self) -> "ValidationSet":
        """The only thing that a weight can be tuned on."""
        return ValidationSet(self.validation, _from_splits=_KEY)

    @property
    def fitting_set(self) -> "FittingSet":
        """The only thing that a model of depth evidence can be fitted to."""
        data = self.train
        return FittingSet(
            DataSet(
                data.root,
                data.category_id,
                data.category,
                (*self.train.frames, *self.calibration.frames),
                {**self.train.truth, **self.calibration.truth},
            ),
            _from_splits=_KEY,
        )


_KEY = object()


@dataclass(frozen=True, eq=False)
class ValidationSet:
    """Validation frames of a data set whose splits share nothing; made by ``Splits.validation_set`` alone.

    What is tuned takes this type, so that test frames cannot get there by mistake.
    """

    data: DataSet
    _from_splits: object

    def __post_init__(self) -> None:
        if self._from_splits is not _KEY:
            raise TypeError("a ValidationSet comes from Splits.of(data).validation_set, nowhere else")
        strangers = sorted({f.split for f in self.data.frames} - {"validation"})
        if strangers:
            raise RescoreError(
                f"validation set: expected split 'validation' alone, got {strangers[0]!r} too; mend it"
            )


@dataclass(frozen=True, eq=False)
class FittingSet:
    """Training and calibration frames of such a data set; made by ``Splits.fitting_set`` alone.

    Detectors never look at measured depth, so the frames that trained them serve too.
    """

    data: DataSet
    _from_splits: object

    def __post_init__(self) -> None:
        if self._from_splits is not _KEY:
            raise TypeError("a FittingSet comes from Splits.of(data).fitting_set, nowhere else")
        strangers = sorted({f.split for f in self.data.frames} - {"train", "calibration"})
        if strangers:
            raise RescoreError(
                f"fitting set: expected splits 'train' and 'calibration' alone, got {strangers[0]!r} too; "
                "mend it"
            )


def _refuse_overlap(what: str, members: Mapping[str, set[Path] | set[str]]) -> None:
    names: Sequence[str] = tuple(members)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            shared = sorted(str(x) for x in members[a] & members[b])
            if shared:
                raise RescoreError(
                    f"splits: {a} and {b} must share no {what}, both hold {shared[0]!r} "
                    f"({len(shared)} in all); give each to one split"
                )


class GroundSource(StrEnum):
    """Where the ground plane of a frame comes from."""

    STATED = "stated"
    """Height and pitch of the camera come with the picture."""
    STEREO = "stereo"
    """None is stated, and that of the measured disparity is trusted."""
    DEFAULT = "default"
    """Neither: ``recon.camera.DEFAULT_GROUND`` predicts depth, and nothing is asked of the ground."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One loaded frame."""

    image_id: int
    left_rgb: NDArray[np.uint8]
    """Shape (h, w, 3)."""
    disparity_px: NDArray[np.float32]
    """Measured, shape (h, w); NaN where there is no measurement."""
    camera: StereoCamera | None
    ground: GroundPlane | None
    """Stated, or that of ``ground_estimate`` where it is trusted; None where it is unknown."""
    ground_estimate: GroundEstimate | None = None
    """From the measured disparity where no ground is stated and the camera is known."""

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


def decode_picture(path: Path, flags: int) -> NDArray[np.generic] | None:
    """The pixels of a picture file as OpenCV gives them; None where it is no whole picture."""
    # imdecode on bytes, since imread neither takes every path nor says why it failed
    data = path.read_bytes()
    # of a damaged file OpenCV gives the rows before the damage, and prints lines of its own
    damaged = (data.startswith(PNG_HEAD) and not _is_whole_png(data)) or (
        data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data
    )
    if not data or damaged:
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None


def _is_whole_png(data: bytes) -> bool:
    """Whether the chunks of a PNG follow each other up to the last one, each with the checksum it names."""
    # Pillow does not read the checksum of the last chunk, and OpenCV refuses pictures without it
    if PNG_END not in data:
        return False
    try:
        PngImageFile(io.BytesIO(data)).verify()
    except (OSError, SyntaxError, ValueError):
        return False
    return True


def read_rgb(path: Path, width_px: int, height_px: int) -> NDArray[np.uint8]:
    """The picture as (h, w, 3) uint8 RGB; an error where it is missing, unreadable or of another size."""
    if not path.is_file():
        raise RescoreError(f"{path}: expected a picture, found no file; check file_name in annotations.json")
    bgr = decode_picture(path, cv2.IMREAD_COLOR)
    if bgr is None:
        raise RescoreError(
            f"{path}: expected a picture that OpenCV reads, could not decode it; write it again as PNG"
        )
    if bgr.shape[:2] != (height_px, width_px):
        raise RescoreError(
            f"{path}: expected {width_px} x {height_px} pixels, got {bgr.shape[1]} x {bgr.shape[0]}; "
            "mend width and height in annotations.json or the picture"
        )
    return np.ascontiguousarray(bgr[..., ::-1], np.uint8)


def load_frame(record: FrameRecord, stereo: SgbmConfig) -> Frame:
    """Read the left picture and the disparity, which is computed from the pair where no file is given.

    The ground plane is that of the record, else that of the disparity where it can be trusted.
    """
    left = read_rgb(record.left_path, record.width_px, record.height_px)
    file = record.measurement
    if file is not None:
        disparity = read_measured(file, record.width_px, record.height_px, record.camera)
        if file.quantity is Quantity.DISPARITY:
            disparity = disparity + np.float32(record.disparity_offset_px)
    elif record.right_path is not None:
        right = read_rgb(record.right_path, record.width_px, record.height_px)
        disparity = _pair_disparity(left, right, stereo, record.disparity_offset_px)
    else:
        raise RescoreError(
            f"image {record.image_id}: expected right_file_name or disparity_file_name, got neither; "
            "rescoring needs measured depth"
        )
    return Frame(record.image_id, left, disparity, record.camera, record.ground).with_stereo_ground()


def _pair_disparity(
    left: NDArray[np.uint8], right: NDArray[np.uint8], stereo: SgbmConfig, offset_px: float
) -> NDArray[np.float32]:
    """Disparity of a pair plus its offset, (h, w).

    The right picture is moved by the whole pixels of the offset before matching: the search begins at
    disparity 0, which is then infinitely far, as for a pair without offset.
    """
    columns, width = round(offset_px), left.shape[1]
    if columns == 0:
        return compute_disparity(left, right, stereo) + np.float32(offset_px)
    if abs(columns) >= width:
        raise RescoreError(
            f"camera: expected a disparity offset below the width of {width} px, got {offset_px:g}; "
            "check the principal points of the calibration"
        )
    source = np.clip(np.arange(width) + columns, 0, width - 1)
    disparity = compute_disparity(left, np.ascontiguousarray(right[:, source]), stereo)
    matched = np.arange(width, dtype=np.float32) - disparity + columns
    # a match in the columns that were repeated to fill the moved picture is none
    disparity[(matched < 0) | (matched > width - 1)] = np.nan
    return disparity + np.float32(offset_px - columns)
