"""A camera model for rendered pictures: exposure, colour balance, blur, noise and JPEG."""

import io
from dataclasses import dataclass

import numpy as np
from PIL import Image
from scipy.ndimage import convolve1d

from vig.scene import srgb8_from_linear


@dataclass(frozen=True)
class PhotoSettings:
    """The camera's settings for one photograph.

    Attributes:
        exposure: Stops above the exposure of the rendered picture.
        white_balance: (3,) factors of the channels behind the sensor, of mean luminance 1.
        vignetting: Share of light lost in the corners.
        blur: Standard deviation of the lens's blur, pixels.
        motion: Length of the camera's path, pixels.
        motion_angle: Its direction, radians from the rows'.
        electrons: Number that a pixel at white (linear 1) collects, with noise of the square root of the
            number.
        read_noise: Standard deviation of the additional noise, electrons.
        quality: Quality of the JPEG, in pillow's scale.
        chroma: Whether its colours have half the resolution (4:2:0).
    """

    exposure: float
    white_balance: tuple[float, float, float]
    vignetting: float
    blur: float
    motion: float
    motion_angle: float
    electrons: float
    read_noise: float
    quality: int
    chroma: bool

    @staticmethod
    def draw(rng: np.random.Generator) -> "PhotoSettings":
        """Draw plausible settings of an indoor photograph by a phone or a small camera."""
        warmth, tint = np.clip(rng.normal(0, [0.05, 0.02]), -0.15, 0.15)
        balance = np.exp([warmth - tint / 2, tint / 2, -warmth - tint / 2])
        balance /= balance @ [0.2126, 0.7152, 0.0722]
        return PhotoSettings(
            exposure=float(np.clip(rng.normal(0, 0.2), -0.6, 0.6)),
            white_balance=tuple(balance.tolist()),
            vignetting=float(rng.uniform(0, 0.2)),
            blur=float(rng.uniform(0.3, 0.8)),
            motion=float(rng.uniform(0.5, 2.5)) if rng.uniform() < 0.2 else 0.0,
            motion_angle=float(rng.uniform(0, np.pi)),
            electrons=float(np.exp(rng.uniform(np.log(1000), np.log(20000)))),
            read_noise=float(np.exp(rng.uniform(np.log(2), np.log(8)))),
            quality=int(rng.integers(60, 96)),
            chroma=bool(rng.uniform() < 0.7),
        )


def photograph(
    linear: np.ndarray, rng: np.random.Generator, settings: PhotoSettings | None = None
) -> tuple[np.ndarray, PhotoSettings]:
    """Pass a picture through lens, sensor, white balance, sRGB and JPEG, in this order.

    Args:
        linear: (H, W, 3) linear light, 0 or more, 1 the white of a right exposure; brighter things are
            clipped by the sensor.
        rng: Source of settings and noise.
        settings: In place of those that are drawn.

    Returns:
        The photograph (H, W, 3) uint8 sRGB and its settings.

    Raises:
        ValueError: For another shape, or values that are negative or not finite.
    """
    if linear.ndim != 3 or linear.shape[2] != 3:
        raise ValueError(f"a picture must be (H, W, 3); got {linear.shape}")
    if not (np.isfinite(linear) & (linear >= 0)).all():
        raise ValueError("a picture in linear light must be finite and at least 0; got other values")
    settings = PhotoSettings.draw(rng) if settings is None else settings
    light = _through_lens(linear.astype(np.float64), settings)
    signal = _count_photons(light, settings, rng) * np.array(settings.white_balance)
    file = io.BytesIO()
    subsampling = "4:2:0" if settings.chroma else "4:4:4"
    Image.fromarray(srgb8_from_linear(signal)).save(
        file, "JPEG", quality=settings.quality, subsampling=subsampling
    )
    return np.asarray(Image.open(file)), settings


def _through_lens(linear: np.ndarray, settings: PhotoSettings) -> np.ndarray:
    """Apply vignetting and blur; edge pixels are repeated beyond the frame."""
    height, width = linear.shape[:2]
    rows, columns = np.ogrid[: float(height), : float(width)]
    away = ((rows - (height - 1) / 2) ** 2 + (columns - (width - 1) / 2) ** 2) / (height**2 + width**2) * 4
    light = linear * (1 - settings.vignetting * away)[..., None]
    if settings.motion > 0:
        steps = np.linspace(-0.5, 0.5, 7) * settings.motion
        shifts = np.stack([np.sin(settings.motion_angle) * steps, np.cos(settings.motion_angle) * steps], 1)
        light = np.mean([_shift(light, dy, dx) for dy, dx in shifts], axis=0)
    reach = np.arange(-3, 4)
    kernel = np.exp(-0.5 * (reach / settings.blur) ** 2)
    kernel /= kernel.sum()
    for axis in (0, 1):
        light = convolve1d(light, kernel, axis, mode="nearest")
    return light


def _count_photons(light: np.ndarray, settings: PhotoSettings, rng: np.random.Generator) -> np.ndarray:
    """Return the sensor's signal in [0, 1]: exposed, with shot noise (a Gaussian) and read noise, clipped."""
    electrons = light * (2.0**settings.exposure * settings.electrons)
    electrons += np.sqrt(electrons + settings.read_noise**2) * rng.standard_normal(light.shape)
    return (electrons / settings.electrons).clip(0, 1)


def _shift(image: np.ndarray, dy: float, dx: float) -> np.ndarray:
    """Return the image (H, W, 3) looked up dy rows down and dx columns to the right, bilinearly."""
    y, x = int(np.floor(dy)), int(np.floor(dx))
    fy, fx = dy - y, dx - x
    rows = np.clip(np.arange(len(image)) + y, 0, len(image) - 1)
    below = np.clip(rows + 1, 0, len(image) - 1)
    image = (1 - fy) * image[rows] + fy * image[below]
    columns = np.clip(np.arange(image.shape[1]) + x, 0, image.shape[1] - 1)
    right = np.clip(columns + 1, 0, image.shape[1] - 1)
    return (1 - fx) * image[:, columns] + fx * image[:, right]
