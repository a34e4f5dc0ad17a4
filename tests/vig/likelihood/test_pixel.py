import math

import numpy as np
import pytest
import scipy.stats

from tests.support import assert_close
from tests.vig.likelihood.mixture import mixture
from vig.likelihood import GAUSSIAN, ROBUST, PixelModel


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


def test_a_perfect_inlier_gains_and_an_outlier_costs_what_the_paper_says() -> None:
    # log(0.9 (2 pi 0.03^2)^(-3/2) + 0.1) = 7.66 nats; its posterior is one but for 5e-5.
    prior = PixelModel(0.03, 0.9).log_prior(1, 1)[0, 0]
    value, posterior = mixture(row(0.3, 0.4, 0.5), row(0.3, 0.4, 0.5), prior, 0.03)
    assert value == pytest.approx(7.6575, abs=1e-3)
    assert posterior == pytest.approx(1 - 0.1 / np.exp(value), abs=1e-12)
    value, posterior = mixture(row(1, 1, 1), row(0, 0, 0), prior, 0.03)
    assert value == pytest.approx(math.log(0.1))
    assert posterior < 1e-100


def test_values_are_those_of_the_densities_themselves() -> None:
    rng = np.random.default_rng(0)
    observed = rng.uniform(size=(50, 3))
    rendered = observed + rng.normal(0, 0.2, (50, 3))
    log_prior = np.log(rng.dirichlet((1, 1, 1), 50))
    inlier = np.exp(log_prior[:, 0]) * scipy.stats.norm.pdf(observed, rendered, 0.15).prod(1)
    hidden = np.exp(log_prior[:, 1])
    value, posterior = mixture(observed, rendered, log_prior, 0.15)
    assert_close(value, np.log(inlier + hidden))
    assert_close(posterior, inlier / (inlier + hidden))
