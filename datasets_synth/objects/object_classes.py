"""The object classes that can be rendered, each a family of part-labelled shapes; their labelled views."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol, runtime_checkable

import numpy as np
from scipy.spatial import ConvexHull

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.cars.parts import CAR_GROUPS, CAR_PARTS, PART_LABEL
from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.mesh import Mesh
from datasets_synth.objects.airplanes import AIRPLANE_PARTS, airplane_mesh, airplane_shapes
from datasets_synth.objects.baskets import BASKET_PARTS, basket_mesh, basket_shapes
from datasets_synth.objects.bicycles import BICYCLE_PARTS, bicycle_mesh, bicycle_shapes
from datasets_synth.objects.chairs import CHAIR_PARTS, chair_mesh, chair_shapes
from datasets_synth.render.part_render import render_part_labels
from recon.arrays import FloatArray, IntArray, UInt8Array
from recon.errors import RescoreError
from recon.part_views import PartView, PartViews
from recon.view_bins import ELEVATION_RAD, ViewBins


class Shape(Protocol):
    """One shape of a family; its build knows what else it holds."""

    @property
    def shape_id(self) -> str:
        """Name of the shape, unique in its class."""


@runtime_checkable
class SizedShape(Shape, Protocol):
    """A shape whose size is known, as in a car's papers."""

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Length, width without mirrors, and height."""


@dataclass(frozen=True, eq=False)
class ObjectClass:
    """A family of part-labelled shapes. The object frame has x forward, y left, z up, the ground at z = 0."""

    name: str
    part_names: tuple[str, ...]
    """Label i of a face is the part at index i - 1."""
    train: tuple[Shape, ...]
    """Shapes to learn from."""
    test: tuple[Shape, ...]
    """Shapes to evaluate on, none of them in ``train``."""
    build: Callable[[Any, np.random.Generator], Mesh]
    """The mesh of a shape; the generator picks its paint, never its form."""
    elevation_rad: float
    """Elevation from which its parts are seen well: the default of its labelled views."""
    solid_parts: tuple[str, ...] = ()
    """Parts one sees through, like a wheel between its spokes, that a person labels as one region."""
    indoors: bool = False
    """Whether it is also photographed in a room, not on streets alone."""

    def __post_init__(self) -> None:
        both = {s.shape_id for s in self.train} & {s.shape_id for s in self.test}
        if both:
            raise RescoreError(
                f"object class {self.name!r}: train and test must share no shape, both hold {sorted(both)}"
            )

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """All shapes of the class, the shapes of ``train`` first."""
        return self.train + self.test

    @property
    def bins(self) -> ViewBins:
        """12 view bins at the elevation of the class."""
        return ViewBins(elevation_rad=self.elevation_rad)

    def labelled_mesh(self, mesh: Mesh) -> Mesh:
        """The mesh as a person labels it: each solid part is replaced by its convex hull.

        It serves part labels alone; normals, texture coordinates and materials of the hulls are empty.
        """
        labels = [self.part_names.index(name) + 1 for name in self.solid_parts]
        return _with_hulls(mesh, [label for label in labels if (mesh.face_part == label).any()])


def object_class(name: str) -> ObjectClass:
    """The class of a name in ``OBJECT_CLASSES``; its lists are always the same.

    Raises:
        RescoreError: no such class.
    """
    if name not in _MAKERS:
        raise RescoreError(f"object class: expected one of {', '.join(OBJECT_CLASSES)}, got {name!r}")
    return _made(name)


@lru_cache(maxsize=16)
def _made(name: str) -> ObjectClass:
    return _MAKERS[name]()


def labelled_views(
    object_class: ObjectClass, shapes: Sequence[Shape], bins: ViewBins, size_px: int
) -> PartViews:
    """Part-labelled views of shapes in every view bin, shape by shape.

    Args:
        object_class: The class of the shapes.
        shapes: Of the class, or other shapes that its build takes.
        bins: The view bins and their elevation; ``object_class.bins`` suits the class.
        size_px: Extent of each object along its longer side in the picture.
    """
    views = []
    for shape in shapes:
        # the paint is not seen
        mesh = object_class.labelled_mesh(object_class.build(shape, np.random.default_rng(0)))
        for b in range(bins.count):
            labels = render_part_labels(mesh, bins.view_from_object(b), size_px)
            views.append(PartView(b, labels, shape.shape_id))
    sizes = {shape.shape_id: shape.size_m for shape in shapes if isinstance(shape, SizedShape)}
    return PartViews(object_class.part_names, bins, tuple(views), sizes)


def level_views(object_class: ObjectClass, shapes: Sequence[Shape], size_px: int) -> PartViews:
    """Part-labelled views of shapes by level cameras, with sizes measured on their meshes."""
    views = labelled_views(object_class, shapes, ViewBins(elevation_rad=0.0), size_px)
    return replace(views, sizes_m={s.shape_id: _measured(object_class, s) for s in shapes})


def _measured(object_class: ObjectClass, shape: Shape) -> tuple[float, float, float]:
    """Length, width and height of the mesh of a shape."""
    mesh = object_class.build(shape, np.random.default_rng(0))
    length, width, height = np.ptp(mesh.vertices_m, axis=0).tolist()
    return length, width, height


def training_views(
    chosen: ObjectClass, instances: int, bins: ViewBins, wanted: Collection[int] | None = None
) -> PartViews:
    """Part-labelled views of the first ``instances`` shapes that a class trains on, in the bins ``wanted``.

    None wants every bin.
    """
    views = labelled_views(chosen, chosen.train[:instances], bins, 256)
    if wanted is None:
        return views
    return replace(views, views=tuple(v for v in views.views if v.view_bin in wanted))


def _with_hulls(mesh: Mesh, labels: Sequence[int]) -> Mesh:
    """The mesh with the convex hulls of some parts in place of their faces."""
    if not labels:
        return mesh
    keep = ~np.isin(mesh.face_part, labels)
    vertices, faces, parts = [mesh.vertices_m], [mesh.faces[keep]], [mesh.face_part[keep]]
    start = len(mesh.vertices_m)
    for label in labels:
        points = mesh.vertices_m[np.unique(mesh.faces[mesh.face_part == label])]
        hull = _hull_faces(points.astype(np.float64))
        vertices.append(points)
        faces.append((hull + start).astype(np.int32))
        parts.append(np.full(len(hull), label, np.uint8))
        start += len(points)
    n = sum(len(f) for f in faces)
    return Mesh(
        vertices_m=np.concatenate(vertices),
        faces=np.concatenate(faces),
        corner_normals=np.zeros((n, 3, 3), np.float32),
        corner_uv=np.zeros((n, 3, 2), np.float32),
        face_material=np.zeros(n, np.int32),
        materials=mesh.materials,
        face_part=np.concatenate(parts),
    )


def _hull_faces(points_m: FloatArray) -> IntArray:
    """Faces (m, 3) of the convex hull of points (n, 3), counter-clockwise seen from outside."""
    hull = ConvexHull(points_m)
    a, b, c = (points_m[hull.simplices[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    return np.asarray(np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices), np.int64)


def _family(
    name: str,
    part_names: tuple[str, ...],
    shapes: tuple[Shape, ...],
    build: Callable[[Any, np.random.Generator], Mesh],
    elevation_deg: float,
    solid_parts: tuple[str, ...] = (),
) -> ObjectClass:
    """Every second shape is for training, so that both halves see every style."""
    elevation = float(np.deg2rad(elevation_deg))
    return ObjectClass(name, part_names, shapes[::2], shapes[1::2], build, elevation, solid_parts)


def _chair() -> ObjectClass:
    chair = _family("chair", CHAIR_PARTS, chair_shapes(), chair_mesh, 20.0, ("back",))
    return replace(chair, indoors=True)


def _bicycle() -> ObjectClass:
    wheels = ("front_wheel", "rear_wheel")
    return _family("bicycle", BICYCLE_PARTS, bicycle_shapes(), bicycle_mesh, 20.0, wheels)


def _airplane() -> ObjectClass:
    return _family("airplane", AIRPLANE_PARTS, airplane_shapes(), airplane_mesh, 20.0)


def _basket() -> ObjectClass:
    return replace(_family("basket", BASKET_PARTS, basket_shapes(), basket_mesh, 30.0), indoors=True)


def _car() -> ObjectClass:
    cars = cars_of_splits()
    return ObjectClass("car", CAR_PARTS, tuple(cars["train"]), tuple(cars["test"]), _car_mesh, ELEVATION_RAD)


def _car_six_parts() -> ObjectClass:
    car = _car()
    return replace(car, name="car_six_parts", part_names=tuple(CAR_GROUPS), build=_grouped_car_mesh)


def _car_mesh(car: CarModel, rng: np.random.Generator) -> Mesh:
    return car.build(rng)


def _grouped_car_mesh(car: CarModel, rng: np.random.Generator) -> Mesh:
    mesh = car.build(rng)
    return replace(mesh, face_part=_group_labels()[mesh.face_part])


def _group_labels() -> UInt8Array:
    """The group's label, shape (256,), of each label of CAR_PARTS."""
    table = np.zeros(256, np.uint8)
    for label, members in enumerate(CAR_GROUPS.values(), start=1):
        table[[PART_LABEL[name] for name in members]] = label
    return table


_MAKERS: dict[str, Callable[[], ObjectClass]] = {
    "car": _car,
    "car_six_parts": _car_six_parts,
    "chair": _chair,
    "bicycle": _bicycle,
    "airplane": _airplane,
    "basket": _basket,
}
OBJECT_CLASSES = tuple(_MAKERS)
"""Names of all classes."""
FIGURE_1_CLASSES = ("chair", "bicycle", "airplane", "car_six_parts")
"""The classes of figure 1 of the report, with 21 parts together."""
