"""Pixel likelihoods: log-probability of a photo, its derivatives, and which pixels are visible."""

from dataclasses import replace

from vig.likelihood.evaluate import Likelihood as Likelihood
from vig.likelihood.evaluate import Photos as Photos
from vig.likelihood.geometry import Geometry as Geometry
from vig.likelihood.pixel import DENSITIES as DENSITIES
from vig.likelihood.pixel import GAUSSIAN as GAUSSIAN
from vig.likelihood.pixel import ROBUST as ROBUST
from vig.likelihood.pixel import SPATIAL as SPATIAL
from vig.likelihood.pixel import PixelModel as PixelModel
from vig.likelihood.pixel import log_colour_density as log_colour_density
from vig.likelihood.spatial import NEVER as NEVER
from vig.likelihood.spatial import SpatialMask as SpatialMask
from vig.likelihood.spatial import spatial_posterior as spatial_posterior
from vig.search.optimizer import Evaluation as Evaluation

LIKELIHOODS: dict[str, PixelModel] = {"robust": ROBUST, "gaussian": GAUSSIAN, "spatial": SPATIAL}
"""The pixel models of a fit by name; by that of another density, the spatial model with it."""
LIKELIHOODS |= {name: replace(SPATIAL, density=name) for name in DENSITIES if name not in LIKELIHOODS}
