"""The packaged teapot, seeded photos of it whose explanation is known, and a small dataset."""

import signal
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from tests.remembering import remembered_networks
from tests.support import TEAPOT, points_of
from vig import Explainer
from vig.likelihood import Likelihood, Photos, PixelModel
from vig.likelihood.geometry import Geometry
from vig.parallel import set_thread_count
from vig.scene import EXPOSURE_L00, Camera, Latents, ObjectClass
from vig_world.dataset import Dataset, read_dataset
from vig_world.generation.write import make_dataset

__all__ = ["remembered_networks"]

with suppress(ImportError):
    import torch  # noqa: F401  # whose number of threads is set with ours
set_thread_count(1)
# Under `nohup make test &` SIGINT is ignored, which programs that tests start and interrupt would inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)


@dataclass(frozen=True)
class Studio:
    """Photographs one class in float64: random latents, their renderings, photos with something in front."""

    geometry: Geometry
    camera: Camera
    pixels: ClassVar[PixelModel] = PixelModel(0.03, 0.9)  # the paper's

    def latents(self, rng: np.random.Generator, count: int = 1) -> Latents:
        """Latents well inside every bound, brighter from above, at the paper's exposure."""
        light = np.concatenate([np.full((count, 1), EXPOSURE_L00), rng.normal(0, 0.5, (count, 8))], axis=1)
        light[:, 2] += 1.0
        numbers = (
            rng.normal(size=(count, self.geometry.model.modes)).clip(-2, 2),
            rng.uniform(0, 2 * np.pi, count),
            rng.uniform(0.1, 1.2, count),
            rng.uniform(0.2, 0.8, (count, 3)),
            light,
        )
        return Latents(*numbers)

    def near(self, rng: np.random.Generator, latents: Latents) -> Latents:
        """A guess off the latents by about 3 degrees, 0.3 sd of shape, 0.05 of albedo, 0.1 of light."""
        modes = self.geometry.model.modes
        spread = np.array([0.3] * modes + [0.05] * 2 + [0.05] * 3 + [0.1] * 9)
        vector = latents.to_vector()
        return Latents.from_vector(vector + rng.normal(size=vector.shape) * spread)

    def likelihood(
        self, photos: np.ndarray, silhouette: str = "exact", stride: int | None = None
    ) -> Likelihood:
        """The paper's robust likelihood of photos (N, H, W, 3)."""
        log_prior = np.broadcast_to(
            self.pixels.log_prior(self.camera.height, self.camera.width), photos.shape
        )
        return Likelihood(self.geometry, self.camera, Photos(photos, log_prior), silhouette, stride)

    def render(
        self, latents: Latents, framing: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Irradiance (B, H, W), coverage (B, H, W) and colour (B, H, W, 3) in front of nothing."""
        count = len(latents)
        blank = np.zeros((1, self.camera.height, self.camera.width, 3))
        framing = np.zeros((count, 4)) if framing is None else framing
        seen = self.likelihood(blank).at(
            points_of(latents, framing), *self.whose(count), derivatives=False, images=True
        )
        colour = seen.irradiance[..., None] * latents.albedo[:, None, None, :]
        return seen.irradiance, seen.coverage, colour

    @staticmethod
    def whose(count: int, sigma: float = pixels.sigma) -> tuple[np.ndarray, np.ndarray]:
        """The arguments `photo` and `sigma` of `count` guesses at the first photo."""
        return np.zeros(count, np.int32), np.full(count, sigma)

    def blocks(self, rng: np.random.Generator) -> np.ndarray:
        """A backdrop of flat coloured blocks, 10 pixels wide: (H, W, 3)."""
        cells = rng.uniform(0.1, 0.9, (self.camera.height // 10, self.camera.width // 10, 3))
        return np.kron(cells, np.ones((10, 10, 1)))

    def photo(
        self,
        rng: np.random.Generator,
        latents: Latents,
        framing: np.ndarray | None = None,
        occluded: bool = True,
        noise: float = 0.0,
    ) -> np.ndarray:
        """A photo (1, H, W, 3) in front of blocks, a tall block of other colours in front when occluded."""
        _, coverage, colour = self.render(latents, framing)
        backdrop = self.blocks(rng)
        photo = np.where(coverage[..., None] > 0.5, colour, backdrop)
        if occluded:
            left = int(rng.integers(20, 80))
            photo[:, 40:110, left : left + 40] = self.blocks(rng)[40:110, left : left + 40]
        return (photo + rng.normal(0, noise, photo.shape)).clip(0, 1)


@pytest.fixture(scope="session")
def teapot() -> ObjectClass:
    return ObjectClass.load(TEAPOT)


@pytest.fixture(scope="session")
def packaged() -> ObjectClass:
    return ObjectClass.load("teapot")


@pytest.fixture(scope="session")
def explainer() -> Explainer:
    """Of the packaged teapot."""
    return Explainer("teapot")


@pytest.fixture(scope="session")
def studio(teapot: ObjectClass) -> Studio:
    """The teapot before the paper's camera, in float64."""
    return Studio(
        Geometry(teapot.shape_model, np.float64), Camera.standard(target_height=teapot.target_height)
    )


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass) -> Path:
    """A small dataset made by one worker."""
    out = tmp_path_factory.mktemp("dataset") / "one"
    return make_dataset(out, count=10, seed=5, workers=1, progress=False, object_class=teapot)


@pytest.fixture(scope="session")
def dataset(made: Path) -> Dataset:
    return read_dataset(made)
