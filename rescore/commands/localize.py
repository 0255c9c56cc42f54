"""The command ``rescore localize``: section 5.1 of the report on rendered model cars."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import ALL_PROCESSORS, Jobs, Seed, app, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from datasets_synth.cars.shapes import CarModel
    from recon.arrays import UInt8Array
    from reports.studies.localization_pictures import Instance3DView
    from rescore.studies.localization.learned import TableClass
    from rescore.studies.localization.result_file import Placement, TablePose
    from rescore.studies.localization.trials import Trial, TrialConfig

_SHOWN, _WORST = 40, 12
"""Placements in the pictures of the first and of the worst ones."""


@app.command()
def localize(
    out: Annotated[Path, typer.Option(help="Folder for localization.json, the table and the pictures.")],
    cars: Annotated[int, typer.Option(min=1, help="Model cars, spread over the body types.")] = 20,
    placements: Annotated[
        int, typer.Option(min=1, help="Placements in all, spread evenly over the cars.")
    ] = 200,
    meshes: Annotated[
        Path | None, typer.Option(help="Folder of OBJ, GLB or PLY cars to place instead.")
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """Localise model cars on a black table, as in section 5.1 of the report: boxes, centroids, orientations.

    Model cars 1:18 are placed at random and seen by one calibrated camera. Cars as dark as the table get
    another paint. The class is learned from part-labelled views of other cars, whose length, width and
    height are known, and from pictures of them on the table.

    Example: [bold]rescore localize --out runs/localize --cars 20 --placements 200[/bold]
    """
    from datasets_synth.cars.models import cars_of_splits
    from rescore.files import write_provenance
    from rescore.parallel import track
    from rescore.studies.localization.learned import TableClassConfig, learn_table_class
    from rescore.studies.localization.trials import TrialConfig, run_trials

    split = cars_of_splits(test_meshes=meshes)
    chosen = _spread(split["test"], cars)
    if placements < len(chosen):
        raise RescoreError(
            f"--placements: expected at least one for each of {len(chosen)} cars, got {placements}; "
            "ask for more placements or fewer --cars"
        )
    say(f"learning from {len(split['train'])} cars")
    table_class = learn_table_class(split["train"], TableClassConfig(), jobs)
    config = TrialConfig()
    gallery = _Gallery(table_class)
    trials = run_trials(chosen, placements, table_class, config, seed, jobs)
    for trial in track(trials, "localise", placements):
        gallery.add(trial)
    gallery.write(out)
    _write_table_picture(out, chosen, table_class, config, seed)
    settings = {"cars": len(chosen), "placements": placements, "meshes": str(meshes) if meshes else None}
    write_provenance(out / "localization.json", "localize", settings, seed)
    say(f"localization: {out / 'localization.json'}")


def _spread(cars: "Sequence[CarModel]", count: int) -> "list[CarModel]":
    """``count`` of the cars evenly over their list, which goes by body type; all where there are fewer."""
    if count >= len(cars):
        return list(cars)
    return [cars[i * len(cars) // count] for i in range(count)]


class _Gallery:
    """Gathers numbers and small pictures as trials are done; large pictures are not kept."""

    def __init__(self, table_class: "TableClass") -> None:
        from datasets_synth.photos.table_scene import CAMERA, GROUND
        from reports.studies.localization_pictures import TableCamera

        self.table_class = table_class
        self.camera = TableCamera(CAMERA, GROUND)
        self.placements: list[Placement] = []
        self.tiles: list[tuple[float, UInt8Array]] = []
        self.typical: tuple[float, UInt8Array, Instance3DView] | None = None

    def add(self, trial: "Trial") -> None:
        """Take what is kept of a trial."""
        from reports.studies.localization_pictures import draw, tile
        from rescore.studies.localization.result_file import Placement
        from rescore.studies.localization.scores import METHODS, Score

        scores = trial.scores
        methods = {m: scores[m] for m in METHODS}
        self.placements.append(Placement(car=trial.shape_id, pose=_pose(trial), methods=methods))
        view = _view(trial, self.table_class)
        self.tiles.append((_badness(trial), tile(trial.crop_rgb, trial.crop_xy_px, view, self.camera)))
        own = scores["3dp"]
        if isinstance(own, Score) and own.overlap is not None:
            # the typical one: nearest to an overlap of 0.88 among the first ones
            off = abs(own.overlap - 0.88)
            if self.typical is None or off < self.typical[0]:
                self.typical = (off, draw(trial.crop_rgb, trial.crop_xy_px, [view], self.camera, 3.0), view)

    def write(self, out: Path) -> None:
        """Write numbers, table and pictures."""
        from reports.studies.localization_pictures import save_png, save_reconstruction, sheet, titled
        from rescore.files import atomic_path
        from rescore.studies.localization.result_file import (
            localization_result,
            scores_by_car,
            write_localization,
        )
        from rescore.studies.localization.scores import markdown_table

        write_localization(out / "localization.json", localization_result(self.placements))
        table = markdown_table(scores_by_car(self.placements))
        with atomic_path(out / "localization.md") as beside:
            beside.write_text(table)
        print(table)
        first = sheet([picture for _, picture in self.tiles[:_SHOWN]], 5)
        save_png(out / "placements.png", titled(first, f"First {min(len(self.tiles), _SHOWN)} placements"))
        worst = sheet([t for _, t in sorted(self.tiles, key=lambda t: -t[0])[:_WORST]], 4)
        save_png(out / "worst.png", titled(worst, f"The worst {min(len(self.tiles), _WORST)} placements"))
        if self.typical is not None:
            save_reconstruction(out / "reconstruction.png", self.typical[1], self.typical[2])


def _pose(trial: "Trial") -> "TablePose":
    from rescore.studies.localization.result_file import TablePose

    x, y = trial.truth.xy_m
    yaw_deg = float(trial.truth.yaw_rad * 57.29577951)
    return TablePose(x_mm=1000 * float(x), y_mm=1000 * float(y), yaw_deg=yaw_deg)


def _badness(trial: "Trial") -> float:
    """How bad the joint fit is: centroid error in mm, lost ones first."""
    from rescore.studies.localization.scores import Score

    own = trial.scores["3dp"]
    return own.centroid_mm + 2 * own.orientation_deg if isinstance(own, Score) else float("inf")


def _view(trial: "Trial", table_class: "TableClass") -> "Instance3DView":
    import numpy as np

    from datasets_synth.photos.table_scene import SCALE
    from recon.localization.localize import FitLocalization
    from reports.studies.localization_pictures import Instance3DView
    from rescore.studies.localization.scores import Score

    own = trial.scores["3dp"]
    if not isinstance(trial.fit, FitLocalization) or not isinstance(own, Score):
        reason = "lost" if isinstance(own, Score) else str(own.reason)
        return Instance3DView(
            trial.truth, None, (), np.zeros((0, 3, 3)), f"{trial.index} {trial.shape_id} {reason}"
        )
    parts = trial.fit.fit.parts_m(table_class.space, SCALE)
    numbers = f"{100 * (own.overlap or 0):.0f}% {own.centroid_mm:.1f}mm {own.orientation_deg:.1f}deg"
    caption = f"{trial.index} {trial.shape_id} {numbers}"
    labels = table_class.space.part_labels
    return Instance3DView(trial.truth, trial.fit.box, labels, parts, caption, trial.ring_px)


def _write_table_picture(
    out: Path, cars: "Sequence[CarModel]", table_class: "TableClass", config: "TrialConfig", seed: int
) -> None:
    """One photograph of several cars with the boxes that the joint fit finds."""
    import numpy as np

    from datasets_synth.photos.table_scene import CAMERA, GROUND, SCALE, photograph
    from recon.errors import Failure
    from recon.localization.localize import FitLocalization
    from recon.localization.standing_box import angle_between
    from reports.studies.localization_pictures import Instance3DView, TableCamera, draw, save_png, titled
    from rescore.studies.localization.segment import segment_table
    from rescore.studies.localization.trials import empty_table, fit_region, several_at_once

    rng = np.random.default_rng([seed, 1_000_000])
    placed = several_at_once([cars[i] for i in rng.permutation(len(cars))][:9], rng)
    rgb = photograph(placed, rng)
    regions = segment_table(rgb, empty_table(config.segment))
    camera = TableCamera(CAMERA, GROUND)
    views = []
    for region in [] if isinstance(regions, Failure) else regions:
        found = fit_region(rgb, region, table_class, config)
        if isinstance(found, FitLocalization):
            nearest = min(placed, key=lambda p: float(np.linalg.norm(p.xy_m - found.box.xy_m)))
            parts = found.fit.parts_m(table_class.space, SCALE)
            labels = table_class.space.part_labels
            views.append(Instance3DView(nearest.box, found.box, labels, parts, "", region.ring_px))
    picture = draw(rgb, (0, 0), views, camera, 1.0)
    turned = [angle_between(v.truth.yaw_rad, v.estimate.yaw_rad) for v in views if v.estimate is not None]
    wrong = sum(angle > np.pi / 2 for angle in turned)
    title = f"{len(placed)} cars, {len(views)} found, {wrong} turned the wrong way; thick: the front"
    save_png(out / "table.png", titled(picture, title))
