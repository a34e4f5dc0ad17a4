"""`vig train`: a recognition network trained on datasets."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from vig.io.errors import UserError
from vig.io.printing import end
from vig.io.progress import Meter
from vig.recognition import WEIGHTS_FILE
from vig.recognition.network import NetworkSettings
from vig.scene import ObjectClass
from vig.scene.object_class import PACKAGED
from vig_train.cli.common import check_workers, check_writable
from vig_train.cli.settings import Train
from vig_train.plots import train_and_plot as train_network
from vig_train.training.drawing import Drawing, drawn_once
from vig_train.training.examples import Examples
from vig_train.training.object_map import MapTraining, add_object_map
from vig_train.training.studio import StudioSettings
from vig_train.training.training import TrainingSettings
from vig_world.dataset import Dataset, read_dataset

TRUNK_STAGES = len(NetworkSettings().blocks)
MOST_RATE = 0.1
MAP_PICTURES = 8000
"""That are put together for the map of objects."""
WITHOUT_MAP = ("epochs", "rate", "batch", "frozen")
"""Options that the training of a map alone does not take."""
CONTEXT = (192, 128, 96, 64)
"""Channels of the decoder that sees the whole image."""


def train(settings: Train) -> int:
    """Run `vig train`."""
    lines: list[str] = []
    report = lines.append if settings.json else lambda line: print(line, flush=True)
    if not settings.dataset and not (settings.map_alone and settings.distinct):
        raise UserError("expected at least one dataset to train on; got none")
    check_workers(settings.workers)
    object_class = ObjectClass.load(settings.object_class)
    shares = {name: getattr(settings, name) for name in ("level", "occluded", "absent")}
    for name, share in shares.items():
        if not 0 <= share <= 1:
            raise UserError(f"expected --{name} as a share from 0 to 1; got {share:g}.")
    for name in ("studio", "distinct"):
        if getattr(settings, name) < 0:
            raise UserError(f"expected --{name} as a number of images; got {getattr(settings, name)}.")
    if not 0 <= settings.frozen <= TRUNK_STAGES:
        raise UserError(f"expected --frozen from 0 to {TRUNK_STAGES}; got {settings.frozen}.")
    if not 0 < settings.rate <= MOST_RATE:
        raise UserError(f"expected --rate above 0 and at most {MOST_RATE}; got {settings.rate:g}.")
    if settings.batch < 1:
        raise UserError(f"expected --batch of 1 or more images; got {settings.batch}.")
    if settings.mask_alone and settings.map_alone:
        raise UserError("expected --mask-alone or --map-alone; got both. Train one after the other.")
    for name in WITHOUT_MAP if settings.map_alone else ():
        if getattr(settings, name) != getattr(Train, name):
            raise UserError(
                f"expected --map-alone without --{name}, which is of the training of other parts; got"
                f" {getattr(settings, name):g}. Leave it out."
            )
    if settings.map_alone and settings.distinct and not settings.studio:
        raise UserError("expected --studio above 0 with --map-alone and --distinct: it draws these images.")
    if settings.others and not (settings.map_alone and settings.distinct):
        raise UserError("expected --map-alone and --distinct with --others: their images are drawn for it.")
    if any(ObjectClass.load(name).name == object_class.name for name in settings.others):
        raise UserError(f"expected --others that are not '{object_class.name}' itself; got it among them.")
    for name in ("mask", "map"):
        if getattr(settings, f"{name}_alone") and settings.start is None:
            raise UserError(
                f"expected --start with --{name}-alone: weights of which the rest stays as it is."
            )
    if settings.distinct and settings.distinct < settings.studio:
        raise UserError(
            f"expected --distinct of as many images as a step takes, {settings.studio}, or more; got"
            f" {settings.distinct}."
        )
    if settings.props and not settings.studio:
        raise UserError("expected --studio above 0 with --props: they stand before the studio's objects.")
    datasets = [read_dataset(path, "train") for path in settings.dataset]
    check_writable(settings.out)
    drawing = None
    if settings.studio and object_class.folder is not None:
        studio = StudioSettings(**shares, props=str(settings.props or ""))
        drawing = Drawing(
            object_class.folder, settings.studio, settings.distinct, studio=studio, workers=settings.workers
        )
    if settings.map_alone:
        path = _train_map(settings, datasets, drawing, object_class.mirror)
        if settings.json:
            print(json.dumps({"weights": str(path), "folder": str(settings.out)}))
        else:
            _end(settings.out, path)
        return 0
    chosen = TrainingSettings(
        seed=settings.seed,
        epochs=settings.epochs,
        symmetry=object_class.symmetry,
        mirror=object_class.mirror,
        drawing=drawing,
        start=settings.start or PACKAGED / "teapot" / "recognition.safetensors",
        trunk_only=settings.start is None,
        frozen=settings.frozen,
        mask_alone=settings.mask_alone,
        batch=settings.batch,
        network=NetworkSettings(context=CONTEXT if settings.mask_alone else ()),
        learning_rate=settings.rate,
    )
    path = train_network(datasets, settings.out, chosen, report, not settings.json)
    if settings.json:
        print(json.dumps({"weights": str(path), "log": lines, "folder": str(settings.out)}))
    else:
        _end(settings.out, path)
    return 0


def _end(folder: Path, weights: Path) -> None:
    print(weights)
    end(folder, f"trained: next, vig calibrate DATASETS --weights {weights}, then vig evaluate --weights ...")


def _train_map(settings: Train, datasets: Sequence[Dataset], drawing: Drawing | None, mirror: bool) -> Path:
    """Return weights with a new map, trained on all images of datasets and of the studio's distinct ones.

    Of each other class there are a third as many, which count as without an object.
    """
    parts = [Examples.of(dataset) for dataset in datasets]
    if drawing is not None and drawing.distinct:
        folders = [
            drawing.object_class,
            *(ObjectClass.load(name).folder or Path() for name in settings.others),
        ]
        for folder in folders:
            own = folder == drawing.object_class
            # A third as many images of each other class.
            count = drawing.distinct if own else math.ceil((1 / 3) * drawing.distinct)
            drawn = replace(drawing, object_class=folder, distinct=count)
            with Meter(drawn.distinct, 0, not settings.json, "images") as meter:
                part = drawn_once(drawn, settings.out, settings.seed, meter.advance)
            parts.append(part if own else part.as_absent(parts[0].numbers.shape[1]))
    path = settings.out / WEIGHTS_FILE
    with Meter(MAP_PICTURES, 0, not settings.json, "pictures") as meter:
        training = MapTraining(Examples.joined(parts), MAP_PICTURES, settings.seed, mirror, meter.advance)
        add_object_map(Path(settings.start or ""), path, training)
    return path
