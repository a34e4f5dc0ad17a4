"""Eq. 4 of a batch of guesses: value, exact gradient and Gauss-Newton matrix from one pass."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp

from vig.likelihood.kernels.geometry import Geometry
from vig.likelihood.kernels.load import likelihood_kernels, load_kernels
from vig.likelihood.passes import Pass
from vig.parallel.threads import on_one_core, run_on_threads, thread_count
from vig.scene import Camera, Latents, latent_layout
from vig.search.native_descent import Valuation
from vig_renderer import warp_array

CURVATURE_LINES = 75
"""Lines of pixels that enter the normal matrix, unless a stride is given."""

FREE_POINTS = 64
"""Points of idle passes that a geometry keeps for reuse: 2.5 MB each at 150 pixels."""


@dataclass(frozen=True)
class Photos:
    """N photos of one size and the prior of their pixels.

    Attributes:
        linear: (N, H, W, 3) linear RGB in [0, 1].
        log_prior: (N, H, W, 3), see `pixel.PixelModel.log_prior`.
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
        if not self.linear.is_floating_point() or not self.log_prior.is_floating_point():
            raise ValueError(
                f"photos must be floating-point linear RGB; got {self.linear.dtype} and a log_prior of"
                f" {self.log_prior.dtype}. Divide 8-bit values by 255 and decode them."
            )
        if not torch.isfinite(self.log_prior).all():
            raise ValueError("log_prior must be finite; got NaN or infinity. NEVER stands for log 0")
        if not torch.isfinite(self.linear).all():
            raise ValueError("photos must be finite linear RGB; got NaN or infinity")
        if self.linear.numel() and self.linear.min() < -1:
            raise ValueError(
                f"photos must be linear RGB in [0, 1]; got a minimum of {float(self.linear.min()):g}."
                " Clip them."
            )
        if self.linear.numel() and self.linear.max() > 8:
            raise ValueError(
                f"photos must be linear RGB in [0, 1]; got a maximum of {float(self.linear.max()):g}."
                " Are these 8-bit values? Decode them first."
            )


@dataclass(frozen=True)
class Evaluation:
    """Eq. 4 at B points of P' numbers each: latents, then framing. Results not requested are None.

    Attributes:
        value: (B,) log-likelihood in nats, float64.
        gradient: (B, P') its derivative.
        normal: (B, P', P') its negative Gauss-Newton Hessian.
        posterior: (B, H, W) of a covered pixel being visible.
        coverage: (B, H, W) of the silhouette, in [0, 1].
        irradiance: (B, H, W); the rendered colour is albedo times this.
    """

    value: torch.Tensor
    gradient: torch.Tensor | None
    normal: torch.Tensor | None
    posterior: torch.Tensor | None
    coverage: torch.Tensor | None
    irradiance: torch.Tensor | None


class Likelihood:
    """Eq. 4 for a set of photos, a class's geometry and a camera, on one device and in one precision.

    Args:
        geometry: The class's mesh and shape components.
        camera: Of the photos; their size.
        photos: What is explained.
        silhouette: "exact" moves the objective with the silhouette, "paper" keeps the mask constant within an
            evaluation as the authors' gradient does.
        stride: Every stride-th pixel of every stride-th line stands for its square in the normal matrix, by
            default as many as make about 75 x 75 of any image; value and gradient always take every pixel.
        density: Of the noise of visible pixels, see `vig.likelihood.densities`.

    Attributes:
        layout: The blocks of a point, latents then framing.
    """

    def __init__(
        self,
        geometry: Geometry,
        camera: Camera,
        photos: Photos,
        silhouette: str = "exact",
        stride: int | None = None,
        density: str = "gaussian",
    ):
        if silhouette not in ("exact", "paper"):
            raise ValueError(f'silhouette must be "exact" or "paper"; got "{silhouette}"')
        if stride is None:
            stride = max(1, round(max(camera.height, camera.width) / CURVATURE_LINES))
        if stride < 1:
            raise ValueError(f"stride must be 1 pixel or more; got {stride}")
        size = tuple(photos.linear.shape[1:3])
        if size != (camera.height, camera.width):
            raise ValueError(f"photos of {size} do not fit a camera of {(camera.height, camera.width)}")
        self.geometry, self.camera, self.silhouette, self.stride = geometry, camera, silhouette, stride
        self.layout = geometry.layout
        count = len(photos.linear)
        self.observed = photos.linear.to(geometry.device, geometry.dtype).reshape(count, -1, 3).contiguous()
        self.log_prior = (
            photos.log_prior.to(geometry.device, geometry.dtype).reshape(count, -1, 3).contiguous()
        )
        self.background = self.log_prior[..., 2].double().sum(1)
        load_kernels(geometry.dtype, geometry.rows.modes, geometry.device, density)
        self.density = density
        k = likelihood_kernels(geometry.dtype, geometry.rows.modes, density)
        self.photo_arrays = {
            "observed": warp_array(self.observed, k.vec3),
            "log_prior": warp_array(self.log_prior, k.vec3),
            "background": warp_array(self.background, wp.float64),
        }
        self.camera_arguments = {
            "camera": k.vec3(camera.focal, camera.cx, camera.cy),
            "target": k.vec3(0.0, 0.0, camera.target_height),
            "distance": camera.distance,
        }
        self.kind = camera.width, camera.height, silhouette, self.stride, density
        """What likelihoods must have in common for a pass to serve both."""

    def __call__(
        self,
        latents: Latents,
        framing: torch.Tensor,
        photo: torch.Tensor,
        sigma: torch.Tensor,
        derivatives: bool = True,
        images: bool = True,
        curvature: bool = True,
    ) -> Evaluation:
        """Evaluate B guesses; photo (B,) int is the photo that each explains, sigma (B,) its noise.

        Numbers of further blocks of the layout are 0.
        """
        vector = latents.to_vector()
        points = vector.new_zeros(len(vector), self.layout.size)
        parts = latent_layout(latents.shape.shape[1]).split(vector) | {"framing": framing}
        for name, numbers in parts.items():
            points[:, self.layout[name]] = numbers.to(points)
        return self.at(points, photo, sigma, derivatives, images, curvature)

    def at(
        self,
        points: torch.Tensor,
        photo: torch.Tensor,
        sigma: torch.Tensor,
        derivatives: bool = True,
        images: bool = False,
        curvature: bool = True,
    ) -> Evaluation:
        """Evaluate points (B, P'), latents followed by framing; else as a call.

        Without curvature there is a gradient but no normal matrix, for searches of first order.

        On the CPU points are shared out to as many threads as torch has (`torch.set_num_threads`), each
        taking one at a time, so that what it works on stays in its cache; on a GPU all go in one batch.
        """
        points = points.to(self.geometry.dtype)
        self._check(points, photo, sigma)
        count = len(points)
        # On a processor each thread takes one point at a time, whose data stay in its cache.
        group = 1 if self.geometry.device == "cpu" else max(count, 1)
        threads = min(thread_count(), count) if self.geometry.device == "cpu" else min(count, 1)
        size = self.layout.size
        place: dict[str, Any] = {"dtype": self.geometry.dtype, "device": self.geometry.device}
        value = torch.empty(count, dtype=torch.float64, device=self.geometry.device)
        gradient = torch.empty(count, size, **place) if derivatives else None
        normal = torch.empty(count, size, size, **place) if derivatives and curvature else None
        order = int(derivatives) + int(derivatives and curvature)
        pixels = self.camera.height * self.camera.width
        shown = [torch.empty(count, pixels, **place) for _ in range(3)] if images else []
        given = list(zip(*(each.split(group) for each in (points, photo, sigma)), strict=True))
        wanted = [each for each in (value, gradient, normal, *shown) if each is not None]
        outputs = list(zip(*(each.split(group) for each in wanted), strict=True))

        def every(start: int) -> None:
            with self._pass(group) as run:
                results = [run.value, *(run.gradient, run.normal)[:order], *(run.images if images else ())]
                for part in range(start, len(given), threads):
                    point, number, noise = given[part]
                    run(point, number, noise, order, images)
                    for output, result in zip(outputs[part], results, strict=True):
                        output.copy_(result)

        on_one_core(lambda: run_on_threads(every, threads))
        shape = count, self.camera.height, self.camera.width
        posterior, coverage, irradiance = (image.view(shape) for image in shown) if images else [None] * 3
        if coverage is not None:
            coverage = coverage.clamp_(0.0, 1.0)
        return Evaluation(value, gradient, normal, posterior, coverage, irradiance)

    @contextmanager
    def valuation(self, photo: int, sigma: float, derivatives: bool = True) -> Iterator[Valuation | None]:
        """How native code values a point of a photo, with its derivatives or alone; None where it cannot.

        For one thread: its memory is that of a pass, which is lent until the block ends.
        """
        if self.geometry.device != "cpu" or not (0 <= photo < len(self.observed) and 0 < sigma < math.inf):
            yield None
            return
        with self._pass(1) as run:
            run.photo.fill_(photo)
            run.sigma.fill_(sigma)
            yield run.valuation(derivatives)

    def _check(self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor) -> None:
        """Raise ValueError for input that kernels do not check: out-of-range indices, NaN."""
        size, count = self.layout.size, len(points)
        if points.ndim != 2 or points.shape[1] != size:
            raise ValueError(f"points must be (B, {size}), latents and framing; got {tuple(points.shape)}")
        if not torch.isfinite(points).all():
            at = (~torch.isfinite(points)).nonzero()[0].tolist()
            raise ValueError(
                f"points must be finite; got {float(points[*at])} in column {at[1]} of point {at[0]}"
            )
        if photo.shape != (count,) or sigma.shape != (count,):
            raise ValueError(
                f"photo and sigma must be ({count},) like the points;"
                f" got {tuple(photo.shape)} and {tuple(sigma.shape)}"
            )
        if photo.is_floating_point() or photo.is_complex():
            raise ValueError(f"photo must be whole numbers, indices of photos; got {photo.dtype}")
        if not count:
            return
        first, last = (int(end) for end in photo.aminmax())
        if first < 0 or last >= len(self.observed):
            raise ValueError(
                f"photo must be indices of the {len(self.observed)} photos; got {first} to {last}"
            )
        least, most = (float(end) for end in sigma.aminmax())
        if not (least > 0 and most < math.inf):
            raise ValueError(
                f"sigma must be positive standard deviations in linear RGB; got {sigma.tolist()}"
            )

    @contextmanager
    def _pass(self, count: int) -> Iterator[Pass]:
        """An idle pass over `count` points: one of these photos, one of others, or a new one.

        Recording launches takes longer than running them all once, so passes outlive a likelihood.
        """
        free = self.geometry.kept.setdefault("passes", [])
        fitting = [run for run in list(free) if run.kind == (count, *self.kind)]
        borrowed = None
        for run in sorted(fitting, key=lambda run: not run.looks_at(self)):
            with suppress(ValueError):
                free.remove(run)
                borrowed = run
                break
        if borrowed is None:
            borrowed = Pass(self, count)
        elif not borrowed.looks_at(self):
            borrowed.look_at(self)
        try:
            yield borrowed
        finally:
            free.append(borrowed)
            with suppress(IndexError):
                while len(free) > 1 and sum(run.count for run in list(free)) > FREE_POINTS:
                    free.pop(0)
