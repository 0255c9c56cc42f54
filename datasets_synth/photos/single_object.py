"""Photographs of one object on the ground, with the true pose, parts and box of the object."""

from dataclasses import dataclass, replace

import numpy as np

from datasets_synth.meshes.materials import TILE_M, plain, surface, tint
from datasets_synth.meshes.mesh import Imaging, Light, Mesh, Placed, Scene
from datasets_synth.meshes.solids import MeshDraft, pose
from datasets_synth.objects.object_classes import ObjectClass, Shape
from datasets_synth.render.render import eye_rays, render_view
from datasets_synth.render.scene_rays import MISS, RayTree
from datasets_synth.render.truth import projected_box
from datasets_synth.street.lighting import ground_irradiance
from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.view_bins import rotation

SETTINGS = ("street", "room")
FILL = 0.8
"""Share of the picture's width or height that an object fills where no distance is given."""
_BRIGHTNESS = 0.95
_NO_SECOND_EYE_M = 0.1
"""Scenes hold a stereo camera; only its left eye is rendered here."""
_GROUNDS = {
    "street": ("asphalt", "slabs", "cobbles", "concrete", "grass"),
    "room": ("planks", "cloth", "slabs"),
}
_WALLS = {"street": ("bricks", "plaster", "concrete", "planks"), "room": ("plaster",)}
_TILE_M = {"street": TILE_M, "room": {"planks": 1.5, "cloth": 0.6, "slabs": 1.2, "plaster": 4.0}}
_LARGE_M = 3.0
"""Radius in metres of a thing above which the textures around it grow with it, so that no repeats show."""


@dataclass(frozen=True)
class Viewpoint:
    """Where the camera stands; it looks at the middle of the object's bounding box and stays level."""

    azimuth_rad: float
    """Counter-clockwise seen from above, from the object's nose, as of view bins; any real angle."""
    elevation_rad: float
    """How far the camera stands above the middle, and looks down."""
    distance_m: float | None = None
    """Distance from the camera to the middle of the object; None brings the object to fill ``FILL`` of the
    picture."""


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
    seen_from: GroundedCamera
    """The camera, and the ground that the object stands on."""
    cam_from_object: FloatArray
    """Shape (4, 4): a rotation and a translation in metres."""
    mesh: Mesh
    """The object, in its own frame."""
    scene: Scene
    """All that was photographed; its world is the object's frame."""


@dataclass(frozen=True, eq=False)
class ViewBeside:
    """What a camera sees that has walked around the object of a photograph."""

    turn_rad: float
    """Angle about the object's middle; positive ones show more of what is on the left in the photograph."""
    cam_from_photo: FloatArray
    """(4, 4) from the camera frame of the photograph to that of this camera."""
    rgb: UInt8Array
    """sRGB, shape (h, w, 3)."""
    mask: BoolArray
    """Where a pixel's centre sees the object, shape (h, w)."""


def view_beside(photo: ObjectPhoto, turn_rad: float) -> ViewBeside:
    """The truth of another view of what was photographed, rendered with the same camera and light."""
    points = photo.mesh.vertices_m
    x, y, z = ((points.min(axis=0) + points.max(axis=0)) / 2).tolist()
    moved = photo.cam_from_object @ pose(x, y, z, turn_rad) @ pose(-x, -y, -z)
    scene = replace(photo.scene, left_from_world=moved)
    view = render_view(scene, np.random.default_rng(0))
    return ViewBeside(turn_rad, moved @ np.linalg.inv(photo.cam_from_object), view.rgb, view.instance == 1)


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
        seen_from=GroundedCamera(camera, ground),
        cam_from_object=cam_from_object,
        mesh=mesh,
        scene=scene,
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


def surroundings(
    mesh: Mesh, azimuth_rad: float, setting: str, rng: np.random.Generator
) -> tuple[tuple[Placed, ...], Light]:
    """Ground at z = 0 and a wall behind the object, in the object frame, and the light on them.

    Args:
        mesh: The object.
        azimuth_rad: Direction of the camera seen from the object.
        setting: "street" or "room".
        rng: Source of every choice.
    """
    # in this frame the camera stands at -y, the wall at +y
    object_from_stage = pose(0, 0, 0, azimuth_rad + np.pi / 2)
    radius = float(np.linalg.norm(mesh.vertices_m[:, :2], axis=1).max())
    far = 60 * max(radius, 1.0)
    kind = str(rng.choice(_GROUNDS[setting]))
    skin = surface(kind, int(rng.integers(4)), tint(rng, 0.7, 1.0))
    tile = _TILE_M[setting][kind] * max(1.0, radius / _LARGE_M)
    ground = MeshDraft()
    start = (float(rng.random()), float(rng.random()))
    ground.panel([(-far, -far, 0), (far, -far, 0), (far, far, 0), (-far, far, 0)], skin, tile, start)
    items = (
        Placed(ground.mesh(), object_from_stage, "ground", "", False),
        Placed(_wall(radius, far, setting, rng), object_from_stage, "wall"),
    )
    return items, _light(azimuth_rad, setting, rng)


def _wall(radius_m: float, far_m: float, setting: str, rng: np.random.Generator) -> Mesh:
    """A wall a step behind the object, turned a little; of a room it goes up out of sight."""
    kind = str(rng.choice(_WALLS[setting]))
    skin = surface(kind, int(rng.integers(4)), _wall_rgb(setting, rng))
    gap = radius_m * float(rng.uniform(1.3, 2.2)) + 0.3
    high = far_m if setting == "room" else max(3.0, 1.5 * radius_m)
    draft = MeshDraft()
    tile = _TILE_M[setting][kind] * max(1.0, radius_m / _LARGE_M)
    draft.panel([(-far_m, 0, 0), (far_m, 0, 0), (far_m, 0, high), (-far_m, 0, high)], skin, tile)
    if setting == "room":
        board = plain((0.5, 0.5, 0.49), 0.05)
        draft.box((0, -0.01, 0.04), (2 * far_m, 0.02, 0.08), board)
    turn = float(rng.uniform(-0.2, 0.2))
    # the wall turns about the point behind the object, so it never comes nearer than cos(0.2) of the gap
    draft.transform(pose(0, 0, 0, turn)[:3, :3], (0, gap, 0))
    return draft.mesh()


def _wall_rgb(setting: str, rng: np.random.Generator) -> tuple[float, float, float]:
    if setting == "street":
        return tint(rng, 0.6, 1.0)
    rgb = np.array([0.9, 0.88, 0.84]) * rng.uniform(0.65, 1.0, 3) ** 0.7
    return (float(rgb[0]), float(rgb[1]), float(rgb[2]))


def _light(azimuth_rad: float, setting: str, rng: np.random.Generator) -> Light:
    """Light from beside or behind the camera."""
    elevation = float(np.radians(rng.uniform(35, 60) if setting == "street" else rng.uniform(50, 70)))
    azimuth = azimuth_rad + float(np.radians(rng.uniform(25, 75))) * float(rng.choice([-1, 1]))
    direction = (
        float(np.cos(elevation) * np.cos(azimuth)),
        float(np.cos(elevation) * np.sin(azimuth)),
        float(np.sin(elevation)),
    )
    if setting == "street":
        return Light(direction, (1.9, 1.85, 1.7), (0.4, 0.55, 0.9), (0.9, 0.95, 1.0), 0.9)
    return Light(direction, (0.75, 0.72, 0.66), (0.85, 0.83, 0.8), (0.9, 0.88, 0.85), 1.0)


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
