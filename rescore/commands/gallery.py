"""The command that makes the gallery of reconstructions: gallery."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from pathlib import Path
from typing import Annotated

import typer

from rescore.commands.base import (
    ALL_PROCESSORS,
    Address,
    Engine,
    Jobs,
    Seed,
    app,
    folder_target,
    workers_of,
)
from rescore.speech import say


@app.command()
def gallery(
    out: Annotated[Path, typer.Option(help="Folder for the pictures and README.md.", callback=folder_target)],
    seed: Seed = 0,
    models: Annotated[
        Path | None, typer.Option(help="Folder where the class models are kept from run to run.")
    ] = None,
    bins: Annotated[int, typer.Option(min=1, max=12, help="View bins of each class in the table.")] = 12,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """Reconstruct photographs of test shapes of every class, and compare with their truth.

    Example: [bold]rescore gallery --out gallery --models models[/bold]
    """
    from reports.studies.reconstructions import SHOWN_BINS, write_reconstructions
    from rescore.studies.reconstructions import study

    command = f"rescore gallery --out {out} --seed {seed} --bins {bins}"
    workers = workers_of(engine, address, jobs)
    shown = study(seed, bins, models, SHOWN_BINS, workers)
    say(f"gallery: {write_reconstructions(shown, out, command)}")
