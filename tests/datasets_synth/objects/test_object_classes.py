from dataclasses import astuple, replace
from functools import lru_cache

import numpy as np
import pytest

from datasets_synth.meshes.mesh import Mesh
from datasets_synth.objects.object_classes import (
    FIGURE_1_CLASSES,
    OBJECT_CLASSES,
    labelled_views,
    object_class,
)
from datasets_synth.render.part_render import render_part_labels
from datasets_synth.render.part_truth import part_truth
from recon.errors import RescoreError
from recon.view_bins import ViewBins

FAMILIES = ("chair", "bicycle", "airplane", "basket")
SIZES_M = {
    # length, width and height: from, to
    "chair": ((0.40, 0.65), (0.38, 0.60), (0.70, 1.10)),
    "bicycle": ((1.55, 1.95), (0.40, 0.80), (0.90, 1.25)),
    "airplane": ((7.0, 50.0), (8.5, 48.0), (2.5, 15.0)),
    "basket": ((0.30, 0.56), (0.22, 0.46), (0.26, 0.60)),
}


@lru_cache(maxsize=64)
def meshes(name: str) -> dict[str, Mesh]:
    """Every shape of a family."""
    family = object_class(name)
    return {s.shape_id: family.build(s, np.random.default_rng(0)) for s in family.shapes}


def same_bytes(a: Mesh, b: Mesh) -> bool:
    arrays = ("vertices_m", "faces", "corner_normals", "corner_uv", "face_material", "face_part")
    return all(getattr(a, n).tobytes() == getattr(b, n).tobytes() for n in arrays)


def test_an_unknown_class_is_answered_with_the_known_ones():
    with pytest.raises(RescoreError, match=r"expected one of car, .*basket, got 'sofa'"):
        object_class("sofa")


def test_figure_1_has_21_parts():
    # chair 6, bicycle 4, airplane 5, car 6
    assert [len(object_class(n).part_names) for n in FIGURE_1_CLASSES] == [6, 4, 5, 6]


@pytest.mark.parametrize("name", OBJECT_CLASSES)
def test_train_and_test_share_no_shape(name):
    chosen = object_class(name)
    ids = [s.shape_id for s in chosen.shapes]
    assert len(ids) == len(set(ids))
    assert min(len(chosen.train), len(chosen.test)) >= 6
    with pytest.raises(RescoreError, match="share no shape"):
        replace(chosen, test=chosen.train[:1])


@pytest.mark.parametrize("name", FAMILIES)
def test_no_two_shapes_have_the_same_measures_and_every_style_is_in_both_halves(name):
    chosen = object_class(name)
    assert len({astuple(s)[2:] for s in chosen.shapes}) == len(chosen.shapes)
    assert {s.style for s in chosen.train} == {s.style for s in chosen.test}


@pytest.mark.parametrize("name", FAMILIES)
def test_objects_stand_on_the_origin_at_real_sizes_with_every_part(name):
    labels = set(range(1, len(object_class(name).part_names) + 1))
    for mesh in meshes(name).values():
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        assert (low + high)[:2] == pytest.approx([0, 0], abs=1e-4)
        assert low[2] == pytest.approx(0, abs=1e-5)
        for extent, (least, most) in zip(high - low, SIZES_M[name], strict=True):
            assert least < extent < most
        assert set(np.unique(mesh.face_part).tolist()) == labels


@pytest.mark.parametrize("name", FAMILIES)
def test_left_is_at_positive_y_and_front_at_positive_x(name):
    part_names = object_class(name).part_names
    for mesh in meshes(name).values():
        for label, truth in part_truth(mesh).items():
            part = part_names[label - 1]
            x, y, _ = truth.centroid_m
            assert y > 0.05 if "left" in part else y < -0.05 if "right" in part else abs(y) < 0.05
            if "front" in part or part == "handlebar":
                assert x > 0.03
            if "rear" in part or part in ("back", "tail_fin", "tailplane"):
                assert x < -0.03


@pytest.mark.parametrize(
    ("name", "left", "right"),
    [
        ("chair", "front_left_leg", "front_right_leg"),
        ("airplane", "left_wing", "right_wing"),
        ("basket", "left_side", "right_side"),
    ],
)
def test_left_parts_mirror_right_ones(name, left, right):
    label = {part: i for i, part in enumerate(object_class(name).part_names, 1)}
    for mesh in meshes(name).values():
        truth = part_truth(mesh)
        a, b = truth[label[left]], truth[label[right]]
        assert a.centroid_m == pytest.approx(b.centroid_m * [1, -1, 1], rel=1e-2, abs=2e-3)
        assert a.spread_m == pytest.approx(b.spread_m, rel=1e-2)


def test_the_planes_of_parts_lie_as_a_person_expects():
    """The axis that each planar part is nearest to: 0 along x, 1 along y, 2 up."""
    expected = {
        "chair": {"seat": 2, "back": 0},
        "bicycle": {"front_wheel": 1, "rear_wheel": 1, "frame": 1},
        "airplane": {"left_wing": 2, "right_wing": 2, "tail_fin": 1, "tailplane": 2},
        "basket": {
            "front_side": 0,
            "rear_side": 0,
            "left_side": 1,
            "right_side": 1,
            "bottom": 2,
            "handle": 0,
        },
    }
    for name, axes in expected.items():
        chosen = object_class(name)
        for mesh in meshes(name).values():
            truth = part_truth(chosen.labelled_mesh(mesh))
            for part, axis in axes.items():
                found = truth[chosen.part_names.index(part) + 1]
                assert abs(found.normal[axis]) > 0.85, (name, part)
                assert not found.is_elongated


def test_legs_and_fuselages_are_elongated():
    for name, word in (("chair", "leg"), ("airplane", "fuselage")):
        names = object_class(name).part_names
        for mesh in meshes(name).values():
            found = part_truth(mesh)
            assert all(found[i].is_elongated for i, part in enumerate(names, 1) if word in part)


@pytest.mark.parametrize("name", FAMILIES)
def test_the_seed_decides_the_paint_and_nothing_else(name):
    chosen = object_class(name)
    shape = chosen.test[0]
    first = meshes(name)[shape.shape_id]
    again = chosen.build(shape, np.random.default_rng(0))
    assert same_bytes(first, again)
    assert [(m.name, m.rgb) for m in first.materials] == [(m.name, m.rgb) for m in again.materials]
    others = [chosen.build(shape, np.random.default_rng(seed)) for seed in (1, 2, 3)]
    assert all(m.vertices_m.tobytes() == first.vertices_m.tobytes() for m in others)
    assert any([m.rgb for m in o.materials] != [m.rgb for m in first.materials] for o in others)


@pytest.mark.parametrize("name", ["chair", "bicycle", "airplane", "basket", "car_six_parts"])
def test_views_show_every_part_from_somewhere(name):
    chosen = object_class(name)
    views = labelled_views(chosen, chosen.train[:1], chosen.bins, 100)
    assert [v.view_bin for v in views.views] == list(range(12))
    assert {v.instance_id for v in views.views} == {chosen.train[0].shape_id}
    assert views.bins.elevation_rad == chosen.elevation_rad
    seen = set().union(*(np.unique(v.labels).tolist() for v in views.views))
    assert seen == set(range(len(chosen.part_names) + 1))
    assert max(v.labels.shape[1] for v in views.views) <= 108


def test_views_of_other_bins_are_those_of_their_azimuth():
    chosen = object_class("chair")
    few = labelled_views(chosen, chosen.train[:1], ViewBins(4, 0.4), 60).views
    many = labelled_views(chosen, chosen.train[:1], ViewBins(12, 0.4), 60).views
    for b in range(4):
        assert np.array_equal(few[b].labels, many[3 * b].labels)


def test_wheels_are_labelled_as_discs_though_one_sees_through_them():
    chosen = object_class("bicycle")
    mesh = next(iter(meshes("bicycle").values()))
    level = ViewBins(12, 0.0).view_from_object(3)
    front = chosen.part_names.index("front_wheel") + 1
    covered = []
    for labels in (
        render_part_labels(mesh, level, 200),
        render_part_labels(chosen.labelled_mesh(mesh), level, 200),
    ):
        wheel = labels == front
        rows, cols = np.nonzero(wheel)
        covered.append(wheel.sum() / (np.ptp(rows) + 1) / (np.ptp(cols) + 1))
    # a disc fills pi / 4 of its box, less what the fork and the mudguard hide
    assert covered[1] == pytest.approx(np.pi / 4, abs=0.06)
    assert covered[0] < 0.45


def test_hulls_are_closed_and_face_outwards():
    chosen = object_class("chair")
    mesh = chosen.labelled_mesh(meshes("chair")["slatted_00"])
    back = mesh.faces[mesh.face_part == chosen.part_names.index("back") + 1]
    p = mesh.vertices_m[back].astype(float)
    flat = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert flat.sum(axis=0) == pytest.approx([0, 0, 0], abs=1e-9)
    middle = p.mean(axis=(0, 1))
    assert (np.einsum("ij,ij->i", flat, p[:, 0] - middle) > -1e-9).all()


def test_the_six_parts_of_a_car_are_those_of_its_fifteen():
    car, six = object_class("car"), object_class("car_six_parts")
    fine = car.build(car.train[0], np.random.default_rng(0)).face_part
    coarse = six.build(six.train[0], np.random.default_rng(0)).face_part
    assert np.array_equal(fine > 0, coarse > 0)
    # each of the fifteen lies in exactly one of the six
    assert len(np.unique(np.stack([fine, coarse]), axis=1).T) == len(np.unique(fine))
