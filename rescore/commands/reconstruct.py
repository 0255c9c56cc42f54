"""The commands that work on one picture and boxes in it: reconstruct, popup."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recon.errors import RescoreError
from rescore.commands.base import AsJson, app, folder_target, print_json
from rescore.speech import say

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from recon.arrays import FloatArray
    from recon.class_model import ClassModel
    from recon.errors import Failure
    from recon.reconstruction.instance import Instance3D
    from rescore.library.single_picture import FoundObject, Photo

Picture = Annotated[Path, typer.Argument(help="Picture that OpenCV reads: PNG, JPEG, ...")]
ClassName = Annotated[str, typer.Option("--class", help="Class of the object; that of the model.")]
Model = Annotated[
    Path | None,
    typer.Option(help="Class model that `rescore learn` wrote. Default: that which comes with the package."),
]
Camera = Annotated[str | None, typer.Option(help="fx,fy,cx,cy in pixels. Default: the report's camera.")]
Calib = Annotated[
    Path | None,
    typer.Option(
        help="Calibration file of any form of docs/own-data.md, or JSON with fx, fy, cx, cy and, if known, "
        "height_m, pitch_rad, roll_rad."
    ),
]
Height = Annotated[float | None, typer.Option(help="Metres of the camera above the ground. Default: 1.5.")]
Pitch = Annotated[
    float | None, typer.Option(min=-89, max=89, help="Degrees that the camera looks down. Default: 0.")
]
ViewBin = Annotated[
    int | None,
    typer.Option(
        "--view-bin",
        help="View bin: 30 degrees each, 0 the front, 3 the left side. Default: the class model chooses.",
    ),
]
BOX_HELP = "Box of the object: left, top, width and height in pixels, x,y,w,h."


@app.command()
def reconstruct(
    picture: Picture,
    box: Annotated[str, typer.Option(help=BOX_HELP)],
    class_name: ClassName,
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for instance.json, object.glb, object.ply, overlay.png.", callback=folder_target
        ),
    ],
    model: Model = None,
    view_bin: ViewBin = None,
    camera: Camera = None,
    calib: Calib = None,
    height: Height = None,
    pitch: Pitch = None,
    as_json: AsJson = False,
) -> None:
    """Reconstruct the object in a box in 3D, with its hidden parts (section 4 of the report).

    Example: [bold]rescore reconstruct street.png --box 40,90,200,80 --class car --model car.json
    --view-bin 3 --out car[/bold]
    """
    from reports.objects.instance_overlay import instance_overlay
    from reports.objects.mesh_files import gltf_from_object, write_glb, write_ply
    from reports.objects.object_mesh import object_layers
    from reports.objects.popup import write_png
    from rescore.files import write_json
    from rescore.library.single_picture import instance_json, load_class, open_photo

    classes = load_class(model, class_name)
    photo = open_photo(picture, camera, calib, height, pitch)
    told, _ = _each_found(photo, [box], [view_bin], classes, say if as_json else typer.echo)
    found, doubt = told[0]
    turn = gltf_from_object(found.instance)
    layers = object_layers(photo.rgb, found, photo.seen_from.camera)
    moved = [(mesh.moved(turn), picture) for mesh, picture in layers]
    write_json(out / "instance.json", instance_json(found.instance, doubt))
    write_glb(out / "object.glb", [(f"{class_name}_{k}", *layer) for k, layer in enumerate(moved)])
    write_ply(out / "object.ply", moved)
    write_png(
        out / "overlay.png",
        instance_overlay(photo.rgb, found.picture, found.instance, photo.seen_from.camera),
    )
    if as_json:
        print_json(instance_json(found.instance, doubt))
    else:
        typer.echo(_table(found.instance))
    say(f"3D object: {out / 'object.glb'}")


@app.command()
def popup(
    picture: Picture,
    box: Annotated[list[str], typer.Option(help=BOX_HELP + " May be repeated.")],
    class_name: ClassName,
    out: Annotated[
        Path, typer.Option(help="Folder for scene.glb, views.png and turntable.gif.", callback=folder_target)
    ],
    model: Model = None,
    view_bin: Annotated[
        list[int] | None,
        typer.Option(
            "--view-bin", help="View bin of each box, or one for all. Default: the class model chooses."
        ),
    ] = None,
    camera: Camera = None,
    calib: Calib = None,
    height: Height = None,
    pitch: Pitch = None,
    as_json: AsJson = False,
) -> None:
    """Make a 3D pop-up scene of a picture: objects, ground and what is behind them (section 7).

    Example: [bold]rescore popup street.png --box 40,90,200,80 --class car --model car.json --view-bin 3
    --out popup[/bold]
    """
    from reports.objects.likeness import source_similarity
    from reports.objects.mesh_files import write_glb
    from reports.objects.popup import in_scene_axes, scene_layers, write_turntable
    from rescore.library.single_picture import instance_json, load_class, open_photo

    classes = load_class(model, class_name)
    photo = open_photo(picture, camera, calib, height, pitch)
    bins: list[int | None] = list(view_bin) if view_bin else [None]
    if len(bins) not in (1, len(box)):
        raise RescoreError(
            f"--view-bin: expected one for all boxes or {len(box)}, one a box, got {len(bins)}; mend them"
        )
    tell = say if as_json else typer.echo
    told, failed = _each_found(photo, box, bins, classes, tell)
    found = [one for one, _ in told]
    layers = scene_layers(photo, found)
    write_glb(out / "scene.glb", in_scene_axes(layers, photo.seen_from.ground))
    write_turntable(out, photo, found, layers)
    likeness = source_similarity(photo, found, layers)
    if as_json:
        objects = [instance_json(one.instance, doubt) for one, doubt in told]
        print_json({"objects": objects, "failed": failed, "structural_similarity": likeness})
    for one in () if as_json else found:
        typer.echo(_table(one.instance))
    alike = f"structural similarity {likeness:.3f} inside the outline"
    tell(f"seen from the picture's camera, where a flat copy has 1: {alike}")
    say(f"3D scene: {out / 'scene.glb'}, turntable: {out / 'turntable.gif'}")


def _each_found(
    photo: "Photo",
    boxes: "Sequence[str]",
    bins: "Sequence[int | None]",
    model: "ClassModel",
    tell: "Callable[[str], None]",
) -> "tuple[list[tuple[FoundObject, str | None]], dict[str, str]]":
    """The objects in boxes with any doubt, and why the other boxes have none, said aloud.

    Raises:
        RescoreError: a text that is no box of the picture, a view bin that the class has not, or no object in
            any box.
    """
    from rescore.library.single_picture import parse_box

    camera = photo.seen_from.camera
    asked = [(text, parse_box(text, camera.width_px, camera.height_px)) for text in boxes]
    told, failed = [], {}
    for i, (text, xyxy) in enumerate(asked):
        found = _found(photo, text, xyxy, bins[i % len(bins)], model, tell)
        if isinstance(found, str):
            failed[text] = found
        else:
            told.append(found)
    if not told and len(boxes) == 1:
        raise RescoreError(failed[boxes[0]])
    for reason in failed.values():
        say(f"{reason}; left out")
    if not told:
        raise RescoreError(f"expected an object in some box, got none in any of {len(boxes)}; mend --box")
    if failed:
        say(f"{len(boxes) - len(told)} of {len(boxes)} boxes failed and are left out of the scene")
    return told, failed


def _found(
    photo: "Photo",
    box: str,
    xyxy_px: "FloatArray",
    view_bin: int | None,
    model: "ClassModel",
    tell: "Callable[[str], None]",
) -> "tuple[FoundObject, str | None] | str":
    """The object in a box and any doubt, said aloud with its view bin; why there is none, in a line."""
    from recon.errors import Failure
    from rescore.library.likeliest import doubt_of
    from rescore.library.single_picture import find_object

    if view_bin is None:
        found = _likeliest(photo, xyxy_px, model, tell)
    else:
        found = find_object(photo, xyxy_px, view_bin, model)
    if isinstance(found, Failure):
        return f"box {box}: {found.reason.value}: {found.detail}"
    if doubt := doubt_of(found, xyxy_px, photo.seen_from.camera):
        tell(f"box {box}: not to be believed: {doubt}")
    return found, doubt


def _likeliest(
    photo: "Photo", xyxy_px: "FloatArray", model: "ClassModel", tell: "Callable[[str], None]"
) -> "FoundObject | Failure":
    """The object from where it is explained best, and that view bin said aloud."""
    from recon.errors import Failure, Reason
    from rescore.library.likeliest import choose_view, find_likeliest

    choice = choose_view(photo.rgb, xyxy_px, model)
    if isinstance(choice, Failure):
        # a box is outside for every bin
        outside = choice.reason is Reason.BOX_OUTSIDE_IMAGE
        advice = "mend --box" if outside else "give --view-bin"
        return Failure(choice.reason, f"{choice.detail}; {advice}")
    found = find_likeliest(photo, xyxy_px, choice, model)
    chosen = choice.view_bin if isinstance(found, Failure) else found.instance.view_bin
    others = ", ".join(f"{b} {choice.probability[b]:.0%}" for b in choice.order[:3] if b != chosen)
    tell(
        f"view bin {chosen} chosen, probability {choice.probability[chosen]:.0%} before shapes are compared"
        f" (others: {others or 'none'}); --view-bin sets another"
    )
    return found


def _table(instance: "Instance3D") -> str:
    """A short table of an instance: size, place, orientation, parts."""
    import math

    length, width, height = instance.size_m
    x, y, z = instance.centroid_m
    rows = [
        (instance.class_name, f"view bin {instance.view_bin}"),
        ("size", f"{length:.2f} x {width:.2f} x {height:.2f} m (length, width, height)"),
        ("distance", f"{instance.distance_m:.2f} m; middle at x {x:.2f}, y {y:.2f}, z {z:.2f} m"),
        (
            "orientation",
            f"azimuth {math.degrees(instance.azimuth_rad):.1f} degrees, "
            f"yaw {math.degrees(instance.yaw_rad):.1f} degrees",
        ),
        (
            "quality",
            f"registration cost {instance.quality.registration_cost:.3f}, "
            f"placed {instance.quality.placed_share:.0%} of the object, "
            f"class model fits to {instance.quality.transform_residual_m:.2f} m",
        ),
    ]
    for part in instance.parts:
        hidden = instance.unplaced.get(part.name, "not in the picture")
        rows.append((part.name, "placed" if part.seen else f"predicted: {hidden}"))
    widest = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{widest}}  {text}" for name, text in rows)
