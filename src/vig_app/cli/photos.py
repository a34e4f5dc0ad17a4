"""The photos that a command names, and a folder for the results of each."""

import glob
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from itertools import count
from pathlib import Path

from PIL import Image

from vig.io.errors import UserError
from vig.io.files import as_stored, compose_name
from vig.io.printing import note
from vig.photo.checks import ADDRESS
from vig.photo.decoding import FORMATS
from vig.photo.formats import why_no_photo
from vig.photo.video import frames_of, is_video
from vig_app.cli.naming import in_order, list_names
from vig_app.exports import run_formats
from vig_app.report.sheet import sheet_name
from vig_app.results import TABLES
from vig_app.runs import LEDGER

FRAMES = "frames"  # folder of the frames of videos within that of the results
EXPORTS = (Path(file).parts[0] for files in run_formats().values() for file in files)
TAKEN = {"report.html", sheet_name(0), LEDGER, FRAMES, *TABLES, *EXPORTS}
"""Names within a run's folder that no photo's folder may have."""
SYSTEM_FILES = {"Thumbs.db", "desktop.ini", "__MACOSX"}  # files that systems put into folders of photos


def photos_of(images: tuple[Path, ...], out: Path) -> list[Path]:
    """Return the photos that are named, those in folders that are, and frames of videos, which are put
    into `out`/frames first; UserError when there are none.
    """
    photos: list[Path] = []
    expanded = [path for image in images for path in _expand_pattern(image)]
    videos = [path for path in expanded if is_video(path) and not path.is_dir()]
    folders = iter(result_folders(videos, out / FRAMES))
    for path in expanded:
        if path.is_dir():
            photos += _photos_in(path)
        elif is_video(path):
            photos += frames_of(path, next(folders))
        else:
            photos.append(path)
    if not photos:
        raise UserError("expected at least one photo, such as `vig fit photo.jpg`; got none.")
    return photos


def _photos_in(folder: Path) -> list[Path]:
    """Return the photos in a folder; other files are named in a line, UserError where there are only such.

    Hidden files are passed over, such as those that macOS puts beside others (._photo.jpg).
    """
    extensions, photos, others = Image.registered_extensions(), list[Path](), list[Path]()
    for path in in_order(folder.iterdir()):
        if path.name.startswith(".") or path.name in SYSTEM_FILES:
            continue
        suffix = path.suffix.lower()
        # A file with a photo's ending that is none is an error of its own, not passed over.
        is_heic = suffix in (".heic", ".heif", ".hif") and find_spec("pillow_heif") is not None
        is_photo = is_heic or extensions.get(suffix) in FORMATS
        (photos if is_photo else others).append(path)
    named = [f"{path.name} ({_kind_of(path)})" for path in others]
    if not photos:
        others_named = f"{len(others)} of other kinds, {list_names(named)}" if others else "none"
        raise UserError(f"expected photos in '{folder}'; got {others_named}. Name others.")
    if others:
        files = "file" if len(others) == 1 else "files"
        note(f"{len(others)} {files} of '{folder}' not taken: {list_names(named)}")
    return photos


def _kind_of(path: Path) -> str:
    """Describe a file that is not taken as a photo from its folder."""
    if path.is_dir():
        return "a folder"
    if is_video(path):
        return "a video; name it itself"
    if not path.is_file():
        return "no file"
    return (why_no_photo(path) or ("no photo", ""))[0]


def _expand_pattern(path: Path) -> list[Path]:
    """Return files of a pattern like photos/*.jpg, which not every shell expands; any other path as it is."""
    pattern = str(path := as_stored(path))
    if os.path.lexists(path) or not glob.has_magic(pattern) or ADDRESS.match(pattern):
        return [path]
    if matches := in_order(map(Path, glob.glob(pattern, recursive=True))):
        return matches
    raise UserError(f"expected photos that match '{pattern}'; got none. Check the folder and the pattern.")


def result_folders(images: Sequence[Path], out: Path) -> list[Path]:
    """Return a folder for each photo, named after it, cut where files' names could not be so long; a
    number is added where two photos share a name.
    """
    used, numbers = set(map(compose_name, TAKEN)), defaultdict[str, Iterator[int]](lambda: count(2))
    folders = []
    # Bytes of the name of a photo's folder, at most: file systems take 255, with a number and a suffix.
    most_name_bytes = 200
    for image in images:
        stem = image.stem[:most_name_bytes]
        while len(os.fsencode(stem)) > most_name_bytes:
            stem = stem[:-1]
        name = stem
        while compose_name(name) in used:
            name = f"{stem}-{next(numbers[stem])}"
        used.add(compose_name(name))
        folders.append(out / name)
    return folders
