"""`vig train`: a recognition network trained on datasets."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil, inf
from pathlib import Path

from vig.io.errors import UserError
from vig.io.printing import end
from vig.io.progress import Meter
from vig.recognition import WEIGHTS_FILE
from vig.recognition.network import NetworkSettings
from vig.scene import ObjectClass
from vig.scene.object_class import PACKAGED
from vig_train.cli.common import check_ranges, check_writable
from vig_train.cli.settings import Train
from vig_train.plots import TrainingLog
from vig_train.training.drawing import Drawing, drawn_once
from vig_train.training.examples import Examples
from vig_train.training.object_map import MapTraining, add_object_map
from vig_train.training.training import TrainingSettings
from vig_train.training.training import train as train_network
from vig_world.dataset import Dataset, read_dataset
from vig_world.studio.studio import StudioSettings

TRUNK_STAGES = len(NetworkSettings().blocks)
MAP_PICTURES = 8000  # number of pictures put together for the map of objects
CONTEXT = (192, 128, 96, 64)  # channels of the decoder that sees the whole image


def train(settings: Train) -> int:
    """Run `vig train`."""
    lines: list[str] = []
    report = lines.append if settings.json else lambda line: print(line, flush=True)
    if not settings.dataset and not (settings.map_alone and settings.distinct):
        raise UserError("expected at least one dataset to train on; got none")
    object_class = ObjectClass.load(settings.object_class)
    check_ranges(
        settings, level=(0, 1), occluded=(0, 1), absent=(0, 1), studio=(0, inf), distinct=(0, inf),
        frozen=(0, TRUNK_STAGES), rate=(1e-6, 0.1), batch=(1, inf), workers=(1, inf),
    )  # fmt: skip
    _check_combination(settings, object_class)
    datasets = [read_dataset(path, "train") for path in settings.dataset]
    check_writable(settings.out)
    drawing = None
    if settings.studio and object_class.folder is not None:
        shares = {name: getattr(settings, name) for name in ("level", "occluded", "absent")}
        studio = StudioSettings(**shares, props=str(settings.props or ""))
        drawing = Drawing(
            object_class.folder, settings.studio, settings.distinct, studio=studio, workers=settings.workers
        )
    if settings.map_alone:
        path = _train_map(settings, datasets, drawing, object_class.mirror)
    else:
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
        log = TrainingLog(settings.out)
        path = train_network(datasets, settings.out, chosen, report, log.add, not settings.json)
    result = {"weights": str(path)} if settings.map_alone else {"weights": str(path), "log": lines}
    next_steps = f"vig calibrate DATASETS --weights {path}, then vig evaluate --weights ..."
    end(settings.out, f"trained: next, {next_steps}", result if settings.json else None, [path])
    return 0


def _check_combination(settings: Train, object_class: ObjectClass) -> None:
    """Refuse options that do not go together."""
    alone = settings.mask_alone or settings.map_alone
    map_of_drawn = settings.map_alone and settings.distinct
    own = [name for name in settings.others if ObjectClass.load(name).name == object_class.name]
    names = ("epochs", "rate", "batch", "frozen")
    of_others = [name for name in names if getattr(settings, name) != getattr(Train, name)]
    for is_wrong, message in (
        (
            settings.mask_alone and settings.map_alone,
            "--mask-alone or --map-alone; got both. Train one after the other.",
        ),
        (
            settings.map_alone and of_others,
            f"--map-alone without --{', --'.join(of_others)}, of the training of other parts. Leave it out.",
        ),
        (
            map_of_drawn and not settings.studio,
            "--studio above 0 with --map-alone and --distinct: it draws these images.",
        ),
        (
            settings.others and not map_of_drawn,
            "--map-alone and --distinct with --others: their images are drawn for it.",
        ),
        (own, f"--others that are not '{object_class.name}' itself; got it among them."),
        (
            alone and settings.start is None,
            f"--start with --{'mask' if settings.mask_alone else 'map'}-alone: weights whose rest stays.",
        ),
        (
            0 < settings.distinct < settings.studio,
            f"--distinct of as many images as a step takes, {settings.studio}, or more;"
            f" got {settings.distinct}.",
        ),
        (
            settings.props and not settings.studio,
            "--studio above 0 with --props: they stand before the studio's objects.",
        ),
    ):
        if is_wrong:
            raise UserError(f"expected {message}")


def _train_map(settings: Train, datasets: Sequence[Dataset], drawing: Drawing | None, mirror: bool) -> Path:
    """Return weights with a new map, trained on all images of datasets and of the studio's distinct ones.

    Each other class adds a third as many, which count as without an object.
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
            count = drawing.distinct if own else ceil((1 / 3) * drawing.distinct)
            drawn = replace(drawing, object_class=folder, distinct=count)
            with Meter(drawn.distinct, 0, not settings.json, "images") as meter:
                part = drawn_once(drawn, settings.out, settings.seed, meter.advance)
            parts.append(part if own else part.as_absent(parts[0].numbers.shape[1]))
    path = settings.out / WEIGHTS_FILE
    with Meter(MAP_PICTURES, 0, not settings.json, "pictures") as meter:
        training = MapTraining(
            Examples.concatenate(parts), MAP_PICTURES, settings.seed, mirror, meter.advance
        )
        add_object_map(Path(settings.start or ""), path, training)
    return path
