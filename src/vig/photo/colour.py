"""Colour encodings other than sRGB, decoded to linear light of Rec. 709's primaries.

Codes of primaries and transfer are those of ITU-T H.273, which PNG, AVIF, HEIC and videos share.
"""

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from PIL import ExifTags, Image, ImageCms

from vig.photo.formats import Codes
from vig.scene.light import linear_from_srgb

D65 = (0.3127, 0.329)
REC709: tuple[float, ...] = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, *D65)  # x and y of red, green, blue and white
# Sets that differ from Rec. 709's by less than two photos of one thing do (BT.601, EBU) count as it.
_PRIMARIES = {
    4: (0.67, 0.33, 0.21, 0.71, 0.14, 0.08, 0.31, 0.316),
    8: (0.681, 0.319, 0.243, 0.692, 0.145, 0.049, 0.31, 0.316),
    9: (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, *D65),
    10: (1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3),
    11: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.314, 0.351),
    12: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, *D65),
} | dict.fromkeys((1, 2, 5, 6, 7, 22), REC709)
PQ = 16  # number of the perceptual quantiser among transfer characteristics (ITU-T H.273)
HLG = 18  # number of hybrid log-gamma among them
SDR_WHITE = 203.0  # cd/m2 of diffuse white in HDR pictures (ITU-R BT.2408), which becomes 1
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
Profile = ImageCms.ImageCmsProfile
Curve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Encoding:
    """The encoding of light by a picture's samples.

    Attributes:
        transfer: Function from samples in [0, 1] to linear light, 1 being white.
        chromaticities: x and y of red, green, blue and white.
        hdr: Whether light may be above 1, and is then mapped into [0, 1].
        system_gamma: Exponent of HLG, whose samples are light of the scene, not of the display.
        narrow: Whether black and white are 16 and 235 of 255.
    """

    transfer: Curve
    chromaticities: tuple[float, ...] = REC709
    hdr: bool = False
    system_gamma: float = 1.0
    narrow: bool = False

    def light(self, samples: np.ndarray, maximum: int) -> np.ndarray:
        """Decode samples to linear light of Rec. 709's primaries in [0, 1], float32.

        Args:
            samples: (..., 3) or grey (..., 1), uint8 or uint16.
            maximum: The sample that stands for 1.
        """
        return self.light_and_peak(samples, maximum)[0]

    def light_and_peak(
        self, samples: np.ndarray, maximum: int, peak: float | None = None
    ) -> tuple[np.ndarray, float]:
        """Return `light`, and the light that became white: `peak` for further frames of a video."""
        levels = np.arange(np.iinfo(samples.dtype).max + 1) / maximum
        if self.narrow:  # 16 to 235 of 255
            levels = (levels * 255 - 16) / 219 if maximum == 255 else (levels * 65535 / 256 - 16) / 219
        light: np.ndarray = self.transfer(np.clip(levels, 0, 1)).astype(np.float32)[samples]
        if self.system_gamma != 1:
            weights = np.array([0.2627, 0.678, 0.0593] if light.shape[-1] == 3 else [1.0], np.float32)
            light = light * ((light @ weights) ** (self.system_gamma - 1))[..., None]
        if light.shape[-1] == 3 and self.chromaticities != REC709:
            light = light @ rec709_from(self.chromaticities).T.astype(np.float32)
        if not self.hdr:
            return np.clip(light, 0, 1), 1.0
        # Nearly the brightest, at least 1; 0.999: quantile of pixels above which they are clipped: few
        # highlights must not darken the rest
        peak = peak or max(1.0, float(np.quantile(light.max(-1), 0.999)))
        return tone_mapped(light, peak), peak


SRGB = Encoding(linear_from_srgb)


def rec709_from(chromaticities: Sequence[float]) -> np.ndarray:
    """Return the matrix (3, 3) from linear RGB of other primaries to Rec. 709's, white kept white (Bradford).

    Args:
        chromaticities: x and y of red, green, blue and white.

    Raises:
        ValueError: They span no colour space.
    """
    to_white, from_white = _adapted_xyz(chromaticities), _adapted_xyz(REC709)
    return np.linalg.solve(from_white, to_white)


def _adapted_xyz(chromaticities: Sequence[float]) -> np.ndarray:
    """Return the matrix from RGB to XYZ (3, 3), adapted from its white to that of D65."""
    values = np.asarray(chromaticities, np.float64)
    xyz = np.stack([values[0::2], values[1::2], 1 - values[0::2] - values[1::2]])  # a column a colour
    primaries, white = xyz[:, :3], xyz[:, 3]
    well_formed = values.shape == (8,) and np.isfinite(xyz).all() and white[1] > 0
    if not well_formed or abs(np.linalg.det(primaries)) < 1e-4:
        raise ValueError("no colour space")
    white = white / white[1]
    matrix = primaries * np.linalg.solve(primaries, white)
    d65 = np.array([D65[0], D65[1], 1 - sum(D65)]) / D65[1]
    gain = (_BRADFORD @ d65) / (_BRADFORD @ white)
    return np.asarray(np.linalg.solve(_BRADFORD, gain[:, None] * _BRADFORD) @ matrix)


def gamma(exponent: float) -> Curve:
    return lambda samples: samples**exponent


def _pq(samples: np.ndarray) -> np.ndarray:
    """Return the light of samples by SMPTE ST 2084, in units of `SDR_WHITE`."""
    root = samples ** (32 / 2523)
    ratio = np.maximum(root - 3424 / 4096, 0) / (2413 / 128 - 2392 / 128 * root)
    return np.asarray(10_000 / SDR_WHITE * ratio ** (16384 / 2610))


def _hlg(samples: np.ndarray) -> np.ndarray:
    """Return light by ARIB STD-B67, scaled so that its system gamma of 1.2 gives 1000 cd/m2 on a display."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    scene = np.where(samples <= 0.5, samples**2 / 3, (np.exp((samples - c) / a) + b) / 12)
    return np.asarray(scene * (1000 / SDR_WHITE) ** (1 / 1.2))


_TRANSFERS: dict[int, Curve] = {
    4: gamma(2.2),
    5: gamma(2.8),
    8: gamma(1.0),
    PQ: _pq,
    17: lambda samples: 52.37 / 48 * samples**2.6,
    HLG: _hlg,
} | dict.fromkeys((1, 2, 6, 7, 13, 14, 15), linear_from_srgb)  # made for a display of sRGB's kind


def coded_encoding(primaries: int, transfer: int) -> Encoding | None:
    """Return the encoding of H.273's codes; None for sRGB and its like.

    Raises:
        ValueError: A code that is not known.
    """
    if primaries not in _PRIMARIES or transfer not in _TRANSFERS:
        raise ValueError(f"primaries {primaries} and transfer {transfer} of H.273")
    curve, chromaticities = _TRANSFERS[transfer], _PRIMARIES[primaries]
    if curve is linear_from_srgb and chromaticities is REC709:
        return None
    return Encoding(curve, chromaticities, transfer in (PQ, HLG), 1.2 if transfer == HLG else 1.0)


def tone_mapped(light: np.ndarray, peak: float) -> np.ndarray:
    """Map light (..., C) in [0, `peak`] into [0, 1], hues kept: unchanged where `peak` is 1.

    The largest channel m becomes m (1 + m / peak^2) / (1 + m), Reinhard's curve with `peak` for white.
    """
    light = np.maximum(light, 0)
    largest = light.max(-1, keepdims=True)
    return np.asarray(np.minimum(light * (1 + largest / peak**2) / (1 + largest), 1))


def encoding_of(image: Image.Image, stated: Codes | None) -> Encoding | Profile | None:
    """Return the encoding of a loaded picture's samples.

    Args:
        image: A picture of any mode.
        stated: The codes of H.273 that its file states and pillow does not read.

    Returns:
        A colour profile for pictures of 8 bits, which is for `in_srgb`; None for sRGB.

    Raises:
        ValueError: The codes are not known.
    """
    data = image.info.get("icc_profile")
    if stated and (image.format == "PNG" or stated.transfer in (PQ, HLG) or not data):
        encoding = coded_encoding(stated.primaries, stated.transfer)
        return encoding if stated.full_range else replace(encoding or SRGB, narrow=True)
    grey = image.mode in ("1", "L", "LA", "La") or image.mode.startswith("I")
    if data:
        try:
            profile = Profile(io.BytesIO(data))
            space = profile.profile.xcolor_space.strip()
            if hdr := _hdr_encoding(profile, data):
                return hdr
            if image.mode.startswith("I") or (space == "GRAY" and not grey):
                return _grey_encoding(profile)
            if space.upper() in ((image.mode,) if image.mode in ("CMYK", "LAB") else ("GRAY", "RGB")):
                return profile
        except (ImageCms.PyCMSError, OSError):  # an unreadable profile is ignored
            pass
    if image.mode == "LAB":
        return Profile(ImageCms.createProfile("LAB"))
    if "srgb" in image.info:
        return None
    exponent = image.info.get("gamma") if image.format == "PNG" else None
    curve, chromaticities = gamma(1 / exponent) if exponent else None, REC709
    if white_first := image.info.get("chromaticity"):  # a PNG's
        chromaticities = (*white_first[2:], *white_first[:2])
    elif _is_adobe_rgb(image):
        curve, chromaticities = gamma(563 / 256), (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *D65)
    try:
        like_srgb = grey or np.abs(rec709_from(chromaticities) - np.eye(3)).max() < 0.01
    except ValueError:  # no colour space: left aside, as readers of PNG do
        like_srgb = True
    if like_srgb and (curve is None or (exponent and abs(exponent * 2.2 - 1) < 0.01)):
        return None  # PNG requires 1 / 2.2 with sRGB's chunk
    return Encoding(curve or linear_from_srgb, REC709 if like_srgb else chromaticities)


def _is_adobe_rgb(image: Image.Image) -> bool:
    """Return whether a camera states Adobe RGB as DCF does, in EXIF alone."""
    try:
        interop = image.getexif().get_ifd(ExifTags.IFD.Interop) if image.getexif() else {}
        return interop.get(1) == "R03"
    except Exception:  # damaged EXIF data
        return False


def _hdr_encoding(profile: Profile, data: bytes) -> Encoding | None:
    """Return the encoding of an HDR profile, whose curve a conversion of 8 bits would lose; else None."""
    for place in range(132, 132 + 12 * int.from_bytes(data[128:132], "big"), 12):
        if data[place : place + 4] == b"cicp":
            start = int.from_bytes(data[place + 4 : place + 8], "big") + 8
            primaries, transfer = data[start : start + 2]
            return coded_encoding(primaries, transfer) if transfer in (PQ, HLG) else None
    name = profile.profile.profile_description or ""
    if re.search("(?<![A-Za-z0-9])(HLG|PQ|2084)(?![A-Za-z0-9])", name):
        return coded_encoding(9, HLG if "HLG" in name else PQ)
    return None


def _grey_encoding(profile: Profile) -> Encoding:
    """Return the encoding of grey samples by a colour profile.

    Raises:
        ImageCms.PyCMSError: The profile is not for grey or RGB.
    """
    ramp = Image.fromarray(np.arange(256, dtype=np.uint8)[None])
    if profile.profile.xcolor_space.strip() == "RGB":
        ramp = ramp.convert("RGB")
    levels = linear_from_srgb(np.asarray(in_srgb(ramp, profile))[0] / 255).mean(-1)
    return Encoding(lambda samples: np.interp(samples, np.arange(256) / 255, levels))


def in_srgb(image: Image.Image, profile: Profile) -> Image.Image:
    """Convert an 8-bit picture by its colour profile to sRGB, mode RGB.

    Raises:
        ImageCms.PyCMSError: The profile is for other pictures.
    """
    converted = ImageCms.profileToProfile(image, profile, ImageCms.createProfile("sRGB"), outputMode="RGB")
    assert converted is not None
    return converted
