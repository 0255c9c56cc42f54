"""How much more likely the disparity of a car is under its true shape, and under fitted ones, than a plane.

All surfaces are compared on the same pixels of a rendered car that is whole and in sight, with the same
noise. What is measured is what the matcher of the run made of the pictures.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from recon.camera import GroundedStereo
from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.localization.disparity_fit import DisparityFitConfig
from recon.shape_space import ShapeSpace
from recon.stereo.sgbm import SgbmConfig
from rescore.data.frames import SPLITS, FrameRecord, Truth, load_frame
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.evidence.instance_fits import fit_instances
from rescore.experiment.config import run_config
from rescore.formats.coco_dataset import read_dataset
from rescore.parallel import one_thread, track
from rescore.results.run_folder import RunFolder
from rescore.studies.relief.compared import SeenCar, compare_car
from rescore.studies.relief.likelihood import MeasurementNoise
from rescore.studies.relief.relief_file import (
    NoiseRecord,
    ReliefCar,
    ReliefResult,
    relief_cells,
    rig_cells,
    target_cell,
)
from rescore.studies.relief.shown_cars import RenderedTruth, shown_cars


def study_relief(root: Path, split: str, command: str, *, seed: int, jobs: Workers) -> ReliefResult:
    """The study on one split of a finished run.

    Args:
        root: The run, of a preset that renders streets along their length.
        split: Whose frames are looked at.
        command: What made it, for the file.
        seed: Of every random choice.
        jobs: Frames at a time.

    Raises:
        RescoreError: no such split, the run is not finished, its class model has no shape space, its frames
            have no truth of their own, or the split shows no car whole.
    """
    if split not in SPLITS:
        raise RescoreError(f"--split: expected {', '.join(SPLITS)}, got {split!r}; choose one of these")
    folder, config = RunFolder(root), run_config(root)
    model = ClassModel.load(folder.class_model)
    if model.shape_space is None:
        raise RescoreError(
            f"{folder.class_model}: expected a class model with a shape space, got one without; learn it "
            "from seven or more instances of known size"
        )
    data = read_dataset(folder.data, config.class_name).split(split)
    truth, noise = RenderedTruth.of(folder.data), MeasurementNoise()
    study = _Study(model, model.shape_space, config.rescore.fit, config.synth.sgbm, truth, seed, noise)
    annotated = ((record, data.truth[record.image_id]) for record in data.frames)
    found = list(track(map_frames(_of_frame, annotated, study, jobs), "relief of cars", len(data.frames)))
    cars = tuple(car for of_frame in found for car in of_frame)
    if not cars:
        raise RescoreError(
            f"{root}: expected a car that is whole and in sight in split {split!r}, got none; choose another"
        )
    rng = np.random.default_rng(seed)
    return ReliefResult(
        command=command,
        split=split,
        n_images=len(data.frames),
        noise=NoiseRecord(**asdict(noise)),
        cells=relief_cells(cars, rng),
        target=target_cell(cars, rng),
        rigs=rig_cells(cars, rng),
        cars=cars,
    )


@dataclass(frozen=True, eq=False)
class _Study:
    """What is the same for all frames."""

    model: ClassModel
    space: ShapeSpace
    fit: DisparityFitConfig
    sgbm: SgbmConfig
    truth: RenderedTruth
    seed: int
    noise: MeasurementNoise

    def of_frame(self, record: FrameRecord, annotated: Truth) -> list[ReliefCar]:
        """The cars of one frame; none of a frame without a camera."""
        with one_thread():
            truth = self.truth.of_frame(record)
            cars = list(shown_cars(record, annotated, truth.ground))
            frame = load_frame(record, self.sgbm)
            if not cars or frame.camera is None:
                return []
            seen_from = frame.seen_from or GroundedStereo(frame.camera, truth.ground)
            boxes = np.stack([car.xyxy_px for car in cars])
            fits = fit_instances(frame, boxes, self.model, self.fit)
            rig, found = self.truth.rig(record.image_id), []
            for car, fit in zip(cars, fits, strict=True):
                rng = np.random.default_rng([self.seed, car.annotation_id])
                measured, true = frame.disparity_px, truth.disparity_px
                one = SeenCar(car, frame.left_rgb, measured, true, seen_from, fit)
                compared = compare_car(one, self.space, self.fit.views, self.noise, rng)
                if compared is not None:
                    found.append(compared.model_copy(update={"image_id": record.image_id, "rig": rig}))
            return found


def _of_frame(annotated: tuple[FrameRecord, Truth], study: _Study) -> list[ReliefCar]:
    return study.of_frame(*annotated)
