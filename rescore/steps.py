"""The steps of the experiment: learn, train, detect, tune. What the commands and a whole run share."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from recon.camera import StereoCamera
from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.learn import LearnConfig, learn_class_model
from recon.part_views import PartViews
from recon.primitives import PrimitiveLibrary
from recon.stereo import SgbmConfig, disparities_to_reach
from rescore.calibration import PlattScaling, fit_platt, label_candidates
from rescore.candidates import Candidates
from rescore.cues import CLASS_MODEL, Registration, check_depth_of
from rescore.detectors.base import Detections, Detector
from rescore.detectors.boosted import BoostedConfig, train_boosted
from rescore.detectors.crop_training import CrossValidation, SceneConfig, cross_validate
from rescore.detectors.crop_training import train_on_crops as train_in_scenes
from rescore.detectors.crops import Crops
from rescore.detectors.hog_svm import HogConfig, train_hog
from rescore.evidence import CandidateTable
from rescore.evidence_model import EvidenceConfig, EvidenceModel, fit_modes
from rescore.frames import DataSet, FrameRecord, Splits, read_rgb
from rescore.fusion_rules import LearnedFusion, fit_fusion
from rescore.pipeline import CameraChoice, RescoreConfig, evidence_of_frames
from rescore.predicted_files import Predictions
from rescore.progress import track
from rescore.store import read_json, write_json
from rescore.threads import one_thread
from rescore.tune import OBJECTIVE, TuneConfig, Tuning, tune_weight
from rescore.weight_interval import uncertainty_as_json, uncertainty_of_json


class DetectorKind(StrEnum):
    """Detectors that can be trained."""

    HOG = "hog"
    BOOSTED = "boosted"


def learn(
    views: PartViews, class_name: str, config: LearnConfig, library: PrimitiveLibrary | None = None
) -> ClassModel:
    """The class model of part-labelled views; the library of the package where none is given."""
    with one_thread():
        return learn_class_model(views, class_name, views.part_names, config, library)


def train(data: DataSet, config: HogConfig | BoostedConfig, seed: int, jobs: int) -> Detector:
    """A detector trained on the split "train" of a data set."""
    training = data.split("train")
    if not training.frames:
        raise RescoreError(f"{data.root}: expected frames of split 'train', got none; add some")
    if isinstance(config, HogConfig):
        return train_hog(training, config, np.random.default_rng([seed, 1]), jobs)
    return train_boosted(training, config, np.random.default_rng([seed, 2]), jobs)


def train_on_crops(
    crops: Crops, config: HogConfig | BoostedConfig, seed: int, jobs: int
) -> tuple[Detector, CrossValidation]:
    """A detector trained on all crops, and what cross-validation tells of it, with its Platt scaling.

    The scaling comes from detectors trained on fewer crops, each on scenes of the crops it has not seen.
    """
    number = 1 if isinstance(config, HogConfig) else 2
    validation = cross_validate(crops, config, SceneConfig(), np.random.default_rng([seed, number, 1]), jobs)
    detector = train_in_scenes(crops, config, SceneConfig(), np.random.default_rng([seed, number]), jobs)
    return detector, validation


def calibrate(detector: Detector, data: DataSet, jobs: int, show: bool = True) -> PlattScaling:
    """Platt scaling fitted on the split "calibration" of a data set, which has trained nothing."""
    frames = Splits.of(data).calibration
    scores, is_car = [], []
    for image_id, found in _detections(detector, frames, jobs, f"calibrate {detector.name}", show):
        car, counts = label_candidates(found, frames.truth[image_id])
        scores.append(found.score[counts])
        is_car.append(car[counts])
    return fit_platt(np.concatenate([np.zeros(0), *scores]), np.concatenate([np.zeros(0, bool), *is_car]))


def detect(
    detector: Detector, scaling: PlattScaling, data: DataSet, jobs: int, show: bool = True
) -> CandidateTable:
    """The candidates of every frame of a data set, with likelihoods."""
    return CandidateTable.of_candidates(
        Candidates(image_id, found.xyxy_px, found.score, scaling.likelihood(found.score))
        for image_id, found in _detections(detector, data, jobs, f"detect {detector.name}", show)
    )


def _detections(
    detector: Detector, data: DataSet, jobs: int, what: str, show: bool
) -> Iterator[tuple[int, Detections]]:
    tasks = (delayed(_detect_frame)(record, detector) for record in data.frames)
    results = Parallel(n_jobs=jobs, return_as="generator", pre_dispatch="2*n_jobs", batch_size=1)(tasks)
    return track(results, what, len(data.frames), show)


def _detect_frame(record: FrameRecord, detector: Detector) -> tuple[int, Detections]:
    rgb = read_rgb(record.left_path, record.width_px, record.height_px)
    with one_thread():
        return record.image_id, detector.detect(rgb)


def find_evidence(
    data: DataSet,
    candidates: Mapping[int, Candidates],
    source: ClassModel | Predictions,
    config: RescoreConfig,
    *,
    jobs: int,
    detector: str,
    evidence_dir: Path | None = None,
    show: bool = True,
) -> CandidateTable:
    """The candidates of all frames with the outcome of eq. 6 (see ``pipeline.evidence_of_frames``)."""
    tables = evidence_of_frames(data, candidates, source, config, jobs=jobs, evidence_dir=evidence_dir)
    return CandidateTable.concatenate(
        list(track(tables, f"depth evidence {detector}", len(data.frames), show))
    )


def fit_evidence(
    table: CandidateTable, data: DataSet, config: EvidenceConfig
) -> dict[Registration, EvidenceModel]:
    """Models of depth evidence from candidates with cues on the splits "train" and "calibration"."""
    return fit_modes(table, Splits.of(data).fitting_set, config)


def tune(
    detector: str,
    table: CandidateTable,
    data: DataSet,
    config: TuneConfig,
    registration: Registration,
    seed: int,
) -> Tuning:
    """The weight w for a detector from candidates with D of a mode, on the split "validation" alone.

    With its interval, and the learned fusion that eq. 7 is compared with.
    """
    validation = Splits.of(data).validation_set
    tuning = tune_weight(detector, table, validation, config, np.random.default_rng([seed, 3]))
    learned = fit_fusion(table, validation, config.min_iou)
    return replace(tuning, registration=registration, learned=learned)


def automatic_stereo(data: DataSet, nearest_m: float = RescoreConfig.nearest_m) -> SgbmConfig:
    """Settings of the stereo matcher for the frames of a data set without a disparity file."""
    width = max((f.width_px for f in data.frames), default=640)
    return stereo_for(width, [(f.camera, f.disparity_offset_px) for f in data.frames if f.camera], nearest_m)


def stereo_for(
    width_px: int, cameras: Iterable[tuple[StereoCamera, float]], nearest_m: float = RescoreConfig.nearest_m
) -> SgbmConfig:
    """Settings of the stereo matcher for pictures of a width.

    Disparities up to a tenth of the picture's width are searched, rounded up to a multiple of 16, 64 at 640
    pixels; and where cameras are known at least as many as reach ``nearest_m``, which makes it
    ``recon.stereo.KITTI_SGBM`` for KITTI's. What is nearer than the search reaches does not come out as a
    hole: much of it gets the largest disparity.

    Args:
        width_px: Of the widest picture.
        cameras: Pairs, each with the cx of its right picture less that of its left one, in pixels.
        nearest_m: Depth of the nearest surface wanted.
    """
    reach = [disparities_to_reach(camera, nearest_m, offset_px) for camera, offset_px in cameras]
    # OpenCV's result is not defined for searches nearly as wide as the picture
    most = max(16, width_px // 32 * 16)
    return SgbmConfig(num_disparities=min(max([-(-width_px // 160) * 16, *reach]), most))


def save_scaling(path: Path, scaling: PlattScaling) -> None:
    """Write Platt scaling as JSON."""
    write_json(path, {"format": "platt-scaling 1", **asdict(scaling)})


def load_scaling(path: Path) -> PlattScaling:
    """Read Platt scaling.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    value = read_json(path, "Platt scaling")
    numbers = [value.get(k) for k in ("a", "b")] if isinstance(value, dict) else [None]
    if not all(isinstance(v, float) for v in numbers):
        raise RescoreError(f"{path}: expected Platt scaling with numbers a and b, got {numbers}; train again")
    return PlattScaling(value["a"], value["b"])


def tuning_as_json(tuning: Tuning) -> dict[str, Any]:
    """The choice of w with its curve, as JSON values; an undefined or infinite objective is null."""
    return {
        "detector": tuning.detector,
        "registration": tuning.registration.value,
        "w": tuning.w,
        "objective_name": OBJECTIVE,
        "w_grid": tuning.grid.tolist(),
        "objective": [v if np.isfinite(v) else None for v in tuning.value.tolist()],
        "n_images": tuning.n_images,
        "n_cars": tuning.n_cars,
        "uncertainty": uncertainty_as_json(tuning.uncertainty),
        "sentence": tuning.sentence,
        "learned": None if tuning.learned is None else asdict(tuning.learned),
        "depth_of": tuning.depth_of,
    }


def load_tuning(path: Path) -> Tuning:
    """Read what ``tuning_as_json`` made.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    value = read_json(path, "a tuned weight")
    try:
        if value["objective_name"] != OBJECTIVE:
            raise ValueError(f"by objective {value['objective_name']!r}")
        tuning = Tuning(
            detector=str(value["detector"]),
            w=float(value["w"]),
            grid=np.array(value["w_grid"], dtype=float),
            value=np.array(value["objective"], dtype=float),
            n_images=int(value["n_images"]),
            n_cars=int(value["n_cars"]),
            registration=Registration(value.get("registration", Registration.PAPER)),
            uncertainty=uncertainty_of_json(value.get("uncertainty")),
            learned=None if value.get("learned") is None else LearnedFusion(**value["learned"]),
            depth_of=str(value.get("depth_of", CLASS_MODEL)),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise RescoreError(
            f"{path}: expected a tuned weight, got {type(error).__name__} {error}; run `rescore tune` again"
        ) from error
    if not 0 <= tuning.w <= 1:
        raise RescoreError(f"{path}: expected w in [0, 1], got {tuning.w}; run `rescore tune` again")
    return tuning


def tuned_weight(path: Path, mode: Registration, depth_of: str = CLASS_MODEL) -> float:
    """The w that was tuned for a mode with someone's depth.

    Raises:
        RescoreError: no such file, or a weight for another mode or with another's depth.
    """
    tuning = load_tuning(path)
    if tuning.registration is not mode:
        raise RescoreError(
            f"{path}: expected a weight tuned for registration {mode}, got one for {tuning.registration}; "
            "tune again in this mode"
        )
    check_depth_of(str(path), tuning.depth_of, depth_of)
    return tuning.w


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
