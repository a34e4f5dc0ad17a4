"""The options of `vig fit` resolved, once: a task for each photo, and the settings of all."""

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from safetensors import SafetensorError, safe_open

from vig.inference import ExplainSettings
from vig.io.errors import UserError
from vig.io.printing import note
from vig.likelihood import LIKELIHOODS
from vig.photo.video import is_video
from vig.recognition import WEIGHTS_FILE
from vig.scene import ObjectClass
from vig.several import MAX_OBJECTS
from vig_app.cli.boxes import Objects, boxes_of, classes_of, labels_of
from vig_app.cli.hints import cameras_of, hints_of, mask_of
from vig_app.cli.naming import list_names
from vig_app.cli.options import FitCommand, ModelOptions, RunOptions, VideoOptions, changed_options
from vig_app.cli.photos import photos_of, result_folders
from vig_app.corrections import CORRECTIONS, Correction, read_corrections
from vig_app.report.folder import FILES, check_files
from vig_app.runs import RunSettings, Task, ledger_of


@dataclass(frozen=True)
class Plan:
    """A command's plan: a task for each photo, in their order, and the settings of all."""

    tasks: tuple[Task, ...]
    settings: RunSettings


def plan_of(command: FitCommand) -> Plan:
    """Resolve a command's options; UserError where they do not go together, or a file cannot be used."""
    run, place, files = command.run, command.place, files_of(command.run)
    say: Callable[[str], None] = (lambda line: None) if run.quiet else note
    if run.workers < 1:
        raise UserError(f"expected 1 or more --workers; got {run.workers}. Leave it out.")
    if command.video.timeout != VideoOptions.timeout:
        raise UserError("expected --timeout with --live; got it without. Leave it out.")
    with ledger_of(run.out) if any(map(is_video, command.images)) else nullcontext():
        photos = photos_of(command.images, run.out)
    folders = result_folders(photos, run.out)
    boxes = boxes_of(place, photos, command.hints)
    object_class, *others = classes_of(place, say)
    for name in (object_class, *others):
        if is_quick(Path(name)):
            say(f"'{name}' has a quick recognizer; `vig class train {name}` makes a better one")
        is_pack = (Path(name) / "class.json").is_file()
        if place.mesh is None and not place.meshes and is_pack and not (Path(name) / WEIGHTS_FILE).exists():
            say(
                f"no network was trained for '{name}': each photo needs --box or --mask, and views are tried"
                f" all round; `vig class train {name}` trains one"
            )
    most = place.objects or (MAX_OBJECTS if place.meshes else 0)
    named = {ObjectClass.load(Path(pack)).name: pack for pack in (object_class, *others) if place.meshes}
    if place.meshes and place.boxes is not None and len(named) <= len(others):
        raise UserError("expected --meshes of different names with --boxes; got two of one name. Rename one.")
    hints, mask = hints_of(command.hints, photos), mask_of(command.hints.mask, photos)
    cameras = cameras_of(command.camera, photos)
    labels = labels_of(place, photos, (object_class, *others))
    located = (place.box, place.boxes, place.labels) != (None,) * 3
    hinted = changed_options(command.hints, command.camera) or located
    by_hand: dict[Path, tuple[Correction, ...]] = dict.fromkeys(folders, ())
    if not (len(folders) == 1 and hinted):
        by_hand = {folder: read_corrections(folder, object_class) for folder in folders}
    taken = [
        folder.name
        for folder, corrections in by_hand.items()
        if corrections and not any(correction.problem for correction in corrections)
    ]
    if taken and not command.video.track:  # which refuses them
        say(f"corrected in vig view, taken as it is there (or remove {CORRECTIONS}): {list_names(taken)}")
    tasks = tuple(
        Task(
            photo, folder, box, command.camera.focal, hints, mask(photo), _of_packs(objects, named), most,
            camera, by_hand[folder], labels.get(photo, ()),
        )
        for photo, folder, (box, objects), camera in zip(photos, folders, boxes, cameras, strict=True)
    )  # fmt: skip
    explain = explain_settings(command.model)
    return Plan(tasks, RunSettings(object_class, explain, run.export, tuple(others), files, run.full_size))


def _of_packs(objects: Objects, named: Mapping[str, str]) -> Objects:
    """Return objects with the packs of --meshes in place of their names; UserError for others."""
    for name, _ in objects if named else ():
        if name not in named:
            raise UserError(
                f"expected --boxes with the names of meshes, {list_names(sorted(named))}; got '{name}'."
            )
    return tuple((named.get(name, name), box) for name, box in objects)


def explain_settings(model: ModelOptions) -> ExplainSettings:
    """Return the settings of a fit."""
    return ExplainSettings(
        LIKELIHOODS[model.likelihood],
        self_shadow=not model.no_self_shadow,
        free_framing={"auto": None, "fixed": False, "free": True}[model.framing],  # type: ignore[arg-type]
    )


def files_of(run: RunOptions) -> tuple[str, ...] | None:
    """Return the chosen files, with the mask where exports name it, or None for all; UserError for others."""
    if run.files == ():
        raise UserError(
            f"expected --files with the names of files, such as --files mask.png, of {' '.join(FILES)}; got"
            " none. Leave it out for all."
        )
    check_files(run.files or ())
    return (*run.files, *("mask.png",) * bool(run.export)) if run.files else None


def is_quick(pack: Path) -> bool:
    """Return whether the weights of a class pack are those that `vig class build` made within two minutes."""
    try:
        with safe_open(pack / WEIGHTS_FILE, "np") as weights:
            return (weights.metadata() or {}).get("quick") == "yes"
    except (OSError, SafetensorError):  # missing or damaged, which is reported where they are read
        return False
