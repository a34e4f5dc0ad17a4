"""`vig fit`: photos explained, a folder each."""

from __future__ import annotations

import glob
import json
import os
import shlex
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, nullcontext
from datetime import datetime
from functools import partial
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any

from PIL import Image
from safetensors import SafetensorError, safe_open

from vig import __version__
from vig.inference import ExplainSettings
from vig.io.errors import UserError
from vig.io.files import as_stored, compose_name
from vig.io.printing import end, in_one_line, note
from vig.io.progress import Meter
from vig.likelihood import LIKELIHOODS
from vig.photo.checks import ADDRESS
from vig.photo.decoding import FORMATS
from vig.photo.formats import why_no_photo
from vig.photo.video import frames_of, is_video
from vig.recognition import WEIGHTS_FILE
from vig.record import read_explanation
from vig_app.cli.boxes import boxes_of, check_place, classes_of
from vig_app.cli.cameras import cameras_of
from vig_app.cli.common import FitCommand
from vig_app.cli.hints import hints_of, mask_of
from vig_app.cli.naming import in_order, listed, note_order
from vig_app.corrections import CORRECTIONS, Correction, corrected_in
from vig_app.exports import RUN_FORMATS, export_run, run_files
from vig_app.report.folder import FILES, check_files
from vig_app.report.folder_page import write_run_page
from vig_app.report.sheet import sheet_name, write_sheets
from vig_app.results import TABLES, TRACK, RowsOnDisk, name_of, write_table
from vig_app.runs import LEDGER, RunSettings, Task, ledger_of, run, run_tracked

FRAMES = "frames"
"""Folder of the frames of videos within that of the results."""
TAKEN = {"report.html", sheet_name(0), LEDGER, FRAMES, *TABLES, *run_files()}
"""Names within a run's folder that no photo's folder may have."""
HEIC_SUFFIXES = (".heic", ".heif", ".hif")
MOST_NAME_BYTES = 200
"""Bytes of the name of a photo's folder, at most: file systems take 255, with a number and a suffix."""
SYSTEM_FILES = {"Thumbs.db", "desktop.ini", "__MACOSX"}
"""What systems put into folders of photos."""
HINTS = (
    "box", "boxes", "mask", "marks", "visible", "points", "azimuth", "elevation", "roll", "pose", "focal",
    "intrinsics", "cameras",
)  # fmt: skip
"""Options that say something of a photo."""
FRAMINGS = {"auto": None, "fixed": False, "free": True}
"""Of `--framing`, as `ExplainSettings.free_framing`."""
WITHOUT_TRACK = (
    "boxes", "objects", "cluster", "mask", "marks", "points", "azimuth", "pose",
)  # fmt: skip
"""Options that do not go with `--track`."""


def _with_mask(settings: FitCommand) -> tuple[str, ...] | None:
    """The chosen files, with the mask where exports name it; None for all."""
    return (*settings.files, *("mask.png",) * bool(settings.export)) if settings.files else None


def fit(settings: FitCommand) -> int:
    """Explain every photo into a folder of its own; returns the exit code."""
    if settings.files == ():
        raise UserError(
            f"expected --files with the names of files, such as --files mask.png, of {' '.join(FILES)}; got"
            " none. Leave it out for all."
        )
    check_files(settings.files or ())
    if settings.live is not None:
        from vig_app.cli.live import fit_live

        return fit_live(settings)
    if settings.timeout != FitCommand.timeout:
        raise UserError("expected --timeout with --live; got it without. Leave it out.")
    if settings.track:
        _check_track(settings)
    with ledger_of(settings.out) if any(map(is_video, settings.images)) else nullcontext():
        photos = photos_of(settings.images, settings.out)
    if settings.track:
        note_order(photos)
    folders = result_folders(photos, settings.out)
    boxes = boxes_of(settings, photos)
    check_place(settings, folders)
    object_class, further_classes = classes_of(settings)
    for name in (object_class, *further_classes):
        if not settings.quiet and is_quick(Path(name)):
            note(f"'{name}' has a quick recognizer; `vig class train {name}` makes a better one")
        if not settings.quiet and settings.mesh is None and is_untrained(Path(name)):
            note(
                f"no network was trained for '{name}': each photo needs --box or --mask, and views are tried"
                f" all round; `vig class train {name}` trains one"
            )
    hints = hints_of(settings, photos)
    mask = mask_of(settings, photos)
    cameras = cameras_of(settings, photos)
    if settings.track and any(repr(camera) != repr(cameras[0]) for camera in cameras):
        raise UserError(f"expected one camera for all frames; got several in '{settings.cameras}'. Name one.")
    explain_settings = ExplainSettings(
        LIKELIHOODS[settings.likelihood],
        self_shadow=not settings.no_self_shadow,
        free_framing=FRAMINGS[settings.framing],
    )
    log = partial(_add_line, settings.log)
    log(f"vig {__version__}: {len(photos)} photos into '{settings.out}'")
    run_settings = RunSettings(
        object_class,
        explain_settings,
        settings.export,
        further_classes,
        _with_mask(settings),
        settings.full_size,
    )
    by_hand, most = _corrected(settings, folders, object_class), settings.objects or 0
    tasks = (
        Task(photo, folder, box, settings.focal, hints, mask(photo), objects, most, camera, by_hand[folder])
        for photo, folder, (box, objects), camera in zip(photos, folders, boxes, cameras, strict=True)
    )
    rows = RowsOnDisk(folder.name for folder in folders)
    made_anew = False
    failed = 0

    def take(row: dict[str, Any]) -> None:
        nonlocal made_anew, failed
        rows.add(row)
        made_anew |= not row.get("done_before")
        failed += row["error"] is not None
        meter.advance(len(rows) - meter.done)
        line = in_one_line(_line(row))
        log(line)
        if row["error"] is not None:
            note(row["error"])
        elif not settings.json and not settings.quiet:
            print(line, flush=True)

    def finish() -> None:
        if len(rows):
            if made_anew:
                for name in run_files():  # of the results before
                    (settings.out / name).unlink(missing_ok=True)
            write_table(settings.out, rows)
            write_run_page(settings.out, rows)
            write_sheets(settings.out, rows)

    show_progress = len(photos) > 1 and not settings.quiet and sys.stderr.isatty()
    with Meter(len(photos), 0, show_progress, "photos") as meter:
        if settings.track:
            frames = run_tracked(list(tasks), settings.out, run_settings, take, finish).frames
        else:
            how = settings.workers, len(photos) > 1, settings.cluster
            with closing(run(tasks, settings.out, run_settings, *how, finish)) as found:
                for row in found:
                    take(row)
    if settings.track and not settings.json and not settings.quiet:
        lost = sum(frame.lost for frame in frames)
        print(f"{len(frames)} frames, {lost} of them lost: {settings.out / TRACK}.csv")
    if len(photos) > 1 and (formats := [name for name in settings.export if name in RUN_FORMATS]):
        export_run(settings.out, formats)
    if settings.json:
        errors = {row["photo"]: row["error"] for row in rows if row["error"] is not None}
        result = {"results": _results(rows, settings.out), "errors": errors, "folder": str(settings.out)}
        print(json.dumps(result, indent=2))
    elif failed < len(rows):
        if settings.quiet:
            print(settings.out)
        else:
            end(settings.out, _next(settings, folders, len(rows) - failed))
    return 0 if not failed else 1 if failed < len(rows) else 2


def _next(settings: FitCommand, folders: Sequence[Path], explained: int) -> str:
    """What was made, and what to do with it."""
    one = len(folders) == 1
    folder = folders[0] if one else settings.out
    page = folder / "report.html"
    look = f"open {page}" if page.exists() else f"the files are in {folder}"
    if settings.track:
        return f"tracked: the path is {settings.out / TRACK}.csv; of the frames {look}"
    made = "explained" if one else f"explained {explained} of {len(folders)} photos"
    if one and not any(folder.glob(f"**/{CORRECTIONS}")):  # a mask, marks or a pose was given
        return f"{made}: {look}"
    order = "" if one else ", the least sure first"
    return f"{made}: {look}; to correct{order}: vig view {shlex.quote(str(folder))}"


def _corrected(
    settings: FitCommand, folders: Sequence[Path], object_class: str
) -> dict[Path, tuple[Correction, ...]]:
    """What was corrected by hand of each photo of an earlier run, with a line on it; of a single photo only
    where no hint is given. UserError where frames are tracked, which would lose it.
    """
    hinted = any(getattr(settings, name) not in (None, (), False) for name in HINTS)
    if len(folders) == 1 and hinted:
        return dict.fromkeys(folders, ())
    by_hand = {folder: corrected_in(folder, object_class) for folder in folders}
    taken = [
        folder.name
        for folder, corrections in by_hand.items()
        if corrections and not any(correction.problem for correction in corrections)
    ]
    if settings.track and any(by_hand.values()):
        edited = listed(folder.name for folder in folders if by_hand[folder])
        raise UserError(
            f"expected frames that were not corrected by hand with --track, which takes no hints on single"
            f" frames; got {CORRECTIONS} of {edited} in '{settings.out}'. Choose another --out."
        )
    if taken and not settings.quiet:
        note(f"corrected in vig view, taken as it is there (or remove {CORRECTIONS}): {listed(taken)}")
    return by_hand


def is_quick(pack: Path) -> bool:
    """Whether the weights of a class pack are those that `vig class build` made within two minutes."""
    try:
        with safe_open(pack / WEIGHTS_FILE, "np") as weights:
            return (weights.metadata() or {}).get("quick") == "yes"
    except (OSError, SafetensorError):  # missing or damaged, which is said where they are read
        return False


def is_untrained(pack: Path) -> bool:
    """Whether a folder is a class pack for which no network was trained."""
    return (pack / "class.json").is_file() and not (pack / WEIGHTS_FILE).exists()


def _results(rows: Iterable[dict[str, Any]], out: Path) -> dict[str, Any]:
    """What each explanation.json holds, by photo; a list of them where a photo has several objects."""
    results: dict[str, Any] = {}
    for row in rows:
        if row["error"] is None:
            folder = out / row["folder"]
            result = read_explanation(folder) | {"folder": str(folder)}
            if "/" in row["folder"]:
                results.setdefault(row["photo"], []).append(result)
            else:
                results[row["photo"]] = result
    return results


def _add_line(log: Path | None, words: str) -> None:
    """Add a line with the time to a file, where there is one; UserError when it cannot be written."""
    if log is None:
        return
    try:
        with open(log, "a", encoding="utf-8", errors="replace") as file:
            print(datetime.now().isoformat(timespec="seconds"), words, file=file)
    except OSError as error:
        raise UserError(
            f"expected --log FILE that can be written; got '{log}' ({error.strerror}). Name another."
        ) from None


def _check_track(settings: FitCommand) -> None:
    """UserError where what was given does not go with `--track`."""
    if len(settings.images) != 1 or not (settings.images[0].is_dir() or is_video(settings.images[0])):
        names = f"{len(settings.images)} names" if len(settings.images) != 1 else f"'{settings.images[0]}'"
        raise UserError(
            f"expected one folder of frames or one video with --track; got {names}. Track one by one."
        )
    for name in WITHOUT_TRACK:
        if getattr(settings, name) not in (None, ()):
            raise UserError(f"expected --track without --{name}; got both. Leave one out.")
    if settings.workers > 1:
        raise UserError(
            "expected --track with one worker, as frames follow from each other. Leave out --workers."
        )


def photos_of(images: tuple[Path, ...], out: Path) -> list[Path]:
    """The photos that are named, those in folders that are, and frames of videos, which are put into
    `out`/frames first; UserError when there are none.
    """
    photos: list[Path] = []
    expanded = [path for image in images for path in _expanded(image)]
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
    """The photos in a folder; what else is there is named in a line, UserError where that is all.

    Hidden files are passed over, such as those that macOS puts beside others (._photo.jpg).
    """
    extensions, photos, others = Image.registered_extensions(), list[Path](), list[Path]()
    for path in in_order(folder.iterdir()):
        if path.name.startswith(".") or path.name in SYSTEM_FILES:
            continue
        suffix = path.suffix.lower()
        # What has a photo's ending and is none is an error of its own, not passed over.
        is_heic = suffix in HEIC_SUFFIXES and find_spec("pillow_heif") is not None
        is_photo = is_heic or extensions.get(suffix) in FORMATS
        (photos if is_photo else others).append(path)
    named = [f"{path.name} ({_kind_of(path)})" for path in others]
    if not photos:
        others_named = f"{len(others)} of other kinds, {listed(named)}" if others else "none"
        raise UserError(f"expected photos in '{folder}'; got {others_named}. Name others.")
    if others:
        files = "file" if len(others) == 1 else "files"
        note(f"{len(others)} {files} of '{folder}' not taken: {listed(named)}")
    return photos


def _kind_of(path: Path) -> str:
    """What a file is that is not taken as a photo from its folder."""
    if path.is_dir():
        return "a folder"
    if is_video(path):
        return "a video; name it itself"
    if not path.is_file():
        return "no file"
    return (why_no_photo(path) or ("no photo", ""))[0]


def _expanded(path: Path) -> list[Path]:
    """Files of a pattern such as photos/*.jpg, which not every shell expands; any other path as it is."""
    pattern = str(path := as_stored(path))
    if os.path.lexists(path) or not glob.has_magic(pattern) or ADDRESS.match(pattern):
        return [path]
    if matches := in_order(map(Path, glob.glob(pattern, recursive=True))):
        return matches
    raise UserError(f"expected photos that match '{pattern}'; got none. Check the folder and the pattern.")


def _line(row: dict[str, Any]) -> str:
    """What is printed of a row."""
    if row["error"] is not None:
        return f"error: {row['error']}"
    when = "done before" if row.get("done_before") else f"{row['seconds']:.1f} s"
    if row["verdict"] == "absent":
        return f"absent: {name_of(row)}; {row['reason']} ({when})"
    hidden, mask_confidence = row["hidden_fraction"], row["mask_confidence"]
    trust = ", trusted" if row["mask_trusted"] else ", not trusted"
    trust = "" if row["mask_trusted"] == row["view_trusted"] else trust  # as the verdict says of the view
    mask = "" if mask_confidence is None else f" (mask {mask_confidence:.0%} likely right{trust})"
    visible = "nothing seen" if hidden is None else f"{hidden:.0%} hidden{mask}"
    if row["focal_from"] == "assumed":
        visible += ", distance unknown (focal length assumed)"
    colour = ", ".join(f"{row[f'albedo_{name}']:.2f}" for name in "rgb")
    right = "" if row["confidence"] is None else f" ({row['confidence']:.0%} likely right)"
    return (
        f"{row['verdict']}: {name_of(row)}, azimuth {row['azimuth_deg']:.1f}, elevation"
        f" {row['elevation_deg']:.1f} degrees{right}, albedo ({colour}), {visible}; {row['reason']} ({when})"
    )


def result_folders(images: Sequence[Path], out: Path) -> list[Path]:
    """A folder for each photo, named after it, cut where files' names could not be so long; a number is added
    where two photos share a name.
    """
    used, numbers = set(map(compose_name, TAKEN)), defaultdict[str, Iterator[int]](lambda: count(2))
    folders = []
    for image in images:
        stem = image.stem[:MOST_NAME_BYTES]
        while len(os.fsencode(stem)) > MOST_NAME_BYTES:
            stem = stem[:-1]
        name = stem
        while compose_name(name) in used:
            name = f"{stem}-{next(numbers[stem])}"
        used.add(compose_name(name))
        folders.append(out / name)
    return folders
