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
from vig_app.report.folder_page import Entry, folder_html, write_thumbnail
from vig_app.report.html import write_page


def save_explanation(explanation: Explanation, folder: str | Path, photo: str) -> Path:
    """The work of `Explanation.save`."""
    if not isinstance(folder, str | Path):
        raise UserError(f"expected a folder's path; got a {type(folder).__name__}. Pass its name.")
    save_entry(explanation, Path(folder), photo, photo)
    return Path(folder)


def save_entry(explanation: Explanation, folder: Path, photo: str, name: str) -> Entry:
    """`save_explanation`; returns what the page of several photos or objects shows of it under a name."""
    described, picture, panels = explanation.to_dict(), explanation.overlay(), explanation.panels()
    _remove_stale_exports(folder, described)
    write_png(folder / "overlay.png", picture)
    thumbnail = write_thumbnail(folder, picture)
    write_png(folder / "mask.png", mask_picture(explanation.amodal, explanation.mask))
    write_png(folder / "render.png", panels)
    write_glb(
        folder / "object.glb",
        explanation.vertices,
        explanation.part_albedo,
        explanation.object_class,
        explanation.camera,
        float(explanation.latents.azimuth),
        float(explanation.latents.elevation),
    )
    write_page(folder / "report.html", page_of(explanation, photo, described, panels))
    write_json(folder, described)
    return Entry(name, folder.name, described, thumbnail)


def save_scene(scene: SceneExplanation, folder: str | Path, photo: str, export: Sequence[str]) -> Path:
    """The work of `SceneExplanation.save`."""
    folder, picture = Path(folder), scene.overlay()
    numbers = np.zeros(picture.shape[:2], np.uint8)
    for number, mask in enumerate(scene.masks, 1):
        numbers[mask] = number
    write_png(folder / "overlay.png", picture)
    _write_numbers(folder / "mask.png", numbers)
    write_thumbnail(folder, picture)
    entries = []
    for name, explanation in zip(scene.names, scene.objects, strict=True):
        entries.append(save_entry(explanation, folder / name, f"{photo}, {name}", name))
        export_explanation(explanation, folder / name, export, photo)
    note = scene.order_note if len(scene.objects) > 1 else ""
    write_page(folder / "report.html", folder_html(entries, title=photo, picture=picture, note=note))
    write_json(folder, scene.to_dict(), "scene.json")
    return folder


def _write_numbers(path: Path, numbers: np.ndarray) -> None:
    """Write numbers (H, W) uint8 as a PNG whose palette shows them in the objects' colours."""
    image = Image.fromarray(numbers, "P")
    palette = [(0, 0, 0)] + [tuple(COLOURS[index % len(COLOURS)].astype(int)) for index in range(255)]
    image.putpalette([int(channel) for colour in palette for channel in colour])
    with atomic_write(path) as temporary:
        image.save(temporary, "PNG")


def _remove_stale_exports(folder: Path, described: dict[str, Any]) -> None:
    """Remove the exports in a folder whose explanation.json is not what is described."""
    with suppress(OSError, ValueError):
        if json.loads((folder / "explanation.json").read_text()) != json.loads(json.dumps(described)):
            remove_exports(folder)
