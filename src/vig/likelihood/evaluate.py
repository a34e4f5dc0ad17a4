"""Eq. 4 of a batch of guesses: value, exact gradient and Gauss-Newton matrix from one pass."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch
import warp as wp

from vig.likelihood.kernels import likelihood_kernels
from vig.render import NOTHING, Geometry, raster_kernels, shade_vertices, warp_array
from vig.scene import Camera, Latents

BOUNDARY_ROWS = 8192
"""Rows kept for occlusion edges, beyond one row for each pixel."""

BOUNDARY_CURVATURE = 0.5
"""Share of an edge's gain per pixel that counts as curvature per pixel squared in the normal matrix."""

_COLOUR_CHANNELS = 3


@dataclass(frozen=True)
class Photos:
    """N photos of one size and what is believed of their pixels before any fit.

    linear (N, H, W, 3): linear RGB in [0, 1]. log_prior (N, H, W, 3): see `pixel.PixelModel.log_prior`.
    """

    linear: torch.Tensor
    log_prior: torch.Tensor

    def __post_init__(self) -> None:
        if self.linear.ndim != 4 or self.linear.shape[-1] != 3:
            raise ValueError(f"photos must be (N, H, W, 3) linear RGB; got {tuple(self.linear.shape)}")
        if self.log_prior.shape != self.linear.shape:
            raise ValueError(
                f"log_prior must be {tuple(self.linear.shape)} like the photos;"
                f" got {tuple(self.log_prior.shape)}"
            )
        if not torch.isfinite(self.linear).all():
            raise ValueError("photos must be finite linear RGB; got NaN or infinity")
        if self.linear.numel() and self.linear.max() > 8:
            raise ValueError(
                f"photos must be linear RGB in [0, 1]; got a maximum of {float(self.linear.max()):g}."
                " Are these 8-bit values? Decode them first."
            )


@dataclass(frozen=True)
class Evaluation:
    """Eq. 4 at B guesses. P' = P + 3: the latents in their order, then the framing.

    value (B,): log-likelihood in nats, float64. gradient (B, P'), normal (B, P', P'): its derivative and its
    negative Gauss-Newton Hessian; None when not asked for. posterior (B, H, W): of a covered pixel being
    visible. coverage (B, H, W): of the silhouette, in [0, 1]. irradiance (B, H, W): rendered colour is
    albedo times this.
    """

    value: torch.Tensor
    gradient: torch.Tensor | None
    normal: torch.Tensor | None
    posterior: torch.Tensor
    coverage: torch.Tensor
    irradiance: torch.Tensor


class Likelihood:
    """Eq. 4 for a set of photos, a class's geometry and a camera, on one device and in one precision.

    silhouette: "exact" moves the objective with the silhouette, "paper" keeps the mask constant within an
    evaluation as the authors' gradient does.
    """

    def __init__(self, geometry: Geometry, camera: Camera, photos: Photos, silhouette: str = "exact"):
        if silhouette not in ("exact", "paper"):
            raise ValueError(f'silhouette must be "exact" or "paper"; got "{silhouette}"')
        size = tuple(photos.linear.shape[1:3])
        if size != (camera.height, camera.width):
            raise ValueError(f"photos of {size} do not fit a camera of {(camera.height, camera.width)}")
        self.geometry, self.camera, self.silhouette = geometry, camera, silhouette
        count = len(photos.linear)
        self.observed = photos.linear.to(geometry.device, geometry.dtype).reshape(count, -1, 3).contiguous()
        self.log_prior = (
            photos.log_prior.to(geometry.device, geometry.dtype).reshape(count, -1, 3).contiguous()
        )
        k = likelihood_kernels(geometry.dtype, geometry.layout.modes)
        self._observed, self._log_prior = (
            warp_array(self.observed, k.vec3),
            warp_array(self.log_prior, k.vec3),
        )
        self._background = self.log_prior[..., 2].contiguous()

    def __call__(
        self,
        latents: Latents,
        framing: torch.Tensor,
        photo: torch.Tensor,
        sigma: torch.Tensor,
        derivatives: bool = True,
    ) -> Evaluation:
        """Evaluate B guesses; photo (B,) int says which photo each explains, sigma (B,) its noise."""
        geometry, camera = self.geometry, self.camera
        dtype, count, width, height = geometry.dtype, len(latents), camera.width, camera.height
        size = (count, height * width)
        k = likelihood_kernels(dtype, geometry.layout.modes)
        scratch = geometry.scratch.of(count, height, width)
        state = shade_vertices(geometry, camera, latents, framing, scratch)
        launch = functools.partial(wp.launch, device=geometry.device)
        keys, keys_wp = scratch.get("keys", (count, height, width), torch.int64, wp.int64)
        _, facing = scratch.get("facing", (count, len(geometry.faces)), torch.uint8, wp.uint8)
        launch(
            raster_kernels(dtype).rasterize_faces,
            dim=(count, len(geometry.faces)),
            inputs=[
                state.points,
                geometry.faces_wp,
                state.intrinsics,
                width,
                height,
                1,
                _filled(keys, keys_wp, NOTHING),
                facing,
            ],
        )
        keep, keep_wp = scratch.get("keep", size, dtype, k.real)
        extra, extra_wp = scratch.get("extra", size, dtype, k.real)
        row_count, row_count_wp = scratch.get("row_count", (count,), torch.int32, wp.int32)
        row_shape = (count, height * width + BOUNDARY_ROWS, geometry.layout.width)
        rows, rows_wp = scratch.get("rows", row_shape, dtype, k.row_type)
        weighted, weighted_wp = scratch.get("weighted", row_shape, dtype, k.row_type)
        flat_keys = keys_wp.reshape(size)
        covered = keys.view(size) != NOTHING
        coverage = covered.to(dtype)
        shaded = [state.attributes, state.irradiances]
        scene = [
            state.rotation,
            state.intrinsics,
            camera.distance,
            scratch.put("albedo", latents.albedo, dtype, k.vec3),
            flat_keys,
            self._observed,
            self._log_prior,
            scratch.put("photo", photo, torch.int32, wp.int32),
            scratch.put("sigma", sigma, dtype, k.real),
        ]
        shared = [_filled(keep, keep_wp, 1.0), _filled(extra, extra_wp, 0.0)]
        derived = [_filled(row_count, row_count_wp, 0), rows_wp, weighted_wp]
        if self.silhouette == "exact":
            rim_count, rim_count_wp = scratch.get("rim_count", (count,), torch.int32, wp.int32)
            _, rims = scratch.get("rims", (count, len(geometry.edges)), torch.int32, wp.int32)
            launch(
                k.collect_rims,
                dim=(count, len(geometry.edges)),
                inputs=[geometry.edges_wp, facing, _filled(rim_count, rim_count_wp, 0), rims],
            )
            launch(
                k.boundary,
                dim=(count, int(rim_count.max())),
                inputs=[
                    state.points,
                    state.normals,
                    state.inverse_lengths,
                    *shaded,
                    state.normal_rates,
                    geometry.basis_wp(k.row_type),
                    geometry.faces_wp,
                    geometry.edges_wp,
                    facing,
                    rim_count_wp,
                    rims,
                    width,
                    height,
                    *scene,
                    BOUNDARY_CURVATURE,
                    int(derivatives),
                    *shared,
                    warp_array(coverage, k.real),
                    *derived,
                ],
            )
        background = self._background[photo.to(geometry.device).long()]
        log_likelihood = torch.where(covered, 0.0, keep * background + extra)
        posterior, irradiance = torch.zeros_like(coverage), torch.zeros_like(coverage)
        pixels = covered.nonzero()
        launch(
            k.interior,
            dim=len(pixels),
            inputs=[
                state.points,
                *shaded,
                geometry.basis_wp(k.row_type),
                geometry.faces_wp,
                width,
                *scene,
                int(derivatives),
                *shared,
                warp_array(pixels, wp.int64),
                *(warp_array(image, k.real) for image in (log_likelihood, posterior, irradiance)),
                *derived,
            ],
        )
        gradient = normal = None
        if derivatives:
            used = row_count.clamp_max(row_shape[1])
            gradient, normal = self._assemble(rows, weighted, used, latents.albedo.to(dtype))
        images = (image.view(keys.shape) for image in (posterior, coverage.clamp_(0.0, 1.0), irradiance))
        return Evaluation(log_likelihood.double().sum(1), gradient, normal, *images)

    def _assemble(
        self, rows: torch.Tensor, weighted: torch.Tensor, used: torch.Tensor, albedo: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Gradient (B, P') and normal matrix (B, P', P') of the latents and framing from the rows.

        A colour channel's row is albedo times the shared row, and irradiance in that channel's albedo place;
        summed over the channels only |albedo|^2, albedo and 1 are left of them.
        """
        layout = self.geometry.layout
        products = torch.stack(
            [row[:n].T @ scaled[:n] for row, scaled, n in zip(rows, weighted, used.tolist(), strict=True)]
        )
        # Into the latents' order: what is before the light, albedo's three places, light and framing.
        first, then = layout.light, layout.irradiance
        square = (albedo * albedo).sum(1).clamp_min(1e-6)
        by_irradiance = products[:, then]
        spread = torch.diag_embed(by_irradiance[:, then, None].expand(-1, _COLOUR_CHANNELS))

        def blocks(head: torch.Tensor, colour: torch.Tensor, tail: torch.Tensor, dim: int) -> torch.Tensor:
            return torch.cat([head, colour, tail], dim=dim)

        def plain(table: torch.Tensor, dim: int) -> tuple[torch.Tensor, torch.Tensor]:
            after = [
                table.narrow(dim, first, then - first),
                table.narrow(dim, then + 1, layout.used - then - 1),
            ]
            return table.narrow(dim, 0, first), torch.cat(after, dim=dim)

        scaled = products[:, : layout.used, : layout.used] * square[:, None, None]
        cross = by_irradiance[:, : layout.used, None] * albedo[:, None, :]
        head, tail = plain(scaled, 2)
        with_colour = blocks(head, cross, tail, 2)
        top, bottom = plain(with_colour, 1)
        across, along = plain(cross, 1)
        middle = blocks(across.mT, spread, along.mT, 2)
        normal = blocks(top, middle, bottom, 1)
        slope_head, slope_tail = plain(products[:, : layout.used, layout.used], 1)
        colours = by_irradiance[:, layout.used + 1 : layout.used + 1 + _COLOUR_CHANNELS]
        return blocks(slope_head, colours, slope_tail, 1), normal


def _filled(tensor: torch.Tensor, view: wp.array, value: float) -> wp.array:
    """Fill a scratch tensor and hand on its view."""
    tensor.fill_(value)
    return view
