"""Where the time of ``rescore_frame`` goes, stage by stage: ``python -m tests.profile_stages``.

Each stage is the functions named in ``STAGES``. While one runs, its processor time, wall time and number of
calls of Python functions and of built-in ones are counted; what a stage calls that is another stage counts
there alone. The calls are counted in a run of their own, since counting slows the rest. Asserts nothing.
"""

import argparse
import importlib
import json
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial, wraps
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.presets import synth_preset
from datasets_synth.street.frame_synth import synth_frame
from recon.arrays import FloatArray, UInt8Array
from recon.boxes import xyxy_from_xywh
from recon.camera import GroundPlane, StereoCamera
from recon.stereo import sgbm
from recon.stereo.sgbm import KITTI_SGBM, SgbmConfig
from rescore.data.frames import Frame
from rescore.data.pictures import read_rgb
from rescore.evidence import cues
from rescore.evidence.candidates import Candidates
from rescore.evidence.registration import Registration
from rescore.evidence.settings import stereo_for
from rescore.formats.open import read_dataset
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.library.bundles import default_bundle
from rescore.parallel import one_thread
from tests.conftest import REAL_STREET

BOXES = 15
RUNS = 5

STAGES: dict[str, tuple[str, ...]] = {
    "SGBM": ("recon.stereo.sgbm:disparity_of_scene",),
    "ground": ("rescore.data.frames:estimate_ground",),
    "fits": ("rescore.evidence.instance_fits:fit_instances",),
    "looks": ("recon.view_looks:ViewLooks.log_density",),
    "views of fits": ("rescore.evidence.views:views_of_fits",),
    "choice of views": ("rescore.evidence.views:views_of",),
    "borders against edges": ("recon.reconstruction.view_selection:_border_agreement",),
    "canonical windows": ("recon.reconstruction.canonical_window:canonical_windows",),
    "edges and level set": (
        "recon.reconstruction.segment:edge_indicator",
        "recon.reconstruction.segment:evolve",
    ),
    "outlines": ("recon.reconstruction.canonical_window:zero_level",),
    "shape contexts": ("recon.shapes.shape_matching:shape_contexts",),
    "matching": ("recon.shapes.shape_matching:match",),
    "thin plate": ("recon.reconstruction.part_registration:register_parts",),
    "part labels": ("recon.reconstruction.reconstruct:_part_labels",),
    "ground line": ("recon.reconstruction.ground_line:ground_line",),
    "part planes": ("recon.reconstruction.place_parts:place_instance",),
    "rest of reconstruction": ("rescore.evidence.views:reconstruct_views",),
    "eq. 6": (
        "rescore.evidence.align_depth:measured_depth",
        "rescore.evidence.align_depth:align_instances",
    ),
    **{
        f"cues: {compute.__name__.replace('_', ' ')}": (f"rescore.evidence.cues:{compute.__name__}",)
        for compute in dict.fromkeys(cue.compute for cue in cues.CUES.values())
    },
    "fusion": ("rescore.fusion.rescore_frame:Rescoring.fuse",),
}
"""Functions of each stage, as module:name."""


@dataclass
class Spent:
    """What a stage took in one run."""

    cpu_s: float = 0.0
    wall_s: float = 0.0
    calls: int = 0


@dataclass
class Watch:
    """The running stages, and what each took so far."""

    spent: defaultdict[str, Spent] = field(default_factory=lambda: defaultdict(Spent))
    _running: list[str] = field(default_factory=list)
    _since: tuple[float, float, int] = (0.0, 0.0, 0)
    _calls: int = 0

    def count(self, frame: object, event: str, argument: object) -> None:
        """A function for ``sys.setprofile``."""
        self._calls += event in ("call", "c_call")

    def enter(self, stage: str) -> None:
        """A stage begins inside of those that run."""
        self._book()
        self._running.append(stage)

    def leave(self) -> None:
        """The innermost stage ends."""
        self._book()
        self._running.pop()

    def _book(self) -> None:
        now = (time.process_time(), time.perf_counter(), self._calls)
        if self._running:
            spent = self.spent[self._running[-1]]
            spent.cpu_s += now[0] - self._since[0]
            spent.wall_s += now[1] - self._since[1]
            spent.calls += now[2] - self._since[2]
        self._since = now


def found(name: str) -> tuple[Any, str]:
    """The module or class that holds a function of ``STAGES``, and the function's name there."""
    module, _, path = name.partition(":")
    *owners, last = path.split(".")
    holder = importlib.import_module(module)
    for owner in owners:
        holder = getattr(holder, owner)
    return holder, last


@contextmanager
def watched(watch: Watch) -> Iterator[None]:
    """Every stage reports to a watch, wherever its functions were imported to."""
    undo: list[Callable[[], object]] = []

    def put(holder: Any, name: str, value: object) -> None:
        undo.append(partial(setattr, holder, name, getattr(holder, name)))
        setattr(holder, name, value)

    table = dict(cues.CUES)
    modules = [m for n, m in sys.modules.items() if n.partition(".")[0] in ("recon", "rescore")]
    for stage, names in STAGES.items():
        for holder, name in map(found, names):
            old = getattr(holder, name)
            new = _reporting(old, stage, watch)
            for place in {id(m): m for m in (holder, *modules) if vars(m).get(name) is old}.values():
                put(place, name, new)
            table = {k: replace(c, compute=new) if c.compute is old else c for k, c in table.items()}
    put(cues, "CUES", table)
    try:
        yield
    finally:
        for restore in reversed(undo):
            restore()


def _reporting(work: Callable[..., Any], stage: str, watch: Watch) -> Callable[..., Any]:
    @wraps(work)
    def reporting(*arguments: Any, **named: Any) -> Any:
        watch.enter(stage)
        try:
            return work(*arguments, **named)
        finally:
            watch.leave()

    return reporting


@dataclass(frozen=True)
class Pair:
    """A stereo pair, and boxes in it."""

    left_rgb: UInt8Array
    right_rgb: UInt8Array
    camera: StereoCamera
    ground: GroundPlane | None
    """None where it is to be measured."""
    sgbm: SgbmConfig
    xyxy_px: FloatArray
    azimuth_deg: FloatArray | None = None
    """Where it is known, shape (n,)."""


def rendered(preset: str) -> Pair:
    """The first test frame of a preset, its cars' boxes and as many beside them as it takes."""
    config = synth_preset(preset)
    n_cars = 1 if config.layout == "across" else None
    made = synth_frame(config, 1, "test", 0, n_cars=n_cars, cars=cars_of_splits()["test"], pictures=())
    cars = sorted(made.cars, key=lambda car: -car.visible_share)[:BOXES]
    boxes = np.stack([car.xyxy_px for car in cars])
    azimuths = np.array([car.azimuth_deg for car in cars])
    rng, left = np.random.default_rng(0), made.scene.camera.left
    width = rng.uniform(60, 300, BOXES - len(boxes))
    x, y = rng.uniform(0, left.width_px - width), left.height_px / 2 + rng.uniform(20, 40, len(width))
    beside = np.stack([x, y - width / 5.6, x + width, y + width / 5.6], axis=1)
    up, shift = made.scene.left_from_world[:3, 2], made.scene.left_from_world[:3, 3]
    level = GroundPlane(float(-up @ shift), float(np.arctan2(-up[2], -up[1])), float(np.arcsin(-up[0])))
    return Pair(
        made.render.left_rgb,
        made.render.right_rgb,
        made.scene.camera,
        level if config.layout == "across" else None,
        config.sgbm if config.layout == "across" else KITTI_SGBM,
        np.concatenate([boxes, beside]),
        np.concatenate([azimuths, np.full(len(beside), 90.0)]),
    )


def real() -> Pair:
    """The first pair of ``examples/real_street``, with its boxes and the same ones moved a little."""
    record = read_dataset(REAL_STREET, "car").frames[0]
    assert record.right_path is not None
    assert record.camera is not None
    left, right = (
        read_rgb(path, record.width_px, record.height_px) for path in (record.left_path, record.right_path)
    )
    rows = json.loads((REAL_STREET / "detections.json").read_text())
    xywh = np.array([row["bbox"] for row in rows if row["image_id"] == record.image_id], float)
    boxes = np.resize(xywh, (BOXES, 4))
    moved = np.random.default_rng(0).normal(0, 0.04, (BOXES, 2)) * boxes[:, 2:]
    boxes[len(xywh) :, :2] += moved[len(xywh) :]
    search = stereo_for(record.width_px, [(record.camera, record.disparity_offset_px)])
    return Pair(left, right, record.camera, record.ground, search, xyxy_from_xywh(boxes))


FRAMES: dict[str, Callable[[], Pair]] = {
    "640x480": lambda: rendered("paper"),
    "1242x375": lambda: rendered("streets"),
    "1280x720": real,
}


def ways(pair: Pair) -> dict[str, Callable[[], object]]:
    """From pair to posterior, by how the views are known and by what D looks at."""
    bundle = default_bundle("car")
    model = bundle.class_model
    metric = replace(bundle.evidence_model, registration=Registration.METRIC)
    boxes, n = pair.xyxy_px, len(pair.xyxy_px)

    def work(view: Any, azimuth_deg: FloatArray | None, *, fits: bool) -> Callable[[], object]:
        config = replace(bundle.config, view_bin=view)
        how = Rescoring(config, None if fits else metric)
        given = Candidates(0, boxes, np.linspace(1, 0, n), np.linspace(0.9, 0.1, n), azimuth_deg)

        def run() -> object:
            disparity = sgbm.disparity_of_scene(pair.left_rgb, pair.right_rgb, pair.sgbm)
            frame = Frame(0, pair.left_rgb, disparity, pair.camera, pair.ground).with_stereo_ground()
            return rescore_frame(frame, given, model, how)

        return run

    known = pair.azimuth_deg if pair.azimuth_deg is not None else np.full(n, 90.0)
    return {
        "view known, no instance fitted": work(3, known, fits=False),
        "view chosen by the class model, no instance fitted": work("model", None, fits=False),
        "view of the fitted instance": work("fit", None, fits=True),
    }


def profile(what: str, run: Callable[[], object]) -> Table:
    """The table of one way: medians of some runs, calls of one."""
    watches = [Watch() for _ in range(RUNS + 1)]
    run()
    for watch in watches[1:]:
        with watched(watch):
            _reporting(run, "all else", watch)()
    with watched(watches[0]):
        sys.setprofile(watches[0].count)
        try:
            _reporting(run, "all else", watches[0])()
        finally:
            sys.setprofile(None)
    table = Table(title=what)
    for name in ("stage", "processor, ms", "wall, ms", "calls"):
        table.add_column(name, justify="left" if name == "stage" else "right")
    total = Spent()
    for stage in (*STAGES, "all else"):
        if stage not in watches[0].spent:
            continue
        cpu_s = statistics.median(w.spent[stage].cpu_s for w in watches[1:])
        wall_s = statistics.median(w.spent[stage].wall_s for w in watches[1:])
        calls = watches[0].spent[stage].calls
        table.add_row(stage, f"{cpu_s * 1e3:.2f}", f"{wall_s * 1e3:.2f}", str(calls))
        total = Spent(total.cpu_s + cpu_s, total.wall_s + wall_s, total.calls + calls)
    table.add_row("sum", f"{total.cpu_s * 1e3:.1f}", f"{total.wall_s * 1e3:.1f}", str(total.calls))
    return table


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--frames", nargs="*", choices=FRAMES, default=["640x480", "1242x375"])
    console = Console()
    with one_thread():
        for name in parser.parse_args().frames:
            for way, run in ways(FRAMES[name]()).items():
                console.print(profile(f"{name}, {BOXES} boxes, {way}", run))


if __name__ == "__main__":
    main()
