from dataclasses import replace

import numpy as np
import pytest

from rescore.data.splits import Splits, ValidationSet
from rescore.evidence.candidates import CandidateTable
from rescore.fusion.fuse import LearnedFusion, fit_fusion, fuse, posteriors
from tests.rescore.fusion.test_tune import data_set, table


def noisy(data: ValidationSet, rng: np.random.Generator) -> CandidateTable:
    """Hits have the lower D, and l says nothing."""
    t = table(data.data, (0.5, 0.2), (0.5, 0.8))
    t.likelihood[:] = rng.uniform(0.2, 0.8, len(t))
    t.depth_difference[:] += rng.uniform(-0.19, 0.19, len(t))
    return t


def test_the_fit_trusts_what_tells_hits_apart() -> None:
    validation = Splits.of(data_set(40)).validation_set
    t = noisy(validation, np.random.default_rng(0))
    learned = fit_fusion(t, validation)
    assert learned is not None
    assert learned.on_depth > 1 > abs(learned.on_likelihood)
    p = learned.posterior(t.likelihood, t.depth_difference)
    assert p[::2].min() > p[1::2].max()


def test_candidates_without_evidence_do_not_fit_and_keep_their_likelihood() -> None:
    validation = Splits.of(data_set(40)).validation_set
    t = noisy(validation, np.random.default_rng(0))
    learned = fit_fusion(t, validation)
    blind = replace(t, depth_difference=np.full(len(t), np.nan))
    assert fit_fusion(CandidateTable.concatenate([t, blind.take(slice(1, None, 2))]), validation) == learned
    assert learned is not None
    for score in posteriors(blind, 0.3, learned).values():
        np.testing.assert_array_equal(score, t.likelihood)


def test_the_rules_are_what_they_say() -> None:
    data = data_set(1).split("validation")
    t = table(data, (0.4, 0.1), (0.8, 1.0))
    scores = posteriors(t, 0.25, LearnedFusion(0.0, 1.0, 2.0))
    np.testing.assert_allclose(scores["depth"], [0.9, 0.0])
    np.testing.assert_allclose(scores["product"], [0.36, 0.0])
    np.testing.assert_allclose(scores["maximum"], [0.9, 0.8])
    np.testing.assert_array_equal(scores["eq7"], fuse(t.likelihood, t.depth_difference, 0.25))
    # odds are l (1 - D)^2
    assert scores["learned"][0] == pytest.approx(0.4 * 0.81 / (1 + 0.4 * 0.81))
    assert np.isfinite(scores["learned"]).all()
    assert set(posteriors(t, None, None)) == {"depth", "product", "maximum"}


def test_one_kind_of_candidate_fits_nothing() -> None:
    validation = Splits.of(data_set()).validation_set
    hits = table(validation.data, (0.4, 0.1), (0.8, 0.5)).take(slice(None, None, 2))
    assert fit_fusion(hits, validation) is None


def test_test_images_cannot_fit_it() -> None:
    data = data_set()
    t = table(data.split("test"), (0.4, 0.1), (0.8, 0.5))
    with pytest.raises(ValueError, match="not among the images"):
        fit_fusion(t, Splits.of(data).validation_set)
    with pytest.raises(TypeError, match=r"comes from Splits\.of"):
        fit_fusion(t, ValidationSet(data.split("test"), object()))
