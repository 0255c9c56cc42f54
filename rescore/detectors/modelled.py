"""Candidates that a model of a modern detector makes from the truth of rendered frames.

No modern detector runs on rendered frames as on real ones. This one knows the answers and spoils them as such
a detector does (rescore.detectors.box_noise), so that depth evidence can be fitted to and judged on them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from recon.arrays import FloatArray, UInt8Array
from recon.boxes import iou_matrix, suppress
from recon.camera import default_camera
from recon.errors import RescoreError
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.data.rendered_kinds import BACKGROUND_KINDS, VEHICLE_KINDS, read_instances
from rescore.detectors.base import Detections, SuppressionConfig
from rescore.detectors.box_noise import DrawnBox, Street, draw_boxes
from rescore.detectors.files import write_detector

_LINKED_IOU = 0.3
"""Overlap of what is seen of a vehicle with an annotated box from which the two are the same."""


@dataclass(frozen=True)
class ModelledConfig:
    """Limits on the boxes of a frame; how they are drawn is fixed, see rescore.detectors.box_noise."""

    suppression: SuppressionConfig = field(default_factory=SuppressionConfig)
    """The judged boxes went through the same."""


@dataclass(frozen=True, eq=False)
class ModelledDetector:
    """Boxes drawn from truth; it can judge no picture."""

    kind: ClassVar[str] = "modelled"
    seed: int
    """Seed of the random numbers, together with the number of the image."""
    config: ModelledConfig = field(default_factory=ModelledConfig)
    name: str = "modelled"

    def detect_frame(self, record: FrameRecord, truth: Truth) -> Detections:
        """The candidates of a rendered frame, scores as log odds; the same for one seed and image number.

        Raises:
            RescoreError: the frame is not rendered.
        """
        return _as_detections(self.drawn(record, truth))

    def drawn(self, record: FrameRecord, truth: Truth) -> list[DrawnBox]:
        """What ``detect_frame`` reports, best first, each with its kind.

        Raises:
            RescoreError: the frame is not rendered.
        """
        street = street_of(record, truth)
        boxes = draw_boxes(street, np.random.default_rng([self.seed, record.image_id]))
        limits, found = self.config.suppression, _as_detections(boxes)
        kept = suppress(found.xyxy_px, found.score, limits.max_iou, limits.max_count)
        return [boxes[i] for i in kept]

    def detect(self, rgb: UInt8Array) -> Detections:
        """Nothing: a picture does not hold the truth.

        Raises:
            RescoreError: always.
        """
        raise RescoreError(
            "detector modelled: expected a rendered frame with its truth, got a picture alone; "
            "use a detector that looks at pictures"
        )

    def scan(self, rgb: UInt8Array) -> Detections:
        """Nothing, as ``detect``."""
        return self.detect(rgb)

    def save(self, path: Path) -> None:
        """Write the detector to one npz file."""
        write_detector(path, self.kind, self.name, asdict(self.config), {"seed": np.array(self.seed)})

    @classmethod
    def from_parts(
        cls, name: str, config: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> "ModelledDetector":
        """The detector of a file's settings and arrays."""
        suppression = SuppressionConfig(**config["suppression"])
        return cls(int(arrays["seed"]), ModelledConfig(suppression), name)


def make_modelled(
    data: DataSet, config: ModelledConfig, rng: np.random.Generator, jobs: int
) -> ModelledDetector:
    """The detector with its random numbers; nothing of the frames trains it.

    Raises:
        RescoreError: a frame is not rendered.
    """
    for record in data.frames:
        _refuse_real(record)
    return ModelledDetector(int(rng.integers(2**31)), config)


def street_of(record: FrameRecord, truth: Truth) -> Street:
    """What the model of boxes needs to know of a rendered frame.

    Raises:
        RescoreError: the frame is not rendered.
    """
    _refuse_real(record)
    instances = read_instances(record)
    assert instances is not None
    numbers, seen = _extents(instances, record.instance_kinds)
    whole, visible = _annotated(seen, truth)
    kinds = record.instance_kinds
    others = [i for i, kind in kinds.items() if kind not in BACKGROUND_KINDS | VEHICLE_KINDS]
    known = record.camera
    camera = default_camera(record.width_px, record.height_px) if known is None else known.left
    return Street(
        seen_xyxy_px=seen,
        whole_xyxy_px=whole,
        visible_share=visible,
        is_car=np.array([kinds[int(i)] == "car" for i in numbers], dtype=bool),
        things=np.where(np.isin(instances, others), instances, 0).astype(np.uint16),
        fx_px=camera.fx_px,
        axis_row_px=camera.cy_px,
    )


def _as_detections(boxes: Sequence[DrawnBox]) -> Detections:
    return Detections(
        np.array([box.xyxy_px for box in boxes]).reshape(-1, 4),
        np.array([box.score for box in boxes], dtype=float),
    )


def _refuse_real(record: FrameRecord) -> None:
    if record.instance_path is None or not record.instance_kinds:
        raise RescoreError(
            f"detector modelled: expected rendered frames, got image {record.image_id} without a picture of "
            "instances; it draws boxes from the truth, use a detector that looks at pictures"
        )


def _annotated(seen_xyxy_px: FloatArray, truth: Truth) -> tuple[FloatArray, FloatArray]:
    """Annotated boxes (n, 4) and visible shares (n,) of what is seen of vehicles (n, 4).

    A vehicle of which too little is seen to know its annotation keeps its box, and none of it counts as seen.
    """
    whole, visible = seen_xyxy_px.copy(), np.zeros(len(seen_xyxy_px))
    if len(truth.xyxy_px):
        overlap = iou_matrix(seen_xyxy_px, truth.xyxy_px)
        best, linked = overlap.argmax(axis=1), overlap.max(axis=1) >= _LINKED_IOU
        whole[linked] = truth.xyxy_px[best[linked]]
        visible[linked] = np.nan_to_num(truth.visibility[best[linked]], nan=1.0)
    return whole, visible


def _extents(instances: NDArray[np.uint16], kinds: Mapping[int, str]) -> tuple[NDArray[np.intp], FloatArray]:
    """Numbers (n,) of the vehicles that are seen, and the extents (n, 4) of what is seen of them."""
    numbers, boxes = [], []
    for number, found in enumerate(find_objects(instances), 1):
        if found is not None and kinds.get(number) in VEHICLE_KINDS:
            rows, columns = found
            numbers.append(number)
            boxes.append([columns.start, rows.start, columns.stop, rows.stop])
    return np.array(numbers, dtype=np.intp), np.array(boxes, dtype=float).reshape(-1, 4)
