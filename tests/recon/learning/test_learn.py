"""Learning: skeleton and planes of a known car come back from labelled views."""

import numpy as np
import pytest

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.learning.learn import LearnConfig, learn_class_model, part_costs
from recon.learning.primitives import lift, primitive_normals
from recon.learning.structure import solve_structure
from recon.part_views import PartView, PartViews
from recon.view_bins import ViewBins
from tests.exact_primitives import cross_view_transforms, exact_library
from tests.recon.box_car import PART_NAMES, box_car, centroid_of, labelled_view, normal_of

BINS = ViewBins(12, np.deg2rad(10))
LENGTH_M = 4.4


def learned(view_bins: list[int], bins: ViewBins = BINS) -> ClassModel:
    views = [labelled_view(box_car(), b, bins) for b in view_bins]
    return learn_class_model(views, "car", PART_NAMES, LearnConfig(bins=bins), exact_library(bins))


def errors(model: ClassModel) -> tuple[dict[str, float], dict[str, float]]:
    """Angle of each normal in degrees; of each centroid its distance in car lengths, best shift and scale."""
    car = box_car()
    parts = [p for p in model.parts if p.view_count > 1]
    mine = np.array([p.centroid for p in parts])
    true = np.array([centroid_of(car[model.part_names[p.label - 1]]) for p in parts])
    a, b = mine - mine.mean(axis=0), true - true.mean(axis=0)
    scale = (a * b).sum() / (a * a).sum()
    names = [model.part_names[p.label - 1] for p in parts]
    angles = {
        n: float(np.rad2deg(np.arccos(np.clip(p.plane[:3] @ normal_of(car[n]), -1, 1))))
        for n, p in zip(names, parts, strict=True)
    }
    return angles, dict(zip(names, np.linalg.norm(scale * a - b, axis=1) / LENGTH_M, strict=True))


@pytest.mark.parametrize("view_bins", [[1, 2], [2, 4], [10, 1]])
def test_two_views_suffice(view_bins: list[int]) -> None:
    angles, centroids = errors(learned(view_bins))
    assert len(angles) >= 4
    assert np.median(list(angles.values())) < 10
    assert np.median(list(centroids.values())) < 0.05
    assert max(centroids.values()) < 0.10


def test_all_views_give_every_part() -> None:
    angles, centroids = errors(learned(list(range(12))))
    assert set(angles) == set(PART_NAMES)
    assert max(angles.values()) < 10
    assert max(centroids.values()) < 0.05


def test_a_part_of_one_view_faces_it_and_says_so() -> None:
    model = learned([2, 4])
    front = model.part(PART_NAMES.index("front") + 1)
    assert (front.view_count, front.primitive) == (1, -1)
    # bin 2 is seen from azimuth 60 degrees
    np.testing.assert_allclose(front.plane[:3], [0.5, np.sqrt(3) / 2, 0.0], atol=1e-9)
    assert np.isfinite(front.centroid).all()


def test_planes_pass_through_their_centroids_and_units_are_those_of_the_length() -> None:
    model = learned([1, 2, 4])
    for part in model.parts:
        assert part.plane @ np.append(part.centroid, 1.0) == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(part.outline @ part.plane[:3] + part.plane[3], 0.0, atol=1e-9)
    assert model.extents[0] == pytest.approx(1.0)
    np.testing.assert_allclose(np.mean([p.centroid for p in model.parts], axis=0), 0.0, atol=1e-9)


def test_learning_is_deterministic() -> None:
    a, b = learned([1, 2]), learned([1, 2])
    for p, q in zip(a.parts, b.parts, strict=True):
        np.testing.assert_array_equal(p.plane, q.plane)
        np.testing.assert_array_equal(p.outline, q.outline)


def test_canonical_view_is_the_medoid() -> None:
    odd = labelled_view(box_car(height=2.6), 3, BINS, instance_id="odd")
    same = [labelled_view(box_car(length=4.4 + d), 3, BINS, instance_id=f"same{d}") for d in (0.0, 0.02)]
    pair = labelled_view(box_car(), 2, BINS, instance_id="same0.0")
    model = learn_class_model(
        [odd, *same, pair], "car", PART_NAMES, LearnConfig(bins=BINS), exact_library(BINS)
    )
    assert model.view(3).instance_id.startswith("same")
    assert [v.view_bin for v in model.views] == [2, 3]


def test_too_few_views() -> None:
    one = labelled_view(box_car(), 1, BINS)
    with pytest.raises(
        RescoreError, match="at least two views of one instance from different bins, got 1 views"
    ):
        learn_class_model([one], "car", PART_NAMES)
    with pytest.raises(RescoreError, match="at least two views of one instance"):
        learn_class_model([one, one], "car", PART_NAMES)
    with pytest.raises(RescoreError, match="at least two views of one instance"):
        learn_class_model([one, labelled_view(box_car(), 2, BINS, instance_id="other")], "car", PART_NAMES)


def test_opposite_views_share_no_part() -> None:
    bins = ViewBins(12, 0.0)
    views = [labelled_view(box_car(), b, bins) for b in (3, 9)]
    with pytest.raises(RescoreError, match="at least two parts that two views show, got 0"):
        learn_class_model(views, "car", PART_NAMES, LearnConfig(bins=bins), exact_library(bins))


def test_labels_without_a_name() -> None:
    with pytest.raises(RescoreError, match="expected labels 0 to 3"):
        learn_class_model([labelled_view(box_car(), b, BINS) for b in (1, 2)], "car", PART_NAMES[:3])


def test_a_centroid_with_little_weight_counts_little() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(8, 3)) / 3
    points -= points.mean(axis=0)
    rotation = np.stack([BINS.view_from_object(b) for b in (0, 1, 2, 3, 4)])
    uv = projected(points, rotation, np.ones(5), np.zeros((5, 2)))
    uv[1, 2] += 0.2
    weight = np.ones(uv.shape[:2])
    error = {}
    for w in (1.0, 0.1, 1e-9):
        weight[1, 2] = w
        error[w] = float(np.abs(solve_structure(uv, rotation, weight).points - points).max())
    assert error[1e-9] < 1e-6 < error[0.1] < 0.5 * error[1.0]


def test_a_library_of_other_view_bins_is_refused() -> None:
    views = [labelled_view(box_car(), b, BINS) for b in (1, 2)]
    with pytest.raises(RescoreError, match="learn the primitives for these view bins"):
        learn_class_model(
            views, "car", PART_NAMES, LearnConfig(bins=BINS), exact_library(ViewBins(12, np.deg2rad(20)))
        )


def test_costs_of_primitives_single_out_the_true_plane() -> None:
    views = PartViews(PART_NAMES, BINS, tuple(labelled_view(box_car(), b, BINS) for b in (1, 2, 3)))
    costs = part_costs(views, None, exact_library(BINS))
    normals = primitive_normals()
    for label, cost in zip(costs.labels, costs.cost, strict=True):
        truth = normal_of(box_car()[PART_NAMES[label - 1]])
        if abs(truth @ BINS.view_from_object(2)[2]) > 0.3:
            best = normals[int(cost.argmin())]
            # half the spacing of the library, and some
            assert np.rad2deg(np.arccos(min(1.0, abs(best @ truth)))) < 25


def projected(points: FloatArray, rotation: FloatArray, scale: FloatArray, shift: FloatArray) -> FloatArray:
    """u with scale u = R S + shift."""
    uv = np.einsum("vij,nj->vni", rotation[:, :2], points) + shift[:, None]
    return np.asarray(uv / scale[:, None, None])


def test_structure_of_exact_centroids() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(6, 3))
    points -= points.mean(axis=0)
    rotation = np.stack([BINS.view_from_object(b) for b in (1, 2, 4)])
    scale = np.array([0.8, 1.1, 1.1])
    uv = projected(points, rotation, scale, rng.normal(size=(3, 2)))
    uv[0, 3] = np.nan
    found = solve_structure(uv, rotation)
    # the mean scale is 1 already, so that nothing is left of the gauge
    np.testing.assert_allclose(found.points, points, atol=1e-9)
    np.testing.assert_allclose(found.scale, scale, atol=1e-9)


def test_structure_needs_views_that_differ() -> None:
    points = np.random.default_rng(0).normal(size=(6, 3))
    rotation = np.stack([BINS.view_from_object(1)] * 2)
    uv = projected(points, rotation, np.ones(2), np.zeros((2, 2)))
    with pytest.raises(RescoreError, match="at least two parts that two views show, got 0"):
        solve_structure(uv, rotation)


def test_cross_view_transform_of_a_plane_is_that_of_its_points() -> None:
    rng = np.random.default_rng(1)
    normals = primitive_normals()
    a, b = BINS.view_from_object(1), BINS.view_from_object(3)
    for normal in normals[np.abs(normals @ a[2]) > 0.1]:
        across = np.linalg.svd(normal[None])[2][1:]
        points = rng.normal(size=(5, 2)) @ across
        transform = cross_view_transforms(normal[None], a, b)[0]
        np.testing.assert_allclose(points @ a[:2].T @ transform.T, points @ b[:2].T, atol=1e-9)
        np.testing.assert_allclose(points @ a[:2].T @ lift(normal[None], a)[0].T, points, atol=1e-9)


def test_library_is_of_distinct_unit_normals() -> None:
    normals = primitive_normals()
    assert normals.shape == (61, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    # a plane has no front: opposite normals are the same
    assert (np.abs(normals @ normals.T) - np.eye(61)).max() < np.cos(np.deg2rad(7))


def test_view_of_another_bin_is_refused() -> None:
    view = labelled_view(box_car(), 1, BINS)
    with pytest.raises(RescoreError, match="expected 0 to 11, got 13"):
        learn_class_model([view, PartView(13, view.labels, "box")], "car", PART_NAMES)
