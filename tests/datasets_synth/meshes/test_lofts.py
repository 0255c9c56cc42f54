import numpy as np
import pytest

from datasets_synth.meshes.lofts import circle, curve, loft, slab, superellipse, tube
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft

GREY = Material("grey", (0.5, 0.5, 0.5))


def volume(mesh: Mesh) -> float:
    """Signed volume by the divergence theorem; positive only where faces turn outwards."""
    p = mesh.vertices_m[mesh.faces].astype(float)
    return float(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6)


def tube_mesh(path, radius, **options) -> Mesh:
    draft = MeshDraft()
    tube(draft, path, radius, GREY, **options)
    return draft.mesh()


def test_a_straight_tube_has_the_volume_of_its_prism():
    # a regular 12-gon of radius r has area 3 r^2; r = 0.1, length |(2, 1, 2)| = 3: 0.09
    assert volume(tube_mesh([(0, 0, 0), (2, 1, 2)], 0.1, sides=12)) == pytest.approx(0.09, rel=1e-5)


def test_a_tapered_tube_has_the_volume_of_its_frustum():
    # h / 3 (A + sqrt(A B) + B) with A = 3 * 0.04, B = 3 * 0.01: 1 / 3 (0.12 + 0.06 + 0.03)
    assert volume(tube_mesh([(0, 0, 0), (0, 0, 1)], [0.2, 0.1], sides=12)) == pytest.approx(0.07, rel=1e-5)


def test_a_closed_tube_is_a_torus():
    # Pappus: area of the section times the way of its middle, for polygons of many corners 2 pi^2 R r^2
    mesh = tube_mesh(circle((1, 2, 3), 0.5, "y", 200), 0.1, sides=64, closed=True)
    assert volume(mesh) == pytest.approx(2 * np.pi**2 * 0.5 * 0.01, rel=5e-3)
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([1.2, 0.2, 1.2], abs=1e-3)


@pytest.mark.parametrize("order", [1, -1])
def test_faces_turn_outwards_whatever_the_order_of_the_rings(order):
    square = np.array([(-1.0, -1), (1, -1), (1, 1), (-1, 1)])
    rings = np.stack([np.column_stack([square, np.full(4, z)]) for z in (0.0, 2.0, 5.0)])[::order]
    draft = MeshDraft()
    loft(draft, rings, GREY)
    mesh = draft.mesh()
    assert volume(mesh) == pytest.approx(20)
    p = mesh.vertices_m[mesh.faces]
    flat = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert (np.einsum("ij,ikj->ik", flat, mesh.corner_normals) > 0).all()


def test_the_texture_of_a_loft_is_in_metres_around_and_along():
    square = np.array([(0.0, 0), (1, 0), (1, 1), (0, 1)])
    rings = np.stack([np.column_stack([square, np.full(4, z)]) for z in (0.0, 3.0)])
    draft = MeshDraft()
    loft(draft, rings, GREY, tile_m=0.5)
    uv = draft.mesh().corner_uv[:8]  # the four sides; the caps follow
    # 4 m around and 3 m along, in tiles of half a metre
    assert uv[..., 0].max() == pytest.approx(8)
    assert uv[..., 1].max() == pytest.approx(6)


def test_a_slab_keeps_its_outline_and_loses_its_edges():
    draft = MeshDraft()
    slab(draft, superellipse(0.5, 0.3, 2.0, 200), (0.4, 0.5), 0.02, GREY)
    mesh = draft.mesh()
    assert mesh.vertices_m.min(axis=0) == pytest.approx([-0.5, -0.3, 0.4], abs=1e-4)
    assert mesh.vertices_m.max(axis=0) == pytest.approx([0.5, 0.3, 0.5], abs=1e-4)
    full = np.pi * 0.5 * 0.3 * 0.1
    # each edge loses (1 - pi / 4) r^2 around the outline of some 2.55 m, twice
    assert volume(mesh) == pytest.approx(full - 2 * (1 - np.pi / 4) * 0.02**2 * 2.55, rel=3e-3)


@pytest.mark.parametrize("power", [2.0, 4.0, 11.0])
def test_a_superellipse_satisfies_its_equation(power):
    x, y = superellipse(0.7, 0.2, power, 36).T
    assert np.abs(x / 0.7) ** power + np.abs(y / 0.2) ** power == pytest.approx(1)


def test_a_curve_starts_and_ends_at_its_ends_along_its_legs():
    path = curve((0, 0, 0), (1, 0, 0), (1, 1, 0))
    assert path[[0, -1]] == pytest.approx(np.array([(0, 0, 0), (1, 1, 0)]))
    # the middle of a parabola lies half way to the point it is drawn to: (a + 2 b + c) / 4
    assert path[6] == pytest.approx((0.75, 0.25, 0))
