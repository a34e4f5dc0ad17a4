"""Pixel likelihoods: log-probability of a photo, its derivatives, and which pixels are visible."""

from vig.likelihood.alpha import log_prior_of, visible_map, visible_share
from vig.likelihood.evaluate import Evaluation, Likelihood, Photos
from vig.likelihood.kernels.assembly import load_kernels
from vig.likelihood.pixel import GAUSSIAN, NEVER, ROBUST, PixelModel, mixture
from vig.likelihood.spatial import SPATIAL, SpatialModel, spatial_posterior
from vig.likelihood.surroundings import log_colour_density

__all__ = [
    "GAUSSIAN",
    "NEVER",
    "ROBUST",
    "SPATIAL",
    "Evaluation",
    "Likelihood",
    "Photos",
    "PixelModel",
    "SpatialModel",
    "load_kernels",
    "log_colour_density",
    "log_prior_of",
    "mixture",
    "spatial_posterior",
    "visible_map",
    "visible_share",
]
