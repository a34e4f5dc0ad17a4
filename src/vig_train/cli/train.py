"""`vig train`: a recognition network trained on datasets."""

from __future__ import annotations

import json

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig.scene.object_class import PACKAGED
from vig_train.cli.common import check_writable
from vig_train.cli.settings import Train
from vig_train.plots import train_and_plot as train_network
from vig_train.training.drawing import Drawing
from vig_train.training.studio import StudioSettings
from vig_train.training.training import TrainingSettings
from vig_world.dataset import read_dataset


def train(settings: Train) -> int:
    """`vig train`."""
    lines: list[str] = []
    report = lines.append if settings.json else lambda line: print(line, flush=True)
    if not settings.dataset:
        raise UserError("expected at least one dataset to train on; got none")
    datasets = [read_dataset(path, "train") for path in settings.dataset]
    check_writable(settings.out)
    object_class = ObjectClass.load(settings.object_class)
    if not 0 <= settings.level <= 1:
        raise UserError(f"expected --level as a share from 0 to 1; got {settings.level:g}.")
    drawing = None
    if settings.studio and object_class.folder is not None:
        studio = StudioSettings(level=settings.level, props=str(settings.props or ""))
        drawing = Drawing(object_class.folder, settings.studio, studio=studio, workers=settings.workers)
    chosen = TrainingSettings(
        seed=settings.seed,
        epochs=settings.epochs,
        symmetry=object_class.symmetry,
        mirror=object_class.mirror,
        drawing=drawing,
        start=settings.start or PACKAGED / "teapot" / "recognition.safetensors",
        trunk_only=settings.start is None,
    )
    path = train_network(datasets, settings.out, chosen, report, not settings.json)
    if settings.json:
        print(json.dumps({"weights": str(path), "log": lines, "folder": str(settings.out)}))
    else:
        print(path)
        print(settings.out)
    return 0
