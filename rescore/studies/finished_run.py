"""A finished run, opened for a study."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.stereo.sgbm import SgbmConfig
from rescore.data.frames import DataSet
from rescore.evidence.candidates import Candidates
from rescore.evidence.model import EvidenceModel, load_models
from rescore.evidence.registration import LEARNED, Registration
from rescore.evidence.settings import RescoreConfig
from rescore.experiment.config import RunConfig, run_config
from rescore.formats.coco import read_detections
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.tuning_file import load_tuning
from rescore.results.run_folder import RunFolder


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """What a study needs of a run: nothing of it is fitted again."""

    data: DataSet
    """Test frames of the run."""
    candidates: Mapping[int, Candidates]
    """Candidates of one detector, by image id."""
    class_model: ClassModel
    config: RescoreConfig
    sgbm: SgbmConfig
    """The matcher that made the disparity of the data set."""
    models: Mapping[Registration, EvidenceModel]
    weights: Mapping[Registration, float]
    """w of each mode."""


def finished_run(root: Path, detector: str, frames: int | None) -> FinishedRun:
    """The parts of a finished run that a study needs, cut to evenly spread test frames.

    Raises:
        RescoreError: the run is not finished, or has no such detector.
    """
    folder, config = RunFolder(root), run_config(root)
    if detector not in list(config.detectors):
        raise RescoreError(
            f"--detector: expected {' or '.join(config.detectors)} in {root}, got {detector!r}; name one"
        )
    data = _spread(_test_frames(folder, config), frames)
    modes = config.registrations
    return FinishedRun(
        data=data,
        candidates=_candidates(folder, detector, data, config),
        class_model=ClassModel.load(folder.class_model),
        config=config.rescore,
        sgbm=config.synth.sgbm,
        models=load_models(folder.evidence_model(detector)) if set(modes) & set(LEARNED) else {},
        weights={m: load_tuning(folder.tuned(detector, m)).w for m in modes},
    )


def _test_frames(folder: RunFolder, config: RunConfig) -> DataSet:
    return read_dataset(folder.data, config.class_name).split("test")


def _spread(data: DataSet, count: int | None) -> DataSet:
    """The data set cut to ``count`` frames, evenly spread; whole for None or where it has fewer."""
    n = len(data.frames)
    if count is None or count >= n:
        return data
    kept = tuple(data.frames[i * n // count] for i in range(count))
    return replace(data, frames=kept, truth={f.image_id: data.truth[f.image_id] for f in kept})


def _candidates(folder: RunFolder, detector: str, data: DataSet, config: RunConfig) -> dict[int, Candidates]:
    whole = _test_frames(folder, config)
    found = read_detections(folder.detections(detector, "test"), whole).candidates(whole)
    return {f.image_id: found[f.image_id] for f in data.frames}
