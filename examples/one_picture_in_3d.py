"""One picture in 3D: an object is rebuilt from one picture by a class model, and written as GLB.

    python examples/one_picture_in_3d.py --out chair.glb
    python examples/one_picture_in_3d.py --out car.glb --picture car.png --box 99,135,196,82 --model car.json

The first learns a class model of chairs from rendered, part-labelled views and photographs a chair that it
was not learned from. The second takes a picture of yours, a box around the object (left, top, width and
height in pixels, drawn tightly) and a class model that `rescore learn` wrote.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from datasets_synth.objects.object_classes import labelled_views, object_class
from datasets_synth.photos.single_object import Viewpoint, photograph
from recon import (
    DEFAULT_GROUND,
    ClassModel,
    Failure,
    GroundedCamera,
    PinholeCamera,
    RescoreError,
    best_view_bin,
    default_camera,
    learn_class_model,
)
from reports.objects.mesh_files import gltf_from_object, write_glb
from reports.objects.object_mesh import object_layers
from rescore import FoundObject, Photo, find_object


def rendered_chair() -> tuple[Photo, np.ndarray, ClassModel]:
    """A photograph of a chair, the box of the chair as edges, and a class model of other chairs."""
    chairs = object_class("chair")
    views = labelled_views(chairs, chairs.train[:2], chairs.bins, size_px=160)
    model = learn_class_model(views, "chair", views.part_names)
    camera = PinholeCamera(560.0, 560.0, 239.5, 179.5, 480, 360)
    viewpoint = Viewpoint(chairs.bins.azimuth_rad(1), chairs.elevation_rad)
    shot = photograph(chairs, chairs.test[0], viewpoint, camera, np.random.default_rng(0), "room")
    return Photo(shot.rgb, shot.seen_from), shot.xyxy_px, model


def own_picture(picture: Path, box: str, model: Path) -> tuple[Photo, np.ndarray, ClassModel]:
    """The picture, box and class model that a user gives. Nothing is known of the camera, so sizes are as
    right as the default one."""
    rgb = np.asarray(Image.open(picture).convert("RGB"))
    left, top, width, height = (float(part) for part in box.split(","))
    seen_from = GroundedCamera(default_camera(rgb.shape[1], rgb.shape[0]), DEFAULT_GROUND)
    edges = np.array([left, top, left + width, top + height])
    return Photo(rgb, seen_from), edges, ClassModel.load(model)


def in_3d(photo: Photo, xyxy_px: np.ndarray, model: ClassModel) -> FoundObject:
    """The object in the box, seen from the view bin that explains it best."""
    view = best_view_bin(photo.rgb, xyxy_px, model)
    found = view if isinstance(view, Failure) else find_object(photo, xyxy_px, view.view_bin, model)
    if isinstance(found, Failure):
        raise RescoreError(f"box: {found.reason.value}: {found.detail}; draw the box tightly")
    return found


def write_object(path: Path, photo: Photo, found: FoundObject) -> None:
    """Write the object with the photograph on it; +Y is up, the origin on the ground below its middle."""
    layers = object_layers(photo.rgb, found, photo.seen_from.camera)
    turn = gltf_from_object(found.instance)
    write_glb(path, [(f"object_{i}", mesh.moved(turn), rgb) for i, (mesh, rgb) in enumerate(layers)])


def main() -> None:
    """Run the example."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--out", type=Path, required=True, help="GLB file to write")
    options.add_argument("--picture", type=Path, help="picture of yours")
    options.add_argument("--box", help="left,top,width,height")
    options.add_argument("--model", type=Path, help="class model of `rescore learn`")
    chosen = options.parse_args()
    if chosen.picture is None:
        photo, xyxy_px, model = rendered_chair()
    else:
        photo, xyxy_px, model = own_picture(chosen.picture, chosen.box, chosen.model)
    found = in_3d(photo, xyxy_px, model)
    write_object(chosen.out, photo, found)
    length, width, height = found.instance.size_m
    seen = sum(part.seen for part in found.instance.parts)
    print(f"{model.class_name}: {length:.2f} m long, {width:.2f} m wide, {height:.2f} m high")
    print(f"{seen} parts from the picture, {len(found.instance.parts) - seen} from the class model")
    print(f"3D object: {chosen.out}")


if __name__ == "__main__":
    main()
