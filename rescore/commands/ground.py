"""The command that trains the classifier of ground pixels: learn-ground."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import Annotated

import typer

from rescore.commands.base import Dataset, Seed, Split, app, read_split, say


@app.command("learn-ground")
def learn_ground(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="Classifier to write, .npz.")],
    seed: Seed = 0,
    split: Split = "train",
    check: Annotated[
        Path | None, typer.Option(help="Another rendered data set, all frames of which it is measured on.")
    ] = None,
) -> None:
    """Train the classifier of ground pixels (section 4.3) on the frames of a rendered data set.

    The one that comes with the package was trained on 30 frames of rendered streets, with --seed 1.

    Example: [bold]rescore learn-ground data/demo --out ground_pixels.npz[/bold]
    """
    import numpy as np

    from rescore.experiment.config import part_as_json
    from rescore.experiment.ground_training import GroundTrainingConfig, score_ground, train_ground
    from rescore.files import atomic_path, write_provenance
    from rescore.parallel import one_thread

    config = GroundTrainingConfig()
    data = read_split(dataset, split)
    with one_thread():
        classifier = train_ground(data, config, np.random.default_rng(seed))
    with atomic_path(out) as beside:
        classifier.save(beside)
    write_provenance(out, "learn-ground", part_as_json(config), seed)
    say(f"ground pixels: {out}")
    if check is None:
        return
    frames = read_split(check, "all")
    for what, judge in (("classifier", classifier), ("below the horizon", None)):
        for known in (True, False):
            score = score_ground(frames, judge, known)
            camera = "camera known" if known else "camera unknown"
            print(
                f"{what}, {camera}: accuracy {score.accuracy:.3f}, precision {score.precision:.3f}, "
                f"recall {score.recall:.3f} of {score.n_frames} frames"
            )
