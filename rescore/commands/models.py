"""The commands of class models: learn-primitives, learn, study-models, study-views."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import (
    ALL_PROCESSORS,
    Address,
    Changes,
    Engine,
    Jobs,
    Preset,
    Seed,
    app,
    config_of,
    file_target,
    folder_target,
    workers_of,
)
from rescore.speech import say

if TYPE_CHECKING:
    from recon.part_views import PartViews
    from recon.view_bins import ViewBins

VIEWS_HELP = (
    "Folder with part_views.json, a data set that holds one, a COCO segmentation JSON, or a folder of "
    "LabelMe JSON. Without it, views of the rendered class that --class names."
)
Elevation = Annotated[
    float | None,
    typer.Option(
        "--elevation-deg",
        min=-80,
        max=80,
        help="Elevation of the view bins of polygons or rendered views.",
        show_default="5, or that of the rendered class",
    ),
]


@app.command("learn-primitives")
def learn_primitives(
    out: Annotated[Path, typer.Option(help="Library of primitives to write, NPZ.", callback=file_target)],
    elevation_deg: Elevation = None,
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """Run the generic phase (section 3.2) for a view space: planes that turn, and what that does to them.

    The package holds the libraries for 12 view bins at 5, 20 and 30 degrees.

    Example: [bold]rescore learn-primitives --elevation-deg 15 --out primitives.npz[/bold]
    """
    import numpy as np

    from recon.learning.generic_phase import learn_primitives as learn_library

    bins = _bins(elevation_deg)
    library = learn_library(bins, jobs=jobs)
    library.save(out)
    residual = float(np.nanmedian(library.residual))
    say(f"{len(library.normals)} primitives, median residual {residual:.1%} of their size: {out}")


@app.command()
def learn(
    out: Annotated[Path, typer.Option(help="Class model to write, JSON.", callback=file_target)],
    views: Annotated[Path | None, typer.Argument(help=VIEWS_HELP)] = None,
    class_name: Annotated[
        str | None,
        typer.Option("--class", help="Name of the class.", show_default="supercategory, else the preset's"),
    ] = None,
    instances: Annotated[int, typer.Option(min=1, help="Shapes of a rendered class to label.")] = 6,
    view_bins: Annotated[
        str | None,
        typer.Option(help="View bins of a rendered class to label, such as 2,4.", show_default="all"),
    ] = None,
    elevation_deg: Elevation = None,
    primitives: Annotated[
        Path | None, typer.Option(help="Library that `rescore learn-primitives` wrote.")
    ] = None,
    preset: Preset = "paper",
    config: Changes = None,
) -> None:
    """Learn a 3D class model from part-labelled views (section 3 of the report).

    Views are those of a data set, of one's own photos labelled with polygons, or rendered ones of car, chair,
    bicycle, airplane or basket.

    Example: [bold]rescore learn --class chair --view-bins 1,2 --instances 1 --out chair.json[/bold]
    """
    from recon.learning.generic_phase import primitive_library
    from recon.learning.label_files import read_labelled_views
    from recon.learning.learn import learn_class_model
    from recon.learning.primitives import PrimitiveLibrary
    from recon.localization.learn_shapes import with_shape_space
    from rescore.experiment.config import part_as_json
    from rescore.files import write_provenance
    from rescore.parallel import one_thread

    settings = config_of(preset, config)
    if views is None:
        if class_name is None:
            raise RescoreError("learn: expected views or --class, got neither; give one of them")
        part_views, name = _rendered_views(class_name, instances, view_bins, elevation_deg), class_name
    else:
        bins = settings.learn.bins if elevation_deg is None else _bins(elevation_deg)
        labelled = read_labelled_views(views, bins)
        for warning in labelled.warnings:
            say(f"{views}: {warning}")
        part_views, name = labelled.part_views, class_name or labelled.class_name or settings.class_name
    library = PrimitiveLibrary.load(primitives) if primitives else primitive_library(part_views.bins)
    with one_thread():
        model = learn_class_model(part_views, name, part_views.part_names, settings.learn, library)
        model = with_shape_space(model, part_views, library)
    model.save(out)
    write_provenance(out, "learn", part_as_json(settings.learn), None)
    for part in model.parts:
        if part.view_count == 1:
            say(f"{model.part_names[part.label - 1]}: only one view shows it, so its plane is a guess")
    say(f"class model of {len(model.parts)} parts from {len(part_views.views)} views: {out}")


@app.command("study-models")
def study_models(
    out: Annotated[Path, typer.Option(help="Folder for the tables and pictures.", callback=folder_target)],
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """How few primitives serve all parts, and how near learned planes and skeletons are to the truth.

    Writes the tables and pictures of reports/published/models.

    Example: [bold]rescore study-models --out runs/models[/bold]
    """
    from reports.studies.class_models import write_study
    from rescore.studies.class_models import study

    workers = workers_of(engine, address, jobs)
    page = write_study(study(jobs=workers), out, f"rescore study-models --out {out}")
    say(f"class models: {page}")


@app.command("study-views")
def study_views(
    out: Annotated[Path, typer.Option(help="Folder for the tables and pictures.", callback=folder_target)],
    photos: Annotated[int, typer.Option(min=1, help="Photographs of each class and elevation.")] = 72,
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
    engine: Engine = "joblib",
    address: Address = None,
) -> None:
    """How often the class model chooses the right view bin on rendered photographs of test shapes.

    Writes the tables and pictures of reports/published/view_bins: cars from 20 and 5 degrees, chairs from 20.

    Example: [bold]rescore study-views --out runs/view_bins[/bold]
    """
    from reports.studies.view_bins import write_view_study
    from rescore.studies.view_bins import LEARNED_SHAPES, VIEW_STUDIES
    from rescore.studies.view_bins import study_views as study

    study(out, photos, seed, workers_of(engine, address, jobs))
    command = f"rescore study-views --out {out} --photos {photos} --seed {seed}"
    say(f"view bins: {write_view_study(out, list(VIEW_STUDIES), LEARNED_SHAPES, command)}")


def _bins(elevation_deg: float | None) -> "ViewBins":
    import numpy as np

    from recon.view_bins import ViewBins

    return ViewBins() if elevation_deg is None else ViewBins(elevation_rad=float(np.deg2rad(elevation_deg)))


def _rendered_views(
    class_name: str, instances: int, view_bins: str | None, elevation_deg: float | None
) -> "PartViews":
    """Views of the shapes that a class trains on."""
    from datasets_synth.objects.object_classes import object_class, training_views

    chosen = object_class(class_name)
    bins = chosen.bins if elevation_deg is None else _bins(elevation_deg)
    return training_views(chosen, instances, bins, _bin_numbers(view_bins, bins.count))


def _bin_numbers(text: str | None, count: int) -> "set[int] | None":
    """The view bins of an option; None where it was left out."""
    if text is None:
        return None
    numbers = text.split(",")
    if not all(n.strip().isdigit() and int(n) < count for n in numbers):
        raise RescoreError(
            f"--view-bins: expected numbers from 0 to {count - 1} with commas between them, got {text!r}"
        )
    return {int(n) for n in numbers}
