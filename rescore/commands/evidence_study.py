"""The commands that study depth evidence: sweep, study-evidence, -class-model, -relief and -places."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from pathlib import Path
from typing import Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import (
    ALL_PROCESSORS,
    Address,
    AsJson,
    Dataset,
    Engine,
    Jobs,
    Maps,
    Seed,
    app,
    detections_of,
    file_target,
    folder_target,
    print_json,
    read_data,
    workers_of,
)
from rescore.speech import say

FinishedRunFolder = Annotated[Path, typer.Argument(help="Folder that `rescore reproduce` has finished.")]
DetectorName = Annotated[str, typer.Option(help="Detector of the run, such as hog.")]
Frames = Annotated[int | None, typer.Option(min=2, help="Test frames to use.", show_default="all")]


Things = Annotated[int, typer.Option(min=2, help="Things of each kind in the bank of distractors.")]


@app.command()
def sweep(
    run: FinishedRunFolder,
    out: Annotated[
        Path, typer.Option(help="Folder for sweep.json, the curves and README.md.", callback=folder_target)
    ],
    dials: Annotated[str | None, typer.Option(help="Dials, comma-separated; all of them else.")] = None,
    levels: Annotated[str | None, typer.Option(help="Levels of the one dial that is named.")] = None,
    frames: Frames = None,
    detector: DetectorName = "hog",
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """Spoil the input of a run's test frames step by step, and measure what is left of the gain.

    Stereo and evidence are computed again; detector, models and weights stay those of the run.

    Example: [bold]rescore sweep runs/paper --out runs/sweep --dials noise,destroyed[/bold]
    """
    from reports.studies.sweep import write_sweep_page
    from rescore.studies.degradations import dials_named
    from rescore.studies.sweep import sweep_run

    workers = workers_of(engine, address, jobs)
    chosen = dials_named(dials, levels)
    value = sweep_run(run, out, chosen, frames, detector=detector, seed=seed, jobs=workers)
    say(f"sweep: {write_sweep_page(value, out)}")


@app.command("study-evidence")
def study_evidence(
    run: FinishedRunFolder,
    out: Annotated[
        Path, typer.Option(help="Folder for README.md, tables and pictures.", callback=folder_target)
    ],
    frames: Frames = None,
    things: Things = 40,
    detector: DetectorName = "hog",
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """What the depth evidence of a run is worth, what it takes for a car, and where it breaks.

    A bank of rendered distractors, the evidence fitted again without each of its parts, and a sweep over
    every dial of `rescore sweep`.

    Example: [bold]rescore study-evidence runs/paper --out reports/published/evidence[/bold]
    """
    from reports.studies.distractors import draw_bank
    from reports.studies.evidence import write_evidence_page
    from reports.studies.sweep import write_sweep_page
    from rescore.studies.ablation import ablate_run
    from rescore.studies.degradations import dials_named
    from rescore.studies.distractors import judge_bank_of_run
    from rescore.studies.sweep import sweep_run

    workers = workers_of(engine, address, jobs)
    bank, first = judge_bank_of_run(run, out, things, detector=detector, seed=seed, jobs=workers)
    draw_bank(out, bank, first)
    ablation = ablate_run(run, out, detector, seed)
    dials = dials_named(None, None)
    swept = sweep_run(run, out / "sweep", dials, frames, detector=detector, seed=seed, jobs=workers)
    write_sweep_page(swept, out / "sweep")
    shortened = "" if frames is None else f" --frames {frames}"
    command = f"rescore study-evidence {run} --out {out} --things {things} --detector {detector}{shortened}"
    say(f"evidence: {write_evidence_page(out, command, bank, ablation, swept)}")


@app.command("study-class-model")
def study_class_model(
    run: FinishedRunFolder,
    out: Annotated[
        Path, typer.Option(help="Folder for the page, its figure and numbers.", callback=folder_target)
    ],
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Whether the class model earns its place: mode instance of a run with and without what comes of it.

    For each detector of the run, false positives where 50 to 80 % of the cars are found, and average
    precision, with paired intervals. Evidence is fitted again and w chosen again, as in the run.

    Example: [bold]rescore study-class-model runs/streets --out runs/class_model[/bold]
    """
    from rich.console import Console

    from reports.studies.class_model_worth import worth_sentence, write_worth_study
    from rescore.studies.class_model_worth import class_model_worth

    result = class_model_worth(run, f"rescore study-class-model {run} --out {out} --seed {seed}", seed)
    page = write_worth_study(result, out)
    if as_json:
        print_json(result.as_json())
    for detector in () if as_json else result.detectors:
        Console().print(worth_sentence(detector), highlight=False, markup=False)
    say(f"class model: {page}")


@app.command("study-relief")
def study_relief(
    run: FinishedRunFolder,
    out: Annotated[
        Path, typer.Option(help="Folder for the page, its figure and numbers.", callback=folder_target)
    ],
    split: Annotated[str, typer.Option(help="Split whose frames are looked at.")] = "test",
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """What a car's disparity says beyond a plane, and how much of it the fitted instance finds.

    Rendered cars of a run of preset streets, in their true shape and pose, fitted, and as the class model has
    them, each against the plane that explains the disparity best.

    Example: [bold]rescore study-relief runs/streets --out runs/relief --split validation[/bold]
    """
    from rich.console import Console

    from reports.studies.relief import target_sentence, write_relief_study
    from rescore.studies.relief.relief import study_relief as study

    workers = workers_of(engine, address, jobs)
    command = f"rescore study-relief {run} --out {out} --split {split} --seed {seed}"
    result = study(run, split, command, seed=seed, jobs=workers)
    page = write_relief_study(result, out)
    if as_json:
        print_json(result.as_json())
    else:
        Console().print(target_sentence(result.target), highlight=False, markup=False)
    say(f"relief: {page}")


@app.command("study-places")
def study_places(
    dataset: Dataset,
    detections: Annotated[Path, typer.Argument(help="Detections in all its frames, with likelihoods.")],
    out: Annotated[
        Path,
        typer.Option(help="JSON file; its page and figure are written beside it.", callback=file_target),
    ],
    rescorer: Annotated[
        Path | None,
        typer.Option(
            help="Rescorer file (docs/library.md) of mode instance.", show_default="that of the package"
        ),
    ] = None,
    seed: Seed = 0,
    maps: Maps = None,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """What D is worth that is fitted on labelled frames of your own, every place left out in turn.

    Neighbouring frames show the same cars: frames whose pictures share points are one place. D is fitted on
    all other places; class model, w and the D it is compared with are those of a rescorer.

    Example: [bold]rescore study-places MY_DATA my_detections.json --out runs/places.json[/bold]
    """
    from rich.console import Console

    from reports.studies.leave_one_out import figures_table, places_sentence, write_places_study
    from rescore.library.rescorer import Rescorer
    from rescore.studies.leave_one_out import study_places as study

    workers = workers_of(engine, address, jobs)
    if out.suffix != ".json":
        raise RescoreError(f"--out: expected a name that ends in .json, got {out.name!r}; change it")
    used = Rescorer.default() if rescorer is None else Rescorer.from_file(rescorer)
    class_name = "car" if used.class_model is None else used.class_model.class_name
    data = read_data(dataset, class_name, maps, of_several=True)
    file = detections_of(detections, data)
    given = "" if rescorer is None else f" --rescorer {rescorer}"
    command = f"rescore study-places {dataset} {detections} --out {out}{given} --seed {seed}"
    result = study(data, file.detector, file.candidates(data), used, command, seed=seed, jobs=workers)
    page = write_places_study(result, out)
    if as_json:
        print_json(result.as_json())
    else:
        Console().print(figures_table(result, short=True).rich())
        Console().print(places_sentence(result), highlight=False, markup=False)
    say(f"places: {page}")
