"""One edge in one pixel: what blending colours and what blending log-likelihoods say of its place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from vig.likelihood import PixelModel, mixture

PULL = 0.1
"""Nats per pixel from which an edge counts as pulled."""


@dataclass(frozen=True)
class Edge:
    """The edge's pixel, at N guessed places of the edge in it: (N,) float64 each.

    posterior: of the pixel being visible under the blended colour. colours, likelihoods: derivatives of the
    objective with respect to the place, in nats per pixel, outwards, when either is blended.
    colours_value, likelihoods_value: the objective itself, nats.
    """

    posterior: torch.Tensor
    colours: torch.Tensor
    likelihoods: torch.Tensor
    colours_value: torch.Tensor
    likelihoods_value: torch.Tensor


def edge(place: torch.Tensor, true_place: float, contrast: float, model: PixelModel) -> Edge:
    """What each way of blending says of an edge guessed at `place` (N,) in a pixel and truly at `true_place`.

    Both are in [0, 1]: the share of the pixel that the object covers; 0 and 1 stand for an edge that truly
    lies in another pixel. contrast: distance of the object's colour from the background's in linear RGB.
    The background's colour is taken as known, the best case for blending colours.
    """
    background = torch.full((3,), 0.5, dtype=torch.float64)
    inside = background + contrast / math.sqrt(3)
    observed = background + true_place * (inside - background)
    log_prior = model.log_prior(1, len(place))[0]
    at = place.double().clone().requires_grad_()
    blended = background + at[:, None] * (inside - background)
    value, posterior = mixture(observed, blended, log_prior, model.sigma)
    (slope,) = torch.autograd.grad(value.sum(), at)
    fit, _ = mixture(observed, inside, log_prior, model.sigma)
    gain = fit - log_prior[:, 2]
    return Edge(posterior.detach(), slope, gain, value.detach(), log_prior[:, 2] + at.detach() * gain)


def reach(contrast: float, model: PixelModel) -> tuple[float, float]:
    """Of the places in pixels that are all object or all background, the share from which the edge is pulled
    the right way by `PULL`: for colours and for log-likelihoods."""
    places = torch.linspace(0.0, 1.0, 1001)
    inside, outside = edge(places, 1.0, contrast, model), edge(places, 0.0, contrast, model)
    colours = (inside.colours > PULL).double() + (outside.colours < -PULL).double()
    likelihoods = (inside.likelihoods > PULL).double() + (outside.likelihoods < -PULL).double()
    return float(colours.mean() / 2), float(likelihoods.mean() / 2)


def errors(contrast: float, model: PixelModel) -> np.ndarray:
    """By how much the maximum within the true edge's own pixel is off, over 100 places of the edge.

    (100, 2) pixels, outwards, for colours and for log-likelihoods.
    """
    places, off = torch.linspace(0.0, 1.0, 1001), []
    for true_place in np.linspace(0.005, 0.995, 100).tolist():
        found = edge(places, true_place, contrast, model)
        values = found.colours_value, found.likelihoods_value
        off.append([float(places[value.argmax()]) - true_place for value in values])
    return np.array(off)


def show(model: PixelModel) -> dict[str, Any]:
    """Print and return what `edge`, `reach` and `errors` say."""
    report: dict[str, Any] = {}
    print("An edge of contrast 0.5, guessed in the middle of a pixel; derivatives in nats per pixel outwards")
    for name, true_place in (("object", 1.0), ("background", 0.0)):
        found = edge(torch.tensor([0.5]), true_place, 0.5, model)
        report[f"all {name}"] = {
            "posterior": float(found.posterior),
            "colours": float(found.colours),
            "likelihoods": float(found.likelihoods),
        }
        print(
            f"  the pixel is all {name}: posterior {float(found.posterior):.1e}, colours"
            f" {float(found.colours):+.1e}, log-likelihoods {float(found.likelihoods):+.2f}"
        )
    print("\n| contrast | pulled the right way | off by, in its own pixel | on the mean |\n|---|---|---|---|")
    for contrast in (0.1, 0.2, 0.3, 0.5):
        pulled, off = reach(contrast, model), errors(contrast, model)
        report[f"contrast {contrast}"] = {
            "reach": pulled,
            "error": np.abs(off).mean(0).tolist(),
            "bias": off.mean(0).tolist(),
        }
        print(
            f"| {contrast} | {pulled[0]:.0%}, {pulled[1]:.0%} |"
            f" {np.abs(off).mean(0)[0]:.2f}, {np.abs(off).mean(0)[1]:.2f} |"
            f" {off.mean(0)[0]:+.2f}, {off.mean(0)[1]:+.2f} |"
        )
    return report
