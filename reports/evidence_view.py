"""What a picture shows of one frame: its pixels, depth, cars, candidates and their reconstructions."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.camera import DEFAULT_GROUND, GroundPlane, PinholeCamera, default_camera
from recon.outcome import Failure
from recon.reconstruct import Reconstruction
from recon.stereo import SgbmConfig
from reports.curves import scores
from reports.overlay import registered_depth
from reports.run_folder import Run, boxes_px
from rescore.align_depth import DepthAlignment, measured_depth
from rescore.candidate_columns import difference, status
from rescore.evidence_files import evidence_path, read_evidence
from rescore.formats.open import read_dataset
from rescore.frames import DataSet, Truth, load_frame

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CandidateView:
    """One candidate of one detector with all that led to its score."""

    rank: int
    """Place by detector score in its frame, 0 is best."""
    new_rank: int
    """Place after rescoring."""
    xyxy_px: FloatArray
    likelihood: float
    posterior: float
    depth_difference: float
    """D in the mode shown; NaN where there is no evidence."""
    status: str
    reason_detail: str
    outcome: str
    """Outcome in the mode shown."""
    outcome_detector: str
    annotation_id: int
    """The car it is matched with in the mode shown, -1 for none."""
    kind: str
    instance: Reconstruction | None
    """The 3D instance before registration; None where there is none."""
    registered: NDArray[np.float32] | None
    """Predicted depth of the window after eq. 6, in the unit of the measured depth; None without evidence."""


@dataclass(frozen=True, eq=False)
class FrameView:
    """One frame with the candidates of every detector."""

    image_id: int
    rgb: NDArray[np.uint8]
    measured: NDArray[np.float32]
    """Metres where the camera is known, else 1 / disparity; NaN in holes."""
    metric: bool
    """Whether ``measured`` is in metres."""
    camera: PinholeCamera
    ground: GroundPlane
    truth: Truth
    candidates: Mapping[str, tuple[CandidateView, ...]]
    """By detector, best detector score first."""


def run_dataset(run: Run) -> DataSet:
    """The data set of a run, with all its splits."""
    return read_dataset(run.data_dir, run.class_name)


def run_data(run: Run) -> DataSet:
    """The frames that the run was evaluated on."""
    data = run_dataset(run)
    return data if run.split == "all" else data.split(run.split)


def frame_views(run: Run, mode: str, image_ids: NDArray[np.int64] | None = None) -> Iterator[FrameView]:
    """The frames of a run one after another, in the order of the data set; all, or those of ``image_ids``."""
    data = run_data(run)
    tables = {d: _Table(run, d, mode) for d in run.detectors}
    for record in data.frames:
        if image_ids is not None and record.image_id not in image_ids:
            continue
        frame = load_frame(record, SgbmConfig(**run.config.get("stereo", {})))
        camera = frame.camera.left if frame.camera else default_camera(record.width_px, record.height_px)
        yield FrameView(
            image_id=frame.image_id,
            rgb=frame.left_rgb,
            measured=measured_depth(frame.disparity_px, frame.camera),
            metric=frame.camera is not None,
            camera=camera,
            ground=frame.ground or DEFAULT_GROUND,
            truth=data.truth[record.image_id],
            candidates={d: table.frame(frame.image_id) for d, table in tables.items()},
        )


class _Table:
    """The candidates of one detector, looked up by frame."""

    def __init__(self, run: Run, detector: str, mode: str) -> None:
        self._rows = run.of(detector)
        self._posterior = scores(run, detector, mode)
        self._difference, self._status = difference(self._rows, mode), status(self._rows, mode)
        self._folder = run.root / "evidence"
        self._detector = detector
        self._mode = mode

    def frame(self, image_id: int) -> tuple[CandidateView, ...]:
        """The candidates of one frame, best detector score first."""
        rows = self._rows
        index = np.flatnonzero(rows["image_id"] == image_id)
        index = index[np.argsort(rows["rank"][index], kind="stable")]
        order = np.lexsort((rows["rank"][index], -rows["detector_score"][index], -self._posterior[index]))
        new_rank = np.empty(len(index), int)
        new_rank[order] = np.arange(len(index))
        path = evidence_path(self._folder, self._detector, image_id)
        instances = read_evidence(path) if path.is_file() else ()
        return tuple(
            self._view(int(i), int(new), _instance(instances, int(rows["rank"][i])))
            for i, new in zip(index, new_rank, strict=True)
        )

    def _view(self, i: int, new_rank: int, instance: Reconstruction | None) -> CandidateView:
        rows = self._rows
        suffix = self._mode if f"outcome_{self._mode}" in rows else "detector"
        registered = None
        if instance is not None and np.isfinite(rows["scale"][i]):
            registered = registered_depth(instance.depth, self._alignment(i))
        return CandidateView(
            rank=int(rows["rank"][i]),
            new_rank=new_rank,
            xyxy_px=boxes_px({k: rows[k][i : i + 1] for k in ("x0", "y0", "x1", "y1")})[0],
            likelihood=float(rows["likelihood"][i]),
            posterior=float(self._posterior[i]),
            depth_difference=float(self._difference[i]),
            status=str(self._status[i]),
            reason_detail=str(rows["reason_detail"][i]),
            outcome=str(rows[f"outcome_{suffix}"][i]),
            outcome_detector=str(rows["outcome_detector"][i]),
            annotation_id=int(rows[f"annotation_id_{suffix}"][i]),
            kind=str(rows["kind"][i]) if "kind" in rows else "",
            instance=instance,
            registered=registered,
        )

    def _alignment(self, i: int) -> DepthAlignment:
        names = ("scale", "offset", "depth_difference", "valid_share", "stereo_low", "stereo_span")
        return DepthAlignment(*(float(self._rows[name][i]) for name in names))


def _instance(instances: tuple[Reconstruction | Failure, ...], rank: int) -> Reconstruction | None:
    one = instances[rank] if rank < len(instances) else None
    return None if isinstance(one, Failure) else one
