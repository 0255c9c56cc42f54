"""The basket of section 5.2: grasped by its handle, which the camera does not see.

The class model comes from two part-labelled views of one basket. In the photograph a card hides every pixel
of the handle; the body is localised by the report's construction, and section 4.4 says where the handle is.
"""

from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from pydantic import TypeAdapter

from datasets_synth.meshes.mesh import Mesh
from datasets_synth.objects.baskets import BASKET_PARTS, BasketShape, basket_mesh, basket_shapes
from datasets_synth.objects.object_classes import object_class
from datasets_synth.photos.table_scene import (
    SCALE,
    SEEN_FROM,
    Placement,
    photograph,
    place_at_random,
    project_ground,
    visible_mesh,
)
from datasets_synth.render.part_render import render_part_labels
from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.class_model import ClassModel
from recon.errors import Failure
from recon.learning.learn import learn_class_model
from recon.localization.localize import PartsConfig, localize_by_parts
from recon.localization.standing_box import StandingBox, cam_from_ground, turn
from recon.part_views import PartView
from recon.reconstruction.occluded_parts import TransformConfig
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.grasping.act import Record, execute
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.choose import Estimate, Grasp
from rescore.grasping.hands import HANDS, Hand
from rescore.grasping.judge import LIFTED_M, Verdict, judge, refused
from rescore.grasping.plan import Motion, plan_motion
from rescore.grasping.result_file import counted
from rescore.grasping.scene import require_robot
from rescore.grasping.solids import Solid, cut_between, hulls_of
from rescore.grasping.trial import within_reach
from rescore.parallel import one_thread, track
from rescore.results.sweep_file import StudyPart
from rescore.studies.localization.segment import empty_table, segment_table
from rescore.studies.localization.trials import TrialConfig

_BODY = TransformConfig(
    calibrated_ground=True, outline_directions=4, outline_error=0.01, outline_outlier=100.0
)
"""How the outline of the body places the instance: by its box, whose sides are all meant. The class model has
two views, so that its outline in other directions is not the basket's."""
TAUGHT, OTHER = "rectangular_00", "rectangular_01"
"""The basket that the class model is made of, and the one that it has never seen."""
VIEW_BINS = (7, 8)
"""The two views."""
BASKET_SCALE = 0.5
"""Size on the table in units of the basket's."""
HANDLE_OPENING_M = 0.120
"""The hand is opened by this for a handle: its thickness, which an outline on a plane does not tell, and room
for the error of a part that is not seen."""
HANDLE_BELOW_PALM_M = 0.035
"""The top of the handle is to lie this far below the palm."""
MASS_KG = 0.25
_CLEAR_M, _LEAST_M = 0.01, 0.005
_HANDLE = BASKET_PARTS.index("handle") + 1
_VIEW_PX = 240
_BIN_HALF_RAD = float(np.deg2rad(15.0))
_CARD_RGB = (176, 160, 132)
_CARD_MARGIN_PX = 4
_TRIES = 2000


@dataclass(frozen=True)
class TableBasket:
    """A basket as a thing that can be put on the table."""

    shape: BasketShape

    @property
    def shape_id(self) -> str:
        """Name of the shape."""
        return self.shape.shape_id

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Length, width and height with the handle, at the size at which the table's scenes are drawn."""
        grown = BASKET_SCALE / SCALE
        return (self.shape.length * grown, self.shape.width * grown, self.shape.handle_height * grown)

    def build(self, rng: np.random.Generator) -> Mesh:
        """The mesh in a willow of its own, at the same size."""
        mesh = basket_mesh(self.shape, rng)
        return replace(mesh, vertices_m=(mesh.vertices_m * BASKET_SCALE / SCALE).astype(np.float32))

    def solid(self) -> Solid:
        """The basket as a body that can be touched; walls and handle in pieces."""
        mesh = self.build(np.random.default_rng(0))
        pieces: list[FloatArray] = []
        for label in range(1, len(BASKET_PARTS) + 1):
            corners = mesh.vertices_m[mesh.faces[mesh.face_part == label]].astype(float) * SCALE
            if label == _HANDLE:
                # the two rods, each along its arch
                rods = cut_between(corners, 0, np.array([0.0, 0.5, 1.0]))
                pieces += [p for rod in rods for p in cut_between(rod, 1, np.linspace(0.0, 1.0, 13))]
            else:
                axis = int(np.argmax(np.ptp(corners.reshape(-1, 3)[:, :2], axis=0)))
                pieces += cut_between(corners, axis, np.linspace(0.0, 1.0, 6))
        size = np.array(self.size_m) * SCALE
        hulls = hulls_of([p.reshape(-1, 3) for p in pieces])
        return Solid.heavy_below(self.shape_id, hulls, size, MASS_KG)


@dataclass(frozen=True, eq=False)
class HiddenHandle:
    """A photograph of a basket on the table with a card before its handle."""

    placement: Placement
    rgb: UInt8Array
    """Shape (h, w, 3)."""
    card: BoolArray
    """Pixels of the card, shape (h, w)."""
    view_bin: int
    mesh: Mesh
    """The basket as it looks."""


def basket_of(shape_id: str) -> TableBasket:
    """The basket of a shape."""
    return TableBasket(next(s for s in basket_shapes() if s.shape_id == shape_id))


def two_view_model() -> ClassModel:
    """The class model of two part-labelled views of one basket."""
    shown, shape = object_class("basket"), basket_of(TAUGHT).shape
    mesh = shown.labelled_mesh(shown.build(shape, np.random.default_rng(0)))
    views = [
        PartView(b, render_part_labels(mesh, shown.bins.view_from_object(b), _VIEW_PX), shape.shape_id)
        for b in VIEW_BINS
    ]
    return learn_class_model(views, "basket", BASKET_PARTS)


def hidden_handle(basket: TableBasket, number: int, seed: int) -> HiddenHandle:
    """A placement of a basket within reach, seen from one of the two view bins, photographed with a card."""
    rng = np.random.default_rng([seed, number])
    for _ in range(_TRIES):
        placement = place_at_random(basket, rng)
        view_bin = _view_bin(placement.box)
        if within_reach(placement.box) and view_bin is not None:
            break
    else:
        raise AssertionError(f"no place for {basket.shape_id} among {_TRIES}")
    # the photograph draws the willow first
    mesh = visible_mesh(basket, deepcopy(rng))
    rgb = photograph([placement], rng)
    card = _card(placement, mesh, rgb.shape[:2])
    rgb[card] = _CARD_RGB
    return HiddenHandle(placement, rgb, card, view_bin, mesh)


def _view_bin(box: StandingBox) -> int | None:
    """The view bin of ``VIEW_BINS`` from which the camera sees a box; None where it is another."""
    towards = float(np.arctan2(-box.xy_m[1], -box.xy_m[0])) - box.yaw_rad
    bins = object_class("basket").bins
    for view_bin in VIEW_BINS:
        away = (towards - bins.azimuth_rad(view_bin) + np.pi) % (2 * np.pi) - np.pi
        if abs(away) < _BIN_HALF_RAD:
            return view_bin
    return None


def _card(placement: Placement, mesh: Mesh, shape: tuple[int, ...]) -> BoolArray:
    """Pixels (h, w) of a card that hides all of the handle."""
    corners = mesh.vertices_m[np.unique(mesh.faces[mesh.face_part == _HANDLE])].astype(float) * SCALE
    corners[:, :2] = corners[:, :2] @ turn(placement.yaw_rad).T + placement.xy_m
    uv = project_ground(corners)
    low = np.floor(uv.min(axis=0)).astype(int) - _CARD_MARGIN_PX
    high = np.ceil(uv.max(axis=0)).astype(int) + _CARD_MARGIN_PX + 1
    card = np.zeros(shape, bool)
    card[max(low[1], 0) : high[1], max(low[0], 0) : high[0]] = True
    return card


@dataclass(frozen=True, eq=False)
class FoundHandle:
    """Where the basket stands, and where section 4.4 puts its handle."""

    body: StandingBox
    """Box of the body without the handle."""
    along_rad: float
    """Direction of the bar of the handle on the table."""
    top_m: FloatArray
    """Middle of the top of the handle in the ground frame, shape (3,)."""


def find_handle(shot: HiddenHandle, model: ClassModel) -> FoundHandle | Failure:
    """The handle of the basket in a photograph that does not show it, by a class model that has one.

    The view bin is given, as the report assumes it of the detector (section 4.1). What the card hides of the
    body is taken for filled: its outline is convex.
    """
    with one_thread():
        regions = segment_table(shot.rgb, empty_table(TrialConfig().segment))
        if isinstance(regions, Failure):
            return regions
        ring = _convex_ring(np.any([r.mask for r in regions], axis=0) & ~shot.card)
        body = _without_handle(model, shot.view_bin)
        found = localize_by_parts(shot.rgb, ring, body, SEEN_FROM, PartsConfig(transform=_BODY))
    if isinstance(found, Failure):
        return found
    pose = cam_from_ground(SEEN_FROM.ground)
    carried = found.instance.class_to_instance

    def on_table(outline: FloatArray) -> FloatArray:
        return np.asarray((carried.points(outline) - pose[:3, 3]) @ pose[:3, :3])

    handle = on_table(model.part(_HANDLE).outline)
    middle = (handle.min(axis=0) + handle.max(axis=0)) / 2
    top = np.array([*middle[:2], handle[:, 2].max()])
    return FoundHandle(found.box, found.box.yaw_rad + np.pi / 2, top)


def _convex_ring(mask: BoolArray) -> FloatArray:
    """The border (m, 2) of the convex hull of a mask (h, w), a point a pixel."""
    rows, columns = np.nonzero(mask)
    corners = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.float32))[:, 0].astype(float)
    after = np.roll(corners, -1, axis=0)
    steps = np.maximum(np.linalg.norm(after - corners, axis=1).astype(int), 1)
    return np.concatenate(
        [
            a + (b - a) * np.linspace(0, 1, n, endpoint=False)[:, None]
            for a, b, n in zip(corners, after, steps, strict=True)
        ]
    )


def _without_handle(model: ClassModel, view_bin: int) -> ClassModel:
    """The class model of the body alone, seen from one view bin."""
    view = model.view(view_bin)
    labels = np.where(view.labels == _HANDLE, 0, view.labels).astype(np.uint8)
    parts = tuple(p for p in model.parts if p.label != _HANDLE)
    return replace(model, parts=parts, views=(PartView(view_bin, labels, view.instance_id),))


def handle_motion(found: FoundHandle | Failure, hand: Hand, seed: int) -> Motion | Refusal:
    """The motion to a handle, from above across its bar; a refusal where there is none.

    A basket is open: the way avoids its box only below the fingers.
    """
    if isinstance(found, Failure):
        return Refusal(Cause.NOT_LOCALISED, found.detail)
    palm = float(found.top_m[2]) + HANDLE_BELOW_PALM_M
    grasp = Grasp(found.top_m[:2], found.along_rad, palm, HANDLE_OPENING_M)
    below = max(_LEAST_M, palm - hand.lowest_m(HANDLE_OPENING_M) - _CLEAR_M)
    body = StandingBox(found.body.xy_m, found.body.yaw_rad, np.array([*found.body.size_m[:2], below]))
    return plan_motion(Estimate(body), grasp, hand, seed)


class BasketRow(StudyPart):
    """One photograph of one basket."""

    basket: str
    placement: int
    handle_off_mm: float | None
    """Distance of the middle of the handle's top from where it is; None where no basket was found."""
    verdicts: dict[str, Verdict]
    """By hand."""


class BasketResult(StudyPart):
    """The content of basket.json."""

    seed: int
    placements: int
    """Placements of each basket."""
    rows: tuple[BasketRow, ...]


@dataclass(frozen=True, eq=False)
class BasketTrial:
    """One photograph of a basket and what became of it with one hand."""

    shot: HiddenHandle
    record: Record


def basket_study(placements: int, seed: int, jobs: Workers) -> BasketResult:
    """The basket that taught the class model, and another, each at a number of places.

    Raises:
        RescoreError: the packages of the robot are not installed.
    """
    require_robot()
    model = two_view_model()
    wanted = [(b, k) for b in (TAUGHT, OTHER) for k in range(placements)]
    rows = tuple(track(map_frames(_row, wanted, (model, seed), jobs), "basket", len(wanted)))
    return BasketResult(seed=seed, placements=placements, rows=rows)


def _row(wanted: tuple[str, int], shared: tuple[ClassModel, int]) -> BasketRow:
    (basket_id, number), (model, seed) = wanted, shared
    basket = basket_of(basket_id)
    shot = hidden_handle(basket, number, seed)
    found = find_handle(shot, model)
    truth, solid = shot.placement.box, basket.solid()
    verdicts = {}
    for key, hand in HANDS.items():
        motion = handle_motion(found, hand, seed)
        verdicts[key] = (
            refused(motion)
            if isinstance(motion, Refusal)
            else judge(execute(motion, hand, solid, truth), solid)
        )
    top = np.array([*truth.xy_m, truth.size_m[2]])
    off = None if isinstance(found, Failure) else 1000 * float(np.linalg.norm(found.top_m - top))
    return BasketRow(basket=basket_id, placement=number, handle_off_mm=off, verdicts=verdicts)


def basket_trial(
    basket_id: str, number: int, model: ClassModel, seed: int, hand: str
) -> BasketTrial | Refusal:
    """One trial with all that was recorded; a refusal where there was no motion."""
    basket = basket_of(basket_id)
    shot = hidden_handle(basket, number, seed)
    motion = handle_motion(find_handle(shot, model), HANDS[hand], seed)
    if isinstance(motion, Refusal):
        return motion
    return BasketTrial(shot, execute(motion, HANDS[hand], basket.solid(), shot.placement.box))


def basket_table(result: BasketResult) -> str:
    """A Markdown table with a row for each basket and hand.

    *Carried* is lifted and kept aloft, though the handle may hang over fingers of one side alone.
    """
    lines = [
        "| basket | hand | handle off, mm (median) | carried | held | gentle | held, 95 % | gentle, 95 % "
        "| failed for |",
        "|---|---|---:|---:|---:|---:|---:|---:|---|",
    ]
    for basket, name in ((TAUGHT, "the one that taught"), (OTHER, "another")):
        rows = [r for r in result.rows if r.basket == basket]
        offs = [r.handle_off_mm for r in rows if r.handle_off_mm is not None]
        middle = f"{np.median(offs):.0f}" if offs else ""
        for key, hand in HANDS.items():
            verdicts = [r.verdicts[key] for r in rows]
            carried = f"{sum(v.lifted_m >= LIFTED_M for v in verdicts)} of {len(verdicts)}"
            cells = [f"{name} ({basket})", hand.name, middle, carried, *counted(verdicts)]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def write_baskets(path: Path, result: BasketResult) -> None:
    """Write basket.json."""
    write_json(path, result.as_json())


def read_baskets(path: Path) -> BasketResult:
    """The results in a file.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(BasketResult), "a finished `rescore grasp-basket`")
