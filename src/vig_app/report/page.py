"""report.html: one file that shows an explanation in a browser, without a server or the network."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vig.io.files import atomic_write
from vig.scene.light import srgb8_from_linear

QUALITY = 88
MOST_ERRORS = 200
THUMBNAIL = 320
"""Pixels of the longer side of a folder's pictures."""
WHOLE = 1200
"""And of the picture of several objects."""
THUMBNAIL_FILE = "thumbnail.jpg"
REVIEW_ORDER = ("failed", "absent", "reverted", "ambiguous", "trusted")
"""Verdicts in the order in which their photos should be looked at."""
INTERVAL = 1.645
"""Standard deviations to either side that hold 90 % of a Gaussian."""


@dataclass(frozen=True)
class Seen:
    """A view and its picture: `words` say which, picture (H, W, 3) uint8 shows it."""

    words: str
    azimuth: float
    elevation: float
    picture: np.ndarray


@dataclass(frozen=True)
class Page:
    """What a page shows.

    Attributes:
        name: The photo's file name, whatever is in it.
        described: What explanation.json holds.
        photo: (H, W, 3) uint8, with `whole` and `outline` of one size.
        whole: The photo with the hidden part of the object drawn in.
        outline: The overlay.
        panels: (h, w, 3) uint8.
        views: The fit and its alternatives.
        steps: Of the fit, from its start to its end.
        vertices: (V, 3) metres, in the object's frame.
        normals: (V, 3).
        faces: (F, 3).
        colours: (F, 3) linear RGB of each face.
        parts: Names and colours (3,) of the parts.
    """

    name: str
    described: dict[str, Any]
    photo: np.ndarray
    whole: np.ndarray
    outline: np.ndarray
    panels: np.ndarray
    views: tuple[Seen, ...]
    steps: tuple[Seen, ...]
    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    colours: np.ndarray
    parts: tuple[tuple[str, np.ndarray], ...]


def html(page: Page) -> str:
    """The page. Whatever it shows is data: no text of a photo's name or class becomes markup or script."""
    described, spread = page.described, np.ptp(page.vertices, axis=0)
    corners = page.faces.ravel()
    data = {
        "name": page.name,
        "verdict": described["verdict"],
        "badge": _badge(described),
        "reason": described["reason"],
        "summary": _summary(described),
        "views_note": _views_note(described),
        "pictures": {
            "photo": _jpeg(page.photo),
            "whole": _jpeg(page.whole),
            "outline": _jpeg(page.outline),
            "panels": _jpeg(page.panels),
        },
        "views": [_seen(view) for view in page.views],
        "steps": [_seen(step) for step in page.steps],
        "rows": rows(described, page.parts),
        "model": {
            "place": _floats(page.vertices[corners]),
            "normal": _floats(page.normals[corners]),
            "colour": _floats(np.repeat(page.colours, 3, axis=0)),
            "count": len(corners),
            "target": (page.vertices.min(0) + spread / 2).tolist(),
            "size": float(spread.max()),
            "light": described["light"],
            "azimuth": page.views[0].azimuth,
            "elevation": page.views[0].elevation,
        },
    }
    return _filled("page.html", data)


def _seen(view: Seen) -> dict[str, Any]:
    return vars(view) | {"picture": _jpeg(view.picture)}


@dataclass(frozen=True)
class Entry:
    """A photo of a folder's page: its name, its results' folder beside the page, numbers and a picture."""

    name: str
    folder: str
    described: dict[str, Any]
    picture: np.ndarray


def thumbnail(picture: np.ndarray) -> np.ndarray:
    """A picture (H, W, 3) uint8 as small as a folder's page shows it."""
    return small(picture, THUMBNAIL)


def small(picture: np.ndarray, side: int) -> np.ndarray:
    """A picture (H, W, 3) uint8 whose longer side has `side` pixels at most."""
    image = Image.fromarray(picture)
    image.thumbnail((side, side), Image.Resampling.BICUBIC, reducing_gap=2.0)
    return np.asarray(image)


def write_thumbnail(folder: Path, picture: np.ndarray) -> None:
    """Write thumbnail.jpg of a picture (H, W, 3) uint8: what pages and sheets of many photos show."""
    with atomic_write(folder / THUMBNAIL_FILE) as temporary:
        Image.fromarray(thumbnail(picture)).save(temporary, "JPEG", quality=QUALITY)


def review_order(row: Mapping[str, Any]) -> tuple[int, float]:
    """Sort key of photos: errors, then by verdict (`REVIEW_ORDER`), the least confidence first."""
    if row.get("error") is not None:
        return -1, 0.0
    return REVIEW_ORDER.index(row["verdict"]), row["confidence"] or 0.0


def folder_html(
    entries: Sequence[Entry],
    total: int | None = None,
    errors: Sequence[str] = (),
    title: str | None = None,
    picture: np.ndarray | None = None,
    note: str = "",
) -> str:
    """A page of several photos, or objects of one, each with a link to its own; the strangest comes first.

    Args:
        entries: The photos that are shown.
        total: How many were explained, if more than are shown.
        errors: Why others were not; the first `MOST_ERRORS` are shown.
        title: In place of their number.
        picture: (H, W, 3) uint8, of all of them.
        note: Under the title.
    """
    data = []
    for place, entry in enumerate(sorted(entries, key=lambda entry: review_order(entry.described))):
        said = entry.described
        confidence, hidden = said["confidence"], said["hidden_fraction"]
        words = [f"azimuth {said['azimuth_deg']:.0f}°"]
        words += [] if hidden is None else [f"{hidden:.0%} hidden"]
        words += [] if confidence is None else [f"right with {confidence:.0%}"]
        data.append(
            {
                "name": entry.name,
                "folder": entry.folder,
                "verdict": said["verdict"],
                "words": ", ".join(words),
                "place": place,
                "hidden": hidden,
                "azimuth": said["azimuth_deg"],
                "elevation": said["elevation_deg"],
                "confidence": confidence,
                "mask": said["mask_confidence"],
                "picture": _jpeg(entry.picture),
            }
        )
    shown = {
        "entries": data,
        "total": len(data) if total is None else total,
        "failed": len(errors),
        "errors": list(errors[:MOST_ERRORS]),
        "title": title,
        "picture": None if picture is None else _jpeg(small(picture, WHOLE)),
        "note": note,
    }
    return _filled("folder.html", shown)


def _filled(template: str, data: Any) -> str:
    """A page with its data, within which only "<" could end the script element or begin a comment."""
    text = json.dumps(data).replace("<", "\\u003c")
    return (resources.files("vig_app.report") / template).read_text(encoding="utf-8").replace("@DATA@", text)


def rows(described: dict[str, Any], parts: tuple[tuple[str, np.ndarray], ...]) -> list[list[Any]]:
    """Name, words, and named colours of each line of the page's table."""
    deviation, camera = described["deviation"], described["camera"]
    hidden = described["hidden_fraction"]
    lines: list[tuple[str, str]] = []
    for name, key in (("azimuth of the eye", "azimuth_deg"), ("its elevation", "elevation_deg")):
        known = deviation[key]
        wide = None if known is None else INTERVAL * known
        interval = (
            ""
            if wide is None
            else f", 90 % interval ±{wide:.0f}°"
            if wide < 90
            else ", if this is the right view"
        )
        lines.append((name, f"{described[key]:.0f}°{interval}"))
    lines += [
        ("roll of the photo", f"{round(described['roll_deg'])}°"),
        ("hidden", "nothing of it is in the photo" if hidden is None else f"{hidden:.0%} of the object"),
        ("kind", f"{described['class']}" + (f", {described['family']}" if described["family"] else "")),
        ("light", _light(described["light"])),
        ("focal length", f"{camera['K'][0][0]:.0f} pixels, {camera['focal_from']}"),
        ("scale", camera["scale"]),
    ]
    colours = [[name, _css(colour)] for name, colour in parts]
    table: list[list[Any]] = [[name, value, []] for name, value in lines]
    return [*table, ["colours", "", colours]]


def _badge(described: dict[str, Any]) -> str:
    """The verdict, which is of the view, with what else of the answer can or cannot be trusted."""
    verdict, mask = described["verdict"], "mask" in described["trusted"]
    if described["mask_confidence"] is None or (verdict == "trusted") == mask:
        return str(verdict)
    return f"view {verdict}, mask {'trusted' if mask else 'not'}"


def _summary(described: dict[str, Any]) -> str:
    confidence, hidden = described["confidence"], described["hidden_fraction"]
    if confidence is None:
        sure = "how sure was not learned"
    else:
        mask_right = described["mask_confidence"]
        sure = f"the view is right with a probability of {confidence:.0%}, the mask of {mask_right:.0%}"
    view, mask = (part in described["trusted"] for part in ("view", "mask"))
    trusted = {
        (True, True): "its view and its mask are trusted",
        (True, False): "its view is trusted, its mask is not",
        (False, True): "its mask is trusted, its view is not",
        (False, False): "neither its view nor its mask is trusted",
    }[view, mask]
    seen = "" if hidden is None else f"; {hidden:.0%} of it is hidden"
    return f"{described['class']}: {trusted} ({sure}){seen}"


def _views_note(described: dict[str, Any]) -> str:
    if described["alternatives"]:
        other = described["alternatives"][0]["azimuth_deg"]
        return (
            f"The search tried these. To take the second one: vig fit --azimuth {other:.0f}, or choose it in"
            " vig view."
        )
    return "The search found no other view worth telling."


def _light(light: list[float]) -> str:
    """Where most light comes from, by the first order of its SH coefficients, in the object's frame."""
    y, z, x = light[1:4]
    above = "from above" if z > 0.5 * float(np.hypot(x, y)) else "from the side"
    strength = float(np.linalg.norm([x, y, z])) / max(abs(light[0]), 1e-6)
    kind = "soft" if strength < 0.4 else "directed" if strength < 0.9 else "strongly directed"
    return f"{kind}, most of it {above}"


def _css(colour: np.ndarray) -> str:
    red, green, blue = srgb8_from_linear(np.asarray(colour, np.float32)).tolist()
    return f"rgb({red}, {green}, {blue})"


def _floats(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode()


def _jpeg(picture: np.ndarray) -> str:
    data = io.BytesIO()
    Image.fromarray(picture).save(data, "JPEG", quality=QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(data.getvalue()).decode()
