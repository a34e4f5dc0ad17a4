"""The paper's Gaussian pixel model, Eq. 2: every pixel of the object is visible."""

from vig.likelihood.pixel import PixelModel

GAUSSIAN = PixelModel(sigma=0.05, alpha=1.0)
