"""Custom panoramas: `.hdr` and `.exr` files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vig.io.errors import UserError
from vig_world.assets.hdr import read_panorama
from vig_world.assets.own.folder import files_of, fingerprint

SUFFIXES = (".hdr", ".exr")
LIGHT_ROWS, MAX_ROWS = 64, 256


@dataclass(frozen=True)
class OwnPanorama:
    """An equirectangular panorama from a file, as `project_panorama` reads it.

    Attributes:
        name: Name of the file, relative to its folder.
        fingerprint: sha256 of the file.
        radiance: (64, 128, 3) float32 linear, for the light's coefficients; `sharp` is for path tracers.
    """

    name: str
    fingerprint: str
    radiance: np.ndarray
    path: Path

    def sharp(self) -> np.ndarray:
        """Return the panorama at up to 256 x 512, read from its file: (H, 2 H, 3) float32 linear radiance."""
        image = read_panorama(self.path)
        return resized(image, min(len(image), MAX_ROWS))


def read_envmaps(folder: str | Path) -> tuple[list[OwnPanorama], list[str]]:
    """Read every panorama below a folder, in the order of their names.

    Returns:
        The panoramas, and one sentence for each skipped file.

    Raises:
        UserError: When there is no such folder or not one usable panorama in it.
    """
    panoramas, problems = [], []
    for name, path in files_of(Path(folder), SUFFIXES):
        try:
            image = read_panorama(path)
            small = resized(image, LIGHT_ROWS)
            if not small[: LIGHT_ROWS // 2].any():
                raise UserError(
                    f"{path}: expected light from above the horizon; got none. Choose another panorama."
                )
            panoramas.append(OwnPanorama(name, fingerprint({name: path}), small, path))
        except UserError as error:
            problems.append(f"{error} Left out.")
        except OSError as error:
            problems.append(f"{path}: cannot be read ({error.strerror or error}). Left out.")
    if not panoramas:
        raise UserError(f"{folder}: not one usable panorama. {' '.join(problems)}")
    return panoramas, problems


def resized(image: np.ndarray, height: int) -> np.ndarray:
    """Return a panorama (H, 2 H, 3) at (height, 2 height, 3): means over the new pixels' solid angles."""
    rows = _overlaps(
        -np.cos(np.linspace(0, np.pi, len(image) + 1)), -np.cos(np.linspace(0, np.pi, height + 1))
    )
    columns = _overlaps(np.linspace(0, 1, image.shape[1] + 1), np.linspace(0, 1, 2 * height + 1))
    return np.einsum("rh,hwc,vw->rvc", rows, image, columns, optimize=True).astype(np.float32)


def _overlaps(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Return shares (N, O) of new intervals in old ones, given the ascending edges of both."""
    shared = np.minimum(new[1:, None], old[None, 1:]) - np.maximum(new[:-1, None], old[None, :-1])
    shared = np.maximum(shared, 0)
    return shared / shared.sum(1, keepdims=True)
