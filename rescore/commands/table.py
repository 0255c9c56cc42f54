"""The commands on model cars on a table: ``rescore localize`` (section 5.1) and ``rescore grasp`` (5.2)."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from datasets_synth.cars import MESH_FORMS
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

if TYPE_CHECKING:
    from datasets_synth.cars.mesh_axes import MeshAxes

Meshes = Annotated[Path | None, typer.Option(help=f"Folder of {MESH_FORMS} cars to take instead.")]
Up = Annotated[
    str | None, typer.Option(help="Axis of the meshes that points up: x, y, z, -x, -y or -z. Default: y.")
]
Nose = Annotated[str | None, typer.Option(help="Axis of the meshes that the nose points along. Default: z.")]


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
    meshes: Meshes = None,
    up: Up = None,
    nose: Nose = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """Localise model cars on a black table, as in section 5.1 of the report: boxes, centroids, orientations.

    Model cars 1:18 are placed at random and seen by one calibrated camera. Cars as dark as the table get
    another paint. The class is learned from part-labelled views of other cars, whose length, width and
    height are known, and from pictures of them on the table. What it learned and the trials are kept in the
    folder, so that a run that was stopped goes on where it was.

    Example: [bold]rescore localize --out runs/localize --cars 20 --placements 200[/bold]
    """
    from reports.studies.localization_sheets import write_localization
    from rescore.studies.localization.result_file import outside_remark
    from rescore.studies.localization.scores import markdown_table
    from rescore.studies.localization.study import learned_study

    workers = workers_of(engine, address, jobs)
    study = learned_study(cars, placements, meshes, seed, workers, out, _axes(meshes, up, nose))
    tally = write_localization(study, out, workers)
    tally.save(out, study, meshes)
    if as_json:
        print_json(tally.result.model_dump(mode="json"))
    else:
        print(markdown_table(tally.by_car))
        print(outside_remark(tally.placements))
    say(f"localization: {out / 'localization.json'}")


@app.command()
def grasp(
    out: Annotated[
        Path, typer.Option(help="Folder for the numbers, the table and the strips.", callback=folder_target)
    ],
    cars: Annotated[int, typer.Option(min=1, help="Model cars, spread over the body types.")] = 20,
    placements: Annotated[int, typer.Option(min=1, help="Placements of each car within reach.")] = 3,
    fit_placements: Annotated[
        int, typer.Option(min=0, help="Placements of each car for the joint fit, if more: for intervals.")
    ] = 0,
    meshes: Meshes = None,
    up: Up = None,
    nose: Nose = None,
    show: Annotated[
        int | None, typer.Option(min=0, help="Also write a recording of this trial (0 is the first).")
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """Let a simulated robot grasp model cars that are localised from one picture, as in section 5.2.

    Each car is put on the table within reach, photographed and localised by every method; an arm with seven
    joints moves a hand to the estimate, closes it, lifts, holds, shakes and puts down. A run that was stopped
    goes on where it was. Needs the package's extra "robot".

    Example: [bold]rescore grasp --cars 20 --placements 3 --out runs/grasp[/bold]
    """
    from reports.recording.grasp import write_grasp_recording
    from reports.studies.grasping import show_trial, write_grasping
    from rescore.grasping.experiment import Experiment
    from rescore.grasping.result_file import grasp_table

    workers = workers_of(engine, address, jobs)
    experiment = Experiment.of(cars, placements, meshes, seed, _axes(meshes, up, nose), fit_placements)
    experiment.require_trial(show)
    result = experiment.run(out, workers)
    write_grasping(experiment, result, out)
    if show is not None:
        shown = show_trial(experiment, result, show)
        say(f"recording: {write_grasp_recording(shown, out / f'trial_{show}.rrd')}")
    if as_json:
        print_json(result.as_json())
    else:
        print(grasp_table(result))
    say(f"grasps: {out / 'grasp.json'}")


@app.command("grasp-errors")
def grasp_errors(
    out: Annotated[Path, typer.Option(help="Folder for errors.json.", callback=folder_target)],
    placements: Annotated[int, typer.Option(min=1, help="Placements of each of eight cars.")] = 2,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """Measure which accuracy a grasp needs: success against errors of the estimate, for both hands.

    Errors across and along the car, of its height and of its heading are put on the true box, one at a time,
    on cars that are not those of `rescore grasp`. Needs the package's extra "robot".

    Example: [bold]rescore grasp-errors --out runs/grasping[/bold]
    """
    from rescore.grasping.error_grid import error_grid, error_table, write_errors

    workers = workers_of(engine, address, jobs)
    grid = error_grid(placements, seed, workers)
    write_errors(out / "errors.json", grid)
    if as_json:
        print_json(grid.as_json())
    else:
        print(error_table(grid))
    say(f"errors: {out / 'errors.json'}")


@app.command("grasp-basket")
def grasp_basket(
    out: Annotated[Path, typer.Option(help="Folder for basket.json and the strips.", callback=folder_target)],
    placements: Annotated[int, typer.Option(min=1, help="Placements of each of two baskets.")] = 40,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
    as_json: AsJson = False,
) -> None:
    """Let the robot grasp baskets by a handle that the camera does not see, as in section 5.2.

    The class model comes from two part-labelled views of one basket; a card hides the handle in the
    photograph, and section 4.4 places it. A second basket is none that taught the model. Needs the package's
    extra "robot".

    Example: [bold]rescore grasp-basket --out runs/grasping[/bold]
    """
    from reports.studies.grasping import write_basket_strips
    from rescore.grasping.basket import basket_study, basket_table, write_baskets

    workers = workers_of(engine, address, jobs)
    result = basket_study(placements, seed, workers)
    write_baskets(out / "basket.json", result)
    write_basket_strips(result, out)
    if as_json:
        print_json(result.as_json())
    else:
        print(basket_table(result))
    say(f"baskets: {out / 'basket.json'}")


def _axes(meshes: Path | None, up: str | None, nose: str | None) -> "MeshAxes":
    from datasets_synth.cars.mesh_axes import MeshAxes, mesh_axes

    if meshes is None and (up or nose):
        raise RescoreError(
            "--up, --nose: expected --meshes too, got none; name the folder, or leave them out"
        )
    return mesh_axes(up or MeshAxes.up, nose or MeshAxes.nose)
