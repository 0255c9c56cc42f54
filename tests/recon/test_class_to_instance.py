import numpy as np
import pytest

from recon.class_to_instance import InstanceTransform, fit_instance_transform
from recon.errors import RescoreError


def points(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-0.5, 0.5, (120, 3)) * np.array([1.0, 0.4, 0.3])


def test_transform_is_recovered_and_wrong_points_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    model = points(rng)
    truth = InstanceTransform(0.3, np.array([0.25, 0.26, 0.24]), np.array([0.1, 1.2, 0.03]))
    seen = truth(model)
    seen[:12] += rng.uniform(0.1, 0.3, (12, 3))
    found = fit_instance_transform(model, seen, 0.1)
    assert found.yaw_rad == pytest.approx(0.3, abs=0.02)
    assert np.allclose(found.scale, truth.scale, rtol=0.04)
    assert np.abs(found(model) - truth(model)).max() < 0.006


def test_too_few_points() -> None:
    with pytest.raises(RescoreError, match="at least three points"):
        fit_instance_transform(np.zeros((2, 3)), np.zeros((2, 3)), 0.0)
