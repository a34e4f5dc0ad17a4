"""`vig train`: a recognition network trained on datasets."""

from __future__ import annotations

import json
from typing import Any

from vig.errors import UserError
from vig.scene import ObjectClass, Symmetry
from vig.scene.object_class import PACKAGED
from vig_lab.cli.common import check_writable
from vig_lab.cli.settings import Train
from vig_lab.paper_network import PaperTrainingSettings, train_paper
from vig_lab.plots import train_and_plot as train_network
from vig_lab.training.drawing import Drawing
from vig_lab.training.studio import StudioSettings
from vig_lab.training.training import TrainingSettings
from vig_world.dataset import read_dataset


def train(settings: Train) -> int:
    """`vig train`."""
    lines: list[str] = []
    report = lines.append if settings.json else lambda line: print(line, flush=True)
    if not settings.dataset:
        raise UserError("expected at least one dataset to train on; got none")
    datasets = [read_dataset(path, "train") for path in settings.dataset]
    check_writable(settings.out)
    chosen: dict[str, Any] = {"seed": settings.seed}
    if settings.epochs is not None:
        chosen["epochs"] = settings.epochs
    object_class = ObjectClass.load(settings.object_class)
    if not 0 <= settings.level <= 1:
        raise UserError(f"expected --level as a share from 0 to 1; got {settings.level:g}.")
    if settings.net == "paper":
        if object_class.symmetry is not Symmetry.NONE:
            raise UserError(
                f"--net paper knows no symmetry; class '{object_class.name}' has one. Leave --net out."
            )
        if len(datasets) > 1:
            raise UserError(f"--net paper learns from one dataset; got {len(datasets)}. Give one.")
        path = train_paper(datasets[0], settings.out, PaperTrainingSettings(**chosen), report)
    else:
        chosen |= {"symmetry": object_class.symmetry, "mirror": object_class.mirror}
        if settings.studio and object_class.folder is not None:
            studio = StudioSettings(level=settings.level)
            chosen["drawing"] = Drawing(
                object_class.folder, settings.studio, studio=studio, workers=settings.workers
            )
        start = settings.start or PACKAGED / "teapot" / "recognition.safetensors"
        chosen |= {"start": start, "trunk_only": settings.start is None}
        path = train_network(datasets, settings.out, TrainingSettings(**chosen), report, not settings.json)
    if settings.json:
        print(json.dumps({"weights": str(path), "log": lines, "folder": str(settings.out)}))
    else:
        print(path)
        print(settings.out)
    return 0
