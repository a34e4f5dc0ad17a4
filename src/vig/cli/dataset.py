"""`vig dataset VERB`: settings, and the work of each verb, imported when it runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from vig.errors import UserError

if TYPE_CHECKING:
    from vig.synthesis.library import OwnAssets

Split = Literal["train", "test", "validation"]


@dataclass(frozen=True)
class Make:
    """Generate photos of scenes with everything known; safe to kill and run again."""

    out: Path
    """Folder of the dataset."""
    count: int
    """How many samples."""
    seed: int = 0
    """The dataset's seed: sample i is a pure function of it and i."""
    tier: Literal["raster", "cycles"] = "raster"
    """Which renderer makes the images: our rasteriser, or Blender's path tracer (the [cycles] extra)."""
    split: Split = "train"
    """Which assets and object designs the scenes are made of; no two splits share any."""
    object_class: Annotated[str, tyro.conf.arg(name="class")] = "teapot"
    """A packaged class or the folder of a class pack."""
    finish: Literal["diffuse", "glossy", "painted"] = "diffuse"
    """Of the object, path traced: matt as in the model, glazed, or glazed over a painted decoration."""
    photo: bool = False
    """Photograph the pictures: exposure, white balance, blur, noise, JPEG."""
    envmaps: str | None = None
    """Folder of your own panoramas (.hdr, .exr) in place of ours; `bpy`: the eight in Blender's wheel."""
    props: Path | None = None
    """Folder of your own household things (.glb, .gltf, .obj, .ply, .off, .stl) in place of ours."""
    furniture: Path | None = None
    """Folder of your own furniture, which takes the place of ours of the same family; docs/light.md."""
    workers: int | None = None
    """Processes; all cores by default."""
    ray: str | None = None
    """Make the samples on the Ray cluster at this address (`auto`: the one this machine belongs to) instead
    of in processes here; needs the [cluster] extra."""
    json: bool = False
    """Print one JSON object at the end, and no progress."""


@dataclass(frozen=True)
class Check:
    """Prove a dataset whole: every file, every label, renderings against files. Exits 1 when it is not."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    split: Split | None = None
    """Which split; all complete ones by default."""
    render: int = 0
    """So many samples of each split, evenly chosen, are rendered again from their specs and compared."""
    object_class: Annotated[str | None, tyro.conf.arg(name="class")] = None
    """The folder of the class pack it was made with, when that is not a packaged class."""
    envmaps: str | None = None
    """Folder of your own panoramas (.hdr, .exr) that it was made with; `bpy`: those in Blender's wheel."""
    props: Path | None = None
    """Folder of your own household things (.glb, .gltf, .obj, .ply, .off, .stl) that it was made with."""
    furniture: Path | None = None
    """Folder of your own furniture that it was made with."""
    json: bool = False
    """Print one JSON object with every problem."""


@dataclass(frozen=True)
class Show:
    """Write a contact sheet and histograms of a dataset."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    split: Split | None = None
    """Which split; by default the only one, or train."""
    count: int = 48
    """How many samples the sheet has, evenly from freely seen to hidden."""
    plain: bool = False
    """Leave the hidden part of the object untinted."""
    out: Path | None = None
    """Folder for the pictures; the dataset's by default."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Export:
    """Write a dataset in another format: COCO annotations, visible and amodal, or WebDataset shards."""

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    to: Literal["coco", "webdataset"]
    """Which format; docs/dataset.md describes both."""
    out: Path
    """Folder for the result."""
    split: Split | None = None
    """Which split; by default the only one, or train."""
    shard: int = 1000
    """webdataset: samples in a tar file."""
    json: bool = False
    """Print one JSON object."""


VERBS: dict[type, str] = {Make: "make", Check: "check", Show: "show", Export: "export"}


def run(settings: Any) -> int:
    """Do what a verb's settings say; returns the exit code."""
    work: dict[type, Callable[[Any], int]] = {Make: make, Check: check, Show: show, Export: export}
    return work[type(settings)](settings)


def make(settings: Make) -> int:
    """`vig dataset make`."""
    from vig.dataset import describe_split, make_dataset
    from vig.scene import ObjectClass

    if settings.finish != "diffuse" and settings.tier != "cycles":
        raise UserError(f"--finish {settings.finish} is for --tier cycles; the raster tier has diffuse only.")
    own = _own(settings)
    folder = make_dataset(
        settings.out,
        settings.count,
        settings.seed,
        tier=settings.tier,
        split=settings.split,
        workers=settings.workers,
        progress=not settings.json,
        object_class=ObjectClass.load(settings.object_class),
        options={"finish": settings.finish} if settings.tier == "cycles" else {},
        own=own,
        photo=settings.photo,
        ray=settings.ray,
    )
    described = describe_split(folder, settings.split)
    if settings.json:
        print(json.dumps({"folder": str(folder)} | asdict(settings) | described, default=str))
        return 0
    deciles = [f"{10 * i}-{10 * i + 10}%: {n}" for i, n in enumerate(described["occlusion_deciles"])]
    print("hidden    " + "  ".join(deciles))
    reasons = ", ".join(f"{name} {count}" for name, count in described["rejections"].items())
    print(f"rejected  {described['rejections_per_sample']:.2f} candidates a sample ({reasons or 'none'})")
    print(folder)
    return 0


def _own(settings: Make | Check) -> OwnAssets:
    """The user's assets; what was left out of them, or guessed at, is told on standard error."""
    from vig.synthesis.library import OwnAssets, OwnFolders

    folders = (settings.envmaps, settings.props, settings.furniture)
    own, notes = OwnAssets.read(OwnFolders(*(None if each is None else str(each) for each in folders)))
    for note in notes:
        print(f"vig: {note}", file=sys.stderr)
    return own


def check(settings: Check) -> int:
    """`vig dataset check`."""
    from vig.dataset import check_dataset
    from vig.dataset.format import complete_split, read_info
    from vig.scene import ObjectClass

    object_class = None if settings.object_class is None else ObjectClass.load(settings.object_class)
    splits = [name for name, held in read_info(settings.dataset)["splits"].items() if held["complete"]]
    if settings.split is not None or not splits:
        splits = [complete_split(settings.dataset, settings.split)]
    own = _own(settings)
    findings = [check_dataset(settings.dataset, name, settings.render, object_class, own) for name in splits]
    clean = all(found.clean for found in findings)
    if settings.json:
        splits_found = {found.split: asdict(found) | {"clean": found.clean} for found in findings}
        print(json.dumps({"clean": clean, "splits": splits_found, "folder": str(settings.dataset)}))
        return 0 if clean else 1
    for found in findings:
        for problem in found.problems[:SHOWN]:
            print(f"{found.split}: {problem}")
        if len(found.problems) > SHOWN:
            print(f"{found.split}: and {len(found.problems) - SHOWN} more (--json lists them)")
        print(found.summary())
    print(settings.dataset)
    return 0 if clean else 1


SHOWN = 20
"""So many problems of a split are printed."""


def show(settings: Show) -> int:
    """`vig dataset show`."""
    from vig.dataset import contact_sheet, describe_split, histograms, read_dataset

    dataset = read_dataset(settings.dataset, settings.split)
    split = dataset.folder.name
    out = settings.out or settings.dataset
    sheet = out / f"contact-sheet-{split}.png"
    contact_sheet(dataset, sheet, settings.count, tint=not settings.plain)
    distributions = histograms(settings.dataset, split, out / f"histograms-{split}.png")
    if settings.json:
        told = {"sheet": str(sheet), "histograms": str(distributions), "split": split}
        print(json.dumps(told | describe_split(settings.dataset, split) | {"folder": str(out)}))
        return 0
    print(sheet)
    print(distributions)
    print(out)
    return 0


def export(settings: Export) -> int:
    """`vig dataset export`."""
    from vig.dataset import export_coco, export_webdataset

    if settings.to == "coco":
        export_coco(settings.dataset, settings.out, settings.split)
    else:
        export_webdataset(settings.dataset, settings.out, settings.split, settings.shard)
    print(json.dumps({"folder": str(settings.out)}) if settings.json else settings.out)
    return 0
