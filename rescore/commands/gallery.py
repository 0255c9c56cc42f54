"""The command that makes the gallery of reconstructions: gallery."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rescore.commands.base import Seed, app, say

if TYPE_CHECKING:
    from datasets_synth.photos.single_object import ObjectPhoto
    from recon.arrays import UInt8Array
    from recon.class_model import ClassModel
    from recon.errors import Failure
    from reports.studies.reconstructions import Exhibit
    from rescore.library.single_picture import FoundObject
    from rescore.studies.instance_accuracy import InstanceErrors

    Pair = tuple[InstanceErrors | Failure, InstanceErrors | Failure]

CLASSES = ("car", "chair", "bicycle", "airplane")
STEPS = (("car", 2), ("car", 8), ("chair", 1), ("chair", 8), ("bicycle", 3), ("airplane", 8))
"""Class and view bin of what is shown step by step."""
SHEETS = {
    "popup_cars_1": (("car", 1), ("car", 2), ("car", 4)),
    "popup_cars_2": (("car", 7), ("car", 8), ("car", 10)),
    "popup_chairs": (("chair", 1), ("chair", 4), ("chair", 11)),
    "popup_others": (("chair", 8), ("bicycle", 4), ("airplane", 10)),
}
"""Class and view bin of each column of the sheets of pop-ups."""


@dataclass(frozen=True)
class Measured:
    """Errors of the class model and of the single plane on one photograph."""

    given: "Pair"
    """Errors of both with the true view bin."""
    right: bool | None
    """Whether the class model chose the true view bin; None where it chose none."""
    chosen: "Pair"
    """Errors of both with the view bin that the class model chose."""


@app.command()
def gallery(
    out: Annotated[Path, typer.Option(help="Folder for the pictures and README.md.")],
    seed: Seed = 0,
    models: Annotated[
        Path | None, typer.Option(help="Folder where the class models are kept from run to run.")
    ] = None,
    bins: Annotated[int, typer.Option(min=1, max=12, help="View bins of each class in the table.")] = 12,
) -> None:
    """Reconstruct photographs of test shapes of every class, and compare with their truth.

    Example: [bold]rescore gallery --out gallery --models models[/bold]
    """
    from datasets_synth.photos.gallery_photos import gallery_photo, learned_model
    from recon.errors import Failure
    from recon.reconstruction.view_selection import best_view_bin
    from reports.studies.reconstructions import Exhibit, popup_sheet, steps_strip, write_small_png
    from rescore.library.single_picture import Photo, find_object

    wanted = set(STEPS) | {pair for sheet in SHEETS.values() for pair in sheet}
    exhibits: dict[tuple[str, int], Exhibit] = {}
    known: dict[str, list[Measured]] = {}
    for name in CLASSES:
        say(f"{name}: learning the class model, {bins} photographs")
        model = learned_model(name, models)
        known[name] = []
        for view_bin in sorted({*range(0, 12, 12 // bins)} | {b for c, b in wanted if c == name}):
            shape_id, shot = gallery_photo(name, view_bin, seed)
            photo = Photo(shot.rgb, shot.camera, shot.ground)
            found = find_object(photo, shot.xyxy_px, view_bin, model)
            exhibits[name, view_bin] = Exhibit(name, shape_id, view_bin, photo, found)
            choice = best_view_bin(shot.rgb, shot.xyxy_px, model)
            if isinstance(choice, Failure):
                known[name].append(Measured(_errors(shot, found), None, (choice, choice)))
                continue
            again = find_object(photo, shot.xyxy_px, choice.view_bin, model)
            right = choice.view_bin == view_bin
            known[name].append(Measured(_errors(shot, found), right, _errors(shot, again)))
    shown: list[tuple[str, str]] = []

    def keep(file: str, picture: "UInt8Array | None", caption: str) -> None:
        if picture is not None:
            write_small_png(out / f"{file}.png", picture)
            shown.append((f"{file}.png", caption))

    for name, view_bin in STEPS:
        one = exhibits[name, view_bin]
        keep(f"steps_{name}_{view_bin:02d}", steps_strip(one), _caption([one]))
    for file, columns in SHEETS.items():
        members = [exhibits[c] for c in columns]
        keep(file, popup_sheet(members), _caption([m for m in members if not isinstance(m.found, Failure)]))
    basket = _basket(learned_model("basket", models), seed)
    keep("basket", popup_sheet([basket[0]]), f"{_caption([basket[0]])}. {basket[1]}")
    command = f"rescore gallery --out {out} --seed {seed} --bins {bins}"
    _write_readme(out / "README.md", command, shown, list(exhibits.values()), known)
    say(f"gallery: {out / 'README.md'}")


def _right_bins(name: str, rows: list[Measured]) -> str:
    return f"{name} {sum(row.right is True for row in rows)} of {len(rows)}"


def _errors(shot: "ObjectPhoto", found: "FoundObject | Failure") -> "Pair":
    """Errors of the class model and of the single plane on one photograph."""
    from recon.errors import Failure
    from recon.localization.single_plane import single_plane
    from rescore.studies.instance_accuracy import BoxTruth, instance_errors, surface_errors

    if isinstance(found, Failure):
        return found, found
    points = shot.mesh.vertices_m
    truth = BoxTruth(shot.cam_from_object, points.min(axis=0), points.max(axis=0))
    plane = single_plane(found.picture.outline_px, found.picture.ground_line_px, shot.camera, shot.ground)
    baseline = plane if isinstance(plane, Failure) else surface_errors(plane, truth, shot.ground)
    return instance_errors(found.instance, truth), baseline


def _basket(model: "ClassModel", seed: int) -> "tuple[Exhibit, str]":
    """The basket with its handle behind a card, and how far off the recovered handle is."""
    import numpy as np

    from datasets_synth.photos.gallery_photos import occluded_basket, views_without
    from recon.errors import Failure
    from reports.studies.reconstructions import Exhibit
    from rescore.library.single_picture import Photo, find_object

    shot = occluded_basket(seed)
    photo = Photo(shot.photo.rgb, shot.photo.camera, shot.photo.ground)
    found = find_object(photo, shot.xyxy_px, shot.view_bin, views_without(model, shot.handle), shot.card)
    exhibit = Exhibit("basket", shot.shape_id, shot.view_bin, photo, found)
    if isinstance(found, Failure):
        return exhibit, f"No reconstruction: {found.reason.value}."
    handle = [p for p in found.instance.parts if p.label == shot.handle]
    if not handle:
        return exhibit, "The handle was not recovered."
    low, high = handle[0].outline_m.min(axis=0), handle[0].outline_m.max(axis=0)
    off = float(np.linalg.norm((low + high) / 2 - shot.handle_middle_m))
    size = float(np.ptp(shot.photo.mesh.vertices_m, axis=0).max())
    return exhibit, (
        f"Every pixel of the handle is behind the card; the class model puts it {100 * off:.0f} cm from "
        f"where it is (middles of the boxes; the basket is {100 * size:.0f} cm long or high)"
    )


def _caption(exhibits: "list[Exhibit]") -> str:
    return "; ".join(f"{e.title} (SSIM {e.similarity:.3f})" for e in exhibits if e.similarity is not None)


def _write_readme(
    path: Path,
    command: str,
    shown: "list[tuple[str, str]]",
    exhibits: "list[Exhibit]",
    known: dict[str, list[Measured]],
) -> None:
    """Pictures with captions, the table and the failures."""
    from recon.errors import Failure
    from reports.studies.reconstructions import accuracy_table
    from rescore.files import atomic_path

    lines = [
        "# 3D from single photographs",
        "",
        f"Made by `{command}`.",
        "",
        "Photographs are rendered, of test shapes; the class models were learned from part-labelled views",
        "of six other shapes. The box and the view bin are given from the truth, and so are camera and",
        "ground. View bins count 30 degrees each, counter-clockwise: 0 shows the front, 3 the left side.",
        "SSIM compares the pop-up, seen from the photograph's own camera, with the photograph inside the",
        "outline that was found.",
        "",
        "`steps_*`: photograph, outline, parts, the object from another side (figure 5 of the report).",
        "`popup_*` and `basket`: photograph, then the pop-up turned by 30 degrees to either side (figures 10",
        "and 12).",
        "",
    ]
    for file, caption in shown:
        lines += [f"![{caption}]({file})", "", f"`{file}`: {caption}", ""]
    lines += [
        "## Against the truth",
        "",
        "View bin given:",
        "",
        accuracy_table({name: [row.given for row in rows] for name, rows in known.items()}),
        "View bin chosen by the class model:",
        "",
        accuracy_table({name: [row.chosen for row in rows] for name, rows in known.items()}),
        "Right view bins: " + "; ".join(_right_bins(name, rows) for name, rows in known.items()) + ".",
        "",
        "Means over the photographs with a reconstruction. The centroid error is in per cent of the largest",
        "true size, sizes are mean absolute errors. The single plane (Hoiem et al., the report's",
        "baseline) has no box; its centroid is that of the surface, its direction is compared with the",
        "object's length.",
        "Orientation of the class model is that of the view bin: where the bin is given, its error is the",
        "object's turn within the bin.",
        "",
        "## Failures",
        "",
    ]
    failed = [e for e in exhibits if isinstance(e.found, Failure)]
    lines += [
        f"- {e.class_name} {e.title}: {e.found.reason.value}: {e.found.detail}"
        for e in failed
        if isinstance(e.found, Failure)
    ]
    poor = [(e, s) for e in exhibits if (s := e.similarity) is not None and s < _FAITHFUL]
    lines += [f"- {e.class_name} {e.title}: SSIM only {s:.3f}" for e, s in poor]
    if not failed and not poor:
        lines.append(f"None: every photograph has a reconstruction of SSIM {_FAITHFUL:g} or more.")
    with atomic_path(path) as beside:
        beside.write_text("\n".join(lines) + "\n")


_FAITHFUL = 0.9
"""A pop-up less like its photograph is named among the failures."""
