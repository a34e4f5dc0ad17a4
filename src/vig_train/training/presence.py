"""The presence head, fitted to images of a class and of other things; all else stays as it is."""

import numpy as np
import torch
from scipy.optimize import minimize
from scipy.special import expit

from vig_train.network.network import RecognitionNetwork, bfloat16
from vig_train.training.augmentation import Augmentation
from vig_train.training.examples import Examples

PRIOR_LOG_ODDS = 2.0
"""Added to the fit's: photos that users ask about show the object more often than these do. Set on real
photos of mugs, teapots and cars: a higher one misses fewer mugs and takes more of other things for one."""
PRESENCE = 1  # row of the presence among the outputs of `RecognitionNetwork.others`


def fit_presence(network: RecognitionNetwork, examples: Examples, seed: int) -> None:
    """Fit the presence head in place: a logistic regression on the dense layer's features.

    Where all of the images show the object, or none does, it stays as it is.

    Args:
        network: In evaluation mode.
        examples: Images with the class, and without it, other classes' among them.
        seed: Seed of their augmentation.
    """
    present, head = examples.present().numpy(), network.others
    if len(np.unique(present)) < 2:
        return
    features = dense_features(network, examples, seed)
    weight, bias = refit_logistic(
        head.weight[PRESENCE].detach().numpy(), float(head.bias[PRESENCE].detach()), features, present
    )
    with torch.no_grad():
        head.weight[PRESENCE] = torch.from_numpy(weight)
        head.bias[PRESENCE] = bias


def dense_features(network: RecognitionNetwork, examples: Examples, seed: int) -> np.ndarray:
    """Return features (N, D) float32 that the heads read, of the images as training augments them."""
    parts = []
    for number, chosen in enumerate(torch.arange(len(examples)).split(60)):
        torch.manual_seed(seed + number)
        batch = Augmentation()(examples[chosen], np.random.default_rng([seed, number, 7]))
        with torch.inference_mode(), bfloat16(batch.images.device):
            parts.append(network.dense(network.maps(batch.images)[-1]).float())
    return torch.cat(parts).numpy()


def refit_logistic(
    weight: np.ndarray, bias: float, features: np.ndarray, present: np.ndarray
) -> tuple[np.ndarray, float]:
    """Regress present (N,) on features (N, D), logistically: weights (D,) and bias near those given."""
    spread = np.maximum(features.std(0), 1e-3)
    standard, before = features / spread, np.append(weight * spread, bias)

    ridge = 1e-3  # strength of the ridge penalty that draws the standardised weights to the earlier ones

    def loss(now: np.ndarray) -> tuple[float, np.ndarray]:
        log_odds = standard @ now[:-1] + now[-1]
        wrong = expit(log_odds) - present
        slope = np.append(standard.T @ wrong, wrong.sum()) / len(present) + ridge * (now - before)
        value = np.mean(np.logaddexp(0, log_odds) - present * log_odds)
        return float(value + 0.5 * ridge * np.square(now - before).sum()), slope

    found = minimize(loss, before, jac=True, method="L-BFGS-B").x
    return (found[:-1] / spread).astype(np.float32), float(found[-1]) + PRIOR_LOG_ODDS
