"""The pixel likelihood, Eq. 2 and 3, and its settings.

At a pixel that the object covers: log(visible N(c; mu, s^2 I) + hidden U), with U = 1 on the unit cube of
linear RGB and N the product over the three channels. At any other pixel: log(background U). The three
prior weights are (alpha, 1 - alpha, 1) in the paper's robust model, (1, 0, 1) in its Gaussian one; with a
recognition model's class probabilities of each pixel, they may differ from pixel to pixel.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from vig.likelihood.spatial import NEVER, SpatialMask
from vig_native import engine

DENSITIES = tuple(engine.DENSITIES)
"""Names of the noise densities of a visible pixel: a header each in vig_native/densities, see density.h."""
DEFAULT_DENSITY = "gaussian"
FLOOR = 0.05  # share of the uniform density, for colours that the photo does not show elsewhere


def log_colour_density(photo: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the log density of each pixel's colour among the surroundings, relative to uniform on the cube.

    photo (H, W, 3) linear RGB in [0, 1]; weights (..., H, W) >= 0: how surely each pixel belongs to the
    surroundings, of which there may be several; returns their shape. See `colour_density`.
    """
    flat = weights.reshape(-1, *photo.shape[:2]).astype(np.float64)
    shares = flat / np.maximum(flat.sum((1, 2), keepdims=True), 1e-9)
    density = engine.colour_density(np.ascontiguousarray(photo, np.float64), np.ascontiguousarray(shares))
    logs: np.ndarray = np.log(FLOOR + (1 - FLOOR) * density).reshape(weights.shape)
    return logs


@dataclass(frozen=True)
class PixelModel:
    """Settings of the pixel likelihood.

    Attributes:
        sigma: Standard deviation of the noise, linear RGB.
        alpha: Prior of an object's pixel being visible, in (0, 1]; 1 is the Gaussian model.
        density: Noise density of a visible pixel, one of `DENSITIES`.
        mask: Coupling of neighbouring pixels in the mask of a finished fit; None: each is on its own.
    """

    sigma: float
    alpha: float
    density: str = DEFAULT_DENSITY
    mask: SpatialMask | None = None

    def __post_init__(self) -> None:
        if not self.sigma > 0:
            raise ValueError(f"sigma must be a positive standard deviation in linear RGB; got {self.sigma}")
        if not 0 < self.alpha <= 1:
            raise ValueError(f"alpha must be a probability in (0, 1]; got {self.alpha}")
        if self.density not in DENSITIES:
            raise ValueError(f"density must be one of {', '.join(DENSITIES)}; got '{self.density}'")

    def log_prior(self, height: int, width: int) -> np.ndarray:
        """Return one log prior (visible, hidden, background) for all pixels: (H, W, 3) float64."""
        hidden = math.log1p(-self.alpha) if self.alpha < 1 else NEVER
        return np.broadcast_to(np.array([math.log(self.alpha), hidden, 0.0]), (height, width, 3))


GAUSSIAN = PixelModel(sigma=0.05, alpha=1.0)
"""The paper's Gaussian pixel model, Eq. 2: every pixel of the object is visible."""

ROBUST = PixelModel(sigma=0.03, alpha=0.55)
"""The paper's robust pixel model, Eq. 3. alpha is learned, as the paper proposes: the mean share of the
teapot that is visible in the training images. The paper's code has 0.9."""


SPATIAL = replace(ROBUST, mask=SpatialMask())
"""The robust model, and in the mask of a finished fit neighbours that agree."""
