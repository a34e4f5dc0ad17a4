"""The section of a class's card on its network, and the history of trainings that it shows."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vig.io.checks import decode, read_json, reading
from vig.io.files import write_json
from vig_train.packs.card import table_lines
from vig_world.assets.own.catalogue import mesh_folder, read_sources

HEADING = "## Recognition"  # heading of the section, which is replaced
COLUMNS = (
    "error of azimuth, median",
    "within 15 degrees",
    "within 30",
    "half round (off by more than 150)",
    "error of elevation, median",
    "IoU of the visible pixels, mean",
)
"""Headers of `_cells`."""


def quick_section(pack: Path, images: int) -> str:
    """Return the section on the quick recognizer of a pack, made on so many images."""
    return "\n".join(
        [
            HEADING,
            "",
            f"A quick recognizer, made by `vig class build` on {images} rendered images."
            f" `vig class train {pack}` makes a better one in a quarter of an hour, and measures it.",
            "",
        ]
    )


def section(
    errors: Mapping[str, Any],
    images: int,
    seconds: Mapping[str, float],
    workers: int,
    unseen: str,
    history: Sequence[Mapping[str, Any]],
    props: Sequence[str] = (),
) -> str:
    """Return the section on a network that was trained and tested.

    Args:
        errors: Result of `studio_errors`, with `cross_validation`, the first line of `describe`.
        images: Number of training images.
        seconds: Seconds of each step.
        workers: Number of cores.
        unseen: See `unseen_in_test`.
        history: Result of `read_history`.
        props: Origins of the models that were put before objects, see `origins`.
    """
    lines = [
        HEADING,
        "",
        f"Trained by `vig class train` on {images} rendered images in"
        f" {sum(seconds.values()) / 60:.0f} minutes on {workers} core{'' if workers == 1 else 's'}:"
        f" {', '.join(f'{name} {math.ceil(value)} s' for name, value in seconds.items())}.",
        "",
        f"Tested on {errors['photos']} rendered images: {unseen}.",
        "",
        *table_lines(["", *COLUMNS], [[name, *_cells(row)] for name, row in errors["methods"].items()]),
        "",
        f"Of the fits {errors['trusted']:.0%} are `trusted`"
        + (
            f", {errors['trusted_right']:.0%} of these within 15 degrees."
            if errors["trusted_right"] is not None
            else "."
        ),
        "",
        f"By cross-validation over meshes (up to four of them: over photos): {errors['cross_validation']}.",
        "",
    ]
    if len(history) > 1:
        rows = [[str(old["minutes"]), str(old["images"]), *_cells(old)] for old in history]
        lines += ["Fits of earlier trainings:", "", *table_lines(["minutes", "images", *COLUMNS], rows), ""]
    lines += ["![reliability](reliability.png)", ""]
    if props:
        lines += [
            "Before and behind the objects were put models of",
            "",
            *(f"- {line}" for line in props),
            "",
        ]
    return "\n".join(lines)


def origins(source: str) -> list[str]:
    """Return where the models of a folder or of catalogues come from, a line for each catalogue and licence.

    source: Argument of `mesh_folder`.
    """
    creators: dict[tuple[str, str], set[str]] = {}
    for model in read_sources(mesh_folder(source)).models:
        key = model.catalogue, model.licence or "no licence stated"
        creators.setdefault(key, set()).add(model.creator or "unknown")
    named = [
        f"{catalogue}, {licence}: {', '.join(sorted(names))}"
        for (catalogue, licence), names in sorted(creators.items())
    ]
    return named or [f"the folder {Path(source).name}"]


def unseen_in_test(held_out: bool, folds: int) -> str:
    """Return a phrase for the data that the tested members had never seen.

    held_out: Whether meshes were held out for the test. folds: Number of folds of cross-validation; 1: none.
    """
    unseen = "views, lights, grounds and things before it that the training never saw"
    if held_out:
        return f"meshes, {unseen}"
    if folds > 1:
        return (
            f"by each of the network's {folds} members on meshes that it has not seen (the mask's decoder has"
            f" seen all): {unseen}"
        )
    return f"{unseen}, of the shapes that it was trained on"


def _cells(row: Mapping[str, float]) -> list[str]:
    azimuth = ["-"] * 4
    if "azimuth_deg" in row:
        shares = (f"{row[name]:.0%}" for name in ("within_15", "within_30", "turned"))
        azimuth = [f"{row['azimuth_deg']:.1f} degrees", *shares]
    return [*azimuth, f"{row['elevation_deg']:.1f} degrees", f"{row['visible_iou']:.2f}"]


def read_history(path: Path) -> list[dict[str, Any]]:
    """Return errors of the fits of earlier trainings, with "minutes", "images" and "trusted" each."""
    if not path.exists():
        return []
    with reading(path, "earlier trainings of a class", "Remove it."):
        return decode(list[dict[str, Any]], read_json(path))


def add_to_history(path: Path, errors: Mapping[str, Any], images: int, seconds: Mapping[str, float]) -> None:
    """Add a training, in place of an earlier one on as many images."""
    entry = {
        "minutes": round(sum(seconds.values()) / 60, 1),
        "images": images,
        "trusted": errors["trusted"],
        **errors["methods"]["fit"],
    }
    earlier = [old for old in read_history(path) if old["images"] != images]
    write_json(path, [*earlier, entry], 1)
