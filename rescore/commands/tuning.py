"""The commands that fit what turns depth into a score: fit-evidence, tune."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import (
    ALL_PROCESSORS,
    DETECTION_FORMS,
    AdaptShare,
    Address,
    Changes,
    Dataset,
    Engine,
    EvidenceModelFile,
    Jobs,
    Maps,
    Preset,
    RegistrationMode,
    Seed,
    app,
    config_of,
    detections_of,
    file_target,
    mode_of,
    read_data,
    with_share,
    workers_of,
)
from rescore.commands.depth_source import (
    Model,
    Predicted,
    evidence_of,
    source_as_json,
    source_of,
    tell_doubts,
)
from rescore.speech import say


@app.command(name="fit-evidence")
def fit_evidence(
    dataset: Dataset,
    detections: Annotated[
        list[Path], typer.Argument(help=f"Detections on the splits train and calibration: {DETECTION_FORMS}.")
    ],
    out: Annotated[
        Path, typer.Option(help="File to write the models of depth evidence to, JSON.", callback=file_target)
    ],
    model: Model = None,
    predicted: Predicted = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            help="Group of cues to leave out, such as 'class model', to see what it is worth; repeat."
        ),
    ] = None,
    preset: Preset = "paper",
    config: Changes = None,
    maps: Maps = None,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """Calibrate D of the modes guarded, metric and instance on the splits "train" and "calibration".

    Example: [bold]rescore fit-evidence data/demo hog_calibration.json --model car.json --out hog.json[/bold]
    """
    from rescore.data.splits import Splits
    from rescore.evidence.candidates import CandidateTable
    from rescore.evidence.cues import cues_of_groups
    from rescore.evidence.fit_model import fit_modes
    from rescore.evidence.model import save_models
    from rescore.evidence.registration import LEARNED
    from rescore.evidence.settings import with_stereo_for
    from rescore.experiment.config import part_as_json
    from rescore.files import write_provenance
    from rescore.fusion.rescore_frame import Rescoring
    from rescore.fusion.rescore_frames import rescore_frames

    workers = workers_of(engine, address, jobs)
    settings, left_out = config_of(preset, config), cues_of_groups(without or ())
    asked = source_of(model, predicted, LEARNED)
    data = read_data(dataset, settings.class_name, maps, of_several=True)
    fitting_set = Splits.of(data).fitting_set
    fitting = _with_frames(dataset, fitting_set.data, "the splits 'train' and 'calibration'")
    rescoring = Rescoring(with_stereo_for(settings.rescore, fitting, None))
    files = [detections_of(path, fitting) for path in detections]
    given = [(file.detector, file.candidates(fitting)) for file in files]
    source = asked.on(fitting, {i: c for _, found in given for i, c in found.items() if len(c)})
    table = CandidateTable.concatenate(
        [
            rescore_frames(
                fitting, candidates, source, rescoring, jobs=workers, progress=f"depth evidence {name}"
            ).candidates
            for name, candidates in given
        ]
    )
    tell_doubts(source, table)
    models = fit_modes(table, fitting_set, settings.evidence, without=left_out)
    save_models(out, {mode: replace(m, depth_of=asked.depth_of) for mode, m in models.items()})
    parts = {n: part_as_json(getattr(settings, n)) for n in ("rescore", "evidence")}
    parts |= {"without": list(left_out)} if left_out else {}
    write_provenance(out, "fit-evidence", parts | source_as_json(source), None)
    _tell_fitted(source, set(models), out)


def _with_frames(where: Path, data: "DataSet", of: str) -> "DataSet":
    """The part of a data set that is worked on; raises RescoreError where it has no frames."""
    if not data.frames:
        raise RescoreError(
            f"{where}: expected frames of {of}, got none; name splits in annotations.json, which "
            "`rescore import` writes"
        )
    return data


def _tell_fitted(source: "ClassModel | Predictions", fitted: "set[Registration]", out: Path) -> None:
    """Say which modes no candidate had evidence for, and why; and where the models of the others are."""
    from recon.class_model import ClassModel
    from rescore.evidence.registration import LEARNED, Registration

    for mode in (mode for mode in LEARNED if mode not in fitted):
        why = "no candidate has what it looks at, or all of it is left out"
        if mode.needs_calibration:
            why = "it takes calibrated cameras, and a ground plane for instance"
        if mode is Registration.INSTANCE and isinstance(source, ClassModel) and source.shape_space is None:
            why = "the class model has no shape space; `rescore learn --instances 7` or more gives it one"
        say(f"note: no depth evidence for {mode}: {why}")
    say(f"depth evidence for {' and '.join(mode for mode in LEARNED if mode in fitted)}: {out}")


if TYPE_CHECKING:
    from recon.class_model import ClassModel
    from rescore.data.frames import DataSet
    from rescore.evidence.predicted_depth_files import Predictions
    from rescore.evidence.registration import Registration


@app.command()
def tune(
    dataset: Dataset,
    detections: Annotated[
        Path, typer.Argument(help=f"Detections on the split validation: {DETECTION_FORMS}.")
    ],
    out: Annotated[Path, typer.Option(help="File to write w and its curve to, JSON.", callback=file_target)],
    model: Model = None,
    predicted: Predicted = None,
    registration: RegistrationMode = "paper",
    evidence_model: EvidenceModelFile = None,
    adapt_share: AdaptShare = False,
    preset: Preset = "paper",
    config: Changes = None,
    seed: Seed = 0,
    maps: Maps = None,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """Choose the weight w of eq. 7 on the split "validation", and keep the curve it was chosen from.

    Example: [bold]rescore tune data/demo hog_validation.json --model car.json --out hog_w.json[/bold]
    """
    from rescore.data.splits import Splits
    from rescore.evidence.registration import check_depth_of
    from rescore.evidence.settings import with_stereo_for
    from rescore.experiment.config import part_as_json
    from rescore.files import write_json, write_provenance
    from rescore.fusion.rescore_frame import Rescoring
    from rescore.fusion.tune import tune_on_validation
    from rescore.fusion.tuning_file import tuning_as_json

    workers = workers_of(engine, address, jobs)
    mode, learned = mode_of(registration, evidence_model)
    asked = source_of(model, predicted, (mode,))
    if learned is not None:
        check_depth_of(str(evidence_model), learned.depth_of, asked.depth_of)
    settings = config_of(preset, config)
    data = read_data(dataset, settings.class_name, maps, of_several=True)
    validation = _with_frames(dataset, Splits.of(data).validation, "the split 'validation'")
    looked = with_stereo_for(settings.rescore, validation, None)
    finding = Rescoring(looked, predict=mode.predicts)
    source, table, detector = evidence_of(validation, detections, asked, finding, workers)
    learned, _ = with_share(learned, table, adapt_share)
    judged = Rescoring(looked, learned).fuse(table).candidates
    tuning = tune_on_validation(detector, judged, data, settings.tune, mode, seed)
    write_json(out, tuning_as_json(replace(tuning, depth_of=asked.depth_of)))
    parts = {n: part_as_json(getattr(settings, n)) for n in ("rescore", "tune")}
    write_provenance(out, "tune", parts | source_as_json(source), seed)
    say(f"w = {tuning.w:g} for {tuning.detector} on {tuning.n_images} frames: {out}")
    if tuning.uncertainty is not None:
        u = tuning.uncertainty
        say(
            f"95 % interval of w {u.low:g} to {u.high:g}, within one standard error of the best "
            f"{u.plateau[0]:g} to {u.plateau[1]:g}; {tuning.sentence}"
        )
