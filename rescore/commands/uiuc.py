"""The command of the UIUC car set: recall and precision of detectors trained on its crops."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import ALL_PROCESSORS, Jobs, app


@app.command()
def uiuc(
    folder: Annotated[Path, typer.Argument(help="Folder with TestImages and trueLocations.txt.")],
    detectors: Annotated[list[Path], typer.Argument(help="Detectors that `rescore train --crops` wrote.")],
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """Recall and precision on the single-scale test pictures of the UIUC car set, by its own rule.

    Example: [bold]rescore uiuc CarData models/hog.npz models/boosted.npz[/bold]
    """
    from rescore.detectors.crop_training import WindowDetector
    from rescore.detectors.registry import load_detector
    from rescore.formats.uiuc import read_uiuc
    from rescore.studies.uiuc import evaluate_uiuc

    pictures = read_uiuc(folder)
    for path in detectors:
        detector = load_detector(path)
        if not isinstance(detector, WindowDetector):
            raise RescoreError(f"{path}: expected a detector that scans for sizes, got {detector.name}")
        curve = evaluate_uiuc(detector, pictures, jobs)
        print(f"{detector.name}, {len(pictures)} pictures: {curve.summary()}")
