"""Writes a class pack's folder: the pack, meshes with materials for training, pictures."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from vig.recognition import WEIGHTS_FILE
from vig_train.building import pictures
from vig_train.building.object_class import ClassShapes
from vig_train.building.result import BuildResult, card
from vig_train.building.stages import BuildRun
from vig_train.packs.card import read_sections, write_card
from vig_train.packs.transfer import write_transfer
from vig_world.assets.held_out import HeldOutDesigns
from vig_world.assets.own.load import has_one_colour
from vig_world.assets.source_meshes import FILE, SourceMesh, save

TRAINED_FILES = (WEIGHTS_FILE, "calibration.json", "reliability.png")
"""Files of a pack that `vig class train` writes."""


def write_pack(result: BuildResult, shapes: ClassShapes, out: Path, run: BuildRun) -> None:
    """Write all that explaining photos and training need; class.json comes last: a pack with it is whole."""
    names = tuple(result.scans[number].name for number in shapes.numbers)
    (out / "class.json").unlink(missing_ok=True)
    staged = out / "build" / "staged"
    result.object_class.save(staged)
    HeldOutDesigns(names, tuple(shapes.splits), shapes.vertices.astype(np.float32)).save(staged)
    run.say("computing how light goes from part to part, on shapes of the class ...")
    write_transfer(result.object_class, staged, run.progress, run.result)
    _put_aside_weights(out, staged, run.say)
    # Those on the weights that stay.
    sections = read_sections(out / "card.md")[1] if (out / TRAINED_FILES[0]).exists() else {}
    kept = ("## Recognition", "## On photographs")  # by `vig class train` and `vig class check`
    write_card(staged, [card(result), *(sections[name] for name in kept if name in sections)])
    for file in sorted(staged.iterdir(), key=lambda path: path.name == "class.json"):
        file.replace(out / file.name)
    shutil.rmtree(staged)


def _put_aside_weights(out: Path, staged: Path, say: Callable[[str], None]) -> None:
    """Move weights that were trained on other shapes, and their calibration, to build/outdated."""
    shapes = "shape.safetensors"
    before = out / shapes
    if not before.exists() or before.read_bytes() == (staged / shapes).read_bytes():
        return
    aside = out / "build" / "outdated"
    for name in TRAINED_FILES:
        if (out / name).exists():
            aside.mkdir(exist_ok=True)
            (out / name).replace(aside / name)
            say(f"{name} was trained on other shapes: it lies in {aside}; run vig class train again")


def source_meshes(shapes: ClassShapes) -> list[SourceMesh]:
    """Return the used meshes that have materials, in metres; refused ones are for training."""
    meshes: list[SourceMesh] = []
    for number in shapes.registered.qualities:
        scan = shapes.registered.meshes[number].scan
        if not scan.pieces or has_one_colour(scan.pieces):
            continue  # without materials, as in some formats
        design = shapes.numbers.index(number) if number in shapes.numbers else -1
        move = shapes.object_from_mesh(number)
        meshes.append(
            SourceMesh.of(
                scan.pieces,
                move[:3, :3],
                move[:3, 3],
                shapes.template_on(number),
                design,
                "train" if design < 0 else shapes.splits[design],
            )
        )
    return meshes


def save_source_meshes(meshes: list[SourceMesh], sheets: Path) -> None:
    """Write the meshes that training shows, in place of an earlier build's."""
    (sheets / FILE).unlink(missing_ok=True)
    if meshes:
        save(sheets / FILE, meshes)


def save_shape_sheets(shapes: ClassShapes, sheets: Path) -> None:
    """Write pictures of the accepted and the refused meshes, the components and their errors."""
    registered, template = shapes.registered, shapes.registered.template
    pictures.save_mesh_sheet(
        sheets / "4-registered.png",
        [(registered.vertices[number], template.faces) for number in shapes.numbers],
        checks=template.vertices,
        labels=[str(number + 1) for number in shapes.numbers],
    )
    refused = [number for number in registered.qualities if number not in shapes.numbers]
    if refused:
        pairs = [
            pair
            for number in refused
            for pair in (registered.meshes[number].triangles, (registered.vertices[number], template.faces))
        ]
        labels = [label for number in refused for label in (str(number + 1), f"{number + 1}: template")]
        pictures.save_mesh_sheet(sheets / "5-refused.png", pairs, labels=labels)
    pictures.save_component_sheet(sheets / "6-components.png", shapes.components, template.faces)
    if shapes.components.errors:
        pictures.save_error_curve(sheets / "7-leave-one-out.png", shapes.components)
