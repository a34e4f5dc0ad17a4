"""The paper's error measures (section 5.2): one number per image.

Every function takes batches as numpy arrays or torch tensors, predictions first, and returns (B,) float64.
Arguments of different shapes raise ValueError: nothing broadcasts by accident.
"""

from typing import Any

import numpy as np

from vig.scene import angle_difference, linear_from_srgb
from vig.scene.functions import numpy_of_tensor

_WHITE_XYZ = np.array([0.950456, 1.0, 1.088754])  # CIE XYZ of sRGB's white, D65, luminance 1
_XYZ_FROM_RGB = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)


def angle_error_deg(predicted: Any, true: Any) -> np.ndarray:
    """Return the absolute difference of angles round the circle: azimuth or elevation.

    predicted, true: (B,) radians, any number of turns. Returns degrees in [0, 180].
    """
    predicted, true = _pair(predicted, true, 1)
    return np.degrees(np.abs(angle_difference(predicted, true)))


def appearance_error(predicted: Any, true: Any) -> np.ndarray:
    """Return the distance of two albedos in the chroma plane (a, b) of CIE Lab, eq. 5.

    predicted, true: (B, 3) linear albedo in [0, 1] (clipped to it). The paper takes the numbers as
    if they were sRGB, and the unit is that of OpenCV's 8-bit Lab divided by 255, without its rounding:
    times 255 gives CIE ab units.
    """
    predicted, true = _pair(predicted, true, 2, channels=3)
    chroma = [_chroma(linear_from_srgb(np.clip(albedo, 0, 1))) for albedo in (predicted, true)]
    return np.linalg.norm(chroma[0] - chroma[1], axis=-1) / 255


def illumination_error(predicted: Any, true: Any) -> np.ndarray:
    """Return the scale-invariant mean squared error of 9 spherical-harmonic coefficients.

    predicted, true: (B, 9) radiance (vig's convention, where exposure puts L00 at 0.75 pi). The prediction is
    scaled by least squares, so only the truth's unit counts; it is the paper's, with L00 = 0.75, which has no
    1 / pi in its reflection: hence the division by pi.
    """
    predicted, true = _pair(predicted, true, 2, channels=9)
    true = true / np.pi
    power = (predicted**2).sum(-1, keepdims=True)
    scale = (predicted * true).sum(-1, keepdims=True) / np.where(power > 0, power, 1)
    return ((scale * predicted - true) ** 2).mean(-1)


def shape_error_mm(predicted: Any, true: Any) -> np.ndarray:
    """Return the mean distance of corresponding vertices in the object's frame.

    predicted, true: (B, V, 3) metres. Returns millimetres.
    """
    predicted, true = _pair(predicted, true, 3, channels=3)
    return 1000 * np.linalg.norm(predicted - true, axis=-1).mean(-1)


def shape_ratio(error_mm: Any, mean_shape_error_mm: Any) -> np.ndarray:
    """Return the shape error in units of the mean shape's: the paper's shape row, up to its unit.

    error_mm, mean_shape_error_mm: (B,) from `shape_error_mm` on the same images. Each error is divided by
    the *median* error of the mean shape, so that the median of the result is the ratio of the medians.
    """
    error, baseline = _pair(error_mm, mean_shape_error_mm, 1)
    return error / np.median(baseline)


def segmentation_iou(predicted: Any, true: Any) -> np.ndarray:
    """Return the intersection over union of predicted-visible and truly visible pixels.

    predicted, true: (B, H, W) bool. Returns [0, 1]; 1 where both masks are empty.
    """
    predicted, true = _numpy(predicted), _numpy(true)
    if predicted.dtype != bool or true.dtype != bool:
        raise ValueError(f"masks must be bool; got {predicted.dtype} and {true.dtype}. Compare with > 0.5.")
    _same_shape(predicted, true, 3, None)
    union = (predicted | true).sum((1, 2))
    return np.where(union > 0, (predicted & true).sum((1, 2)) / np.maximum(union, 1), 1.0)


def _chroma(linear: np.ndarray) -> np.ndarray:
    """Return CIE (a, b) of linear RGB in [0, 1]: (..., 3) -> (..., 2)."""
    xyz = linear @ _XYZ_FROM_RGB.T / _WHITE_XYZ
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.stack([500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def _numpy(value: Any) -> np.ndarray:
    return np.asarray(numpy_of_tensor(value))


def _pair(a: Any, b: Any, dimensions: int, channels: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    a, b = _numpy(a).astype(np.float64), _numpy(b).astype(np.float64)
    _same_shape(a, b, dimensions, channels)
    return a, b


def _same_shape(a: np.ndarray, b: np.ndarray, dimensions: int, channels: int | None) -> None:
    if a.shape != b.shape or a.ndim != dimensions or (channels is not None and a.shape[-1] != channels):
        size = "" if channels is None else f" and a last one of {channels}"
        raise ValueError(
            f"expected two arrays of {dimensions} axes{size}, alike; got {a.shape} and {b.shape}"
        )
