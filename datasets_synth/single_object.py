"""Photographs of one object on the ground, with everything that is known of them."""

from dataclasses import dataclass

import numpy as np

from datasets_synth.lighting import ground_irradiance
from datasets_synth.mesh import Imaging, Light, Mesh, Placed, Scene
from datasets_synth.object_classes import ObjectClass, Shape
from datasets_synth.render import eye_rays, render_view
from datasets_synth.scene_rays import MISS, RayTree
from datasets_synth.surroundings import SETTINGS, surroundings
from datasets_synth.truth import projected_box
from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.camera import GroundPlane, PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.view_bins import rotation

FILL = 0.8
"""Share of the picture's width or height that an object fills where no distance is given."""
_BRIGHTNESS = 0.95
_NO_SECOND_EYE_M = 0.1
"""Scenes hold a stereo camera; only its left eye is rendered here."""


@dataclass(frozen=True)
class Viewpoint:
    """Where the camera stands; it looks at the middle of the object's bounding box and stays level."""

    azimuth_rad: float
    """Counter-clockwise seen from above, from the object's nose, as of view bins; any real angle."""
    elevation_rad: float
    """How far the camera stands above the middle, and looks down."""
    distance_m: float | None = None
    """From the camera to the middle; None brings the object to fill ``FILL`` of the picture."""


@dataclass(frozen=True, eq=False)
class ObjectPhoto:
    """A picture of one object and its truth; pictures are (h, w, ...)."""

    rgb: UInt8Array
    """sRGB, shape (h, w, 3), with the noise of a camera."""
    mask: BoolArray
    """Where a pixel's centre sees the object, shape (h, w); false between the spokes of a wheel."""
    part_labels: UInt8Array
    """Shape (h, w), 0 for none. As a person labels: parts one sees through, such as wheels, are solid."""
    depth_m: Float32Array
    """Depth z of what each pixel's centre sees, the surroundings too, shape (h, w); NaN for the sky."""
    xyxy_px: FloatArray
    """Extent of the projected object as pixel edges, shape (4,), clipped to the picture."""
    camera: PinholeCamera
    ground: GroundPlane
    """The ground that the object stands on, in the camera frame."""
    cam_from_object: FloatArray
    """Shape (4, 4): a rotation and a translation in metres."""
    mesh: Mesh
    """The object, in its own frame."""


def photograph(
    object_class: ObjectClass,
    shape: Shape,
    viewpoint: Viewpoint,
    camera: PinholeCamera,
    rng: np.random.Generator,
    setting: str = "street",
) -> ObjectPhoto:
    """A picture of one shape on the ground before a wall; the same seed gives the same bytes.

    Args:
        object_class: Class of the shape.
        shape: What is shown.
        viewpoint: Where the camera stands.
        camera: Any pinhole camera.
        rng: Source of paint, surroundings, light and noise.
        setting: One of ``SETTINGS``: "street" in the sun, "room" in softer light.

    Raises:
        RescoreError: no such setting, a camera below the ground, or no object in the picture.
    """
    if setting not in SETTINGS:
        raise RescoreError(f"setting: expected one of {', '.join(SETTINGS)}, got {setting!r}")
    mesh = object_class.build(shape, rng)
    cam_from_object, ground = _pose(mesh, viewpoint, camera)
    items, light = surroundings(mesh, viewpoint.azimuth_rad, setting, rng)
    object_item = Placed(mesh, np.eye(4), object_class.name, shape.shape_id)
    scene = Scene(
        (object_item, *items),
        light,
        StereoCamera(camera, _NO_SECOND_EYE_M),
        cam_from_object,
        _imaging(light, rng),
    )
    view = render_view(scene, rng)
    mask = view.instance == 1
    box = projected_box(object_item, scene)
    if box is None or not mask.any():
        raise RescoreError(
            f"photograph of {shape.shape_id!r}: expected the object in the picture, it is not; "
            "choose a larger distance or move the principal point into the picture"
        )
    size = np.array([camera.width_px, camera.height_px] * 2, float)
    return ObjectPhoto(
        rgb=view.rgb,
        mask=mask,
        part_labels=_part_labels(object_class.labelled_mesh(mesh), scene),
        depth_m=view.depth_m,
        xyxy_px=np.clip(box, 0, size),
        camera=camera,
        ground=ground,
        cam_from_object=cam_from_object,
        mesh=mesh,
    )


def _pose(mesh: Mesh, viewpoint: Viewpoint, camera: PinholeCamera) -> tuple[FloatArray, GroundPlane]:
    """cam_from_object (4, 4), and the ground under the object in the camera frame."""
    turn = rotation(viewpoint.azimuth_rad, viewpoint.elevation_rad)
    points = mesh.vertices_m.astype(np.float64)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    distance = viewpoint.distance_m
    if distance is None:
        distance = _fitting_distance_m((points - middle) @ turn.T, camera)
    eye = middle - distance * turn[2]
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, -turn @ eye
    return out, GroundPlane(float(eye[2]), viewpoint.elevation_rad)


def _fitting_distance_m(seen_m: FloatArray, camera: PinholeCamera) -> float:
    """The distance at which points (n, 3), in camera axes about the middle, just fill ``FILL``."""
    # f |x| / (distance + z) = FILL * half the picture
    half = FILL / 2 * np.array([camera.width_px, camera.height_px])
    needed = np.abs(seen_m[:, :2]) * [camera.fx_px, camera.fy_px] / half - seen_m[:, 2:]
    return float(needed.max())


def _imaging(light: Light, rng: np.random.Generator) -> Imaging:
    """A fair camera: well exposed, a little blur and noise."""
    gain = _BRIGHTNESS * float(rng.uniform(0.85, 1.1)) / ground_irradiance(light)
    return Imaging((gain, gain), (0.5, 0.5), 0.08, 0.003, 0.008, (0.0, 0.0))


def _part_labels(mesh: Mesh, scene: Scene) -> UInt8Array:
    """Labels (h, w) that the pixel centres of the left eye see of a mesh alone, given in the world frame."""
    height, width = scene.camera.left.height_px, scene.camera.left.width_px
    v, u = np.mgrid[:height, :width].astype(np.float32)
    rays = eye_rays(scene, np.stack([u.ravel(), v.ravel()], axis=1), eye=0)
    face = RayTree(mesh.vertices_m, mesh.faces).cast(rays).face
    return np.where(face == MISS, 0, mesh.face_part[face]).astype(np.uint8).reshape(height, width)
