"""Pixel likelihoods: log-probability of a photo, its derivatives, and which pixels are visible."""

from dataclasses import replace

from vig.likelihood.evaluate import Likelihood, Photos
from vig.likelihood.geometry import Geometry
from vig.likelihood.pixel import DENSITIES, GAUSSIAN, ROBUST, SPATIAL, PixelModel, log_colour_density
from vig.likelihood.spatial import NEVER, SpatialMask, spatial_posterior
from vig.search.optimizer import Evaluation

LIKELIHOODS: dict[str, PixelModel] = {"robust": ROBUST, "gaussian": GAUSSIAN, "spatial": SPATIAL}
"""The pixel models of a fit by name; by that of another density, the spatial model with it."""
LIKELIHOODS |= {name: replace(SPATIAL, density=name) for name in DENSITIES if name not in LIKELIHOODS}

__all__ = [
    "DENSITIES",
    "GAUSSIAN",
    "LIKELIHOODS",
    "NEVER",
    "ROBUST",
    "SPATIAL",
    "Evaluation",
    "Geometry",
    "Likelihood",
    "Photos",
    "PixelModel",
    "SpatialMask",
    "log_colour_density",
    "spatial_posterior",
]
