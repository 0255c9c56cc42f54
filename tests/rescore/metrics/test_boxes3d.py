"""Overlaps and errors of 3D boxes: by hand, and against polygons of shapely."""

import numpy as np
import pytest
import shapely

from recon.arrays import FloatArray
from rescore.data.boxes3d import Boxes3D
from rescore.metrics.boxes3d import box_errors, box_overlaps


def boxes(*rows: tuple[float, ...]) -> Boxes3D:
    return Boxes3D.of_values(np.array(rows, float))


def test_overlaps_by_hand() -> None:
    # 4 x 2 x 1.5 m, turned so that the length lies along z; the other one stands 1 m further and 0.5 m lower
    a = boxes((0, 0, 10, 4, 2, 1.5, np.pi / 2))
    b = boxes((0, 0.5, 11, 4, 2, 1.5, -np.pi / 2))
    from_above, in_space = box_overlaps(a, b)
    # footprints share 3 x 2 of 2 x 8 - 6; heights share 1 m: 6 of 2 x 12 - 6
    assert from_above[0] == pytest.approx(6 / 10)
    assert in_space[0] == pytest.approx(6 / 18)


def test_a_square_turned_by_45_degrees_leaves_an_octagon() -> None:
    a, b = boxes((0, 0, 10, 2, 2, 1, 0)), boxes((0, 0, 10, 2, 2, 1, np.pi / 4))
    # each corner that is cut off has the height sqrt(2) - 1 and the area of its square
    octagon = 4 - 4 * (np.sqrt(2) - 1) ** 2
    from_above, in_space = box_overlaps(a, b)
    assert from_above[0] == pytest.approx(octagon / (8 - octagon))
    assert in_space[0] == pytest.approx(octagon / (8 - octagon))


def test_the_nose_turns_as_kittis_does() -> None:
    # rotation_y 0.5 turns the nose towards the camera: the box covers its middle plus 3 (cos 0.5, -sin 0.5)
    long = boxes((0, 0, 10, 8, 0.5, 1, 0.5))
    where = [(3 * np.cos(0.5), 0, 10 + sign * 3 * np.sin(0.5), 0.2, 0.2, 1, 0) for sign in (-1, 1)]
    on, off = (box_overlaps(long, boxes(w))[0][0] for w in where)
    assert on == pytest.approx(0.04 / 4)
    assert off == 0


def test_boxes_that_touch_or_coincide() -> None:
    a = boxes((0, 0, 10, 4, 2, 1.5, 0.3))
    np.testing.assert_allclose(box_overlaps(a, a), 1, atol=1e-12)
    # the opposite heading has the same footprint
    np.testing.assert_allclose(box_overlaps(a, boxes((0, 0, 10, 4, 2, 1.5, 0.3 - np.pi))), 1, atol=1e-9)
    # on top of each other, and side by side
    above, space = box_overlaps(a, boxes((0, 1.5, 10, 4, 2, 1.5, 0.3)))
    np.testing.assert_allclose((above[0], space[0]), (1, 0), atol=1e-12)
    b = boxes((0, 0, 10, 4, 2, 1, 0))
    np.testing.assert_allclose(box_overlaps(b, boxes((4, 0, 10, 4, 2, 1, 0))), 0, atol=1e-12)


def test_rows_without_a_box_overlap_nothing() -> None:
    known = boxes((0, 0, 10, 4, 2, 1.5, 0))
    both = Boxes3D.concatenate([known, Boxes3D.none(1), Boxes3D.none(1)])
    other = Boxes3D.concatenate([known, known, Boxes3D.none(1)])
    np.testing.assert_allclose(box_overlaps(both, other), [[1, 0, 0], [1, 0, 0]])
    errors = box_errors(both, other)
    for values in (errors.translation_m, errors.scale, errors.orientation_rad):
        np.testing.assert_array_equal(np.isnan(values), [False, True, True])


def footprints(of: Boxes3D) -> FloatArray:
    """Corners (n, 4, 2) from noses and the directions to their right."""
    nose, middle = of.nose_cam[:, ::2], of.centre_cam_m[:, ::2]
    along = nose * of.size_m[:, :1] / 2
    across = np.column_stack([-nose[:, 1], nose[:, 0]]) * of.size_m[:, 1:2] / 2
    return np.stack(
        [middle + a * along + b * across for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))], axis=1
    )


def test_overlaps_equal_those_of_shapelys_polygons() -> None:
    rng = np.random.default_rng(0)
    low = (-2, -1, 8, 0.5, 0.5, 0.5, -4)
    a, b = (Boxes3D.of_values(rng.uniform(low, (2, 1, 12, 5, 3, 2, 4), (3000, 7))) for _ in range(2))
    mine, theirs = shapely.polygons(footprints(a)), shapely.polygons(footprints(b))
    shared = shapely.area(shapely.intersection(mine, theirs))
    union = shapely.area(mine) + shapely.area(theirs) - shared
    from_above, in_space = box_overlaps(a, b)
    np.testing.assert_allclose(from_above, shared / union, atol=1e-12)
    assert 0.4 < (from_above > 0).mean() < 0.9
    ends = [x.centre_cam_m[:, 1] + s * x.size_m[:, 2] / 2 for s in (-1, 1) for x in (a, b)]
    volume = shared * np.clip(np.minimum(*ends[2:]) - np.maximum(*ends[:2]), 0, None)
    both = np.prod(a.size_m, axis=1) + np.prod(b.size_m, axis=1)
    np.testing.assert_allclose(in_space, volume / (both - volume), atol=1e-12)


def test_errors_by_hand() -> None:
    true = boxes((1, 0.8, 10, 4, 2, 1.5, 3.0))
    found = boxes((1.3, 5, 10.4, 3.2, 2, 1.8, -3.0))
    errors = box_errors(found, true)
    # height does not count: 3, 4, 5
    assert errors.translation_m[0] == pytest.approx(0.5)
    # 3.2 x 2 x 1.5 = 9.6 of 12 + 11.52 - 9.6 = 13.92
    assert errors.scale[0] == pytest.approx(1 - 9.6 / 13.92)
    assert errors.orientation_rad[0] == pytest.approx(2 * np.pi - 6)
