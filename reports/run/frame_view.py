"""What a picture shows of one frame: its pixels, depth, cars, candidates and their reconstructions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from recon.arrays import Float32Array, FloatArray, IntArray, UInt8Array
from recon.camera import GroundedCamera
from recon.depth_map import DepthMap
from recon.errors import Failure, RescoreError
from recon.reconstruction.reconstruct import Reconstruction
from reports.run.curves import scores
from reports.run.overlay import registered_depth, registered_relief
from rescore.data.boxes3d import BOX_NAMES, Boxes3D
from rescore.data.frames import DataSet, FrameRecord, Truth, load_frame
from rescore.data.pictures import read_rgb
from rescore.evidence.align_depth import DepthAlignment, measured_depth
from rescore.evidence.candidates import NUMBERS, alignment_of
from rescore.evidence.cues import CUES, cue_column
from rescore.evidence.files import Predicted, evidence_path, read_evidence, read_fits
from rescore.evidence.fit_summaries import FitSummary
from rescore.evidence.instances import assumed_camera
from rescore.evidence.predicted_depth import BoxPrediction
from rescore.evidence.registration import Registration
from rescore.evidence.settings import CameraChoice
from rescore.formats.open import read_dataset
from rescore.results.candidate_file import difference, of_mode, status
from rescore.results.run_folder import Run, boxes_px
from rescore.results.words import view_text


@dataclass(frozen=True, eq=False)
class CandidateView:
    """One candidate of one detector with all that led to its score."""

    row: int
    """Row of the candidate in the table of candidates of its detector."""
    rank: int
    """Place by detector score in its frame, 0 is best."""
    new_rank: int
    """Place by rescored score in its frame, 0 is best."""
    xyxy_px: FloatArray
    """Box of the candidate, pixel edges, shape (4,)."""
    likelihood: float
    posterior: float
    depth_difference: float
    """D of the mode shown; NaN where there is none."""
    status: str
    """Whether the mode shown had evidence, and why not."""
    reason_detail: str
    outcome: str
    """Outcome in the mode shown."""
    outcome_detector: str
    annotation_id: int
    """The car it is matched with in the mode shown, -1 for none."""
    kind: str
    instance: Reconstruction | None
    """The 3D instance before registration; None where there is none, or another system predicts depth."""
    predicted: DepthMap | None
    """Depth before registration, of the instance or of another system; None where there is none."""
    registered: Float32Array | None
    """Predicted depth of the window after the registration of the mode shown, in the unit of the measured
    depth; None where there is no registration, as in mode "instance"."""
    cues: FloatArray
    """Parts of the depth evidence (k,), columns ``CUES``; NaN where one is missing."""
    box3d: Boxes3D | None = None
    """The 3D box of the candidate, fitted or as the detector brought it; None where it has none."""
    fit: FitSummary | None = None
    """The instances fitted to the box; None in other modes than "instance", and where nothing was fitted."""
    view: str = ""
    """Words for the side from which the fitted instance shows the object; empty where none was fitted."""


@dataclass(frozen=True, eq=False)
class FrameView:
    """One frame with the candidates of every detector."""

    image_id: int
    rgb: UInt8Array
    """Left picture, shape (h, w, 3)."""
    measured: Float32Array
    """Metres where the camera is known, else 1 / disparity; NaN in holes."""
    metric: bool
    """Whether ``measured`` is in metres."""
    seen_from: GroundedCamera
    """Camera and ground plane; assumed ones where they are not known."""
    truth: Truth
    candidates: Mapping[str, tuple[CandidateView, ...]]
    """Candidates by detector, best detector score first, in the mode shown."""
    file: str
    """Path of the left picture in the data set."""
    right_rgb: UInt8Array | None
    """Right picture, shape (h, w, 3); None where the data set has none."""
    baseline: float
    """Distance of the two eyes, metres; 0 where it is not known."""
    other_modes: Mapping[tuple[str, str], tuple[CandidateView, ...]]
    """Candidates by detector and mode, without their reconstructions, of the other modes asked for."""


def run_dataset(run: Run) -> DataSet:
    """The data set of a run, with all its splits."""
    return read_dataset(run.data_dir, run.class_name)


def run_data(run: Run) -> DataSet:
    """The frames that the run was evaluated on.

    Raises:
        RescoreError: the data set has been changed since: an image with candidates is not there, or the
            number of frames is another.
    """
    data = run_dataset(run)
    chosen = data if run.split == "all" else data.split(run.split)
    strangers = set(run.candidates["image_id"].tolist()) - {f.image_id for f in chosen.frames}
    if strangers or len(chosen.frames) != run.metrics.n_images:
        came = f"no image {min(strangers)}" if strangers else f"{len(chosen.frames)} of them"
        raise RescoreError(
            f"{run.data_dir}: expected the {run.metrics.n_images} frames that were evaluated, got {came}: "
            "the data set was changed since; run `rescore evaluate` again"
        )
    return chosen


def frame_views(
    run: Run, mode: str, image_ids: IntArray | None = None, others: Sequence[str] = ()
) -> Iterator[FrameView]:
    """The frames of a run one after another.

    Args:
        run: the run.
        mode: the way of scoring that is shown.
        image_ids: the frames to read, in this order; None for all, in the order of the data set.
        others: other modes whose candidates are wanted too.
    """
    reader = FrameReader(run, run_data(run), mode, others)
    for image_id in reader.records if image_ids is None else image_ids.tolist():
        yield reader.read(image_id)


class FrameReader:
    """Reads single frames of a run, in any order.

    Args:
        run: the run.
        data: the frames that it was evaluated on.
        mode: the way of scoring that is shown.
        others: other modes whose candidates are wanted too.
    """

    def __init__(self, run: Run, data: DataSet, mode: str, others: Sequence[str] = ()) -> None:
        self.records = {r.image_id: r for r in data.frames}
        self._run, self._data = run, data
        self._tables = {d: _Table(run, d, mode) for d in run.detectors}
        self._more = {(d, m): _Table(run, d, m, with_instances=False) for d in run.detectors for m in others}

    def read(self, image_id: int) -> FrameView:
        """The frame of an image."""
        record = self.records[image_id]
        frame = load_frame(record, self._run.config.stereo)
        measured = measured_depth(frame.disparity_px, frame.camera)
        root = self._data.root
        return FrameView(
            image_id=frame.image_id,
            rgb=frame.left_rgb,
            measured=measured,
            metric=frame.camera is not None,
            seen_from=assumed_camera(frame, CameraChoice.CALIBRATED),
            truth=self._data.truth[record.image_id],
            candidates={d: table.frame(frame.image_id, measured) for d, table in self._tables.items()},
            file=record.left_path.relative_to(root).as_posix()
            if record.left_path.is_relative_to(root)
            else record.left_path.name,
            right_rgb=_right_picture(record),
            baseline=frame.camera.baseline_m if frame.camera else 0.0,
            other_modes={key: table.frame(frame.image_id, measured) for key, table in self._more.items()},
        )


def _right_picture(record: FrameRecord) -> UInt8Array | None:
    if record.right_path is None or not record.right_path.is_file():
        return None
    return read_rgb(record.right_path, record.width_px, record.height_px)


class _Table:
    """The candidates of one detector in one mode, looked up by frame."""

    def __init__(self, run: Run, detector: str, mode: str, with_instances: bool = True) -> None:
        self._rows = rows = run.of(detector)
        self._posterior = scores(run, detector, mode)
        self._difference = difference(rows, mode)
        self._status = status(rows, mode)
        self._outcome = of_mode(rows, "outcome", mode)
        self._annotation_id = of_mode(rows, "annotation_id", mode)
        nothing = np.full(len(rows["rank"]), np.nan)
        self._cues = np.stack([rows.get(f"cue_{name}", nothing) for name in CUES], axis=1)
        # eq. 6 has a scale and an offset of depth, the other modes a scale of relief
        self._of_relief = f"difference_{mode}" in rows
        self._of_fits = mode == Registration.INSTANCE
        self._folder = run.root / "evidence" if with_instances else None
        self._detector = detector

    def frame(self, image_id: int, measured: Float32Array) -> tuple[CandidateView, ...]:
        """The candidates of one frame, best detector score first."""
        rows = self._rows
        index = np.flatnonzero(rows["image_id"] == image_id)
        index = index[np.argsort(rows["rank"][index], kind="stable")]
        order = np.lexsort((rows["rank"][index], -rows["detector_score"][index], -self._posterior[index]))
        new_rank = np.empty(len(index), int)
        new_rank[order] = np.arange(len(index))
        instances: tuple[Predicted, ...] = ()
        fits: tuple[FitSummary | None, ...] = ()
        if self._folder is not None:
            path = evidence_path(self._folder / self._detector, image_id)
            instances = read_evidence(path) if path.is_file() else ()
            fits = read_fits(path) if self._of_fits and path.is_file() else ()
        views = []
        for i, new in zip(index.tolist(), new_rank.tolist(), strict=True):
            rank = int(rows["rank"][i])
            view = self._view(i, new, _found(instances, rank), measured)
            views.append(replace(view, fit=fits[rank]) if rank < len(fits) else view)
        return tuple(views)

    def _view(
        self,
        i: int,
        new_rank: int,
        found: Reconstruction | BoxPrediction | None,
        measured: Float32Array,
    ) -> CandidateView:
        rows = self._rows
        box = boxes_px({k: rows[k][i : i + 1] for k in ("x0", "y0", "x1", "y1")})[0]
        return CandidateView(
            row=i,
            rank=int(rows["rank"][i]),
            new_rank=new_rank,
            xyxy_px=box,
            likelihood=float(rows["likelihood"][i]),
            posterior=float(self._posterior[i]),
            depth_difference=float(self._difference[i]),
            status=str(self._status[i]),
            reason_detail=str(rows["reason_detail"][i]) if "reason_detail" in rows else "",
            outcome=str(self._outcome[i]),
            outcome_detector=str(rows["outcome_detector"][i]),
            annotation_id=int(self._annotation_id[i]),
            kind=str(rows["kind"][i]) if "kind" in rows else "",
            instance=found if isinstance(found, Reconstruction) else None,
            predicted=None if found is None else found.depth,
            registered=None if found is None else self._registered(i, found, box, measured),
            cues=self._cues[i],
            box3d=self._box3d(i),
            view=self._view_text(i),
        )

    def _view_text(self, i: int) -> str:
        if "view_bin" not in self._rows:
            return ""
        first, second = str(self._rows["view_bin"][i]), str(self._rows["second_view"][i])
        return view_text(first, float(self._rows["view_probability"][i]), second)

    def _box3d(self, i: int) -> Boxes3D | None:
        if f"box3d_{BOX_NAMES[0]}" not in self._rows:
            return None
        box = Boxes3D.of_values(np.array([self._rows[f"box3d_{name}"][i] for name in BOX_NAMES], float))
        return box if box.known.all() else None

    def _registered(
        self, i: int, found: Reconstruction | BoxPrediction, box: FloatArray, measured: Float32Array
    ) -> Float32Array | None:
        if self._of_fits:
            return None
        if self._of_relief:
            scale = float(np.exp(self._cues[i, cue_column("relief_scale")]))
            return registered_relief(found.depth, measured, box, scale) if np.isfinite(scale) else None
        if not np.isfinite(self._rows["scale"][i]):
            return None
        inverse = isinstance(found, BoxPrediction) and found.inverse
        return registered_depth(found.depth, self._alignment(i), inverse)

    def _alignment(self, i: int) -> DepthAlignment:
        return alignment_of({name: float(self._rows[name][i]) for name in NUMBERS})


def _found(found: Sequence[Predicted], rank: int) -> Reconstruction | BoxPrediction | None:
    one = found[rank] if rank < len(found) else None
    return None if isinstance(one, Failure) else one
