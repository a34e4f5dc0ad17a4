"""Eq. 4 of a batch of guesses: value, exact gradient and Gauss-Newton matrix from one pass."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp

from vig.likelihood.kernels import likelihood_kernels
from vig.render import NOTHING, Geometry, raster_kernels, shade_vertices, warp_array
from vig.scene import Camera, Latents

FRAMING_COUNT = 3
BOUNDARY_ROWS = 8192
"""Rows kept for occlusion edges, beyond one row for each pixel."""

BOUNDARY_CURVATURE = 2.0
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
    albedo times this. depth key (B, H, W): below NOTHING where the object covers the pixel's centre.
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
        self._buffers: dict[int, tuple[dict[str, torch.Tensor], dict[str, wp.array]]] = {}

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
        dtype, device = geometry.dtype, geometry.device
        state = shade_vertices(geometry, camera, latents, framing)
        count, height, width = len(latents), camera.height, camera.width
        buffer, view = self._buffers_for(count)
        k = likelihood_kernels(dtype, geometry.layout.modes)
        buffer["keys"].fill_(NOTHING)
        buffer["keep"].fill_(1.0)
        for name in ("extra", "rim_count", "pixel_count", "row_count"):
            buffer[name].zero_()
        points, faces = warp_array(state.points, k.vec3), warp_array(geometry.faces, wp.int32)
        intrinsics, rotation = warp_array(state.intrinsics, k.vec3), warp_array(state.rotation, k.mat33)
        launch = functools.partial(wp.launch, device=device)
        launch(
            raster_kernels(dtype).rasterize_faces,
            dim=(count, len(geometry.faces)),
            inputs=[points, faces, intrinsics, width, height, 1, view["keys"], view["facing"]],
        )
        coverage = (buffer["keys"] != NOTHING).to(dtype)
        log_likelihood, posterior, irradiance = (torch.empty_like(coverage) for _ in range(3))
        maps = [warp_array(m.view(count, -1), k.real) for m in (log_likelihood, posterior, irradiance)]
        shaded = [warp_array(state.attributes, k.row_type), warp_array(state.irradiances, k.real)]
        basis, edges = warp_array(geometry.basis, k.row_type), warp_array(geometry.edges, wp.int32)
        log_prior = warp_array(self.log_prior, k.vec3)
        photo_wp = warp_array(photo.to(device, torch.int32).contiguous(), wp.int32)
        scene = [
            rotation,
            intrinsics,
            camera.distance,
            warp_array(latents.albedo.to(dtype).contiguous(), k.vec3),
            view["flat_keys"],
            warp_array(self.observed, k.vec3),
            log_prior,
            photo_wp,
            warp_array(sigma.to(device, dtype).contiguous(), k.real),
        ]
        if self.silhouette == "exact":
            launch(
                k.collect_rims,
                dim=(count, len(geometry.edges)),
                inputs=[edges, view["facing"], view["rim_count"], view["rims"]],
            )
            launch(
                k.boundary,
                dim=(count, int(buffer["rim_count"].max())),
                inputs=[
                    points,
                    warp_array(state.normals, k.vec3),
                    warp_array(state.inverse_lengths, k.real),
                    *shaded,
                    warp_array(state.normal_rates, k.normal_jacobian),
                    basis,
                    faces,
                    edges,
                    *(view[name] for name in ("facing", "rim_count", "rims")),
                    width,
                    height,
                    *scene,
                    BOUNDARY_CURVATURE,
                    int(derivatives),
                    view["keep"],
                    view["extra"],
                    warp_array(coverage.view(count, -1), k.real),
                    *(view[name] for name in ("row_count", "rows", "weighted")),
                ],
            )
        keep_extra = [view["keep"], view["extra"]]
        pixels = [view["pixel_count"], view["pixels"]]
        launch(
            k.collect_pixels,
            dim=(count, height * width),
            inputs=[view["flat_keys"], log_prior, photo_wp, *keep_extra, *maps, *pixels],
        )
        launch(
            k.interior,
            dim=(count, int(buffer["pixel_count"].max())),
            inputs=[
                points,
                *shaded,
                basis,
                faces,
                width,
                *scene,
                int(derivatives),
                *keep_extra,
                *pixels,
                *maps,
                *(view[name] for name in ("row_count", "rows", "weighted")),
            ],
        )
        value = log_likelihood.view(count, -1).sum(1, dtype=torch.float64)
        gradient = normal = None
        if derivatives:
            gradient, normal = self._assemble(buffer, latents.albedo.to(dtype))
        return Evaluation(value, gradient, normal, posterior, coverage.clamp_(0.0, 1.0), irradiance)

    def _views(self, buffer: dict[str, torch.Tensor]) -> dict[str, wp.array]:
        """The scratch as Warp sees it."""
        k = likelihood_kernels(self.geometry.dtype, self.geometry.layout.modes)
        kinds = {"keys": wp.int64, "facing": wp.uint8, "keep": k.real, "extra": k.real}
        kinds |= {"rows": k.row_type, "weighted": k.row_type}
        views = {name: warp_array(tensor, kinds.get(name, wp.int32)) for name, tensor in buffer.items()}
        views["flat_keys"] = warp_array(buffer["keys"].view(len(buffer["keys"]), -1), wp.int64)
        return views

    def _buffers_for(self, count: int) -> tuple[dict[str, torch.Tensor], dict[str, wp.array]]:
        """Scratch of a batch size, kept from call to call, as torch and as Warp see it."""
        if count not in self._buffers:
            options: dict[str, Any] = {"dtype": self.geometry.dtype, "device": self.geometry.device}
            size = (count, self.camera.height, self.camera.width)
            row_count = size[1] * size[2] + BOUNDARY_ROWS
            integer: dict[str, Any] = {"dtype": torch.int32, "device": self.geometry.device}
            buffer = {
                "keys": torch.empty(size, dtype=torch.int64, device=self.geometry.device),
                "facing": torch.empty(
                    count, len(self.geometry.faces), dtype=torch.uint8, device=self.geometry.device
                ),
                "keep": torch.empty(count, size[1] * size[2], **options),
                "extra": torch.empty(count, size[1] * size[2], **options),
                "rim_count": torch.empty(count, **integer),
                "rims": torch.empty(count, len(self.geometry.edges), **integer),
                "pixel_count": torch.empty(count, **integer),
                "pixels": torch.empty(count, size[1] * size[2], **integer),
                "row_count": torch.empty(count, **integer),
                "rows": torch.empty(count, row_count, self.geometry.layout.width, **options),
                "weighted": torch.empty(count, row_count, self.geometry.layout.width, **options),
            }
            self._buffers[count] = buffer, self._views(buffer)
        return self._buffers[count]

    def _assemble(
        self, buffer: dict[str, torch.Tensor], albedo: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Gradient (B, P') and normal matrix (B, P', P') of the latents and framing from the rows."""
        layout = self.geometry.layout
        rows, weighted = buffer["rows"], buffer["weighted"]
        used = buffer["row_count"].clamp_max(rows.shape[1])
        products = torch.stack(
            [
                row[:n].T @ by_weight[:n]
                for row, by_weight, n in zip(rows, weighted, used.tolist(), strict=True)
            ]
        )
        # Columns of a row in the order of the latents, albedo's three places left out.
        plain = [*range(layout.light), *range(layout.light, layout.irradiance)]
        plain += range(layout.framing, layout.used)
        plain_at = torch.tensor(plain, device=rows.device)
        count, before = len(products), layout.light
        total = len(plain) + _COLOUR_CHANNELS
        targets = torch.tensor(
            [i if i < before else i + _COLOUR_CHANNELS for i in range(len(plain))], device=rows.device
        )
        colours = torch.arange(before, before + _COLOUR_CHANNELS, device=rows.device)
        gradient = products.new_empty(count, total)
        gradient[:, targets] = products[:, plain_at, layout.used]
        gradient[:, colours] = products[:, layout.irradiance, layout.used + 1 : layout.used + 4]
        normal = products.new_zeros(count, total, total)
        square = (albedo * albedo).sum(1).clamp_min(1e-6)
        normal[:, targets[:, None], targets] = (
            products[:, plain_at[:, None], plain_at] * square[:, None, None]
        )
        cross = products[:, plain_at, layout.irradiance][:, :, None] * albedo[:, None, :]
        normal[:, targets[:, None], colours] = cross
        normal[:, colours[:, None], targets] = cross.transpose(1, 2)
        normal[:, colours, colours] = products[:, layout.irradiance, layout.irradiance][:, None]
        return gradient, normal
