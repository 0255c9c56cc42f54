"""Rendering: a stereo pair with truth and measured disparity, against its ray casts and SGBM alone."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.meshes.mesh import Scene
from datasets_synth.presets import synth_preset
from datasets_synth.render.render import StereoRender, render_pair
from datasets_synth.render.scene_rays import RayTree
from datasets_synth.render.truth import visible_objects
from datasets_synth.street.frame_synth import synth_frame
from recon.stereo.sgbm import compute_disparity
from reports.publishing.bench_file import Row
from tests.bench.scenes import MATCHER, SEED
from tests.bench.timing import Call, paired

SCENES = 4


def rendering() -> list[Row]:
    """A stereo pair with truth and measured disparity, against its ray casts and its SGBM alone."""
    config, cars = synth_preset("demo"), cars_of_splits()["test"]

    def pairs() -> Iterator[tuple[Call, Call]]:
        for i in range(SCENES):
            scene = synth_frame(config, SEED, "test", i, n_cars=1, cars=cars, pictures=()).scene
            first = render_pair(scene, np.random.default_rng(0))
            ours = partial(rendered, scene)
            yield ours, partial(casts_and_matcher, recorded_casts(ours), first)

    return [paired("stereo pair rendered with truth / its ray casts and SGBM", 1.4, pairs())]


def rendered(scene: Scene) -> None:
    """The pair, what is seen in it, and its measured disparity."""
    pair = render_pair(scene, np.random.default_rng(0))
    visible_objects(pair, scene)
    compute_disparity(pair.left_rgb, pair.right_rgb, MATCHER)


def casts_and_matcher(casts: list[Call], pair: StereoRender) -> None:
    """The bare calls."""
    for cast in casts:
        cast()
    compute_disparity(pair.left_rgb, pair.right_rgb, MATCHER)


def recorded_casts(work: Call) -> list[Callable[[], object]]:
    """The bare Open3D call of every ray cast that ``work`` makes, its rays ready."""
    import open3d as o3d  # noqa: PLC0415

    calls: list[Callable[[], object]] = []
    cast, occluded = RayTree.cast, RayTree.occluded

    def tensor(rays):  # type: ignore[no-untyped-def]
        # a copy, since the room for rays may be used again
        return o3d.core.Tensor.from_numpy(np.array(rays, dtype=np.float32))

    def note_cast(self, rays):  # type: ignore[no-untyped-def]
        if self.n_faces and len(rays):
            calls.append(partial(self._scene.cast_rays, tensor(rays), nthreads=1))
        return cast(self, rays)

    def note_occluded(self, rays, t_far=np.inf):  # type: ignore[no-untyped-def]
        if self.n_faces and len(rays):
            calls.append(partial(self._scene.test_occlusions, tensor(rays), tfar=t_far, nthreads=1))
        return occluded(self, rays, t_far)

    RayTree.cast, RayTree.occluded = note_cast, note_occluded  # type: ignore[method-assign]
    try:
        work()
    finally:
        RayTree.cast, RayTree.occluded = cast, occluded  # type: ignore[method-assign]
    return calls
