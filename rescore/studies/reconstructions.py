"""Photographs of test shapes of every class, reconstructed, with their errors against the truth."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from datasets_synth.objects.object_classes import (
    ObjectClass,
    SizedShape,
    labelled_views,
    level_views,
    object_class,
)
from datasets_synth.photos.gallery_photos import (
    gallery_photo,
    occluded_basket,
    views_without,
)
from datasets_synth.photos.single_object import ObjectPhoto, ViewBeside, view_beside
from recon.class_model import ClassModel
from recon.errors import Failure
from recon.learning.learn import learn_class_model
from recon.localization.learn_shapes import with_shape_space
from recon.localization.single_plane import single_plane
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.library.likeliest import choose_view
from rescore.library.single_picture import FoundObject, Photo, find_object
from rescore.speech import say
from rescore.studies.instance_accuracy import BoxTruth, InstanceErrors, instance_errors, surface_errors

CLASSES = ("car", "chair", "bicycle", "airplane")
BESIDE_RAD = np.deg2rad([-40.0, -20.0, 20.0, 40.0])
"""Angles from a photograph's view at which pop-ups are judged."""
Pair = tuple[InstanceErrors | Failure, InstanceErrors | Failure]
"""Errors of the class model and of the single plane on one photograph."""


@dataclass(frozen=True, eq=False)
class Exhibit:
    """One photograph and what was made of it."""

    class_name: str
    shape_id: str
    view_bin: int
    photo: Photo
    found: FoundObject | Failure
    beside: tuple[ViewBeside, ...] = ()
    """The truth from beside the photograph, from right to left."""

    @property
    def title(self) -> str:
        """Shape and view bin."""
        return f"{self.shape_id}, bin {self.view_bin}"


@dataclass(frozen=True, eq=False)
class Measured:
    """Errors on one photograph, and whether its view bin was found."""

    given: Pair
    """With the view bin of the truth."""
    right: bool | None
    """Whether the class model chose that view bin; None where it chose none."""
    chosen: Pair
    """With the view bin that it chose."""


@dataclass(frozen=True, eq=False)
class Reconstructions:
    """Everything that was photographed and reconstructed."""

    exhibits: Mapping[tuple[str, int], Exhibit]
    """With the view bin of the truth, by class and view bin."""
    known: Mapping[str, list[Measured]]
    """Errors by class, view bin by view bin."""
    basket: Exhibit
    """With its handle behind a card."""
    handle: str
    """How far off the recovered handle is, in words."""
    held_out: tuple[Exhibit, ...]
    """Other photographs with the view bin of the truth, on which nothing was tried while this was made."""


def study(
    seed: int, bins: int, models: Path | None, wanted: Collection[tuple[str, int]], jobs: Workers = 1
) -> Reconstructions:
    """Photograph and reconstruct test shapes of ``CLASSES``, and the occluded basket.

    Args:
        seed: Of every random choice; the photographs that are held out are those of the next.
        bins: View bins of each class, evenly spread.
        models: Folder where class models are kept from one study to the next; None for none.
        wanted: Classes and view bins that are photographed too.
        jobs: Who reconstructs.
    """
    exhibits: dict[tuple[str, int], Exhibit] = {}
    known: dict[str, list[Measured]] = {}
    held_out: list[Exhibit] = []
    spread = range(0, 12, 12 // bins)
    for name in CLASSES:
        say(f"{name}: learning the class model, {bins} photographs")
        model = learned_model(name, models)
        shown = [(name, b, seed) for b in sorted({*spread} | {b for c, b in wanted if c == name})]
        found = list(map_frames(_reconstructed, shown, model, jobs))
        exhibits |= {(name, exhibit.view_bin): exhibit for exhibit, _ in found}
        known[name] = [measured for _, measured in found]
        held_out += map_frames(_exhibit_alone, [(name, b, seed + 1) for b in spread], model, jobs)
    basket, handle = _basket(learned_model("basket", models), seed)
    return Reconstructions(exhibits, known, basket, handle, tuple(held_out))


def _exhibit(name: str, view_bin: int, model: ClassModel, seed: int) -> tuple[Exhibit, ObjectPhoto]:
    """One photograph reconstructed with the view bin of the truth, and its truth."""
    shape_id, shot = gallery_photo(name, view_bin, seed)
    photo = Photo(shot.rgb, shot.seen_from)
    found = find_object(photo, shot.xyxy_px, view_bin, model)
    beside = tuple(view_beside(shot, float(turn)) for turn in BESIDE_RAD)
    return Exhibit(name, shape_id, view_bin, photo, found, beside), shot


def _exhibit_alone(photographed: tuple[str, int, int], model: ClassModel) -> Exhibit:
    name, view_bin, seed = photographed
    return _exhibit(name, view_bin, model, seed)[0]


def _reconstructed(photographed: tuple[str, int, int], model: ClassModel) -> tuple[Exhibit, Measured]:
    """One photograph by class, view bin and seed, with the view bin of the truth and with the one that the
    class model chooses."""
    name, view_bin, seed = photographed
    exhibit, shot = _exhibit(name, view_bin, model, seed)
    given = _errors(shot, exhibit.found)
    choice = choose_view(shot.rgb, shot.xyxy_px, model)
    if isinstance(choice, Failure):
        return exhibit, Measured(given, None, (choice, choice))
    if choice.view_bin == view_bin:
        return exhibit, Measured(given, True, given)
    again = find_object(exhibit.photo, shot.xyxy_px, choice.view_bin, model)
    return exhibit, Measured(given, False, _errors(shot, again))


def _errors(shot: ObjectPhoto, found: FoundObject | Failure) -> Pair:
    """Errors of the class model and of the single plane on one photograph."""
    if isinstance(found, Failure):
        return found, found
    points = shot.mesh.vertices_m
    truth = BoxTruth(shot.cam_from_object, points.min(axis=0), points.max(axis=0))
    plane = single_plane(found.picture.outline_px, found.picture.ground_line_px, shot.seen_from)
    baseline = plane if isinstance(plane, Failure) else surface_errors(plane, truth, shot.seen_from.ground)
    return instance_errors(found.instance, truth), baseline


def _basket(model: ClassModel, seed: int) -> tuple[Exhibit, str]:
    """The basket with its handle behind a card, and how far off the recovered handle is."""
    shot = occluded_basket(seed)
    photo = Photo(shot.photo.rgb, shot.photo.seen_from)
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


_INSTANCES = 6
_LABEL_SIZE_PX = 160
_THIN_LABEL_SIZE_PX = 320
"""Extent of objects with thin limbs: the leg of a chair is ten pixels wide."""


def learned_model(name: str, models: Path | None) -> ClassModel:
    """The class model of six train shapes in all view bins; kept in a folder where one is given.

    Those of ``CLASSES`` have a shape space of all train shapes.
    """
    path = None if models is None else models / f"{name}.json"
    if path is not None and path.is_file():
        return ClassModel.load(path)
    shown = object_class(name)
    shapes = shown.train[:: max(1, len(shown.train) // _INSTANCES)][:_INSTANCES]
    views = labelled_views(shown, shapes, shown.bins, _LABEL_SIZE_PX)
    model = learn_class_model(views, name, shown.part_names)
    # the basket shows what the planes of section 4.4 tell of a hidden part
    if name in CLASSES:
        model = _with_shapes(model, shown)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        model.save(path)
    # files hold hulls in half precision: a model that was kept gives the same results
    return ClassModel.from_json(model.as_json(), Path(name))


def _with_shapes(model: ClassModel, shown: ObjectClass) -> ClassModel:
    """The class model with a shape space of all train shapes."""
    if all(isinstance(shape, SizedShape) for shape in shown.train):
        return with_shape_space(model, labelled_views(shown, shown.train, shown.bins, _LABEL_SIZE_PX))
    views = labelled_views(shown, shown.train, shown.bins, _THIN_LABEL_SIZE_PX)
    level = level_views(shown, shown.train, _THIN_LABEL_SIZE_PX)
    return with_shape_space(model, replace(views, sizes_m=level.sizes_m), level=level)
