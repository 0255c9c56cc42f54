"""Pop-ups of real cars: ``python -m reports.publishing.real_cars STREET FOLDER COMMAND``.

STREET is ``examples/real_street``. Each box of a large vehicle is reconstructed by the class model that comes
with the package. What comes out is drawn from the photograph's view and from beside it, with a page that says
how well each shape goes with its picture; one object is kept as a file.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recon.arrays import FloatArray
from recon.camera import DEFAULT_GROUND, GroundedCamera
from recon.class_model import ClassModel
from recon.errors import Failure, RescoreError
from recon.files import atomic_path
from recon.stereo.sgbm import SgbmConfig
from reports.objects.mesh_files import gltf_from_object, write_glb
from reports.objects.object_mesh import object_layers
from reports.studies.reconstructions import around_sheet, write_small_png
from reports.templating import render
from rescore.data.frames import FrameRecord, load_frame
from rescore.files import read_json
from rescore.formats.labels import ClassMap
from rescore.formats.open import read_dataset
from rescore.library.likeliest import choose_view, doubt_of, find_likeliest
from rescore.library.single_picture import FoundObject, Photo, load_class

LEAST_PX = 90.0
"""Lower boxes show too little of a car."""
LEAST_SCORE = 0.9
"""Boxes of lower scores are on roads, lamps and parts of cars."""
KEPT = 5
"""Number, from 0 on, of the object that is kept as a file."""


@dataclass(frozen=True, eq=False)
class RealCar:
    """One box of a photograph and what was made of it."""

    shows: str
    """What a person sees in the box."""
    photo: Photo
    xyxy_px: FloatArray
    """Pixel edges, shape (4,)."""
    found: FoundObject | Failure


def publish_real_cars(street: Path, folder: Path, command: str) -> Path:
    """Draw pop-ups of the cars of a street into a folder, with a page that shows them; returns the page.

    Args:
        street: ``examples/real_street``, or another data set with ``detections.json`` beside it.
        folder: where to publish; made where it is missing.
        command: what makes it, for the page.

    Raises:
        RescoreError: no such data set, or fewer large boxes than are needed.
    """
    model = load_class(None, "car")
    boxes = large_boxes(read_json(street / "detections.json", "detections"))
    if len(boxes) <= KEPT:
        raise RescoreError(
            f"{street}: expected {KEPT + 1} boxes of score {LEAST_SCORE:g} and {LEAST_PX:g} pixels height, "
            f"got {len(boxes)}; take the example's"
        )
    data = read_dataset(street, "car", ClassMap.of("car", (), of_several=True))
    photos = {r.image_id: _photo(r) for r in data.frames if r.image_id in {b["image_id"] for b in boxes}}
    shown = [_real_car(photos[b["image_id"]], b, model) for b in boxes]
    folder.mkdir(parents=True, exist_ok=True)
    write_small_png(folder / "real_cars.png", around_sheet([(c.photo, c.found, c.xyxy_px) for c in shown]))
    _write_object(folder / "real_car.glb", shown[KEPT])
    rows = [(c.shows, *_words(c)) for c in shown]
    text = render("reports.publishing", "real_cars_page.md.j2", command=command, rows=rows, kept=KEPT + 1)
    page = folder / "real_cars.md"
    with atomic_path(page) as beside:
        beside.write_text(text + "\n", encoding="utf-8")
    return page


def large_boxes(detections: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The detections that are large and sure enough, in their order."""
    return [d for d in detections if d["score"] >= LEAST_SCORE and d["bbox"][3] >= LEAST_PX]


def _photo(record: FrameRecord) -> Photo:
    """The left picture of a frame with the ground of its disparity; the default where that is not trusted."""
    frame = load_frame(record, SgbmConfig()).with_stereo_ground()
    if frame.camera is None:
        raise RescoreError(f"{record.left_path}: expected a calibrated pair, got no camera; add calib.yaml")
    return Photo(frame.left_rgb, GroundedCamera(frame.camera.left, frame.ground or DEFAULT_GROUND))


def _real_car(photo: Photo, box: dict[str, Any], model: ClassModel) -> RealCar:
    x, y, w, h = box["bbox"]
    xyxy_px = np.array([x, y, x + w, y + h])
    choice = choose_view(photo.rgb, xyxy_px, model)
    found = choice if isinstance(choice, Failure) else find_likeliest(photo, xyxy_px, choice, model)
    return RealCar(str(box.get("shows", "car")), photo, xyxy_px, found)


def _write_object(path: Path, car: RealCar) -> None:
    """Write the object alone, without its street, as GLB; nothing for a failure."""
    if not isinstance(car.found, Failure):
        turn = gltf_from_object(car.found.instance)
        layers = object_layers(car.photo.rgb, car.found, car.photo.seen_from.camera)
        write_glb(path, [(f"car_{k}", mesh.moved(turn), rgb) for k, (mesh, rgb) in enumerate(layers)])


def _words(car: RealCar) -> tuple[str, str, str]:
    """View bin, agreement and doubt of a car, in words."""
    found = car.found
    if isinstance(found, Failure):
        return "-", "-", f"{found.reason.value}: {found.detail}"
    doubt = doubt_of(found, car.xyxy_px, car.photo.seen_from.camera) or "none"
    agreement = "-" if found.agreement is None else f"{found.agreement.overlap:.0%}"
    return str(found.instance.view_bin), agreement, doubt


if __name__ == "__main__":
    print(publish_real_cars(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
