"""Opened pictures decoded: largest page, orientation, depth, colour, transparency."""

import math
import re
import sys
import threading
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, ImageCms, ImageFile, ImageOps

from vig.photo import formats
from vig.photo.checks import MAX_FLOAT_PIXELS, check_pixels, check_size, head_of, refuse
from vig.photo.colour import SRGB, Profile, encoding_of, in_srgb
from vig.scene.light import linear_from_srgb

MID_GREY = 0.18  # linear reflectance of a photographer's grey card, which shows through transparent pixels
LINEAR: np.ndarray = linear_from_srgb(np.arange(256) / 255).astype(np.float32)
"""Linear light of each byte of sRGB."""
PHOTO = "a photo (JPEG, PNG, WebP, TIFF, ...)"
# Only formats that pillow decodes itself: no vector files, no outside programs.
FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP", "GIF", "PPM", "JPEG2000", "AVIF")
_PILLOW_LIMIT = threading.Lock()


def open_picture(path: Path) -> Image.Image:
    """Open the largest picture of a photo file.

    Raises:
        UserError: The file is another kind (`vig.photo.formats.why_no_photo`), or tiny or huge by its header.
    """
    if reason := formats.why_no_photo(path):
        refuse(path, PHOTO, *reason)
    if formats.is_heif(head_of(path)):
        from pillow_heif import HeifImageFile

        image: ImageFile.ImageFile = HeifImageFile(path)  # type: ignore[no-untyped-call]
    else:
        image = _open_of_any_size(path)
    try:
        return _largest(path, image)
    except BaseException:
        image.close()
        raise


def _open_of_any_size(path: Path) -> ImageFile.ImageFile:
    """Open a file without pillow's own limit, which is that of the process; `check_size` has ours."""
    with _PILLOW_LIMIT:
        former, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(path, formats=FORMATS)
        finally:
            Image.MAX_IMAGE_PIXELS = former


def _largest(path: Path, image: ImageFile.ImageFile) -> Image.Image:
    if image.format == "TIFF" and (page := formats.largest_page(path)):
        check_size(path, *page.size)
        if page.number is None:
            with image:
                return max(image.get_child_images(), key=lambda child: math.prod(child.size))
        image.seek(page.number)
    elif image.format == "MPO":
        sizes = []
        for number in range(getattr(image, "n_frames", 1)):
            image.seek(number)
            sizes.append(math.prod(image.size))
        image.seek(int(np.argmax(sizes)))
    check_size(path, *image.size)
    return image


def decode_picture(path: Path, image: Image.Image) -> np.ndarray:
    """Decode an opened picture, as `vig.photo.images.coded_photo` describes; errors name `path`."""
    _check_square(path, image)
    source, tags = getattr(image, "filename", ""), getattr(image, "tag_v2", {})
    stated = _stated_colour(image)
    rawmodes = str(getattr(image, "tile", ""))
    deep = ";16" in rawmodes
    if tags.get(ExifTags.Base.Orientation, 1) > 4:
        image.filename = ""  # type: ignore[attr-defined]  # else pillow maps the file with the sides exchanged
    image.load()
    if source:
        image.filename = source  # type: ignore[attr-defined]
    try:
        encoding = encoding_of(image, stated)
    except ValueError as error:
        refuse(path, "a known colour encoding", str(error), "Save it as 8-bit sRGB.")
    white, alpha = formats.white_level(tags), None
    picture = _upright(image)
    if picture.mode.startswith("I;16") or (image.format == "PPM" and picture.mode == "I"):
        samples = np.asarray(picture).astype(np.uint16)[..., None]
        _check_scale(path, int(samples.max()), white)
        if isinstance(key := image.info.get("transparency"), int):
            alpha = (samples != key).astype(np.float32)
        if tags.get(ExifTags.Base.PhotometricInterpretation) == 0:  # white; pillow inverts 8 bits only
            samples = white - np.minimum(samples, white)
        encoding = encoding or SRGB
    elif picture.mode in ("I", "F"):
        kind = formats.samples_of(tags) if tags else "32 bits"
        refuse(path, "8 or 16 bits a channel", kind, "Save it as 8-bit sRGB.")
    else:
        picture, alpha = _without_alpha(picture, rawmodes)
        if deep:
            _check_scale(path, int(np.asarray(picture).max()) << 8, white)
        whole = _sixteen_bits(source, image) if deep and (encoding or white != 65535) else None
        if whole is not None:
            if alpha is not None and whole.shape[-1] == 4:
                alpha = whole[..., 3:].astype(np.float32) / 65535
            encoding = encoding or SRGB
        elif white != 65535:
            refuse(path, "samples of 8 or 16 bits", f"a largest one of {white}", "Save it as 8-bit sRGB.")
        if isinstance(encoding, Profile):
            if whole is not None:
                whole = np.rint(np.minimum(whole[..., :3], white) * (255 / white))
                picture = Image.fromarray(whole.astype(np.uint8))
            picture, encoding, whole = _by_profile(picture, encoding), None, None
        picture = picture if picture.mode == "RGB" else picture.convert("RGB")
        samples = np.asarray(picture) if whole is None else whole[..., :3]
    if encoding is None and alpha is None:
        return samples
    assert not isinstance(encoding, Profile)
    check_pixels(
        path, samples.shape[1], samples.shape[0], MAX_FLOAT_PIXELS, " of 16 bits, HDR or with transparency"
    )
    byte = samples.dtype == np.uint8
    light = LINEAR[samples] if encoding is None else encoding.light(samples, 255 if byte else white)
    light = np.broadcast_to(light, (*light.shape[:2], 3))
    if alpha is not None:
        light = alpha * light + (1 - alpha) * np.float32(MID_GREY)
    return np.ascontiguousarray(light)


def _without_alpha(picture: Image.Image, rawmodes: str) -> tuple[Image.Image, np.ndarray | None]:
    """Return an 8-bit picture without transparency, and opacity (H, W, 1) in [0, 1]; None where it is 1."""
    if not picture.has_transparency_data:
        return picture, None
    key = picture.info.get("transparency")
    for rawmode, factor in (("L;2", 85), ("L;4", 17), ("RGB;16B", 1 / 256)):
        if key is not None and f"'{rawmode}'" in rawmodes:  # pillow scales a PNG's samples, and not its key
            picture = picture.copy()
            picture.info["transparency"] = (
                int(key * factor) if isinstance(key, int) else tuple(int(k * factor) for k in key)
            )
    picture = picture.convert("RGBA")
    opacity = np.asarray(picture)[..., 3:]
    return picture.convert("RGB"), opacity.astype(np.float32) / 255 if opacity.min() < 255 else None


def _upright(image: Image.Image) -> Image.Image:
    try:
        if image.getexif().get(ExifTags.Base.Orientation, 1) != 1:  # else it would copy the image
            return ImageOps.exif_transpose(image)
    except Exception:  # an unreadable EXIF block has no orientation
        pass
    return image


def _by_profile(picture: Image.Image, profile: Profile) -> Image.Image:
    """Convert a picture without alpha to sRGB, mode RGB; by its mode alone if its profile is unreadable."""
    mode = {"GRAY": "L", "CMYK": "CMYK", "Lab": "LAB"}.get(profile.profile.xcolor_space.strip(), "RGB")
    try:
        return in_srgb(picture if picture.mode == mode else picture.convert(mode), profile)
    except (ImageCms.PyCMSError, OSError, ValueError):
        return picture.convert("RGB")


def _sixteen_bits(path: str, image: Image.Image) -> np.ndarray | None:
    """Return all bits of a picture whose channels pillow cuts to their upper bytes, (H, W, 3 or 4) uint16.

    Its file is decoded again with the bytes swapped, which gives the lower ones. None for a picture that is
    not from a file, for planes in a row, and for modes without a swapped one.
    """
    swapped = {"L": "B", "B": "L", "N": "B" if sys.byteorder == "little" else "L"}
    if not path or getattr(image, "tag_v2", {}).get(ExifTags.Base.PlanarConfiguration) == 2:
        return None
    with _open_of_any_size(Path(path)) as lower:
        lower.seek(image.tell())
        tiles = []
        for tile in lower.tile:
            rawmode, *others = (tile.args,) if isinstance(tile.args, str) else tile.args or ("",)
            match = re.fullmatch(r"((?:RGB[AX]?|[RGBA]);16)([LBN])", rawmode)
            if (
                rawmode == "LA;16B" and lower.mode == "RGBA"
            ):  # 32 bits: upper and lower bytes of grey, of alpha
                other = "RGBA"
            elif match:
                other = match[1] + swapped[match[2]]
            else:
                return None
            tiles.append(tile._replace(args=(other, *others) if others else other))
        lower.tile = tiles
        lower.load()
        low = np.asarray(_upright(lower)).astype(np.uint16)
    if other == "RGBA":
        return (low[..., ::2] << 8 | low[..., 1::2])[..., [0, 0, 0, 1]]
    return np.asarray(_upright(image)).astype(np.uint16) << 8 | low


def _stated_colour(image: Image.Image) -> formats.Codes | None:
    """Return the codes in a file of PNG, AVIF or HEIC."""
    if nclx := image.info.get("nclx_profile"):  # pillow_heif's
        return formats.Codes(nclx["color_primaries"], nclx["transfer_characteristics"])
    if image.format not in ("PNG", "AVIF"):
        return None
    try:
        if path := getattr(image, "filename", ""):
            with open(path, "rb") as file:
                return formats.stated_codes(file)
        file = image.fp  # type: ignore[attr-defined]
        place = file.tell()
        try:
            return formats.stated_codes(file)
        finally:
            file.seek(place)
    except Exception:  # a damaged file, or a closed one: its decoder reports so
        return None


def _check_scale(path: Path, brightest: int, white: int) -> None:
    # 4096: A 16-bit picture whose samples are all below is one of 12 bits or fewer, not scaled to 16; so is
    # one whose brightest is exactly that of 13 to 15 bits
    if white == 65535 and (0 < brightest < 4096 or brightest in (8191, 16383, 32767)):
        received = f"none above {brightest}"
        refuse(
            path,
            "16-bit samples",
            received,
            "Are these fewer bits? Scale them to 16, or save it as 8-bit sRGB.",
        )


def _check_square(path: Path, image: Image.Image) -> None:
    """Raise UserError for pixels that the header calls oblong, as frames of anamorphic videos have them."""
    density = image.info.get("aspect") if image.format == "PNG" else image.info.get("jfif_density")
    if not density or min(density) <= 0 or image.info.get("jfif_unit", 0) != 0:
        return
    ratio = max(density) / min(density)
    if 1.01 < ratio < 4:  # more is no aspect
        refuse(
            path, "square pixels", f"oblong ones ({density[0]}:{density[1]})", "Resample it to square pixels."
        )
