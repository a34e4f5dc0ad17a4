"""The alternative to our silhouettes: colours, not log-likelihoods, are blended at the edge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from vig.inference import Objective
from vig.likelihood import NEVER, mixture
from vig.render import MeshObject, Pinhole, Scene, Topology, render
from vig.scene import Camera, Latents, ObjectClass

Beyond = Literal["beside", "constant"]
Covered = Literal["share", "centre"]

REACH = 2
"""Pixels round a pixel among which the background beside it is looked for."""


@dataclass(frozen=True)
class Valued:
    """What an optimiser asks for; see `vig.optimizers.optimizer.Valued`."""

    value: torch.Tensor
    gradient: torch.Tensor | None
    normal: torch.Tensor | None


def pixel_values(
    observed: torch.Tensor,
    blended: torch.Tensor,
    share: torch.Tensor,
    log_prior: torch.Tensor,
    sigma: float,
) -> torch.Tensor:
    """log p (...) of pixels covered by `share` (...): a covered pixel's Eq. 3 of the blended colour (..., 3),
    and what a background pixel has, mixed by the share. At shares 0 and 1 this is Eq. 4.

    observed (..., 3), log_prior (..., 3): as `vig.likelihood.mixture`.
    """
    covered, _ = mixture(observed, blended, log_prior, sigma)
    # Where there is nothing to mix, log 0 is left out: its derivative would be infinite.
    some, whole = share > 0, share >= 1
    inside = torch.where(some, torch.where(some, share, 1.0).log() + covered, NEVER)
    outside = torch.where(whole, NEVER, torch.where(whole, 0.0, -share).log1p() + log_prior[..., 2])
    return torch.logaddexp(inside, outside)


def _beside(camera: Camera) -> torch.Tensor:
    """The pixels round each pixel: (H * W, 24), those beyond the frame being its border's."""
    steps = torch.arange(-REACH, REACH + 1)
    y, x = torch.arange(camera.height), torch.arange(camera.width)
    rows = (y[:, None] + steps).clamp(0, camera.height - 1)
    columns = (x[:, None] + steps).clamp(0, camera.width - 1)
    around = rows[:, None, :, None] * camera.width + columns[None, :, None, :]
    around = around.reshape(len(y) * len(x), -1)
    return around[:, torch.arange(around.shape[1]) != around.shape[1] // 2]


class ColourBlending:
    """Eq. 4 of one photo with colours blended by coverage, and the priors of `like`: a `Problem`.

    A partly covered pixel shows k mu + (1 - k) b. beyond: b is what the photo shows beside the pixel
    ("beside": the mean over the 24 pixels round it, each by how little it is covered), or the mean colour of
    the photo outside the start's silhouette ("constant"). covered: the pixel's density is mixed with a
    background pixel's by its coverage k ("share"), or it is the object's where its centre is ("centre", as
    in Eq. 4). Value and exact gradient come from the general renderer, through coverage and b, too.
    """

    def __init__(
        self,
        like: Objective,
        object_class: ObjectClass,
        start: torch.Tensor,
        beyond: Beyond = "beside",
        covered: Covered = "share",
    ):
        self.lower, self.upper, self.dtype, self.device = like.lower, like.upper, like.dtype, like.device
        self.prior, self.latents = like.prior, like.latents
        self.camera, self.beyond, self.covered = like.likelihood.camera, beyond, covered
        self.photo, self.log_prior = like.likelihood.observed[0], like.likelihood.log_prior[0]
        self.nothing, self.beside = like.likelihood.background[0], _beside(self.camera)
        self.shape_model = object_class.shape_model
        self.topology = Topology.of(self.shape_model.faces, self.shape_model.mean)
        with torch.no_grad():
            outside = self._drawn(like.latents(start))[0] < 0.5
        self.constant = self.photo[outside.flatten()].mean(0)

    def __call__(
        self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor, derivatives: bool = True
    ) -> Valued:
        """Value points (B, P') under noise sigma (B,). There is no normal matrix."""
        if derivatives:
            value, gradient, _ = self.prior.with_derivatives(points)
        else:
            value, gradient = self.prior.value(points), None
        for index, point in enumerate(points):
            moving = point.detach().clone().requires_grad_(derivatives)
            found = self.log_likelihood(moving, float(sigma[index]))
            value[index] += found.detach()
            if gradient is not None:
                gradient[index] += torch.autograd.grad(found, moving)[0]
        return Valued(value, gradient, None)

    def log_likelihood(self, point: torch.Tensor, sigma: float) -> torch.Tensor:
        """Eq. 4 with blended colours at a point (P',), float64; to be differentiated."""
        share, over_black = (image.flatten(0, 1) for image in self._drawn(self.latents(point[None])))
        here = (share > 0).nonzero()[:, 0]
        some, log_prior = share[here], self.log_prior[here]
        blended = over_black[here]
        edge = ((some > 0) & (some < 1)).nonzero()[:, 0]
        behind = (1 - some[edge])[:, None] * self._behind(share, here[edge])
        blended = blended.index_add(0, edge, behind)
        if self.covered == "centre":
            some = (some >= 0.5).to(some)
        values = pixel_values(self.photo[here], blended, some, log_prior, sigma) - log_prior[:, 2]
        return values.double().sum() + self.nothing

    def _drawn(self, latents: Latents) -> tuple[torch.Tensor, torch.Tensor]:
        """Coverage (H, W) and the object's colours times it (H, W, 3)."""
        item = MeshObject(
            self.shape_model.vertices(latents.shape)[0],
            self.topology,
            albedo=latents.albedo[0],
            light=latents.light[0],
        )
        seen = render(Scene([item], Pinhole.on_sphere(self.camera, latents.azimuth[0], latents.elevation[0])))
        return seen.coverage[0].clamp(0.0, 1.0), seen.rgb[0]

    def _behind(self, share: torch.Tensor, pixels: torch.Tensor) -> torch.Tensor:
        """b at some pixels (N,): (N, 3); share (H * W,)."""
        if self.beyond == "constant":
            return self.constant.expand(len(pixels), 3)
        beside = self.beside[pixels]
        free = (1 - 2 * share[beside]).clamp_min(0.0)
        # A thousandth of the constant colour, for pixels that see nothing beside them.
        summed = (self.photo[beside] * free[..., None]).sum(1) + 1e-3 * self.constant
        return summed / (free.sum(1) + 1e-3)[:, None]
