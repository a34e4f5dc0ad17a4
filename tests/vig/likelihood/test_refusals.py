"""Arguments that likelihoods refuse, some of which native code would read beyond."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from tests.support import POINT
from vig.likelihood import (
    DENSITIES,
    Geometry,
    Likelihood,
    Photos,
    PixelModel,
    SpatialMask,
    log_colour_density,
)

NAN = math.nan
PHOTO = np.full((1, 150, 150, 3), 0.5)


def photos(value: float = 0.5, shape: tuple[int, ...] = (1, 4, 4, 3), prior: Any = None) -> Photos:
    return Photos(np.full(shape, value), np.zeros(shape) if prior is None else prior)


def density_of(shape: tuple[int, ...]) -> np.ndarray:
    return log_colour_density(np.zeros(shape, np.float32), np.ones((20, 20), np.float32))


@pytest.mark.parametrize(
    ("call", "why"),
    [
        (
            lambda: PixelModel(0.03, 0.9, density="cauchy"),
            f"must be one of {', '.join(DENSITIES)}; got 'cauchy'",
        ),
        *((lambda s=s: PixelModel(s, 0.9), "sigma must be a positive standard dev") for s in (0.0, -1, NAN)),
        *((lambda a=a: PixelModel(0.03, a), r"alpha .* probability in \(0, 1\]") for a in (0.0, 1.1, NAN)),
        (lambda: photos(shape=(150, 150, 3)), r"photos must be \(N, H, W, 3\)"),
        (lambda: photos(prior=np.zeros((1, 4, 5, 3))), "log_prior must be"),
        (lambda: photos(prior=np.full((1, 4, 4, 3), NAN)), "log_prior must be finite"),
        (lambda: photos(NAN), "NaN or infinity"),
        (lambda: photos(-1.5), "minimum of -1.5"),
        (lambda: Photos(*np.zeros((2, 1, 4, 4, 3), np.uint8)), "floating-point linear RGB; got uint8"),
        (lambda: photos(214.0), "maximum of 214. Are these 8-bit"),
        (
            lambda: Photos(torch.zeros(1, 4, 4, 3), np.zeros((1, 4, 4, 3))),  # type: ignore[arg-type]
            "photos must be arrays .* got torch.float32",
        ),
        *(
            (lambda setting=setting: SpatialMask(**setting), "must be")
            for setting in ({"coupling": -1.0}, {"rim": -0.1}, {"contrast": 0.0}, {"sweeps": 0}, {"rim": NAN})
        ),
        *((lambda s=s: density_of(s), "photo must be") for s in ((20, 20), (20, 20, 1), (20, 20, 4))),
    ],
)
def test_settings_and_photos_that_are_none(call: Callable[[], object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        call()


def test_what_does_not_fit_the_class_or_the_camera(studio, teapot) -> None:
    with pytest.raises(ValueError, match=r"transfer must be \(11, 2636, 9\) like the shape model"):
        Geometry(teapot.shape_model, transfer=np.zeros((11, 5, 9), np.float32))
    with pytest.raises(ValueError, match='"exact" or "paper"; got "soft"'):
        studio.likelihood(PHOTO, "soft")
    with pytest.raises(ValueError, match=r"photos of \(100, 150\) do not fit a camera of \(150, 150\)"):
        Likelihood(studio.geometry, studio.camera, photos(shape=(1, 100, 150, 3)))


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"photo": np.array([1])}, "photo must be from 0 to 0; they are from 1 to 1"),
        ({"photo": np.array([-1])}, "they are from -1 to -1"),
        ({"photo": np.array([0.5])}, "whole numbers, indices of photos; got float64"),
        ({"photo": np.zeros(2, int)}, r"photo must be \(1\); got \(2\)"),
        ({"sigma": np.zeros(1)}, "sigma must be positive"),
        ({"sigma": np.full(1, NAN)}, "sigma must be positive"),
        ({"points": np.zeros((1, 1))}, rf"points must be \(any, {POINT.size}\); got \(1, 1\)"),
        ({"points": np.eye(1, POINT.size, 3) * NAN}, "points must be finite; got NaN"),
    ],
)
def test_points_photos_and_noise_that_are_none(studio, changed: dict[str, np.ndarray], why: str) -> None:
    given = {"points": np.zeros((1, POINT.size)), "photo": np.zeros(1, int), "sigma": np.ones(1)}
    with pytest.raises(ValueError, match=why):
        studio.likelihood(PHOTO).at(**(given | changed))
