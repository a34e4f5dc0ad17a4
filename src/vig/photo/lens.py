"""The lens that took a photo: its intrinsics, given or read from EXIF data, and poses before it."""

import math
import re
import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from PIL import ExifTags, Image

from vig.io.checks import number_of
from vig.io.errors import UserError
from vig.io.printing import note
from vig.photo.checks import existing_file
from vig.photo.decoding import open_picture

WIDEST = 0.15  # focal length, in longer sides of the photo, below which K is not in this photo's pixels
MIN_COSINE = 0.2
"""Cosine of the angle between the lens's optical axis and the rays of a window that it may show, at least."""
DISTORTION = re.compile(
    r"d|(?!undist).*dist(?!anc).*|.*coef.*|.*(radial|tangential).*|[kps][1-9]|tau[xy]|xi|omega|kc|alphac?|skew"
)
"""Keys of the coefficients of a lens's distortion in files of cameras, as `_key` has them."""
NOT_PINHOLE = re.compile(
    r"fish|equi|omni|kannala|ucm|double|fov|spher|cylind|ortho|theta|scaramuzza|\b(ds|mei|kb\d?)\b", re.I
)
"""Names of lenses that a K does not describe, with any coefficients."""
SIZES = (
    ("width", "w", "imagewidth", "imgwidth"), ("height", "h", "imageheight", "imgheight"),
    ("resolution", "imagesize", "imgsize", "size", "imageresolution"),
)  # fmt: skip
"""Keys of width, of height, and of both."""
MATRICES = ("K", "k", "cam_K", "camera_matrix", "intrinsic_matrix", "intrinsics")
"""Keys of K, or of fx, fy, cx, cy."""
PARAMETERS = "params"  # COLMAP's key of fx, fy, cx, cy or f, cx, cy, and coefficients of distortion
FIELDS = (("fx", "fl_x"), ("fy", "fl_y"), ("cx", "ppx"), ("cy", "ppy"))
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
    def of(camera: Any, width: int, height: int) -> "Intrinsics":
        """Return the intrinsics of a photo from any form that callers have them in.

        Args:
            camera: A focal length, for a principal point in the middle; `Intrinsics`; fx, fy, cx, cy; K as
                (3, 3) or its nine numbers row by row; or a mapping with one of these by a name of `MATRICES`,
                with "fx", "fy", "cx" and "cy" or other names of them (`FIELDS`), or with COLMAP's "params".
            width: Width of the photo, pixels; and height.

        Raises:
            UserError: They are something else, or cannot be those of such a photo.
        """
        if isinstance(camera, Intrinsics):
            lens = camera
        elif isinstance(camera, float):
            lens = Intrinsics(camera, camera, width / 2, height / 2)
        else:
            lens = Intrinsics(*_four_numbers(camera))
        size = _size_of(camera)
        if any(given not in (None, own) for given, own in zip(size, (width, height), strict=True)):
            received = "one of {} x {}. Scale it".format(*(reprlib.repr(given) for given in size))
            _refuse(f"a camera of a photo of {width} x {height}", received)
        longer, numbers = max(width, height), (lens.fx, lens.fy, lens.cx, lens.cy)
        words = "fx {:g}, fy {:g}, cx {:g}, cy {:g}".format(*numbers)
        _check_finite(numbers)
        if min(lens.fx, lens.fy) < WIDEST * longer:
            _refuse(f"focal lengths that suit a photo of {width} x {height}", words)
        if not 0.2 < lens.fx / lens.fy < 5:
            _refuse("fx and fy that are nearly equal", words)
        # Sides of the photo from its middle within which a principal point may lie: crops have it outside.
        most_off_centre = 3.0
        if (
            abs(lens.cx - width / 2) > most_off_centre * width
            or abs(lens.cy - height / 2) > most_off_centre * height
        ):
            _refuse(f"a principal point of a photo of {width} x {height}", words)
        return lens

    @property
    def K(self) -> np.ndarray:  # noqa: N802
        """Return intrinsic matrix (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def scale(self, factor: float) -> "Intrinsics":
        """Return the same lens for a photo `factor` times as wide and high."""
        return Intrinsics(self.fx * factor, self.fy * factor, self.cx * factor, self.cy * factor)

    def turned_to(self, x: float, y: float) -> tuple[np.ndarray, float]:
        """Return a camera at the same place that looks at a point of the photo, with its horizon kept.

        Returns:
            Rotation (3, 3) from this camera's axes to those of the other; and the focal length in pixels with
            which the other shows things about the point as large as the photo does.
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


def camera_as_shown(photo: object, camera: Any) -> Any:
    """Return the camera of a photo as it is shown, where it may be given as that of the stored picture.

    EXIF's orientation turns that by a quarter: which one is given follows from its size, else from which of
    the two has the principal point in the middle. One that is turned is reported in a line.

    Args:
        photo: A file or a PIL image; others are taken as upright.
        camera: A camera in any form of `Intrinsics.of`.

    Raises:
        UserError: It fits both pictures.
    """
    orientation, (width, height) = _stored_size(photo)
    if width == height or isinstance(camera, float):
        return camera
    lens = camera if isinstance(camera, Intrinsics) else Intrinsics(*_four_numbers(camera))
    is_turned, sized = orientation > 4, None not in (size := _size_of(camera))
    shown, other = ((height, width), (width, height))[:: 1 if is_turned else -1]
    to_shown, to_other = (math.dist((2 * lens.cx, 2 * lens.cy), each) for each in (shown, other))
    if sized:
        to_shown, to_other = float(size != shown), float(size != other)
    # Ratio of distances to two middles from which a principal point is that of the nearer.
    surely_nearer = 0.5
    # 0.1: ratio of distances below which a principal point is that of a photo with exchanged sides
    if to_shown <= to_other * surely_nearer or (not is_turned and (sized or to_other > to_shown * 0.1)):
        return camera
    name = photo if isinstance(photo, str | Path) else "the photo"
    if not is_turned or to_other > to_shown * surely_nearer:
        if sized:  # for neither, which is refused where it meets the photo
            return camera
        raise UserError(
            f"{name}: expected a camera of the photo as it is shown, {shown[0]} x {shown[1]}; got cx"
            f" {lens.cx:g}, cy {lens.cy:g}, which may be of one of {other[0]} x {other[1]}. Turn it with the"
            ' photo, or give "width" and "height" with it (--cameras).'
        )
    turned = Intrinsics(
        lens.fy,
        lens.fx,
        lens.cy if orientation in (5, 8) else height - lens.cy,
        lens.cx if orientation in (5, 6) else width - lens.cx,
    )
    note(
        f"the camera of {str(name)!r} is that of the stored {width} x {height}, which EXIF turns; turned with"
        f" it to fx {turned.fx:g}, fy {turned.fy:g}, cx {turned.cx:g}, cy {turned.cy:g}"
    )
    return turned


def _stored_size(photo: object) -> tuple[int, tuple[int, int]]:
    """Return EXIF's orientation of a photo, 1 where it states none, and width and height before turning."""
    try:
        if isinstance(photo, str | Path):
            with open_picture(existing_file(photo)) as image:
                return _stored_size(image)
        assert isinstance(photo, Image.Image)
        if before := photo.info.get("original_orientation"):  # HEIF, which its decoder turns
            return before, (photo.height, photo.width) if before > 4 else photo.size
        orientation = photo.getexif().get(ExifTags.Base.Orientation, 1)
        return orientation if orientation in range(1, 9) else 1, photo.size
    except Exception:  # unreadable files are refused where they are decoded
        return 1, (0, 0)


def _key(name: object) -> str:
    return re.sub(r"[\W_]", "", str(name)).lower()


def _flat(camera: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return a mapping with the fields of a matrix's own mapping, and OpenCV's `data` in place of its."""
    flat = dict(camera)
    for name in MATRICES:
        if isinstance(inner := flat.get(name), Mapping):
            flat |= {name: inner["data"]} if "data" in inner else {name: None, **inner}
    return {name: value for name, value in flat.items() if value is not None}


def _size_of(camera: Any) -> tuple[Any, Any]:
    """Return the width and height that a mapping states, None for each that is missing."""
    if not isinstance(camera, Mapping):
        return None, None
    fields = {_key(name): value for name, value in _flat(camera).items()}
    width, height, both = (next((fields[key] for key in keys if key in fields), None) for keys in SIZES)
    if isinstance(both, Mapping):
        return _size_of(both)
    if isinstance(both, list | tuple) and len(both) == 2:
        return both[0] if width is None else width, both[1] if height is None else height
    return width, height


def _check_pinhole(camera: Mapping[Any, Any]) -> None:
    """Raise UserError for a lens with distortion, by whichever name."""
    for name, value in camera.items():
        key = _key(name)
        if isinstance(value, str) and re.search("model|type|projection", key):
            if NOT_PINHOLE.search(value):
                _refuse("a pinhole camera", f"'{value[:40]}' in '{name}'. Undistort the photo first")
        elif DISTORTION.fullmatch(key) and any(_numbers_in(value)):
            _refuse("a photo without lens distortion", f"coefficients of it in '{name}'. Undistort it first")


def _numbers_in(value: Any) -> Iterator[Any]:
    """Yield all numbers in a nested value, and texts that hold any but 0."""
    values = [value]
    while values:
        item = values.pop()
        if isinstance(item, Mapping):
            values += [item["data"]] if "data" in item else item.values()
        elif isinstance(item, str):
            yield re.fullmatch(r"[\s\d.,;eE+\-()\[\]]*[1-9][\s\d.,;eE+\-()\[\]]*", item)
        elif (number := number_of(item)) is not None:
            yield number
        elif hasattr(item, "__iter__"):
            values += item


def check_camera(camera: Any) -> None:
    """Raise UserError unless the camera has a form that `Intrinsics.of` takes, for any photo."""
    if not isinstance(camera, Intrinsics):
        _check_finite((camera, camera, 0.0, 0.0) if isinstance(camera, float) else _four_numbers(camera))


def _check_finite(numbers: tuple[float, float, float, float]) -> None:
    """Raise UserError for fx, fy, cx, cy that no camera has."""
    if not all(map(math.isfinite, numbers)) or min(numbers[:2]) <= 0:
        words = "fx {:g}, fy {:g}, cx {:g}, cy {:g}".format(*numbers)
        _refuse("finite numbers, focal lengths above 0", f"{words}. OpenCV's axes make both positive")


def _four_numbers(camera: Any) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy from any form of them."""
    given = camera
    if isinstance(camera, Mapping):
        camera = _flat(camera)
        parameters = camera.get(PARAMETERS)
        if isinstance(parameters, list | tuple):
            one_focal = str(camera.get("model")).upper().startswith(("SIMPLE", "RADIAL"))
            camera |= {"distortion in params": parameters[3 if one_focal else 4 :]}
            parameters = [parameters[0], *parameters[:3]] if one_focal and parameters else parameters[:4]
        _check_pinhole(camera)
        matrix = next((camera[name] for name in MATRICES if name in camera), None)
        fields = [camera.get(name, camera.get(other)) for name, other in FIELDS]
        camera = matrix if matrix is not None else parameters if None in fields else fields
    try:
        if any(isinstance(number, bool) for number in np.ravel(np.asarray(camera, object))):
            raise TypeError
        numbers = np.asarray(camera, float)
    except (TypeError, ValueError, OverflowError):
        numbers = np.empty(0)
    if numbers.shape == (9,):
        numbers = numbers.reshape(3, 3)
    if numbers.shape == (3, 3):
        fx, skew, cx = numbers[0].tolist()
        fy, cy = numbers[1, 1:].tolist()
        if numbers[1, 0] or numbers[2, :2].any() or numbers[2, 2] != 1 or abs(skew) > 1e-3 * abs(fx):
            rows = [[float(f"{number:g}") for number in row] for row in numbers.tolist()]
            _refuse("K as [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]", f"{rows}. Is it transposed or skewed?")
        return fx, fy, cx, cy
    if numbers.shape != (4,):
        _refuse("a camera as fx, fy, cx, cy or K (3, 3)", reprlib.repr(given)[:60])
    fx, fy, cx, cy = numbers.tolist()
    return fx, fy, cx, cy


def _refuse(expected: str, received: str) -> NoReturn:
    raise UserError(f"expected {expected}; got {received}. {REMEDY}")


def focal_of(photo: object) -> float | None:
    """Return the focal length in pixels that EXIF data of a photo's file, or of a PIL image, state.

    None where they state none, and where the picture is not of the size at which they say it was stored: it
    was cropped or resized since, by an unknown amount.
    """
    try:
        if isinstance(photo, str | Path):
            with open_picture(existing_file(photo)) as image:  # a pipe would be waited for
                return focal_of(image)
        if not isinstance(photo, Image.Image):
            return None
        tags = photo.getexif().get_ifd(ExifTags.IFD.Exif)
        size = sorted(photo.size)
        sides = ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight
        stored = sorted(int(tags.get(side) or 0) for side in sides)
        # 16: pixels by which EXIF's size of the stored picture may differ: JPEG stores blocks of 8 or 16
        if all(stored) and any(abs(a - b) > 16 for a, b in zip(size, stored, strict=True)):
            return None
        of_film = float(tags.get(ExifTags.Base.FocalLengthIn35mmFilm) or 0)
        # math.hypot(36, 24): millimetres of 35 mm film, to which cameras state their focal length
        equivalent = of_film / math.hypot(36, 24) * math.hypot(*size) if 1 <= of_film <= 2000 else None
        millimetres = float(tags.get(ExifTags.Base.FocalLength) or 0)
        resolution = float(tags.get(ExifTags.Base.FocalPlaneXResolution) or 0)  # pixels a unit
        unit = int(tags.get(ExifTags.Base.FocalPlaneResolutionUnit) or 2)
        # Millimetres of the units: inch, centimetre, millimetre, micrometre
        of_unit = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}.get(unit, 0.0)
        known = millimetres > 0 and resolution > 0 and of_unit > 0
        exact = millimetres * resolution / of_unit if known else 0.0
        if exact < WIDEST * size[1]:
            return equivalent
        # 0.1: relative difference up to which two of EXIF's focal lengths agree; above, the 35 mm equivalent
        # counts, as FocalPlane tags of pictures that a camera stored smaller are often those of its whole
        # sensor
        agrees = equivalent is None or abs(exact / equivalent - 1) <= 0.1
        return exact if agrees else equivalent
    except Exception:  # no EXIF data, or damaged ones
        return None
