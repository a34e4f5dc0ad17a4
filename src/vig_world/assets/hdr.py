"""HDR panorama files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vig.errors import UserError
from vig.photo.checks import check_size, existing_file, head_of, refuse
from vig.photo.formats import HDR_MAGIC
from vig_world.extras import optional_import

UNDERSHOOT = 0.05


def read_panorama(path: str | Path) -> np.ndarray:
    """Read an equirectangular `.hdr` or `.exr` panorama as linear RGB radiance, (H, 2 H, 3) float32 >= 0.

    Values below 0 by at most `UNDERSHOOT` of the mean become 0: resampling filters leave such values.

    Raises:
        UserError: For a missing, unreadable or damaged file, one that is not twice as wide as high, tiny or
            huge, one that holds NaN, infinite or more negative values, and one that is black throughout.
    """
    path = existing_file(path)
    if not head_of(path).startswith(HDR_MAGIC):
        refuse(path, "an HDR panorama (.hdr or .exr)", "something else", "Convert it to .hdr or .exr.")
    try:
        rgb = _radiance(path)
    except UserError:
        raise
    except Exception as error:  # OpenImageIO may raise anything on a damaged file, even while reporting it
        refuse(path, "a whole HDR panorama", f"a damaged one ({error})", "Copy it again.")
    finite = np.isfinite(rgb)
    lowest = -UNDERSHOOT * float(rgb.mean(where=finite, dtype=np.float64)) if finite.any() else 0.0
    bad = np.count_nonzero(~(finite & (rgb >= min(lowest, 0.0))).all(-1))
    if bad:
        came = f"{bad} pixels with NaN, infinite or negative values"
        refuse(path, "finite radiance of at least 0", came, "Clean the panorama.")
    if not (rgb > 0).any():
        refuse(path, "a panorama with some light in it", "a black one", "Choose another.")
    return np.maximum(rgb, 0)


def _radiance(path: Path) -> np.ndarray:
    """Decode an HDR file, (H, 2 H, 3) float32; values are not checked. OSError when it is damaged."""
    with optional_import("world"):  # 80 ms that only panoramas need to spend
        import OpenImageIO as oiio

    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise OSError(oiio.geterror())
    spec = source.spec()
    check_size(path, spec.width, spec.height)
    if spec.width != 2 * spec.height:
        came = f"{spec.width} x {spec.height} pixels"
        refuse(path, "an equirectangular panorama, twice as wide as high", came, "Crop or resize it.")
    channels = {name.upper(): index for index, name in enumerate(spec.channelnames)}
    if not {"R", "G", "B"} <= channels.keys():
        refuse(path, "channels R, G and B", ", ".join(spec.channelnames), "Export it as RGB.")
    pixels = source.read_image(oiio.FLOAT)
    if pixels is None:
        raise OSError(source.geterror())
    return np.ascontiguousarray(pixels[..., [channels[name] for name in "RGB"]], dtype=np.float32)
