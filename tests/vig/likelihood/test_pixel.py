from __future__ import annotations

import numpy as np
import scipy.stats

from tests.support import assert_close
from tests.vig.likelihood.mixture import mixture
from vig.likelihood import GAUSSIAN, ROBUST


def row(*numbers: float) -> np.ndarray:
    return np.array(numbers, np.float64)


def test_the_gaussian_model_has_no_outliers() -> None:
    log_prior = GAUSSIAN.log_prior(2, 3)
    assert log_prior.shape == (2, 3, 3) and np.isfinite(log_prior).all()
    observed, rendered = row(1, 1, 1), row(0, 0, 0)
    value, posterior = mixture(observed, rendered, log_prior, 0.05)
    expected = scipy.stats.norm.logpdf(observed, rendered, 0.05).sum()
    assert_close(value, np.full((2, 3), expected))
    assert (posterior == 1).all()


def test_the_prior_of_the_robust_model() -> None:
    assert_close(np.exp(ROBUST.log_prior(4, 5)[3, 4]), row(0.55, 0.45, 1.0))
