"""Pages of HTML from the templates beside this file, and the pictures that are part of them."""

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from vig.io.files import write_bytes
from vig.photo.images import png_bytes

QUALITY = 88  # quality of JPEG files, of at most 100


def fill_template(template: str, **content: Any) -> str:
    """Return a page. All its text is escaped: no text of a photo's name or class becomes markup or script."""
    return _PAGES.get_template(template).render(content)


def write_page(path: Path, html: str) -> None:
    """Write a page, in whose text a photo's name may have bytes of no encoding."""
    write_bytes(path, html.encode(errors="replace"))


def jpeg_bytes(picture: np.ndarray) -> bytes:
    """Return a picture (H, W, 3) uint8 as a JPEG file."""
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=QUALITY)
    return file.getvalue()


def jpeg_url(picture: np.ndarray) -> str:
    """Return a picture (H, W, 3) uint8 as the address of an image within a page."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg_bytes(picture)).decode()


def png_url(picture: np.ndarray) -> str:
    """Return a URL as `jpeg_url` does, of numbers (H, W) uint8 that must stay as they are."""
    return "data:image/png;base64," + base64.b64encode(png_bytes(picture)).decode()


_PAGES = Environment(
    loader=PackageLoader("vig_app.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_PAGES.filters |= {"url": jpeg_url, "degrees": "{:.0f}°".format, "percent": "{:.0%}".format}
