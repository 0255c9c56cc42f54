import numpy as np
import pytest

from datasets_synth.render.part_render import MARGIN_PX, render_part_labels
from recon.view_bins import rotation
from tests.datasets_synth.simple_scenes import SIDES, box, joined

LABEL = {name: i + 1 for i, name in enumerate(SIDES)}


def view(bin_, elevation_rad=0.0):
    return rotation(np.radians(30 * bin_), elevation_rad)


CAR = box(4.0, 2.0, 1.5, parts=tuple(LABEL[s] for s in SIDES))


@pytest.mark.parametrize(("bin_", "side"), [(0, "front"), (3, "left"), (6, "back"), (9, "right")])
def test_square_views_show_one_side_in_true_proportion(bin_, side):
    labels = render_part_labels(CAR, view(bin_), 200)
    inner = labels[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX]
    assert set(np.unique(inner)) == {LABEL[side]}
    assert not labels[:MARGIN_PX].any()
    assert not labels[:, -MARGIN_PX:].any()
    # 4 x 1.5 m from the sides, 2 x 1.5 m from the ends, 200 pixels along the longer side
    assert inner.shape == ((75, 200) if side in ("left", "right") else (150, 200))


def test_bin_3_has_the_nose_at_the_left_and_bin_9_at_the_right():
    nose = box(0.5, 2.0, 1.5, parts=(7,) * 6)
    nose.vertices_m[:, 0] += 2.2
    both = joined(CAR, nose)
    for bin_, half in ((3, np.s_[:, :50]), (9, np.s_[:, -50:])):
        labels = render_part_labels(both, view(bin_), 200)
        assert (labels == 7).sum() > 500
        assert (labels == 7).sum() == (labels[half] == 7).sum()


def test_a_view_from_above_shows_the_top_over_the_side():
    # at 30 degrees: 1.5 cos 30 of side below 2 sin 30 of top, at 50 pixels a metre
    labels = render_part_labels(CAR, view(3, np.pi / 6), 200)
    column = labels[:, labels.shape[1] // 2]
    assert (column == LABEL["left"]).sum() == pytest.approx(1.5 * np.cos(np.pi / 6) * 50, abs=1)
    assert (column == LABEL["top"]).sum() == pytest.approx(50, abs=1)
    assert np.flatnonzero(column == LABEL["top"]).max() < np.flatnonzero(column == LABEL["left"]).min()


@pytest.mark.parametrize("bin_", range(12))
def test_axes_are_right_handed_and_look_at_the_object(bin_):
    axes = view(bin_, 0.2)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(axes[0], axes[1]), axes[2], atol=1e-12)
    assert axes[1, 2] == pytest.approx(-np.cos(0.2))  # down has no other way
    to_camera = -axes[2]
    assert np.degrees(np.arctan2(to_camera[1], to_camera[0])) % 360 == pytest.approx(30 * bin_)
