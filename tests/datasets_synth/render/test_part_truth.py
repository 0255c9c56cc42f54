import numpy as np
import pytest

from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.objects.chairs import chair_mesh, chair_shapes
from datasets_synth.render.part_truth import part_truth
from tests.datasets_synth.simple_scenes import box, joined, quad


def test_a_panel_is_flat_and_faces_outward():
    # 4 x 2 m, leaning back: corners from (0, 0, 0) to (0, 4, 0), up along (-0.6, 0, 0.8) * 2
    corners = [(0, 0, 0), (0, 4, 0), (-1.2, 4, 1.6), (-1.2, 0, 1.6)]
    truth = part_truth(quad(corners, part=5))[5]
    assert truth.centroid_m == pytest.approx([-0.6, 2, 0.8])
    assert truth.normal == pytest.approx([0.8, 0, 0.6], abs=1e-6)
    assert truth.one_sided
    # a uniform distribution of width a has the standard deviation a / sqrt(12)
    assert truth.spread_m == pytest.approx([4 / 12**0.5, 2 / 12**0.5, 0], abs=1e-4)
    assert truth.planarity == pytest.approx(1, abs=1e-3)
    assert not truth.is_elongated


def test_a_closed_plate_has_the_axis_of_its_thickness_without_a_sign():
    truth = part_truth(box(3.0, 2.0, 0.1, parts=(4,) * 6))[4]
    assert truth.centroid_m == pytest.approx([0, 0, 0.05], abs=1e-6)
    assert truth.normal == pytest.approx([0, 0, 1], abs=1e-6)
    assert not truth.one_sided
    # along z: top and bottom (6 m2 each) lie 0.05 m off; the sides (1 m2 together) spread by 0.1 / sqrt(12)
    assert truth.spread_m[2] == pytest.approx(((12 * 0.05**2 + 0.1**2 / 12) / 13) ** 0.5)


def test_turning_a_side_inside_out_turns_its_normal():
    left = box(4.0, 2.0, 1.5, parts=(1, 2, 3, 4, 5, 6))
    truth = part_truth(left)
    for label, normal in enumerate([(0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1)], 1):
        assert truth[label].normal == pytest.approx(normal, abs=1e-6)
        assert truth[label].one_sided


def test_a_rod_is_elongated_and_a_long_strip_is_not():
    draft = MeshDraft()
    grey = Material("grey", (0.5, 0.5, 0.5))
    with draft.labelling(1):
        draft.bar((0, 0, 0), (0.3, 0.1, 1.0), 0.02, grey, sides=12)
    with draft.labelling(2):
        draft.panel([(0, 0, 0), (5, 0, 0), (5, 0, 0.1), (0, 0, 0.1)], grey)
    truth = part_truth(draft.mesh())
    assert truth[1].is_elongated
    assert truth[1].planarity < 0.01
    assert not truth[2].is_elongated
    assert truth[2].normal == pytest.approx([0, -1, 0], abs=1e-6)


def test_unlabelled_faces_have_no_truth_and_two_plates_of_a_part_count_by_area():
    # squares of 1 and 4 m2 of one label at x = 0 and x = 10: the middle is at 8
    small = quad([(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)], part=2)
    large = quad([(10, 0, 0), (10, 2, 0), (10, 2, 2), (10, 0, 2)], part=2)
    truth = part_truth(joined(small, large, quad([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])))
    assert set(truth) == {2}
    assert truth[2].centroid_m[0] == pytest.approx(8)


def sampled(mesh: Mesh, label: int, n: int) -> np.ndarray:
    """Points spread evenly over the surface of a part."""
    rng = np.random.default_rng(0)
    p = mesh.vertices_m[mesh.faces[mesh.face_part == label]].astype(float)
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    p = p[rng.choice(len(p), n, p=area / area.sum())]
    u, v = rng.random((2, n, 1))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    return p[:, 0] + u * (p[:, 1] - p[:, 0]) + v * (p[:, 2] - p[:, 0])


def test_the_integrals_agree_with_points_sampled_on_the_surface():
    mesh = chair_mesh(chair_shapes()[12], np.random.default_rng(0))
    for label, truth in part_truth(mesh).items():
        points = sampled(mesh, label, 40_000)
        assert points.mean(axis=0) == pytest.approx(truth.centroid_m, abs=0.003)
        spread = np.sqrt(np.linalg.eigvalsh(np.cov(points.T))[::-1])
        assert spread == pytest.approx(truth.spread_m, rel=0.02, abs=1e-4)
