"""The paper's robust pixel model, Eq. 3."""

from vig.likelihood.pixel import PixelModel

ROBUST = PixelModel(sigma=0.03, alpha=0.9)
