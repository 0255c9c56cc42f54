"""A classifier that hands given scores to scikit-learn, apart since its base classes are slow to import."""

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin

from recon.arrays import BoolArray, FloatArray


class ScoreItself(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """A classifier whose decision value is its input, so that scikit-learn calibrates given scores."""

    def fit(self, score: FloatArray, is_car: BoolArray) -> "ScoreItself":
        """The classifier, once it knows the classes of labels (n,)."""
        self.classes_ = np.unique(is_car)
        return self

    def predict(self, score: FloatArray) -> BoolArray:
        """Mask of the scores (n, 1) that are above 0, shape (n,)."""
        return np.asarray(score[:, 0] > 0)

    def decision_function(self, score: FloatArray) -> FloatArray:
        """The scores (n, 1) themselves, shape (n,)."""
        return score[:, 0]
