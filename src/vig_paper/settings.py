"""Settings of a reproduction, from which the command line of `vig reproduce` is derived.

Little is imported here, so that `vig --help` is quick.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

from vig.io.errors import UserError
from vig_train import METHODS, Method

Network = Literal["vig", "paper"]
Objects = Literal["model", "designs"]
Scale = Literal["tiny", "small", "paper"]
StepKind = Literal["data", "train", "calibrate", "evaluate", "ablations", "figures", "page"]
STEP_KINDS: tuple[StepKind, ...] = get_args(StepKind)
"""The kinds of steps of a reproduction in their order: data, evaluate and figures have several steps."""

COUNTS = ("train_images", "epochs", "validation_images", "test_images", "cycles_images", "ablation_images")
SCALES: dict[Scale, tuple[int | None, ...]] = {
    "tiny": (200, 2, 50, 20, 6, 2),
    "small": (6000, 12, 500, 200, 40, 50),
    "paper": (10000, None, 1000, 1000, 1000, 200),
}
"""Values of `COUNTS`: tiny checks an installation, small takes two cores an hour, paper has the paper's."""


@dataclass(frozen=True)
class ReproductionSettings:
    """Settings that determine a run's numbers: the same settings give the same tables.

    Raises:
        UserError: A number is out of range, or there are no methods.
    """

    scale: Scale
    """How much: tiny takes minutes, small an hour on two cores, paper is 10,000 training and 1,000 test
    images of each renderer. The options below change single numbers of it."""
    train_images: int | None = None
    """Rasterised photos to train on."""
    epochs: int | None = None
    """Passes of the training over them, at most; at the paper's scale as many as `vig train` does."""
    validation_images: int | None = None
    """Rasterised photos on which uncertainties are calibrated."""
    test_images: int | None = None
    """Rasterised photos to test on."""
    cycles_images: int | None = None
    """Path-traced photos to test on."""
    ablation_images: int | None = None
    """Rasterised test photos that are fitted with each part of the method switched off."""
    seed: int = 0
    """Seed of the data and the training."""
    net: Network = "vig"
    """The recognition model: vig's one network, or the paper's four."""
    objects: Objects = "designs"
    """Shapes of test and validation photos: `model`, shapes drawn from the shape model as in the paper; or
    `designs`, which the model was not made of. Training photos show the model's."""
    methods: tuple[Method, ...] = METHODS
    """Methods to compare."""
    weights: Path | None = None
    """Recognition weights to use in place of training."""
    train: Path | None = None
    """Folder of a dataset to train on, in place of making one."""
    validation: Path | None = None
    """Folder of a dataset with a validation split."""
    test_raster: Path | None = None
    """Folder of a rasterised dataset with a test split."""
    test_cycles: Path | None = None
    """Folder of a path-traced dataset with a test split."""

    def __post_init__(self) -> None:
        minimums = dict.fromkeys(COUNTS, 1) | {"train_images": 16, "seed": 0}  # some photos are held out
        for name, smallest in minimums.items():
            value = getattr(self, name)
            if value is not None and value < smallest:
                option = "--" + name.replace("_", "-")
                raise UserError(f"expected {option} of at least {smallest}; got {value}")
        unknown = [method for method in self.methods if method not in METHODS]
        if unknown or not self.methods:
            got = ", ".join(unknown) or "none"
            raise UserError(f"expected methods among {', '.join(METHODS)}; got {got}")

    @staticmethod
    def of(scale: Scale, **chosen: Any) -> "ReproductionSettings":
        """Return the settings `chosen`, and the scale's counts where none is."""
        settings = ReproductionSettings(scale, **chosen)
        counts: dict[str, Any] = dict(zip(COUNTS, SCALES[scale], strict=True))
        return replace(settings, **{name: n for name, n in counts.items() if getattr(settings, name) is None})

    def count(self, name: str) -> int:
        """Return one of `COUNTS`, in settings that have them all."""
        return int(getattr(self, name))

    def to_json(self) -> dict[str, Any]:
        """Return plain data: paths as strings."""
        plain = {field.name: getattr(self, field.name) for field in fields(ReproductionSettings)}
        plain["methods"] = list(self.methods)
        return {name: str(value) if isinstance(value, Path) else value for name, value in plain.items()}


@dataclass(frozen=True)
class Reproduce(ReproductionSettings):
    """The paper's section 5: data, training, every method under both renderers, Table 1 beside the paper's,
    figures, ablations, and one page of results. Continues where it was stopped."""

    out: Path = Path("vig-reproduce")
    """Folder of the run."""
    steps: Annotated[tuple[StepKind, ...], tyro.conf.arg(name="stages")] = STEP_KINDS
    """Which steps to do; those done already are skipped."""
    no_cycles: bool = False
    """Leave path-traced photos out; the same command without this option adds them."""
    workers: int | None = None
    """Processes and threads; all cores by default."""
    json: bool = False
    """Print one JSON object at the end, and no progress."""
