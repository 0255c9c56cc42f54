"""Sheets of reconstructions: the steps as in figure 5 of the report, pop-ups as in figures 10 and 12."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from recon.arrays import FloatArray, UInt8Array
from recon.camera import PinholeCamera
from recon.errors import Failure
from recon.files import atomic_path
from recon.pixels import sample_bilinear
from reports import palette
from reports.objects.likeness import Likeness, likeness
from reports.objects.mesh_files import BACKGROUND, MeshView, turned_about, write_glb
from reports.objects.object_mesh import object_layers
from reports.objects.popup import close_camera, in_scene_axes, scene_layers
from reports.pages import write_page
from rescore.library.single_picture import FoundObject, Photo
from rescore.studies.instance_accuracy import InstanceErrors
from rescore.studies.reconstructions import BESIDE_RAD, Exhibit, Measured, Reconstructions

Beside = dict[int, list[Likeness]]
"""Likeness of an object to the truth by degrees from the photograph's view."""
_PANEL_PX = (240, 180)
"""Width and height of one picture of a sheet."""
_GAP_PX = 6
_COLOURS = 160
"""Colours of a file; more make it larger than a page wants."""
_OTHER_SIDE_RAD = float(np.deg2rad(40.0))
_TURN_RAD = float(np.deg2rad(30.0))


@dataclass(frozen=True)
class Shown:
    """A picture that was written, for the page."""

    file: str
    caption: str


STEPS = (("car", 2), ("car", 8), ("chair", 1), ("chair", 8), ("bicycle", 3), ("airplane", 8))
"""Class and view bin of what is shown step by step."""
SHEETS = {
    "popup_cars_1": (("car", 1), ("car", 2), ("car", 4)),
    "popup_cars_2": (("car", 7), ("car", 8), ("car", 10)),
    "popup_chairs": (("chair", 1), ("chair", 4), ("chair", 11)),
    "popup_others": (("chair", 8), ("bicycle", 4), ("airplane", 10)),
}
"""Class and view bin of each column of the sheets of pop-ups."""
BESIDE = (("car", 5), ("car", 11), ("chair", 0), ("bicycle", 10))
"""Class and view bin of what is shown from beside the photograph, under the truth."""
FILES = (("car", 5), ("chair", 0))
"""Class and view bin of the pop-ups that are kept as files."""
SHOWN_BINS = frozenset({*STEPS, *BESIDE, *FILES, *(column for sheet in SHEETS.values() for column in sheet)})
"""Class and view bin of everything that is drawn."""
_POOR = 0.5
"""Pop-ups that share less with the truth from beside the photograph are named among the failures."""


def write_reconstructions(study: Reconstructions, out: Path, command: str) -> Path:
    """Write the pictures and README.md of the study to a folder; returns the page."""
    beside = {key: likeness_beside(one) for key, one in study.exhibits.items()}

    def kept(name: str, picture: UInt8Array | None, keys: Sequence[tuple[str, int]]) -> Shown | None:
        captions = [_caption(study.exhibits[key], beside[key]) for key in keys]
        return _kept(out, name, picture, "; ".join(c for c in captions if c))

    shown = []
    for key in STEPS:
        shown.append(kept("steps_{}_{:02d}".format(*key), steps_strip(study.exhibits[key]), [key]))
    for file, columns in SHEETS.items():
        shown.append(kept(file, popup_sheet([study.exhibits[column] for column in columns]), columns))
    for key in BESIDE:
        shown.append(kept("beside_{}_{:02d}".format(*key), beside_sheet(study.exhibits[key]), [key]))
    for key in FILES:
        write_popup(out / f"{key[0]}.glb", study.exhibits[key])
    basket = f"{study.basket.title}. {study.handle}"
    shown.append(_kept(out, "basket", popup_sheet([study.basket]), basket))
    pairs = [(study.exhibits[key], of) for key, of in beside.items()]
    return write_page(out, _page(command, [one for one in shown if one], study, pairs))


def _kept(out: Path, name: str, picture: UInt8Array | None, caption: str) -> Shown | None:
    """A picture, written with its caption; None where there is none."""
    if picture is None:
        return None
    write_small_png(out / f"{name}.png", picture)
    return Shown(f"{name}.png", caption)


def _caption(exhibit: Exhibit, beside: Beside) -> str:
    """Shape, view bin and overlap with the truth from beside the photograph; empty for a failure."""
    shares = (f"{np.mean([o.overlap for o in of]):.0%} at {angle}°" for angle, of in sorted(beside.items()))
    return f"{exhibit.title} (overlap {', '.join(shares)})" if beside else ""


def steps_strip(exhibit: Exhibit) -> UInt8Array | None:
    """Photograph, outline, parts, the object from another side, as in figure 5; None for a failure."""
    if isinstance(exhibit.found, Failure):
        return None
    one, rgb = exhibit.found, exhibit.photo.rgb
    camera = close_camera(exhibit.photo, [one], *_fine())
    panels = [
        _cut(p, exhibit.photo.seen_from.camera, camera) for p in (rgb, _outlined(rgb, one), _tinted(rgb, one))
    ]
    view = MeshView(object_layers(rgb, one, exhibit.photo.seen_from.camera))
    # towards the side that the photograph shows less of
    side = np.sign(_nose_right(one)) * _OTHER_SIDE_RAD
    turn = turned_about(one.instance.centroid_m, exhibit.photo.seen_from.ground.up, float(side))
    panels.append(view.picture(camera, turn)[0])
    return _sheet([[_small(p) for p in panels]])


def popup_sheet(exhibits: Sequence[Exhibit]) -> UInt8Array | None:
    """A column an object: photograph, then two views of its pop-up turned to either side; as in figure 12.

    Failures are left out; None where all failed.
    """
    columns = []
    for exhibit in exhibits:
        if isinstance(exhibit.found, Failure):
            continue
        camera = close_camera(exhibit.photo, [exhibit.found], *_fine())
        layers = scene_layers(exhibit.photo, [exhibit.found])
        view = MeshView([(mesh, rgb) for _, mesh, rgb in layers])
        centre, up = exhibit.found.instance.centroid_m, exhibit.photo.seen_from.ground.up
        turned = [view.picture(camera, turned_about(centre, up, a))[0] for a in (-_TURN_RAD, _TURN_RAD)]
        whole = _cut(exhibit.photo.rgb, exhibit.photo.seen_from.camera, camera)
        columns.append([_small(p) for p in (whole, *turned)])
    return _sheet([list(row) for row in zip(*columns, strict=True)]) if columns else None


def beside_sheet(exhibit: Exhibit) -> UInt8Array | None:
    """The truth from beside the photograph, the pop-up under it; the photograph's own view is in the middle.

    None for a failure.
    """
    if isinstance(exhibit.found, Failure):
        return None
    camera, own = close_camera(exhibit.photo, [exhibit.found], *_fine()), exhibit.photo.seen_from.camera
    view = MeshView([(mesh, rgb) for _, mesh, rgb in scene_layers(exhibit.photo, [exhibit.found])])
    turns = [(v.rgb, v.cam_from_photo) for v in exhibit.beside]
    turns.insert(len(turns) // 2, (exhibit.photo.rgb, np.eye(4)))
    truth = [_small(_cut(rgb, own, camera)) for rgb, _ in turns]
    made = [_small(view.picture(camera, turn)[0]) for _, turn in turns]
    return _sheet([truth, made])


def around_sheet(objects: Sequence[tuple[Photo, FoundObject | Failure, FloatArray]]) -> UInt8Array:
    """A row an object: photograph with its box (4,), then its pop-up from right to left, its own view third.

    Failures have the photograph alone.
    """
    rows = []
    for shot, found, (left, top, right, bottom) in objects:
        own = shot.seen_from.camera
        framed = shot.rgb.copy()
        colour = palette.rgb(palette.VERMILION)
        cv2.rectangle(framed, (round(left), round(top)), (round(right), round(bottom)), colour, 2)
        if isinstance(found, Failure):
            blank = np.full((_PANEL_PX[1], _PANEL_PX[0], 3), 255, np.uint8)
            photo = cv2.resize(framed, _PANEL_PX, interpolation=cv2.INTER_AREA)
            rows.append([np.asarray(photo, np.uint8), *[blank] * (len(BESIDE_RAD) + 1)])
            continue
        camera = close_camera(shot, [found], *_fine())
        view = MeshView([(mesh, rgb) for _, mesh, rgb in scene_layers(shot, [found])])
        centre, up = found.instance.centroid_m, shot.seen_from.ground.up
        angles = sorted([*BESIDE_RAD.tolist(), 0.0])
        made = [view.picture(camera, turned_about(centre, up, a))[0] for a in angles]
        rows.append([_small(p) for p in (_cut(framed, own, camera), *made)])
    return _sheet(rows)


def write_popup(path: Path, exhibit: Exhibit) -> None:
    """Write the pop-up scene of an exhibit as GLB; nothing for a failure."""
    if not isinstance(exhibit.found, Failure):
        layers = scene_layers(exhibit.photo, [exhibit.found])
        write_glb(path, in_scene_axes(layers, exhibit.photo.seen_from.ground))


def likeness_beside(exhibit: Exhibit) -> Beside:
    """Likeness of an exhibit's object to the truth, by degrees from the photograph's view, both sides.

    Empty for a failure.
    """
    out: Beside = {}
    if isinstance(exhibit.found, Failure):
        return out
    camera = exhibit.photo.seen_from.camera
    layers = object_layers(exhibit.photo.rgb, exhibit.found, camera)
    for view in exhibit.beside:
        degrees = abs(round(float(np.rad2deg(view.turn_rad))))
        out.setdefault(degrees, []).append(likeness(layers, camera, view.cam_from_photo, view.rgb, view.mask))
    return out


def beside_table(found: Sequence[tuple[Exhibit, Beside]]) -> str:
    """Markdown table with a row a class: mean likeness from beside the photographs."""
    angles = sorted({a for _, of in found for a in of})
    head = [f"{a}°: {what}" for a in angles for what in ("overlap", "SSIM")]
    lines = ["| | photographs | " + " | ".join(head) + " |", "|---|---:|" + "---:|" * len(head)]
    for name in dict.fromkeys(e.class_name for e, _ in found):
        rows = [of for e, of in found if e.class_name == name]
        good = [of for of in rows if of]
        lost = len(rows) - len(good)
        cells = [name, f"{len(rows)}" + (f" ({lost} failed)" if lost else "")]
        for angle in angles:
            both = [one for of in good for one in of[angle]]
            cells.append(f"{np.mean([o.overlap for o in both]):.1%}")
            cells.append(f"{np.mean([o.similarity for o in both]):.3f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def write_small_png(path: Path, rgb: UInt8Array) -> None:
    """Write a picture (h, w, 3) as PNG with a palette, a third of the size of one with full colours."""
    image = Image.fromarray(rgb).quantize(_COLOURS, dither=Image.Dither.NONE)
    with atomic_path(path) as beside:
        image.save(beside, format="PNG", optimize=True)


def accuracy_table(
    rows: Mapping[str, Sequence[tuple[InstanceErrors | Failure, InstanceErrors | Failure]]],
) -> str:
    """Markdown table with a row a class: mean errors of the class model and of the single plane.

    Args:
        rows: for each class the errors of both methods for each photograph.
    """
    lines = [
        "| | photographs | centroid | length | width | height | orientation "
        "| centroid, single plane | orientation, single plane |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name, pairs in rows.items():
        ours = [a for a, _ in pairs if isinstance(a, InstanceErrors)]
        plane = [b for _, b in pairs if isinstance(b, InstanceErrors)]
        lost = len(pairs) - len(ours)
        cells = [name, f"{len(pairs)}" + (f" ({lost} failed)" if lost else "")]
        cells += _mean_cells(ours, True) + _mean_cells(plane, False)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _mean_cells(errors: Sequence[InstanceErrors], sizes: bool) -> list[str]:
    if not errors:
        return ["-"] * (5 if sizes else 2)
    centroid = f"{np.mean([e.centroid_share for e in errors]):.1%}"
    turned = f"{np.mean([e.orientation_deg for e in errors]):.1f}°"
    if not sizes:
        return [centroid, turned]
    off = np.mean([np.abs(e.size_share) for e in errors if e.size_share is not None], axis=0)
    return [centroid, *(f"{x:.0%}" for x in off), turned]


def _fine() -> tuple[int, int]:
    """Panels are drawn twice as large and shrunk, so that edges are smooth."""
    return 2 * _PANEL_PX[0], 2 * _PANEL_PX[1]


def _small(rgb: UInt8Array) -> UInt8Array:
    return np.asarray(cv2.resize(rgb, _PANEL_PX, interpolation=cv2.INTER_AREA), np.uint8)


def _cut(rgb: UInt8Array, camera: PinholeCamera, to: PinholeCamera) -> UInt8Array:
    """The picture as another camera at the same place with the same axes sees it; plain beyond its border."""
    v, u = np.mgrid[: to.height_px, : to.width_px].astype(float)
    at = camera.project(to.rays(np.stack([u, v], axis=-1)))
    return np.asarray(sample_bilinear(rgb, at, cv2.BORDER_CONSTANT, BACKGROUND))


def _outlined(rgb: UInt8Array, one: FoundObject) -> UInt8Array:
    out = rgb.copy()
    points = np.round(one.picture.outline_px * 16).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(out, [points], True, palette.rgb(palette.VERMILION), 2, cv2.LINE_AA, shift=4)
    return out


def _tinted(rgb: UInt8Array, one: FoundObject) -> UInt8Array:
    """The parts in their colours on a pale picture."""
    out = (0.5 * rgb + 0.5 * 255).astype(np.uint8)
    window = out[one.picture.depth.window]
    for label in (int(k) for k in np.unique(one.picture.part_labels) if k):
        own = one.picture.part_labels == label
        tint = np.array(palette.rgb(palette.part_colour(label)))
        window[own] = (0.3 * rgb[one.picture.depth.window][own] + 0.7 * tint).astype(np.uint8)
    return out


def _nose_right(one: FoundObject) -> float:
    """Positive where the object's nose or tail that faces the camera points to the right of the picture."""
    nose = one.instance.cam_from_object[:3, 0]
    return float(-nose[0] * nose[2]) or 1.0


def _sheet(rows: Sequence[Sequence[UInt8Array]]) -> UInt8Array:
    """Panels in rows with white gaps."""
    width, height = _PANEL_PX
    across, down = len(rows[0]), len(rows)
    shape = (down * (height + _GAP_PX) - _GAP_PX, across * (width + _GAP_PX) - _GAP_PX, 3)
    out = np.full(shape, 255, np.uint8)
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            top, left = i * (height + _GAP_PX), j * (width + _GAP_PX)
            out[top : top + height, left : left + width] = panel
    return out


def _page(
    command: str,
    shown: Sequence[Shown],
    study: Reconstructions,
    beside: Sequence[tuple[Exhibit, Beside]],
) -> str:
    """Pictures with captions, the table and the failures."""
    lines = [
        "# 3D from single photographs",
        "",
        f"Made by `{command}`.",
        "",
        "Photographs are rendered, of test shapes; the class models were learned from part-labelled views",
        "of six other shapes, the shape spaces from views of all training shapes. The box and the",
        "view bin are given from the truth, and so are camera and ground. View bins count 30 degrees each,",
        "counter-clockwise: 0 shows the front, 3 the left side.",
        "",
        "`steps_*`: photograph, outline, parts, the object from another side (figure 5 of the report).",
        "`popup_*` and `basket`: photograph, then the pop-up turned by 30 degrees to either side (figures 10",
        "and 12). `beside_*`: above the truth, below the pop-up, from 40 degrees on one side to 40 on the",
        "other.",
        "",
        "[car.glb](car.glb) and [chair.glb](chair.glb): pop-ups of " + _of(study, FILES) + ".",
        "",
        "## From beside the photograph",
        "",
        "The object's pop-up beside the truth, from cameras that walked around the object by 20 and 40",
        "degrees to either side. Overlap: intersection over union of the two silhouettes. SSIM: structural",
        "similarity where either shows the object, on plain grey. Captions give the overlap",
        "of what they show.",
        "",
        beside_table(beside),
        "The same on photographs of the next seed, of the same shapes in other paint and surroundings. They",
        "are held out: the method was made looking at those above.",
        "",
        beside_table([(e, likeness_beside(e)) for e in study.held_out]),
        "## Pictures",
        "",
    ]
    for one in shown:
        lines += [f"![{one.caption}]({one.file})", "", f"`{one.file}`: {one.caption}", ""]
    lines += [
        "## Against the truth",
        "",
        "View bin given:",
        "",
        accuracy_table({name: [row.given for row in rows] for name, rows in study.known.items()}),
        "View bin chosen by the class model:",
        "",
        accuracy_table({name: [row.chosen for row in rows] for name, rows in study.known.items()}),
        "Right view bins: " + "; ".join(_right_bins(name, rows) for name, rows in study.known.items()) + ".",
        "",
        "Means over the photographs with a reconstruction. The centroid error is in per cent of the largest",
        "true size, sizes are mean absolute errors. The single plane (Hoiem et al., the report's",
        "baseline) has no box; its centroid is that of the surface, its direction is compared with the",
        "object's length.",
        "The direction is that of the fitted shape; where none fits it is the middle of the view bin.",
        "",
        "## Failures",
        "",
        "On photographs of real streets fewer cars hold together from beside. [How many, what fails, with",
        "pictures and a car as GLB](real_cars.md), made by `make published-real-cars`.",
        "",
    ]
    lines += _failures(beside)
    return "\n".join(lines) + "\n"


def _of(study: Reconstructions, which: Sequence[tuple[str, int]]) -> str:
    return " and of ".join(study.exhibits[key].title for key in which)


def _right_bins(name: str, rows: Sequence[Measured]) -> str:
    return f"{name} {sum(row.right is True for row in rows)} of {len(rows)}"


def _failures(beside: Sequence[tuple[Exhibit, Beside]]) -> list[str]:
    """Photographs without a reconstruction, and those whose pop-up is poorly like the truth."""
    lines = [
        f"- {e.class_name} {e.title}: {e.found.reason.value}: {e.found.detail}"
        for e, _ in beside
        if isinstance(e.found, Failure)
    ]
    nearest = [(e, float(np.mean([v.overlap for v in of[min(of)]]))) for e, of in beside if of]
    lines += [
        f"- {e.class_name} {e.title}: overlap from beside only {o:.0%}" for e, o in nearest if o < _POOR
    ]
    return lines or [f"None: every photograph has a pop-up of overlap {_POOR:.0%} or more from beside."]
