"""Families of shapes: a predicted shape's probability of each of a class's kinds, and the shape in each."""

import numpy as np

from vig.recognition import Prediction
from vig.scene import Family, ObjectClass
from vig.scene.functions import softmax

MIN_FAMILY_PROBABILITY = 0.02
"""Families with less probability are left out."""


def family_shapes(prediction: Prediction, object_class: ObjectClass) -> tuple[np.ndarray, np.ndarray]:
    """Return probabilities (F,) of a class's families for one photo (N = 1), and its shape (F, K) in each.

    A family's shapes are a Gaussian, and so is the network's prediction: their product has the family's
    evidence for its mass and the shape for its mean. Where the class names none, one: the predicted shape.
    """
    place = prediction.layout["shape"]
    shape, deviation = prediction.numbers[0, place], prediction.deviation[0, place]
    if not object_class.families:
        return np.ones(1, np.float32), shape[None]
    mean, spread, share = _tables(object_class.families, shape)
    # Evidence of a family: the predicted Gaussian and the family's, multiplied and integrated over the shape.
    both = spread**2 + deviation**2
    evidence = np.log(share) - 0.5 * ((shape - mean) ** 2 / both + np.log(both)).sum(1)
    probability = softmax(evidence)
    # The mean of their product: between the two, nearer to the narrower one.
    weight = spread**2 / both
    return probability, mean + weight * (shape - mean)


def shape_deviation(prediction: Prediction, object_class: ObjectClass) -> np.ndarray:
    """Return the standard deviations (K,) of one photo's shape, that between its likely families included."""
    place = prediction.layout["shape"]
    probability, shapes = family_shapes(prediction, object_class)
    # Law of total variance: within the families, and between their means.
    between = (probability[:, None] * (shapes - prediction.numbers[0, place]) ** 2).sum(0)
    deviation: np.ndarray = np.sqrt(
        prediction.deviation[0, place] ** 2 + between * float(len(probability) > 1)
    )
    return deviation


def family_of(shape: np.ndarray, object_class: ObjectClass) -> str | None:
    """Return the name of the family that a shape (K,) is likeliest of; None where the class names none."""
    if not object_class.families:
        return None
    mean, spread, share = _tables(object_class.families, shape)
    evidence = np.log(share) - 0.5 * (((shape - mean) / spread) ** 2).sum(1) - np.log(spread).sum(1)
    return object_class.families[int(evidence.argmax())].name


def _tables(families: tuple[Family, ...], like: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means (F, K), deviations (F, K) and shares (F,)."""
    means, spreads, shares = zip(*((f.mean, f.deviation, f.share) for f in families), strict=True)
    return np.array(means, like.dtype), np.array(spreads, like.dtype), np.array(shares, like.dtype)
