"""The command ``rescore localize``: section 5.1 of the report on rendered model cars."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from pathlib import Path
from typing import Annotated

import typer

from rescore.commands.base import ALL_PROCESSORS, AsJson, Jobs, Seed, app, folder_target, print_json
from rescore.speech import say


@app.command()
def localize(
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for localization.json, the table and the pictures.", callback=folder_target
        ),
    ],
    cars: Annotated[int, typer.Option(min=1, help="Model cars, spread over the body types.")] = 20,
    placements: Annotated[
        int, typer.Option(min=1, help="Placements in all, spread evenly over the cars.")
    ] = 200,
    meshes: Annotated[
        Path | None, typer.Option(help="Folder of OBJ, GLB or PLY cars to place instead.")
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    as_json: AsJson = False,
) -> None:
    """Localise model cars on a black table, as in section 5.1 of the report: boxes, centroids, orientations.

    Model cars 1:18 are placed at random and seen by one calibrated camera. Cars as dark as the table get
    another paint. The class is learned from part-labelled views of other cars, whose length, width and
    height are known, and from pictures of them on the table.

    Example: [bold]rescore localize --out runs/localize --cars 20 --placements 200[/bold]
    """
    from reports.studies.localization_sheets import write_localization
    from rescore.studies.localization.scores import markdown_table
    from rescore.studies.localization.study import learned_study

    study = learned_study(cars, placements, meshes, seed, jobs)
    tally = write_localization(study, out, jobs)
    tally.save(out, study, meshes)
    if as_json:
        print_json(tally.result.model_dump(mode="json"))
    else:
        print(markdown_table(tally.by_car))
    say(f"localization: {out / 'localization.json'}")
