"""The command that studies measured disparity: study-stereo."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import app, read_data
from rescore.speech import say

if TYPE_CHECKING:
    from rescore.data.frames import DataSet
    from rescore.studies.stereo import Accuracy, Consistency


@app.command("study-stereo")
def study_stereo(
    folders: Annotated[
        list[Path],
        typer.Argument(
            help="KITTI stereo 2015 (its folder training), Middlebury scenes with truth, or any data set of "
            "pairs."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the page, its figure and numbers.")],
    nearest: Annotated[
        float, typer.Option(min=0.1, help="Depth in metres from which calibrated pairs are measured.")
    ] = 2.0,
) -> None:
    """How good measured disparity is: against the truth, OpenCV called directly, and public figures.

    Pairs without truth get their density, and how the map agrees with matched features.

    Example: [bold]rescore study-stereo data_scene_flow/training --out runs/stereo[/bold]
    """
    from rich.console import Console

    from reports.studies.stereo import consistency_table, kitti_table, short_table, write_stereo_study
    from rescore.formats.stereo_truth import find_true_scenes
    from rescore.studies.stereo import accuracies, added, consistency_of

    scenes: list[Accuracy] = []
    kitti: Accuracy | None = None
    without_truth: list[Consistency] = []
    for folder in folders:
        found = find_true_scenes(folder)
        if found is None:
            without_truth += consistency_of(_pairs_of(folder), nearest)
        elif not found.kitti:
            scenes += accuracies(found, nearest)
        elif kitti is None:
            say(f"{folder}: KITTI stereo 2015, {len(found.scenes)} pairs")
            kitti = added("KITTI 2015", accuracies(found, nearest))
        else:
            raise RescoreError(f"{folder}: expected one folder of KITTI stereo 2015, got a second; give one")
    command = f"rescore study-stereo {' '.join(map(str, folders))} --out {out} --nearest {nearest:g}"
    page = write_stereo_study(scenes, kitti, without_truth, out, command, nearest)
    console = Console()
    if known := [*scenes, *([kitti] if kitti else [])]:
        console.print(short_table(known).rich())
    if kitti:
        console.print(kitti_table(kitti).rich())
    if without_truth:
        console.print(consistency_table(without_truth, short=True).rich())
    say(f"measured disparity: {page}")


def _pairs_of(folder: Path) -> "DataSet":
    """A data set that has right pictures."""
    data = read_data(folder)
    if not any(frame.right_path for frame in data.frames):
        raise RescoreError(f"{folder}: expected pairs of pictures, got frames without right ones; give pairs")
    return data
