"""How wide the choice of w is, by the number of validation images: tuning on subsets of a large set."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.data.splits import Splits, ValidationSet
from rescore.detectors.detect import detect_candidates
from rescore.detectors.platt import load_scaling
from rescore.detectors.registry import load_detector
from rescore.engines.executor import Workers
from rescore.evidence.candidates import CandidateTable, RescoredTable
from rescore.evidence.model import load_models
from rescore.evidence.registration import Registration
from rescore.experiment.config import RunConfig, part_as_json, run_config
from rescore.experiment.stages import Stage, run_stage
from rescore.files import json_values, write_json
from rescore.formats import coco
from rescore.formats.open import read_dataset
from rescore.fusion import rescore_frames
from rescore.fusion.rescore_frame import Rescoring
from rescore.fusion.tune import TuneConfig, objective_on_grid, tune_weight
from rescore.fusion.weight_interval import choices
from rescore.metrics.matching import TruthTable
from rescore.results.run_folder import RunFolder
from rescore.results.sweep_file import StudyPart
from rescore.speech import say


@dataclass(frozen=True)
class WeightWidth:
    """What tuning on so many images chooses."""

    n_images: int
    low: float
    """2.5 % quantile of the chosen w."""
    lower_quartile: float
    median: float
    upper_quartile: float
    high: float
    """97.5 % quantile of the chosen w."""
    loss: float
    """Mean of what the choices lose on all images against the best w there, in units of the objective."""
    n_undefined: int
    """Subsets that choose no w, since they have no car."""


@dataclass(frozen=True, eq=False)
class WeightStudy:
    """The choice of w for one detector in one mode."""

    detector: str
    registration: Registration
    n_images: int
    """Images that subsets are drawn from."""
    n_cars: int
    n_draws: int
    w: float
    """Weight of the detector chosen on all images."""
    objective: str
    """Name of the objective that w is chosen by."""
    grid: FloatArray
    """Every w tried, shape (n_grid,)."""
    value: FloatArray
    """The objective on all images at each w of ``grid``, shape (n_grid,)."""
    widths: tuple[WeightWidth, ...]
    """Width of w at each size of subset."""


def study_weight(
    detector: str,
    registration: Registration,
    table: CandidateTable,
    validation: ValidationSet,
    sizes: Sequence[int],
    n_draws: int,
    config: TuneConfig,
    rng: np.random.Generator,
) -> WeightStudy:
    """Tune on ``n_draws`` subsets of each size, images drawn with replacement.

    Subsets of as many images as there are repeat images as the bootstrap does; larger ones would say that w
    is narrower than it is.

    Args:
        detector: its name.
        registration: mode that D of ``table`` comes from.
        table: candidates on the validation set, with D.
        validation: the images; never test images, as for every choice of w.
        sizes: images in a subset.
        n_draws: subsets of each size.
        config: how w is chosen.
        rng: draws the images.

    Raises:
        RescoreError: a size is larger than the set, or w cannot be chosen on the whole set.
    """
    truth = TruthTable.of(validation.data)
    if not sizes or min(sizes) < 1 or max(sizes) > truth.n_images:
        raise RescoreError(
            f"weight study: expected sizes from 1 to the {truth.n_images} validation images, got "
            f"{', '.join(map(str, sizes)) or 'none'}; choose others or render more images"
        )
    whole = tune_weight(detector, table, validation, config)
    share = np.full(truth.n_images, 1 / truth.n_images)
    widths = []
    for size in sizes:
        weight = rng.multinomial(size, share, size=n_draws).astype(np.int32)
        sample = objective_on_grid(table, truth, config, weight)
        widths.append(_width(size, whole.grid, whole.value, choices(whole.grid, sample)))
    return WeightStudy(
        detector,
        registration,
        truth.n_images,
        truth.n_cars,
        n_draws,
        whole.w,
        config.objective,
        whole.grid,
        whole.value,
        tuple(widths),
    )


def _width(size: int, grid: FloatArray, gain: FloatArray, chosen: FloatArray) -> WeightWidth:
    known = chosen[np.isfinite(chosen)]
    if not len(known):
        raise RescoreError(
            f"weight study: expected a subset of {size} images with a car, got none; choose a larger size"
        )
    shares = (0.025, 0.25, 0.5, 0.75, 0.975)
    low, lower, median, upper, high = np.quantile(known, shares, method="inverted_cdf").tolist()
    at = np.argmin(np.abs(grid[:, None] - known), axis=0)
    loss = float((np.nanmax(gain) - gain[at]).mean())
    return WeightWidth(size, low, lower, median, upper, high, loss, len(chosen) - len(known))


def study_weights_of_run(
    root: Path,
    dataset: Path | None,
    sizes: Sequence[int],
    draws: int,
    *,
    keep: Path | None,
    seed: int,
    jobs: Workers,
) -> list[WeightStudy]:
    """The study of every detector and mode of a finished run.

    Args:
        root: The finished run.
        dataset: Data set whose split validation is drawn from; None for that of the run.
        sizes: Numbers of images of a subset; those beyond the validation images are left out.
        draws: Subsets of each size.
        keep: Folder where candidates with their evidence are kept from one study to the next; None for none.
        seed: Of every random choice.
        jobs: Frames at a time.

    Raises:
        RescoreError: the run is not finished, or no size can be served.
    """
    folder, config = RunFolder(root), run_config(root)
    data = read_dataset(dataset or folder.data, config.class_name)
    for note in data.notes:
        say(f"note: {note}")
    validation = Splits.of(data).validation_set
    served = _served(sizes, len(validation.data.frames))
    studies = []
    for kind in config.detectors:
        table = _candidates(folder, kind, config, validation.data, keep, jobs)
        models = load_models(folder.evidence_model(kind)) if folder.evidence_model(kind).is_file() else {}
        for number, mode in enumerate(config.registrations):
            rng = np.random.default_rng([seed, number])
            rated = Rescoring(config.rescore, models.get(mode)).fuse(table).candidates
            studies.append(study_weight(kind, mode, rated, validation, served, draws, config.tune, rng))
    return studies


def _served(sizes: Sequence[int], n_images: int) -> list[int]:
    """The sizes that the set can serve."""
    fit = [n for n in sizes if n <= n_images]
    if not fit:
        raise RescoreError(
            f"--sizes: expected a number up to the {n_images} validation images, got "
            f"{','.join(map(str, sizes))}; choose a smaller one or render more images"
        )
    if len(fit) < len(sizes):
        left_out = ", ".join(str(n) for n in sizes if n > n_images)
        say(f"left out {left_out}: there are {n_images} validation images")
    return fit


def _candidates(
    folder: RunFolder,
    kind: str,
    config: RunConfig,
    validation: DataSet,
    keep: Path | None,
    jobs: Workers,
) -> CandidateTable:
    """The candidates of a detector of the run on validation images, with depth evidence, before w."""
    if validation.root.resolve() == folder.data.resolve():
        return coco.read_detections(folder.evidence_table(kind, "validation"), validation).table
    detector, scaling, model = folder.detector(kind), folder.scaling(kind), folder.class_model
    rescoring = Rescoring(config.rescore)

    def find() -> RescoredTable:
        found = detect_candidates(load_detector(detector), load_scaling(scaling), validation, jobs)
        candidates = found.by_image([f.image_id for f in validation.frames])
        class_model = ClassModel.load(model)
        return rescore_frames.rescore_frames(
            validation, candidates, class_model, rescoring, jobs=jobs, progress=f"depth evidence {kind}"
        )

    if keep is None:
        return find().candidates
    stage = Stage(
        f"evidence_{kind}",
        part_as_json(config.rescore),
        (detector, scaling, model, validation.root / "annotations.json"),
        (keep / f"{kind}.json",),
        (rescore_frames, coco),
    )
    if run_stage(
        keep,
        stage,
        lambda out: coco.write_rescored(
            out, kind, find(), validation, w=rescoring.w, registration=rescoring.mode
        ),
    ).reused:
        say(f"{kind}: candidates of {keep}")
    return coco.read_detections(keep / f"{kind}.json", validation).table


class WeightRecord(StudyPart):
    """The choice of w for one detector in one mode, as weight.json holds it."""

    detector: str
    registration: Registration
    objective_name: str
    n_images: int
    n_cars: int
    n_draws: int
    w: float
    w_grid: tuple[float, ...]
    objective: tuple[float | None, ...]
    """The objective at each w; None where it is undefined or infinite."""
    widths: tuple[WeightWidth, ...]

    @classmethod
    def of(cls, study: WeightStudy) -> Self:
        """What the file holds of a study."""
        return cls(
            detector=study.detector,
            registration=study.registration,
            objective_name=study.objective,
            n_images=study.n_images,
            n_cars=study.n_cars,
            n_draws=study.n_draws,
            w=study.w,
            w_grid=tuple(study.grid.tolist()),
            objective=tuple(v if np.isfinite(v) else None for v in study.value.tolist()),
            widths=study.widths,
        )


def write_weights(path: Path, records: Sequence[WeightRecord]) -> None:
    """Write weight.json; a number that JSON cannot hold is null."""
    write_json(path, json_values([record.as_json() for record in records]))
