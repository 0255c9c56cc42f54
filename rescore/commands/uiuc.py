"""The command of the UIUC car set: recall and precision of detectors trained on its crops."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import Annotated

import typer

from rescore.commands.base import ALL_PROCESSORS, Address, AsJson, Engine, Jobs, app, print_json, workers_of


@app.command()
def uiuc(
    folder: Annotated[Path, typer.Argument(help="Folder with TestImages and trueLocations.txt.")],
    detectors: Annotated[list[Path], typer.Argument(help="Detectors that `rescore train --crops` wrote.")],
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """Recall and precision on the single-scale test pictures of the UIUC car set, by its own rule.

    Example: [bold]rescore uiuc CarData models/hog.npz models/boosted.npz[/bold]
    """
    from rescore.studies.uiuc import evaluate_files

    workers = workers_of(engine, address, jobs)
    found = evaluate_files(folder, detectors, workers)
    if as_json:
        print_json([one.as_json() for one in found])
    for one in () if as_json else found:
        print(f"{one.detector}, {one.n_pictures} pictures: {one.curve.summary()}")
