"""`vig train`: a recognition network trained on datasets."""

from __future__ import annotations

import json

from vig.io.errors import UserError
from vig.recognition.network import NetworkSettings
from vig.scene import ObjectClass
from vig.scene.object_class import PACKAGED
from vig_train.cli.common import check_workers, check_writable
from vig_train.cli.settings import Train
from vig_train.plots import train_and_plot as train_network
from vig_train.training.drawing import Drawing
from vig_train.training.studio import StudioSettings
from vig_train.training.training import TrainingSettings
from vig_world.dataset import read_dataset

TRUNK_STAGES = len(NetworkSettings().blocks)
MOST_RATE = 0.1
CONTEXT = (192, 128, 96, 64)
"""Channels of the decoder that sees the whole image."""


def train(settings: Train) -> int:
    """`vig train`."""
    lines: list[str] = []
    report = lines.append if settings.json else lambda line: print(line, flush=True)
    if not settings.dataset:
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
    if settings.mask_alone and settings.start is None:
        raise UserError("expected --start with --mask-alone: weights whose trunk and heads stay as they are.")
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
        print(path)
        print(settings.out)
    return 0
