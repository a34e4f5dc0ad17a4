"""The folder of files of an explanation, or of several objects of one photo; docs/explanation.md."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vig.explanation import Explanation
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.output import mask_picture, write_glb, write_json
from vig.photo.images import write_png
from vig.several.scene import COLOURS, SceneExplanation
from vig_app.exports import export_explanation, remove_exports
from vig_app.report.contents import page_of
from vig_app.report.page import Entry, folder_html, thumbnail, write_thumbnail


def save_explanation(explanation: Explanation, folder: str | Path, photo: str) -> Path:
    """The work of `Explanation.save`."""
    if not isinstance(folder, str | Path):
        raise UserError(f"expected a folder's path; got a {type(folder).__name__}. Pass its name.")
    folder, described, drawn = Path(folder), explanation.to_dict(), explanation.overlay()
    remove_stale_exports(folder, described)
    write_png(folder / "overlay.png", drawn)
    write_thumbnail(folder, drawn)
    write_png(folder / "mask.png", mask_picture(explanation.amodal, explanation.mask))
    write_png(folder / "render.png", explanation.panels())
    write_glb(
        folder / "object.glb",
        explanation.vertices,
        explanation.part_albedo,
        explanation.object_class,
        explanation.camera,
        float(explanation.latents.azimuth),
        float(explanation.latents.elevation),
    )
    write_page(folder / "report.html", page_of(explanation, photo, described))
    write_json(folder, described)
    return folder


def save_scene(scene: SceneExplanation, folder: str | Path, photo: str, export: Sequence[str]) -> Path:
    """The work of `SceneExplanation.save`."""
    folder, picture = Path(folder), scene.overlay()
    numbers = np.zeros(picture.shape[:2], np.uint8)
    for number, mask in enumerate(scene.masks, 1):
        numbers[mask] = number
    write_png(folder / "overlay.png", picture)
    write_numbers(folder / "mask.png", numbers)
    write_thumbnail(folder, picture)
    entries = []
    for name, explanation in zip(scene.names, scene.objects, strict=True):
        save_explanation(explanation, folder / name, f"{photo}, {name}")
        export_explanation(explanation, folder / name, export, photo)
        entries.append(Entry(name, name, explanation.to_dict(), thumbnail(explanation.overlay())))
    note = scene.order_note if len(scene.objects) > 1 else ""
    write_page(folder / "report.html", folder_html(entries, title=photo, picture=picture, note=note))
    write_json(folder, scene.to_dict(), "scene.json")
    return folder


def write_page(path: Path, html: str) -> None:
    """Write a page, in whose text a photo's name may have bytes of no encoding."""
    with atomic_write(path) as temporary:
        temporary.write_text(html, encoding="utf-8", errors="replace")


def write_numbers(path: Path, numbers: np.ndarray) -> None:
    """Write numbers (H, W) uint8 as a PNG whose palette shows them in the objects' colours."""
    image = Image.fromarray(numbers, "P")
    palette = [(0, 0, 0)] + [tuple(COLOURS[index % len(COLOURS)].astype(int)) for index in range(255)]
    image.putpalette([int(channel) for colour in palette for channel in colour])
    with atomic_write(path) as temporary:
        image.save(temporary, "PNG")


def remove_stale_exports(folder: Path, described: dict[str, Any]) -> None:
    """Remove the exports in a folder whose explanation.json is not what is described."""
    path = folder / "explanation.json"
    with suppress(OSError, ValueError):
        if path.exists() and json.loads(path.read_text()) != json.loads(json.dumps(described)):
            remove_exports(folder)
