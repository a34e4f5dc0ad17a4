"""The folder of files of an explanation, or of several objects of one photo; docs/explanation.md."""

import json
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image

from vig.explanation import Explanation
from vig.io.errors import UserError
from vig.io.files import atomic_write, write_json
from vig.photo.images import as_srgb, write_png
from vig.record import FILE
from vig.several.scene import SceneExplanation
from vig_app.exports import export_explanation, remove_exports
from vig_app.glb import Texture, bake, write_object, write_scene
from vig_app.pictures import COLOURS, overlay, panels, scene_overlay
from vig_app.report.contents import page_of, page_photo
from vig_app.report.folder_page import Entry, folder_html, reduce_picture, write_thumbnail
from vig_app.report.html import write_page

FILES = (
    FILE, "overlay.png", "thumbnail.jpg", "mask.png", "render.png", "object.glb", "report.html",
)  # fmt: skip
"""Files of an explanation's folder; the first in any case."""
OPTIONAL_FILES = ("texture_seen.png",)  # files that it holds only on request
TEXTURED = {"object.glb", *OPTIONAL_FILES}  # files that need the texture
PICTURE_SIDE = 2048  # pixels of overlay.png's longer side at most, unless its full size is asked for


def save_explanation(
    explanation: Explanation,
    folder: str | Path,
    photo: str,
    files: Sequence[str] | None = None,
    full_size: bool = False,
) -> Path:
    """Write the files of `Explanation.save`."""
    if not isinstance(folder, str | Path):
        raise UserError(f"expected a folder's path; got a {type(folder).__name__}. Pass its name.")
    save_entry(explanation, Path(folder), photo, photo, files, full_size)
    return Path(folder)


def save_entry(
    explanation: Explanation,
    folder: Path,
    photo: str,
    name: str,
    files: Sequence[str] | None = None,
    full_size: bool = False,
) -> tuple[Entry, Texture | None]:
    """Save as `save_explanation` does; return the entry for the page of several photos or objects, and
    the texture where a file has it.
    """
    files = FILES if files is None else files
    check_files(files)
    described = explanation.to_dict()
    with suppress(OSError, ValueError):  # exports and files of another result that are not written anew
        if json.loads((folder / FILE).read_text()) != json.loads(json.dumps(described)):
            remove_exports(folder)
            for stale in {*FILES, *OPTIONAL_FILES} - {*files, FILE}:
                (folder / stale).unlink(missing_ok=True)
    picture = as_srgb(explanation.picture)
    picture = picture if full_size else reduce_picture(picture, PICTURE_SIDE)
    shown = page_photo(picture)
    small = overlay(explanation, reduce_picture(shown))
    entry = Entry(name, folder.name, described, small, "report.html" in files)
    texture = bake(explanation) if TEXTURED & set(files) else None

    def write_masks(path: Path) -> None:
        """Write 255 where the object is visible, 128 where hidden, else 0."""
        levels = explanation.amodal.view(np.uint8) * np.uint8(128)
        levels[explanation.mask] = 255
        write_png(path, levels)

    writers: dict[str, Callable[[Path], None]] = {
        "overlay.png": lambda path: write_png(path, overlay(explanation, picture)),
        "thumbnail.jpg": lambda path: write_thumbnail(path.parent, small),
        "mask.png": write_masks,
        "render.png": lambda path: write_png(path, panels(explanation)),
        "object.glb": lambda path: write_object(path, explanation, texture),
        "report.html": lambda path: write_page(path, page_of(explanation, photo, described, shown)),
    }
    for file, write in writers.items():
        if file in files:
            write(folder / file)
    if "texture_seen.png" in files:
        if texture is None:  # nor may that of an earlier object stay
            (folder / "texture_seen.png").unlink(missing_ok=True)
            note = "texture_seen.png is left out: the class is in too many pieces for a texture"
            print(f"vig: {note}", file=sys.stderr)
        else:
            write_png(folder / "texture_seen.png", texture.origin_picture)
    write_json(folder / FILE, described)
    return entry, texture


def check_files(files: Sequence[str]) -> None:
    """Raise UserError unless all are of `FILES` or `OPTIONAL_FILES`."""
    wanted = f"expected files of {', '.join(FILES + OPTIONAL_FILES)}"
    if isinstance(files, str) or not isinstance(files, Sequence):
        raise UserError(f"{wanted}; got {str(files)[:60]!r}. Pass a list of names.")
    for name in files:
        if name not in FILES + OPTIONAL_FILES:
            raise UserError(f"{wanted}; got {name!r}. Leave it out (photos come before --files).")


def save_scene(
    scene: SceneExplanation,
    folder: str | Path,
    photo: str,
    export: Sequence[str],
    files: Sequence[str] | None,
    full_size: bool = False,
) -> Path:
    """Write the files of `SceneExplanation.save`."""
    files = FILES if files is None else files
    check_files(files)
    folder, picture = Path(folder), scene_overlay(scene)
    numbers = np.zeros(picture.shape[:2], np.uint8)
    for number, mask in enumerate(scene.masks, 1):
        numbers[mask] = number
    write_png(folder / "overlay.png", picture if full_size else reduce_picture(picture, PICTURE_SIDE))
    image = Image.fromarray(numbers, "P")  # shown in the objects' colours
    palette = [(0, 0, 0)] + [tuple(COLOURS[index % len(COLOURS)].astype(int)) for index in range(255)]
    image.putpalette([int(channel) for colour in palette for channel in colour])
    with atomic_write(folder / "mask.png") as temporary:
        image.save(temporary, "PNG")
    write_thumbnail(folder, reduce_picture(picture))
    entries, textures = [], []
    for name, explanation in zip(scene.names, scene.objects, strict=True):
        entry, texture = save_entry(explanation, folder / name, f"{photo}, {name}", name, files, full_size)
        entries.append(entry)
        textures.append(texture)
        export_explanation(explanation, folder / name, export, photo)
    note = scene.order_note if len(scene.objects) > 1 else ""
    write_page(folder / "report.html", folder_html(entries, title=photo, picture=picture, note=note))
    if "object.glb" in files:
        write_scene(folder / "scene.glb", scene, textures)
    else:  # from an earlier result
        (folder / "scene.glb").unlink(missing_ok=True)
    write_json(folder / "scene.json", scene.to_dict())
    return folder
