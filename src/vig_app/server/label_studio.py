"""Label Studio's protocol of machine learning backends: photos of its tasks, and results as it draws them."""

import base64
import math
import re
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urljoin, urlsplit
from xml.etree import ElementTree

import numpy as np

from vig import __version__
from vig.explanation import Explanation
from vig.inference import Verdict
from vig.io.errors import UserError
from vig.photo.masks import box_of
from vig_app.exports.annotations import polygons_of

KINDS = {
    "PolygonLabels": "polygonlabels",
    "RectangleLabels": "rectanglelabels",
    "KeyPointLabels": "keypointlabels",
}
"""Tags of a labelling configuration that are answered, and the types of their results."""
MAX_BYTES = 100_000_000
SECONDS = 20.0


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_: Any) -> None:
        """Follow none: it could lead to any other server."""


def fetch(task: Mapping[str, Any], config: str, address: str | None, token: str | None) -> bytes:
    """Return a task's photo: data in its own address, or a file of the Label Studio that was named.

    The labelling configuration says which of its values is the photo's address.

    Raises:
        UserError: It has none, is on another server, or cannot be fetched.
    """
    data = task.get("data") if isinstance(task, Mapping) else None
    name = re.search(r"<Image\b[^>]*\bvalue=[\"']\$(\w+)", config)
    url = str(data.get(name[1] if name else "image", "")) if isinstance(data, Mapping) else ""
    if url.startswith("data:"):
        try:
            return base64.b64decode(url.partition(",")[2], validate=True)
        except ValueError:
            raise UserError("expected a data: address in base64; got another.") from None
    full = urljoin(f"{address}/", url) if address else url
    if not url or not address or urlsplit(full)[:2] != urlsplit(address)[:2]:
        raise UserError(f"expected a photo of {address or '--label-studio ADDRESS'}; got '{url[:100]}'.")
    request = urllib.request.Request(full, headers={"Authorization": f"Token {token}"} if token else {})
    try:
        with urllib.request.build_opener(_NoRedirect).open(request, timeout=SECONDS) as answer:
            content: bytes = answer.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise UserError(f"expected a photo at '{url[:100]}'; got an error ({error}).") from None
    if len(content) > MAX_BYTES:
        raise UserError(f"expected at most {MAX_BYTES:,} bytes at '{url[:100]}'; got more.")
    return content


def prediction(explanation: Explanation, folder: Path, config: str) -> dict[str, Any]:
    """Return a prediction with the shapes that a labelling configuration has tags and labels for.

    Labels are the class's name, and those of its points; a polygon or box is round what is seen, or round the
    whole object for a label that ends in "amodal".
    """
    try:
        root = ElementTree.fromstring(config)
    except ElementTree.ParseError as error:
        raise UserError(f"expected a label_config in XML; got another text ({error}).") from None
    height, width = explanation.mask.shape
    common = {"original_width": width, "original_height": height, "image_rotation": 0}
    result = []
    for tag in root.iter():
        if (kind := KINDS.get(tag.tag)) is None or explanation.verdict is Verdict.ABSENT:
            continue
        for label in (str(each.get("value")) for each in tag.iter("Label")):
            for value in _values(explanation, kind, label):
                shape = {"from_name": tag.get("name"), "to_name": tag.get("toName"), "type": kind}
                result.append(shape | common | {"value": value | {kind: [label]}})
    score = 0.0 if math.isnan(explanation.confidence) else round(explanation.confidence, 4)
    return {"result": result, "score": score, "model_version": f"vig {__version__}"}


def _values(explanation: Explanation, kind: str, label: str) -> list[dict[str, Any]]:
    """Return the values of a label's results, in percent of the photo's sides."""
    plain, percent = label.casefold(), 100 / np.array(explanation.mask.shape[::-1])
    if kind == "keypointlabels":
        places = [percent * at[:2] for name, at in explanation.points.items() if name.casefold() == plain]
        # Drawn width of a point, percent of the photo's.
        return [{"x": x, "y": y, "width": 0.75} for x, y in map(np.ndarray.tolist, places)]
    if plain.removesuffix("amodal").strip(" -_") != explanation.object_class.name.casefold():
        return []
    mask = explanation.amodal if plain.endswith("amodal") else explanation.mask
    if kind == "polygonlabels":
        return [{"points": (percent * piece).tolist()} for piece in polygons_of(mask)]
    sides = np.reshape(box_of(mask) or [], (-1, 2)) * percent
    names = "x", "y", "width", "height"
    return [dict(zip(names, sides.ravel().tolist(), strict=True)) | {"rotation": 0}] if len(sides) else []
