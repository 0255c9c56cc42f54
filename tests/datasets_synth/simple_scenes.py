"""Small scenes whose pictures can be worked out by hand."""

import numpy as np

from datasets_synth.meshes.mesh import Imaging, Light, Material, Mesh, Placed, Scene
from recon.camera import PinholeCamera, StereoCamera

CAMERA = StereoCamera(PinholeCamera(200.0, 200.0, 79.5, 59.5, 160, 120), baseline_m=0.5)
CLEAN = Imaging((1.0, 1.0), (0.0, 0.0), 0.0, 0.0, 0.0, (0.0, 0.0))
FLAT_LIGHT = Light((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0), 1.0)
"""No sun, a white sky: an upright or raised surface of albedo a has a radiance between 0.6 a and a."""
WHITE = Material("white", (1.0, 1.0, 1.0))


def unit(*xyz: float) -> tuple[float, float, float]:
    v = np.array(xyz) / np.linalg.norm(xyz)
    return float(v[0]), float(v[1]), float(v[2])


def quad(corners, material=WHITE, uv=((0, 0), (1, 0), (1, 1), (0, 1)), part=0) -> Mesh:
    """Corners bottom left, bottom right, top right, top left as seen from outside."""
    vertices = np.array(corners, np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    normal = np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    normal /= np.linalg.norm(normal)
    return Mesh(
        vertices,
        faces,
        np.tile(normal.astype(np.float32), (2, 3, 1)),
        np.array(uv, np.float32)[faces],
        np.zeros(2, np.int32),
        (material,),
        np.full(2, part, np.uint8),
    )


def joined(*meshes: Mesh) -> Mesh:
    """One mesh of several that share one material."""
    start = np.cumsum([0] + [len(m.vertices_m) for m in meshes[:-1]])
    return Mesh(
        np.concatenate([m.vertices_m for m in meshes]),
        np.concatenate([m.faces + s for m, s in zip(meshes, start, strict=True)]).astype(np.int32),
        np.concatenate([m.corner_normals for m in meshes]),
        np.concatenate([m.corner_uv for m in meshes]),
        np.concatenate([m.face_material for m in meshes]),
        meshes[0].materials,
        np.concatenate([m.face_part for m in meshes]),
    )


SIDES = ("left", "right", "front", "back", "top", "bottom")


def box(length: float, width: float, height: float, material=WHITE, *, parts=(0, 0, 0, 0, 0, 0)) -> Mesh:
    """A box on the ground in the object frame; parts are the labels of SIDES."""
    x, y, z = length / 2, width / 2, height
    faces = (
        [(x, y, 0), (-x, y, 0), (-x, y, z), (x, y, z)],
        [(-x, -y, 0), (x, -y, 0), (x, -y, z), (-x, -y, z)],
        [(x, -y, 0), (x, y, 0), (x, y, z), (x, -y, z)],
        [(-x, y, 0), (-x, -y, 0), (-x, -y, z), (-x, y, z)],
        [(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)],
        [(-x, y, 0), (x, y, 0), (x, -y, 0), (-x, -y, 0)],
    )
    return joined(*(quad(c, material, part=p) for c, p in zip(faces, parts, strict=True)))


def ball(radius: float, material=WHITE, n: int = 128) -> Mesh:
    """A latitude-longitude ball about the origin with exact corner normals."""
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, n + 1), np.linspace(0, 2 * np.pi, 2 * n + 1), indexing="ij"
    )
    normal = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    index = np.arange(normal[..., 0].size).reshape(theta.shape)
    a, b, c, d = (k.ravel() for k in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    normal = normal.reshape(-1, 3).astype(np.float32)
    n_faces = len(faces)
    return Mesh(
        radius * normal,
        faces,
        normal[faces],
        np.zeros((n_faces, 3, 2), np.float32),
        np.zeros(n_faces, np.int32),
        (material,),
        np.zeros(n_faces, np.uint8),
    )


def pose(x: float, y: float, z: float = 0.0, yaw: float = 0.0, scale: float = 1.0) -> np.ndarray:
    """World from object."""
    c, s = np.cos(yaw), np.sin(yaw)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    matrix[:3, 3] = x, y, z
    return matrix


def camera_pose(height_m: float, pitch_rad: float = 0.0) -> np.ndarray:
    """Left camera from world: above the world's origin, looking along +y, pitched down."""
    level = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    c, s = np.cos(pitch_rad), np.sin(pitch_rad)
    rotation = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ level
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ np.array([0, 0, height_m])
    return matrix


def scene(
    *items: Placed, light=FLAT_LIGHT, height_m=1.5, pitch_rad=0.0, imaging=CLEAN, camera=CAMERA
) -> Scene:
    return Scene(items, light, camera, camera_pose(height_m, pitch_rad), imaging)


def wall(y: float, texture=None, *, half_width=20.0, top=15.0, bottom=-10.0, uv_scale=1.0) -> Placed:
    """An upright wall that faces the camera."""
    k = uv_scale
    material = Material("wall", (1.0, 1.0, 1.0), texture)
    mesh = quad(
        [(-half_width, y, bottom), (half_width, y, bottom), (half_width, y, top), (-half_width, y, top)],
        material,
        uv=((0, 0), (k, 0), (k, k), (0, k)),
    )
    return Placed(mesh, np.eye(4), "wall")


def ground(material=WHITE) -> Placed:
    return Placed(
        quad([(-80, -20, 0), (80, -20, 0), (80, 300, 0), (-80, 300, 0)], material),
        np.eye(4),
        "road",
        "",
        False,
    )


def noise_texture(size: int, seed: int = 0) -> np.ndarray:
    """Grey noise of several sizes, (size, size, 3)."""
    rng = np.random.default_rng(seed)
    grey = sum(np.kron(rng.random((size // k, size // k)), np.ones((k, k))) for k in (1, 2, 4, 16)) / 4
    return np.repeat((40 + 200 * grey)[..., None], 3, axis=2).astype(np.uint8)
