"""Renders scenes by ray casting: a stereo pair as a camera delivers it, with depth and instances as truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synth.meshes.mesh import Scene
from datasets_synth.render.imaging import expose, rectification_shift
from datasets_synth.render.scene_rays import MISS, Hits, SceneRays
from datasets_synth.render.shade import Shader, build_shader
from recon.arrays import BoolArray, Float32Array, UInt8Array
from recon.pixels import srgb_from_linear

SUBSAMPLES_PX = np.array([(-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)], np.float32)
"""Offsets of the rays that smooth an edge: a rotated grid, best for near-level and upright ones."""
FEW_SUBSAMPLES_PX = np.array([(-1 / 3, -1 / 6), (0, 0), (1 / 3, 1 / 6)], np.float32)
"""Offsets of fewer rays, for pictures half of which are leaves, that is edges."""


@dataclass(frozen=True, eq=False)
class StereoRender:
    """A rendered pair and its truth, all (h, w, ...)."""

    left_rgb: UInt8Array
    """sRGB picture of the left eye, shape (h, w, 3)."""
    right_rgb: UInt8Array
    """sRGB picture of the right eye, shape (h, w, 3)."""
    depth_m: Float32Array
    """Depth z of the left pixel centres, shape (h, w); NaN for the sky."""
    instance: NDArray[np.uint16]
    """What the left pixel centres see, shape (h, w): 0 for the sky, i for ``scene.items[i - 1]``."""


@dataclass(frozen=True, eq=False)
class ViewRender:
    """The rendered picture of the left eye and its truth, all (h, w, ...)."""

    rgb: UInt8Array
    """sRGB picture, shape (h, w, 3)."""
    depth_m: Float32Array
    """Depth z of the pixel centres, shape (h, w); NaN for the sky."""
    instance: NDArray[np.uint16]
    """What the pixel centres see, shape (h, w): 0 for the sky, i for ``scene.items[i - 1]``."""


def render_pair(
    scene: Scene,
    rng: np.random.Generator,
    rays: SceneRays | None = None,
    subsamples_px: Float32Array = SUBSAMPLES_PX,
) -> StereoRender:
    """The stereo pair of a scene with its truth; the same seed gives the same bytes.

    Args:
        scene: What to draw.
        rng: Source of the noise of the camera alone.
        rays: The ray trees of the scene's items; built where they are not given.
        subsamples_px: Offsets (n, 2) of the rays that smooth an edge.
    """
    shader = _shader(scene, rays)
    left = _render_left(scene, shader, rng, subsamples_px)
    right, _ = _render_eye(scene, shader, eye=1, subsamples_px=subsamples_px)
    return StereoRender(left.rgb, expose(right, scene.imaging, 1, rng), left.depth_m, left.instance)


def render_view(scene: Scene, rng: np.random.Generator) -> ViewRender:
    """The left picture of a scene with its truth; the same seed gives the same bytes.

    Args:
        scene: What to draw.
        rng: Source of the noise of the camera alone.
    """
    return _render_left(scene, _shader(scene), rng)


def render_rgb(scene: Scene) -> UInt8Array:
    """The left picture (h, w, 3) sRGB of a perfect camera: exposure and gamma, no blur, no noise."""
    return srgb_from_linear(render_radiance(scene) * np.float32(scene.imaging.exposure[0]))


def render_radiance(scene: Scene) -> Float32Array:
    """Linear radiance (h, w, 3) that reaches the left eye: no camera at all."""
    return _render_eye(scene, _shader(scene), eye=0)[0]


def _shader(scene: Scene, rays: SceneRays | None = None) -> Shader:
    return build_shader(scene.items, scene.light, scene.camera.left.fx_px, rays, scene.grade)


def _render_left(
    scene: Scene, shader: Shader, rng: np.random.Generator, subsamples_px: Float32Array = SUBSAMPLES_PX
) -> ViewRender:
    radiance, hits = _render_eye(scene, shader, eye=0, subsamples_px=subsamples_px)
    shape = radiance.shape[:2]
    return ViewRender(
        rgb=expose(radiance, scene.imaging, 0, rng),
        depth_m=np.where(np.isfinite(hits.t), hits.t, np.nan).astype(np.float32).reshape(shape),
        instance=_instances(hits, shader.rays).reshape(shape),
    )


def _render_eye(
    scene: Scene, shader: Shader, eye: int, subsamples_px: Float32Array = SUBSAMPLES_PX
) -> tuple[Float32Array, Hits]:
    """Linear radiance (h, w, 3) of one eye with smooth edges, and the hits of its pixel centres (h * w)."""
    from datasets_synth.render.picture_loops import mix  # noqa: PLC0415 (half a second to import)

    width, height = scene.camera.left.width_px, scene.camera.left.height_px
    rays = _pixel_rays(scene, np.arange(height * width), np.zeros((1, 2), np.float32), eye)
    hits = shader.rays.cast(rays)
    colour, sunlit = shader.radiance(rays, hits)

    edge = np.flatnonzero(_edges(hits, sunlit, shader.rays, width))
    # the pixel's centre is known already
    extra = subsamples_px[np.any(subsamples_px != 0, axis=1)]
    fine_rays = _pixel_rays(scene, edge, extra, eye)
    fine, _ = shader.radiance(fine_rays, shader.rays.cast(fine_rays))
    mix(edge, fine, len(extra), len(extra) < len(subsamples_px), colour)
    return colour.reshape(height, width, 3), hits


def _pixel_rays(scene: Scene, pixel: NDArray[np.intp], offset_px: Float32Array, eye: int) -> Float32Array:
    """World rays (n * k, 6) of places around pixels (n,), the offsets (k, 2) of one pixel side by side."""
    from datasets_synth.render.picture_loops import pixel_places  # noqa: PLC0415

    uv = np.empty((len(pixel) * len(offset_px), 2), np.float32)
    pixel_places(pixel, scene.camera.left.width_px, offset_px, uv)
    return eye_rays(scene, uv, eye)


def eye_rays(scene: Scene, uv_px: Float32Array, eye: int) -> Float32Array:
    """World rays (n, 6) of pixels (n, 2) of an eye; t along them is depth, since the camera's z is 1.

    Args:
        scene: Its camera and pose.
        uv_px: Pixels, whole numbers at pixel centres.
        eye: 0 for the left, 1 for the right, which carries the rectification error.
    """
    from datasets_synth.render.picture_loops import rays_of_places  # noqa: PLC0415

    camera = scene.camera.left
    if eye:
        uv_px = rectification_shift(uv_px, scene.imaging, camera.width_px, camera.height_px)
    world_from_left = np.linalg.inv(scene.left_from_world)
    origin = world_from_left[:3, 3] + world_from_left[:3, 0] * (scene.camera.baseline_m * eye)
    world_from_pixel = (world_from_left[:3, :3] @ np.linalg.inv(camera.matrix)).astype(np.float32)
    rays = np.empty((len(uv_px), 6), np.float32)
    # written out, since a matrix product with so few columns is slow and its bits may depend on the threads
    rays_of_places(uv_px, origin.astype(np.float32), world_from_pixel, rays)
    return rays


def _instances(hits: Hits, rays: SceneRays) -> NDArray[np.uint16]:
    instance = np.zeros(len(hits.face), np.uint16)
    hit = hits.face != MISS
    instance[hit] = rays.table.item[hits.face[hit]] + 1
    return instance


def _edges(hits: Hits, sunlit: BoolArray, rays: SceneRays, width_px: int) -> BoolArray:
    """Pixels (h * w) whose neighbours show another thing, material, slope, depth or side of a shadow."""
    from datasets_synth.render.picture_loops import face_keys, mark_edges  # noqa: PLC0415

    n, table = len(hits.face), rays.table
    edge = np.zeros(n, np.bool_)
    if (hits.face != MISS).any():
        key = np.empty(n, np.int64)
        face_keys(hits.face, sunlit, table.item, table.material, len(table.materials), key)
        mark_edges(key, hits.normal, hits.t, width_px, np.empty(n, np.float32), edge)
    return edge
