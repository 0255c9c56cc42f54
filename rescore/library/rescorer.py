"""Rescoring as a library: loaded once, then arrays in and out, from any number of threads.

A ``Rescorer`` never changes. After its first frame, which loads compiled loops and solvers, it reads no file;
it sets nothing that other code could see, such as the number of threads of OpenCV or of the linear algebra.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from recon.arrays import BoolArray, FloatArray, IntArray
from recon.class_model import ClassModel
from recon.errors import RescoreError
from rescore.data.boxes3d import Boxes3D
from rescore.data.units import refuse_other_size
from rescore.detectors.platt import PlattScaling
from rescore.evidence.cues import cue_names
from rescore.evidence.files import Predicted
from rescore.evidence.model import EvidenceModel
from rescore.evidence.predicted_depth import PredictedDepth, another_system, check_mode
from rescore.evidence.registration import CLASS_MODEL, Registration, check_depth_of
from rescore.evidence.settings import RescoreConfig
from rescore.fusion.rescore_frame import Rescoring, rescore_frame, things_of
from rescore.library.inputs import Boxes, StereoFrame

if TYPE_CHECKING:
    from rescore.library.rescorer_files import Parts

SIDES = ("front", "front left", "left", "rear left", "rear", "rear right", "right", "front right")
"""Sides from which an object is seen, each 45 degrees wide, from azimuth 0 on."""


@dataclass(frozen=True, eq=False)
class Rescored:
    """What became of the boxes of one frame; all in the order in which they were given."""

    posterior: FloatArray
    """Eq. 7, shape (n,), in [0, 1]: the boxes' new scores."""
    likelihood: FloatArray
    """l in [0, 1] that went into it, shape (n,)."""
    depth_difference: FloatArray
    """D in [0, 1], shape (n,). Without evidence it is NaN in mode "paper", which keeps l, and in the others
    the D of silent cues."""
    status: tuple[str, ...]
    """"ok", or the reason for which a box has no evidence or was suppressed (``recon.errors.Reason``)."""
    reasons: tuple[str, ...]
    """What was expected and what came, a sentence for a person; "" where the status is "ok"."""
    has_evidence: BoolArray
    """Whether depth gave evidence on each box, shape (n,)."""
    cues: FloatArray
    """Parts of the evidence, shape (n, k), columns ``cue_names``; NaN where one is missing."""
    log_odds: FloatArray
    """What each cue added to the log odds of a car, shape (n, k); 0 where there is no evidence, and in mode
    "paper"."""
    view_bin: IntArray
    """View bin of the class model that each box is taken to be seen from, shape (n,): it is reconstructed
    with that. -1 where none will do, or another system predicts depth."""
    view: tuple[str, ...]
    """The side from which the fitted instance shows each object, a name of ``recon.view_bins.ViewBins`` such
    as "left front"; "" where none was fitted."""
    view_probability: FloatArray
    """Probability of that view, shape (n,); NaN where no instance was fitted."""
    second_view: tuple[str, ...]
    """The next likely view of each, as ``view``."""
    boxes3d: Boxes3D | None
    """The 3D box of the instance of the class that was fitted to each box and the disparity, camera frame,
    metres, with standard deviations; NaN rows where nothing is measured. None where no instance was fitted:
    that takes a class model with a shape space, a calibrated camera and a ground plane, stated or measured;
    and mode "instance" or "paper", ``suppress``, or ``view_bin`` "fit"."""
    baseline_m: float | None
    """Metres from left to right: as stated, or for ``depth_m`` without a stated baseline that of the pair
    which would measure as finely (``recon.stereo.depth_noise``); None without a camera."""
    instances: tuple[Predicted, ...] | None
    """The 3D instance in each box, or the depth that another system predicts there, or why there is none;
    None where they were not asked for."""

    @property
    def cue_names(self) -> tuple[str, ...]:
        """Columns of ``cues`` and ``log_odds``."""
        return cue_names()

    @property
    def azimuth_deg(self) -> FloatArray:
        """Azimuth from which each fitted 3D box is seen, shape (n,), counter-clockwise from above: 0 its
        front, 90 its left side; NaN where there is none."""
        return np.full(len(self.posterior), np.nan) if self.boxes3d is None else self.boxes3d.azimuth_deg

    @property
    def side(self) -> tuple[str, ...]:
        """The one of ``SIDES`` from which each fitted 3D box is seen; "" where there is none."""
        width_deg = 360 / len(SIDES)
        return tuple(
            "" if np.isnan(a) else SIDES[round(a / width_deg) % len(SIDES)] for a in self.azimuth_deg.tolist()
        )


@dataclass(frozen=True, eq=False)
class Rescorer:
    """A class model, a weight, and what turns depth into D: all that rescoring needs.

    Raises:
        RescoreError: w outside [0, 1], a view bin that the class model does not have, or ``suppress`` with a
            class model that has no shape space.
    """

    class_model: ClassModel | None
    """Class model that predicts depth; None where another system predicts the depth of every frame."""
    w: float
    """Weight of the detector in eq. 7, in [0, 1]."""
    evidence_model: EvidenceModel | None = None
    """Model of D of the learned modes; None for mode "paper", whose D is that of eq. 6."""
    scaling: PlattScaling | None = None
    """Platt scaling from raw scores to likelihoods; None where boxes come with likelihoods."""
    config: RescoreConfig = field(default_factory=RescoreConfig)
    suppress: bool = False
    """Whether second boxes of a car, found in 3D, get status "second_box" and a posterior below all others
    (``rescore.fusion.suppress3d``)."""

    def __post_init__(self) -> None:
        _ = self._rescoring
        if self.class_model is not None and isinstance(self.config.view_bin, int):
            self.class_model.view(self.config.view_bin)
        if self.suppress and (self.class_model is None or self.class_model.shape_space is None):
            raise RescoreError(
                "rescorer: expected a class model with a shape space for suppress=True, got none; learn one "
                "from seven part-labelled instances or more, or leave suppress out"
            )

    @staticmethod
    def default(class_name: str = "car") -> "Rescorer":
        """The rescorer that comes with the package for a class: mode "instance", for boxes with likelihoods.

        ``dataclasses.replace`` changes a part of it, such as ``suppress``.

        Raises:
            RescoreError: none comes with it for this class.
        """
        from rescore.library.bundles import default_bundle  # noqa: PLC0415 (readers take long to import)

        bundle = default_bundle(class_name)
        return Rescorer(bundle.class_model, bundle.w, bundle.evidence_model, None, bundle.config)

    @staticmethod
    def from_file(path: str | Path) -> "Rescorer":
        """The rescorer that a JSON file describes (docs/library.md).

        Raises:
            RescoreError: no such file or another content, here or in the files that it names.
        """
        from rescore.library.rescorer_files import parts_of_file  # noqa: PLC0415

        return _of_parts(parts_of_file(Path(path)))

    @staticmethod
    def from_run(run_dir: str | Path, detector: str, mode: str = "paper") -> "Rescorer":
        """The rescorer of a finished run of ``rescore reproduce``.

        Args:
            run_dir: its folder.
            detector: a detector of the run, such as "hog", whose weight, evidence model and Platt scaling are
                taken.
            mode: "paper", "guarded", "metric" or "instance".

        Raises:
            RescoreError: no such run, detector or mode, or a damaged file.
        """
        from rescore.library.rescorer_files import parts_of_run  # noqa: PLC0415

        return _of_parts(parts_of_run(Path(run_dir), detector, mode))

    @property
    def _rescoring(self) -> Rescoring:
        return Rescoring(self.config, self.evidence_model, self.w, self.suppress)

    @property
    def mode(self) -> Registration:
        """How predicted and measured depth are compared."""
        return Registration.PAPER if self.evidence_model is None else self.evidence_model.registration

    def rescore(
        self,
        frame: StereoFrame,
        boxes: Boxes,
        *,
        predicted: PredictedDepth | None = None,
        instances: bool = False,
    ) -> Rescored:
        """Rescore the boxes of one frame. Any number of threads may call this at once.

        Args:
            frame: picture, measured depth, and what is known of camera and ground.
            boxes: the detections.
            predicted: depth that another system predicts of the left picture, in place of the class model's.
            instances: whether the result shall hold what was predicted in each box.

        Raises:
            RescoreError: scores without a scaling, a pair too narrow to match, a prediction of another size,
                or one without known scale in a mode past eq. 6; neither prediction nor class model; D fitted
                with depth of another kind.
        """
        candidates = boxes.candidates(self.scaling)
        loaded = frame.loaded(self.config.stereo, self.config.nearest_m)
        source = self._source(predicted)
        if (things := things_of(candidates, source)) is not None:
            refuse_other_size("frame", loaded, frame.quantity, things)
        rescoring = replace(self._rescoring, predict=instances or self.mode.predicts)
        rescored = rescore_frame(loaded, candidates, source, rescoring)
        table, model = rescored.candidates, self.evidence_model
        d = table.depth_difference if model is None else model.difference(table.cues)
        has_evidence, log_odds = np.isfinite(d), np.zeros_like(table.cues)
        if model is not None:
            log_odds = model.contributions(table.cues) * has_evidence[:, None]
        return Rescored(
            posterior=rescored.posterior,
            likelihood=candidates.likelihood,
            depth_difference=table.depth_difference,
            status=tuple(str(s) for s in table.status),
            reasons=tuple(str(s) for s in table.reason_detail),
            has_evidence=has_evidence,
            cues=table.cues,
            log_odds=log_odds,
            view_bin=rescored.views.view_bin,
            view=tuple(str(v) for v in table.view_bin),
            view_probability=table.view_probability,
            second_view=tuple(str(v) for v in table.second_view),
            boxes3d=table.boxes3d,
            baseline_m=None if loaded.camera is None else loaded.camera.baseline_m,
            instances=rescored.instances if instances else None,
        )

    def _source(self, predicted: PredictedDepth | None) -> ClassModel | PredictedDepth:
        """What predicts depth, and whether the evidence model and the mode go with it."""
        if predicted is not None:
            check_mode(predicted.unit, self.mode)
            self._check_evidence(another_system(predicted.predicted_as, predicted.unit))
            return predicted
        if self.class_model is None:
            raise RescoreError(
                "rescorer: expected a class model or a prediction, got neither; give rescore(predicted=...)"
            )
        self._check_evidence(CLASS_MODEL)
        return self.class_model

    def _check_evidence(self, depth_of: str) -> None:
        if self.evidence_model is not None:
            check_depth_of("rescorer: evidence model", self.evidence_model.depth_of, depth_of)


def _of_parts(parts: "Parts") -> Rescorer:
    return Rescorer(parts.class_model, parts.w, parts.evidence_model, parts.scaling, parts.config)
