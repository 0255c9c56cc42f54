"""Errors of class models against the truth of a mesh."""

from dataclasses import replace

import numpy as np
import pytest

from datasets_synth.objects.object_classes import object_class
from datasets_synth.render.part_truth import PartTruth, part_truth
from recon.class_model import ClassModel, ClassPart
from recon.part_views import PartView
from recon.view_bins import ViewBins
from rescore.studies.class_models import _fitted_distance, model_errors


def exact_model(truth: dict[int, PartTruth], scale: float, shift: np.ndarray) -> ClassModel:
    """A model whose parts are the truth in other units and at another place."""
    parts = []
    for label, t in sorted(truth.items()):
        centroid = scale * t.centroid_m + shift
        plane = np.append(t.normal, -t.normal @ centroid)
        parts.append(ClassPart(label, centroid, plane, np.tile(centroid, (3, 1)), 0, 2))
    view = PartView(3, np.ones((4, 4), np.uint8), "one")
    return ClassModel("chair", object_class("chair").part_names, ViewBins(), tuple(parts), (view,))


@pytest.fixture(scope="module")
def truth() -> dict[int, PartTruth]:
    chair = object_class("chair")
    return part_truth(chair.labelled_mesh(chair.build(chair.train[0], np.random.default_rng(0))))


def test_the_truth_in_other_units_has_no_error(truth: dict[int, PartTruth]) -> None:
    angle, distance = model_errors(exact_model(truth, 0.4, np.array([1.0, -2.0, 3.0])), truth)
    # seat and back have normals, four legs have none
    assert (len(angle), len(distance)) == (2, 6)
    np.testing.assert_allclose(angle, 0, atol=1e-5)
    np.testing.assert_allclose(distance, 0, atol=1e-6)


def test_errors_are_those_put_in(truth: dict[int, PartTruth]) -> None:
    model = exact_model(truth, 1.0, np.zeros(3))
    seat = model.parts[0]
    across = np.linalg.svd(seat.plane[None, :3])[2][1]
    turned = np.cos(np.deg2rad(20)) * seat.plane[:3] + np.sin(np.deg2rad(20)) * across
    # the sign of a normal does not count
    parts = (replace(seat, plane=np.append(-turned, 0.0)), *model.parts[1:])
    angle, _ = model_errors(replace(model, parts=parts), truth)
    assert angle.max() == pytest.approx(20, abs=1e-6)


def test_one_part_astray_leaves_the_others_alone() -> None:
    true = np.random.default_rng(0).normal(size=(9, 3))
    mine = 0.5 * true + 2.0
    mine[4] += 3.0
    distance = _fitted_distance(mine, true)
    # astray by (3, 3, 3) in units of half the size: sqrt(27) / 0.5
    assert distance[4] == pytest.approx(2 * np.sqrt(27), rel=0.05)
    assert np.delete(distance, 4).max() < 0.1
