"""The lens that took a photo: its intrinsics, given or read from EXIF data, and poses before it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from PIL import ExifTags, Image

from vig.io.errors import UserError
from vig.photo.checks import existing_file
from vig.photo.decoding import opened

FILM_DIAGONAL = math.hypot(36, 24)
"""Millimetres of 35 mm film, to which cameras state their focal length."""
UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}
"""Millimetres of EXIF's FocalPlaneResolutionUnit: inch, centimetre, millimetre, micrometre."""
SAME_FOCAL = 0.1
"""Relative difference up to which two of EXIF's focal lengths agree; above, the 35 mm equivalent counts, as
FocalPlane tags of pictures that a camera stored smaller are often those of its whole sensor."""
STORED_SIZE = (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)
STORED_PIXELS = 16
"""Pixels by which EXIF's size of the stored picture may differ: JPEG stores blocks of 8 or 16."""
WIDEST = 0.15
"""Focal length, in longer sides of the photo, below which K is not in this photo's pixels."""
MOST_OFF_CENTRE = 3.0
"""Sides of the photo from its middle within which a principal point may lie: crops have it outside."""
LEAST_COSINE = 0.2
"""Of the angle between the lens's optical axis and the rays of a window that is looked at through it."""
DISTORTION = ("d", "D", "dist", "k1", "k2", "k3", "k4", "p1", "p2")
"""What files of cameras call the coefficients of a lens's distortion."""
FIELDS = (("fx", "fl_x"), ("fy", "fl_y"), ("cx", "cx"), ("cy", "cy"))
REMEDY = "Give fx,fy,cx,cy in pixels of this photo, undistorted."


@dataclass(frozen=True)
class Intrinsics:
    """A lens without distortion: focal lengths and principal point in pixels of the photo.

    Axes are OpenCV's (x right, y down, z forward); the centre of the first pixel is (0.5, 0.5).
    """

    fx: float
    fy: float
    cx: float
    cy: float

    @staticmethod
    def of(camera: Any, width: int, height: int) -> Intrinsics:
        """The intrinsics of a photo from what a caller has them in.

        Args:
            camera: A focal length, for a principal point in the middle; `Intrinsics`; fx, fy, cx, cy; K as
                (3, 3) or its nine numbers row by row; or a mapping with one of these as "K", "k" or "cam_K",
                or with "fx" or "fl_x", "fy" or "fl_y", "cx" and "cy".
            width: Of the photo, pixels; and height.

        Raises:
            UserError: They are something else, or cannot be those of such a photo.
        """
        if isinstance(camera, Intrinsics):
            lens = camera
        elif isinstance(camera, float):
            lens = Intrinsics(camera, camera, width / 2, height / 2)
        else:
            lens = Intrinsics(*_four_numbers(camera))
        if isinstance(camera, Mapping):
            size = [camera.get(long, camera.get(short)) for long, short in (("width", "w"), ("height", "h"))]
            if None not in size and size != [width, height]:
                received = f"one of {size[0]} x {size[1]}. Scale it"
                _refuse(f"a camera of a photo of {width} x {height}", received)
        longer, numbers = max(width, height), (lens.fx, lens.fy, lens.cx, lens.cy)
        words = "fx {:g}, fy {:g}, cx {:g}, cy {:g}".format(*numbers)
        if not all(map(math.isfinite, numbers)) or min(lens.fx, lens.fy) <= 0:
            _refuse("finite numbers, focal lengths above 0", f"{words}. OpenCV's axes make both positive")
        if min(lens.fx, lens.fy) < WIDEST * longer:
            _refuse(f"focal lengths that suit a photo of {width} x {height}", words)
        if not 0.2 < lens.fx / lens.fy < 5:
            _refuse("fx and fy that are nearly equal", words)
        if (
            abs(lens.cx - width / 2) > MOST_OFF_CENTRE * width
            or abs(lens.cy - height / 2) > MOST_OFF_CENTRE * height
        ):
            _refuse(f"a principal point of a photo of {width} x {height}", words)
        return lens

    @property
    def K(self) -> np.ndarray:  # noqa: N802
        """Intrinsic matrix (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def scaled(self, factor: float) -> Intrinsics:
        """The same lens for a photo `factor` times as wide and high."""
        return Intrinsics(self.fx * factor, self.fy * factor, self.cx * factor, self.cy * factor)

    def turned_to(self, x: float, y: float) -> tuple[np.ndarray, float]:
        """A camera at the same place that looks at a point of the photo, with its horizon kept.

        Returns:
            Rotation (3, 3) from this camera's axes to those of the other; and the focal length in pixels with
            which the other shows what is about the point as large as the photo does.
        """
        ray = np.array([(x - self.cx) / self.fx, (y - self.cy) / self.fy, 1.0])
        length = float(np.linalg.norm(ray))
        forward = ray / length
        right = np.cross([0.0, 1.0, 0.0], forward)
        right /= np.linalg.norm(right)
        # A small thing off the middle of a flat film is drawn larger, by the ray's length across the ray
        # and by its square along it.
        focal = math.sqrt(self.fx * self.fy) * length**1.5
        return np.stack([right, np.cross(forward, right), forward]), focal


def _four_numbers(camera: Any) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy from whatever states them."""
    if isinstance(camera, Mapping):
        if bent := [
            name for name in DISTORTION if name in camera and np.any(np.asarray(camera[name], float))
        ]:
            _refuse(
                "a photo without lens distortion", f"coefficients of it in '{bent[0]}'. Undistort it first"
            )
        matrix = next((camera[name] for name in ("K", "k", "cam_K") if name in camera), None)
        fields = [camera.get(name, camera.get(other)) for name, other in FIELDS]
        camera = (None if None in fields else fields) if matrix is None else matrix
    try:
        if any(isinstance(number, bool) for number in np.ravel(np.asarray(camera, object))):
            raise TypeError
        numbers = np.asarray(camera, float)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape == (9,):
        numbers = numbers.reshape(3, 3)
    if numbers.shape == (3, 3):
        fx, skew, cx = numbers[0].tolist()
        fy, cy = numbers[1, 1:].tolist()
        if numbers[1, 0] or numbers[2, :2].any() or numbers[2, 2] != 1 or abs(skew) > 1e-3 * abs(fx):
            rows = numbers.round(3).tolist()
            _refuse("K as [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]", f"{rows}. Is it transposed or skewed?")
        return fx, fy, cx, cy
    if numbers.shape != (4,):
        _refuse("a camera as fx, fy, cx, cy or K (3, 3)", str(camera)[:60])
    fx, fy, cx, cy = numbers.tolist()
    return fx, fy, cx, cy


def _refuse(expected: str, received: str) -> NoReturn:
    raise UserError(f"expected {expected}; got {received}. {REMEDY}")


def focal_of(photo: object) -> float | None:
    """The focal length in pixels that EXIF data of a photo's file, or of a PIL image, state.

    None where they state none, and where the picture is not of the size that they say it was stored in: it
    was cropped or resized since, and by how much of either they do not say.
    """
    try:
        if isinstance(photo, str | Path):
            with opened(existing_file(photo)) as image:  # a pipe would be waited for
                return focal_of(image)
        if not isinstance(photo, Image.Image):
            return None
        tags = photo.getexif().get_ifd(ExifTags.IFD.Exif)
        size = sorted(photo.size)
        stored = sorted(int(tags.get(tag) or 0) for tag in STORED_SIZE)
        if all(stored) and any(abs(a - b) > STORED_PIXELS for a, b in zip(size, stored, strict=True)):
            return None
        of_film = float(tags.get(ExifTags.Base.FocalLengthIn35mmFilm) or 0)
        equivalent = of_film / FILM_DIAGONAL * math.hypot(*size) if 1 <= of_film <= 2000 else None
        exact = _focal_plane(tags)
        if exact is None or exact < WIDEST * size[1]:
            return equivalent
        agrees = equivalent is None or abs(exact / equivalent - 1) <= SAME_FOCAL
        return exact if agrees else equivalent
    except Exception:  # no EXIF data, or damaged ones
        return None


def _focal_plane(tags: Mapping[int, Any]) -> float | None:
    """Focal length in pixels by EXIF's FocalLength (mm) and FocalPlaneXResolution (pixels a unit)."""
    millimetres = float(tags.get(ExifTags.Base.FocalLength) or 0)
    resolution = float(tags.get(ExifTags.Base.FocalPlaneXResolution) or 0)
    unit = UNIT_MM.get(int(tags.get(ExifTags.Base.FocalPlaneResolutionUnit) or 2))
    return millimetres * resolution / unit if millimetres > 0 and resolution > 0 and unit else None
