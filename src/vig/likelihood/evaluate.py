"""Eq. 4 of a batch of guesses: value, exact gradient and Gauss-Newton matrix from one pass."""

import math
from dataclasses import dataclass

import numpy as np

from vig.likelihood.geometry import Geometry
from vig.likelihood.pixel import DEFAULT_DENSITY, DENSITIES
from vig.parallel.threads import thread_count
from vig.scene import Camera
from vig.search.optimizer import Evaluation
from vig_native import engine

CURVATURE_LINES = 75  # lines of pixels that enter the normal matrix, unless a stride is given


@dataclass(frozen=True)
class Photos:
    """N photos of one size and the prior of their pixels.

    Attributes:
        linear: (N, H, W, 3) linear RGB in [0, 1].
        log_prior: (N, H, W, 3), see `pixel.PixelModel.log_prior`.
    """

    linear: np.ndarray
    log_prior: np.ndarray

    def __post_init__(self) -> None:
        if self.linear.ndim != 4 or self.linear.shape[-1] != 3:
            raise ValueError(f"photos must be (N, H, W, 3) linear RGB; got {tuple(self.linear.shape)}")
        if self.log_prior.shape != self.linear.shape:
            raise ValueError(
                f"log_prior must be {tuple(self.linear.shape)} like the photos;"
                f" got {tuple(self.log_prior.shape)}"
            )
        both = self.linear, self.log_prior
        if not all(isinstance(each, np.ndarray) and np.issubdtype(each.dtype, np.floating) for each in both):
            raise ValueError(
                f"photos must be arrays of floating-point linear RGB; got {self.linear.dtype} and a log_prior"
                f" of {self.log_prior.dtype}. Divide 8-bit values by 255 and decode them."
            )
        if not self.linear.size:
            return
        # NaN is the least and the most of any numbers that it is among.
        if not all(math.isfinite(end) for end in (self.log_prior.min(), self.log_prior.max())):
            raise ValueError("log_prior must be finite; got NaN or infinity. NEVER stands for log 0")
        least, most = float(self.linear.min()), float(self.linear.max())
        if not (math.isfinite(least) and math.isfinite(most)):
            raise ValueError("photos must be finite linear RGB; got NaN or infinity")
        if least < -1:
            raise ValueError(f"photos must be linear RGB in [0, 1]; got a minimum of {least:g}. Clip them.")
        if most > 8:
            raise ValueError(
                f"photos must be linear RGB in [0, 1]; got a maximum of {most:g}."
                " Are these 8-bit values? Decode them first."
            )


class Likelihood:
    """Eq. 4 for a set of photos, a class's geometry and a camera, in one precision.

    Args:
        geometry: The class's mesh and shape components.
        camera: Camera of the photos; their size.
        photos: Photos to explain.
        silhouette: "exact" moves the objective with the silhouette, "paper" keeps the mask constant within an
            evaluation as the authors' gradient does.
        stride: Every stride-th pixel of every stride-th line stands for its square in the normal matrix, by
            default as many as make about 75 x 75 of any image; value and gradient always take every pixel.
        density: Noise density of visible pixels, one of `DENSITIES`.

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
        density: str = DEFAULT_DENSITY,
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
        self.layout, self.density = geometry.layout, density
        shape = len(photos.linear), camera.height * camera.width, 3
        self.observed = np.ascontiguousarray(photos.linear, geometry.dtype).reshape(shape)
        self.log_prior = np.ascontiguousarray(photos.log_prior, geometry.dtype).reshape(shape)
        eye = camera.focal, camera.cx, camera.cy, camera.target_height, camera.distance
        self.native = engine.photos(
            (*eye, camera.width, camera.height),
            self.observed,
            self.log_prior,
            stride,
            silhouette == "exact",
            DENSITIES.index(density),
        )
        """The same photos for the native library."""

    def at(
        self,
        points: np.ndarray,
        photo: np.ndarray,
        sigma: np.ndarray,
        derivatives: bool = True,
        images: bool = False,
        curvature: bool = True,
    ) -> Evaluation:
        """Evaluate points (B, P'), latents then framing, of photos (B,) int under noise sigma (B,).

        Without curvature there is a gradient but no normal matrix, for searches of first order.

        Points are shared out to `vig.parallel.thread_count` threads.
        """
        photo, points = np.asarray(photo), np.ascontiguousarray(points, self.geometry.dtype)
        sigma = np.ascontiguousarray(sigma, np.float64)
        if not np.isfinite(points).all():
            raise ValueError("points must be finite; got NaN or infinity")
        if photo.dtype.kind not in "iu":
            raise ValueError(f"photo must be whole numbers, indices of photos; got {photo.dtype}")
        if len(sigma) and not (sigma.min() > 0 and sigma.max() < math.inf):
            raise ValueError(f"sigma must be positive deviations in linear RGB; got {sigma.tolist()}")
        value, *results = engine.evaluate(
            self.geometry.native,
            self.native,
            points,
            np.ascontiguousarray(photo, np.int32),
            sigma,
            int(derivatives) + int(derivatives and curvature),
            images,
            thread_count(),
        )
        wanted = derivatives, derivatives and curvature, images, images, images
        asked = (each if want else None for each, want in zip(results, wanted, strict=True))
        return Evaluation(value, *asked)
