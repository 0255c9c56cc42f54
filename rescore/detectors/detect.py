"""Run a detector on a data set: its candidates, and its Platt scaling."""

from collections.abc import Iterable, Iterator

import numpy as np

from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.data.pictures import read_rgb
from rescore.data.splits import Splits
from rescore.detectors.base import Detections, Detector, FrameDetector
from rescore.detectors.platt import PlattScaling, fit_platt, label_candidates
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.parallel import one_thread, track


def calibrate_detector(detector: Detector, data: DataSet, jobs: Workers, show: bool = True) -> PlattScaling:
    """Platt scaling fitted on the split "calibration" of a data set, which has trained nothing."""
    return calibrate_and_detect(detector, data, jobs, show)[0]


def calibrate_and_detect(
    detector: Detector, data: DataSet, jobs: Workers, show: bool = True
) -> tuple[PlattScaling, CandidateTable]:
    """Platt scaling fitted on the split "calibration" of a data set, and the candidates of that split."""
    frames = Splits.of(data).calibration
    found = list(_detections(detector, frames, jobs, f"calibrate {detector.name}", show))
    scores, is_car = [], []
    for image_id, of_frame in found:
        car, counts = label_candidates(of_frame, frames.truth[image_id])
        scores.append(of_frame.score[counts])
        is_car.append(car[counts])
    scaling = fit_platt(np.concatenate([np.zeros(0), *scores]), np.concatenate([np.zeros(0, bool), *is_car]))
    return scaling, with_likelihoods(found, scaling)


def detect_candidates(
    detector: Detector, scaling: PlattScaling, data: DataSet, jobs: Workers, show: bool = True
) -> CandidateTable:
    """The candidates of every frame of a data set, with likelihoods."""
    return with_likelihoods(_detections(detector, data, jobs, f"detect {detector.name}", show), scaling)


def with_likelihoods(found: Iterable[tuple[int, Detections]], scaling: PlattScaling) -> CandidateTable:
    """The candidates of detections by image, with likelihoods."""
    return CandidateTable.of_candidates(
        Candidates(
            image_id,
            of_frame.xyxy_px,
            of_frame.score,
            scaling.likelihood(of_frame.score),
            of_frame.azimuth_deg,
        )
        for image_id, of_frame in found
    )


def _detections(
    detector: Detector, data: DataSet, jobs: Workers, what: str, show: bool
) -> Iterator[tuple[int, Detections]]:
    annotated = ((record, data.truth[record.image_id]) for record in data.frames)
    return track(map_frames(detect_frame_of, annotated, detector, jobs), what, len(data.frames), show)


def detect_frame_of(annotated: tuple[FrameRecord, Truth], detector: Detector) -> tuple[int, Detections]:
    """The image of a frame, read from disk, and what a detector finds in it."""
    record, truth = annotated
    if isinstance(detector, FrameDetector):
        return record.image_id, detector.detect_frame(record, truth)
    rgb = read_rgb(record.left_path, record.width_px, record.height_px)
    with one_thread():
        return record.image_id, detector.detect(rgb)
