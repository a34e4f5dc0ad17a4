"""`vig dataset VERB`: the work of each verb."""

import re
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from vig.io.errors import UserError
from vig.io.printing import end
from vig_world.cli.settings import Check, ExportDataset, Make, Show

if TYPE_CHECKING:
    from vig.scene import ObjectClass
    from vig_world.library import OwnAssets


def make(settings: Make) -> int:
    """Run `vig dataset make`."""
    from vig.scene import ObjectClass
    from vig_world.generation.describe import describe_split
    from vig_world.generation.write import make_dataset

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
        own=own,
        photo=settings.photo,
        world=settings.world,
        ray=settings.ray,
        size=_size(settings.size),
        normals=settings.normals,
    )
    described = describe_split(folder, settings.split)
    deciles = [f"{10 * i}-{10 * i + 10}%: {n}" for i, n in enumerate(described["occlusion_deciles"])]
    reasons = ", ".join(
        f"{REASONS.get(name, name)} {count}" for name, count in described["rejections"].items()
    )
    redrawn = described["rejections_per_sample"]
    lines = [
        "hidden    " + "  ".join(deciles),
        f"redrawn   {redrawn:.1f} placements a sample, before one suited ({reasons or 'none'})",
    ]
    result = asdict(settings) | described if settings.json else None
    draw = f"vig dataset show {folder} --split {settings.split}"
    end(folder, f"made a dataset: {draw} draws a sheet of it", result, lines)
    return 0


def _size(text: str) -> tuple[int, int]:
    """Return the width and height as --size states them."""
    match = re.fullmatch(r"([0-9]{1,9})[xX]([0-9]{1,9})", text)
    if match is None:
        raise UserError(f"expected --size WIDTHxHEIGHT in pixels, such as 640x480; got '{text[:40]}'.")
    return int(match[1]), int(match[2])


REASONS = {
    "place eye": "no space for the camera",
    "place near": "something right before the camera",
    "place open": "nothing behind the object",
    "room": "no place in a room",
    "scene": "a scene that cannot be composed",
    "tolerance": "another share hidden than wanted",
}
"""Why candidates were not taken, where the name of the reason in info.json does not say it."""


def _own(settings: Make | Check) -> "OwnAssets":
    """Return the user's custom assets; skipped files and guesses are reported on standard error."""
    from vig_world.library import OwnAssets, OwnFolders

    folders = (settings.envmaps, settings.props, settings.furniture)
    own, notes = OwnAssets.read(OwnFolders(*(None if each is None else str(each) for each in folders)))
    for note in notes:
        print(f"vig: {note}", file=sys.stderr)
    return own


def _class(name: str | None) -> "ObjectClass | None":
    """Return the class that --class names."""
    from vig.scene import ObjectClass

    return None if name is None else ObjectClass.load(name)


def check(settings: Check) -> int:
    """Run `vig dataset check`."""
    from vig_world.dataset.format import complete_split, read_info
    from vig_world.generation.check import check_dataset

    object_class = _class(settings.object_class)
    splits = [name for name, held in read_info(settings.dataset)["splits"].items() if held["complete"]]
    if settings.split is not None or not splits:
        splits = [complete_split(settings.dataset, settings.split)]
    own = _own(settings)
    findings = [check_dataset(settings.dataset, name, settings.render, object_class, own) for name in splits]
    clean = all(of_split.clean for of_split in findings)
    lines = []
    for of_split in findings:
        lines += [f"{of_split.split}: {problem}" for problem in of_split.problems[:SHOWN]]
        if len(of_split.problems) > SHOWN:
            lines.append(f"{of_split.split}: and {len(of_split.problems) - SHOWN} more (--json lists them)")
        lines.append(of_split.summary())
    splits_found = {of_split.split: asdict(of_split) | {"clean": of_split.clean} for of_split in findings}
    result = {"clean": clean, "splits": splits_found} if settings.json else None
    found = (
        "it is as it was made" if clean else "it is not as it was made; remove the folder and make it again"
    )
    end(settings.dataset, f"checked: {found}", result, lines)
    return 0 if clean else 1


SHOWN = 20  # number of problems of a split that are printed


def show(settings: Show) -> int:
    """Run `vig dataset show`."""
    from vig_world.dataset import read_dataset
    from vig_world.generation.describe import describe_split
    from vig_world.generation.keypoints import class_of_keypoints
    from vig_world.generation.show import contact_sheet, histograms

    dataset = read_dataset(settings.dataset, settings.split)
    split = dataset.folder.name
    out = settings.out or settings.dataset
    sheet = out / f"contact-sheet-{split}.png"
    object_class = None
    if not settings.plain:
        try:
            object_class = class_of_keypoints(settings.dataset, split, _class(settings.object_class))
        except UserError as error:
            if settings.object_class is not None:
                raise
            print(f"vig: {error} The sheet has no keypoints.", file=sys.stderr)
    contact_sheet(dataset, sheet, settings.count, not settings.plain, object_class)
    distributions = histograms(settings.dataset, split, out / f"histograms-{split}.png")
    described = {"sheet": str(sheet), "histograms": str(distributions), "split": split}
    result = described | describe_split(settings.dataset, split) if settings.json else None
    end(out, f"drawn: open {sheet}, and {distributions.name} beside it", result, (sheet, distributions))
    return 0


def export(settings: ExportDataset) -> int:
    """Run `vig dataset export`."""
    from vig_world.generation.coco import export_coco, export_coco_keypoints
    from vig_world.generation.webdataset import export_webdataset
    from vig_world.generation.yolo import export_yolo_pose

    out = settings.out or Path(f"{settings.dataset.resolve().name}-{settings.to}")
    where = settings.dataset, out, settings.split
    if settings.to == "coco":
        export_coco(*where)
    elif settings.to == "webdataset":
        export_webdataset(*where, settings.shard)
    else:
        exporters = {"coco-keypoints": export_coco_keypoints, "yolo-pose": export_yolo_pose}
        exporters[settings.to](*where, _class(settings.object_class))
    result = dict[str, str]() if settings.json else None
    end(out, f"exported: {READERS[settings.to]} reads it; docs/dataset.md says what it holds", result)
    return 0


READERS = {
    "coco": "pycocotools",
    "coco-keypoints": "pycocotools",
    "yolo-pose": "yolo pose train data=data.yaml (Ultralytics)",
    "webdataset": "webdataset.WebDataset",
}
"""Reader of each format."""
