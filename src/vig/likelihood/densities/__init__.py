"""Densities of the noise at a visible pixel, a file each, beside the snippet of C++ that kernels include.

A density is p(error) = exp(log_density(s)) / normaliser, with s = |error|^2 / (2 sigma^2) over the three
channels of linear RGB. NAME.py has

    LOG_UNIT          log of the normaliser for sigma = 1; for another sigma 3 log sigma is added
    log_density(s)    as above, a function of tensors: the reference of what the kernels compute

and NAME.cc two macros, `LOG_DENSITY(s)` and `PULL(s)`, which is - d log_density / d s: 1 for a Gaussian, less
for what forgives large errors. It weighs a pixel in the gradient and in the Gauss-Newton matrix (iteratively
reweighted least squares).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

FOLDER = Path(__file__).parent
NAMES = tuple(sorted(path.stem for path in FOLDER.glob("*.cc")))
"""Of all densities: `PixelModel.density`."""


def density_of(name: str) -> ModuleType:
    """The module of a density. ValueError when there is none of that name."""
    if name not in NAMES:
        raise ValueError(f"density must be one of {', '.join(NAMES)}; got '{name}'")
    return import_module(f"{__name__}.{name}")
