"""Densities of the noise at a visible pixel, a file each, with a header in native code.

A density is p(error) = exp(log_density(s)) / normaliser, with s = |error|^2 / (2 sigma^2) over the three
channels of linear RGB. NAME.py has

    LOG_UNIT          log of the normaliser for sigma = 1; for another sigma 3 log sigma is added
    log_density(s)    as above, a function of arrays: the reference of native code

and vig_native/densities/NAME.h a struct of that name with `log_density(s)` and `pull(s)`, which is
- d log_density / d s: 1 for a Gaussian, less for one that forgives large errors. It weighs a pixel in the
gradient and in the Gauss-Newton matrix (iteratively reweighted least squares).
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from vig_native import engine

DEFAULT_DENSITY = "gaussian"
NAMES = tuple(engine.DENSITIES)
"""Names of all densities: `PixelModel.density`."""


def density_of(name: str) -> ModuleType:
    """Return the module of a density. ValueError when there is none of that name."""
    if name not in NAMES:
        raise ValueError(f"density must be one of {', '.join(NAMES)}; got '{name}'")
    return import_module(f"{__name__}.{name}")
