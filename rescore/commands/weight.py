"""The command that studies the width of w: study-weight."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import (
    ALL_PROCESSORS,
    Address,
    AsJson,
    Engine,
    Jobs,
    Seed,
    app,
    folder_target,
    print_json,
    workers_of,
)
from rescore.speech import say


@app.command("study-weight")
def study_weight(
    run: Annotated[Path, typer.Argument(help="Finished run of `rescore reproduce`: detectors and models.")],
    out: Annotated[
        Path, typer.Option(help="Folder for the page, its figure and numbers.", callback=folder_target)
    ],
    dataset: Annotated[
        Path | None,
        typer.Option(
            help="Data set whose split validation is drawn from, such as one of preset weight-study.",
            show_default="that of the run",
        ),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            help="Folder to keep the candidates with their evidence in, for reuse.", callback=folder_target
        ),
    ] = None,
    sizes: Annotated[str, typer.Option(help="Numbers of validation images.")] = "20,100,500",
    draws: Annotated[int, typer.Option(min=20, help="Subsets of each size.")] = 400,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """How wide w is: tune it on many subsets of a large validation set, for each detector and mode.

    Sizes larger than the validation set are left out.

    Example: [bold]rescore study-weight runs/paper --dataset data/weight --out runs/weight[/bold]
    """
    from rich.console import Console

    from reports.studies.weight import width_table, write_weight_study
    from rescore.studies.weight import WeightRecord, study_weights_of_run

    workers = workers_of(engine, address, jobs)
    studies = study_weights_of_run(run, dataset, _numbers(sizes), draws, keep=keep, seed=seed, jobs=workers)
    of_data = "" if dataset is None else f" --dataset {dataset}"
    command = f"rescore study-weight {run}{of_data} --out {out} --sizes {sizes} --draws {draws} --seed {seed}"
    page = write_weight_study(studies, out, command)
    if as_json:
        print_json([WeightRecord.of(s).as_json() for s in studies])
    else:
        Console().print(width_table(studies, short=True).rich())
    say(f"width of w: {page}")


def _numbers(text: str) -> list[int]:
    """The numbers of an option with commas between them."""
    if not all(part.strip().isdigit() and int(part) for part in text.split(",")):
        raise RescoreError(
            f"--sizes: expected numbers with commas between them, such as 20,100, got {text!r}; mend it"
        )
    return [int(part) for part in text.split(",")]
