"""The command that studies measured disparity: study-stereo."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import Annotated

import typer

from rescore.commands.base import (
    ALL_PROCESSORS,
    Address,
    AsJson,
    Engine,
    Jobs,
    app,
    folder_target,
    print_json,
    workers_of,
)
from rescore.speech import say


@app.command("study-stereo")
def study_stereo(
    folders: Annotated[
        list[Path],
        typer.Argument(
            help="KITTI stereo 2015 (its folder training), Middlebury scenes with truth, or any data set of "
            "pairs."
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="Folder for the page, its figure and numbers.", callback=folder_target)
    ],
    nearest: Annotated[
        float, typer.Option(min=0.1, help="Depth in metres from which calibrated pairs are measured.")
    ] = 2.0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """How good measured disparity is: against the truth, OpenCV called directly, and public figures.

    Pairs without truth get their density, and how the map agrees with matched features.

    Example: [bold]rescore study-stereo data_scene_flow/training --out runs/stereo[/bold]
    """
    from rich.console import Console

    from reports.studies.stereo import short_tables, write_stereo_study
    from rescore.studies.stereo import study_folders
    from rescore.studies.stereo_file import stereo_result

    study = study_folders(folders, nearest, workers_of(engine, address, jobs))
    command = f"rescore study-stereo {' '.join(map(str, folders))} --out {out} --nearest {nearest:g}"
    result = stereo_result(study, command, nearest)
    page = write_stereo_study(study, result, out)
    if as_json:
        print_json(result.as_json())
    for table in () if as_json else short_tables(study):
        Console().print(table.rich())
    say(f"measured disparity: {page}")
