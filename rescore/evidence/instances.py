"""The depth that is predicted in each box of a frame: 3D instances of a class model, or another system's."""

from dataclasses import dataclass

from recon.camera import DEFAULT_GROUND, GroundedCamera, default_camera
from recon.class_model import ClassModel
from recon.depth_map import DepthMap
from recon.errors import Failure
from rescore.data.frames import Frame
from rescore.evidence.candidates import Candidates
from rescore.evidence.files import Predicted
from rescore.evidence.predicted_depth import BoxPrediction, PredictedDepth, cut_to_boxes
from rescore.evidence.settings import CameraChoice, RescoreConfig
from rescore.evidence.views import FittedViews, Views, reconstruct_views, views_of, views_without_model


@dataclass(frozen=True, eq=False)
class Instances:
    """What is predicted of the candidates of one frame: 3D instances, or depth of another system."""

    found: tuple[Predicted, ...]
    """Prediction of each candidate, or why there is none."""
    views: Views
    """View of each candidate: the side that it is taken to be seen from."""

    @property
    def inverse(self) -> bool:
        """Whether inverse depth is predicted, and eq. 6 is solved there."""
        return any(isinstance(i, BoxPrediction) and i.inverse for i in self.found)

    @property
    def scaled_depths(self) -> tuple[DepthMap | None, ...]:
        """Depth of each candidate; None where there is none, or its scale and offset are unknown."""
        return tuple(
            None if isinstance(i, Failure) or (isinstance(i, BoxPrediction) and not i.metric) else i.depth
            for i in self.found
        )


DepthSource = ClassModel | PredictedDepth | Instances
"""What predicts the depth of a frame's candidates: a class model, a depth map of another system, or instances
that were predicted before."""


def predict_instances(
    frame: Frame,
    candidates: Candidates,
    source: DepthSource,
    config: RescoreConfig,
    fitted: FittedViews | None = None,
) -> Instances:
    """The depth Zi of each candidate, from the left picture, camera and ground alone (section 4).

    Args:
        frame: the frame.
        candidates: its candidates.
        source: what predicts depth.
        config: settings.
        fitted: what fits say of the views, for ``view_bin`` "fit"; None where nothing was fitted.

    Raises:
        RescoreError: the prediction of another system is of another size than the picture, or the class model
            has no labelled view of a bin that it is asked for.
    """
    if isinstance(source, Instances):
        return source
    rgb, boxes = frame.left_rgb, candidates.xyxy_px
    views = candidate_views(frame, candidates, source, config, fitted)
    if isinstance(source, PredictedDepth):
        size = (rgb.shape[1], rgb.shape[0])
        return Instances(cut_to_boxes(source, boxes, size, config.reconstruct.min_inside), views)
    seen_from = assumed_camera(frame, config.camera)
    return Instances(reconstruct_views(rgb, boxes, views, source, seen_from, config.reconstruct), views)


def candidate_views(
    frame: Frame,
    candidates: Candidates,
    source: DepthSource,
    config: RescoreConfig,
    fitted: FittedViews | None = None,
) -> Views:
    """The view of each candidate as ``predict_instances`` takes it, from the same arguments."""
    if isinstance(source, Instances):
        return source.views
    if isinstance(source, PredictedDepth):
        return views_without_model(candidates, config.view_bin)
    return views_of(frame.left_rgb, candidates, config.view_bin, source, config.reconstruct, fitted)


def assumed_camera(frame: Frame, choice: CameraChoice) -> GroundedCamera:
    """The camera M and the ground plane Qg that predict depth in a frame."""
    h, w = frame.left_rgb.shape[:2]
    assumed = GroundedCamera(default_camera(w, h), DEFAULT_GROUND)
    if choice is CameraChoice.DEFAULT:
        return assumed
    camera = frame.camera.left if frame.camera else assumed.camera
    return GroundedCamera(camera, frame.ground or assumed.ground)
