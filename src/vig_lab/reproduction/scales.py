"""How large a run is: the settings of a reproduction, and the three scales."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from vig.errors import UserError
from vig_lab.evaluation import METHODS

Scale = Literal["tiny", "small", "paper"]
Net = Literal["vig", "paper"]

LEAST_TRAINING = 16
"""With fewer photos there is nothing to train on and hold out."""


@dataclass(frozen=True)
class Settings:
    """What a run's numbers depend on: the same settings give the same tables.

    train_images, validation_images, test_images, cycles_images: samples of each dataset, the last of the
    path-traced test set. epochs: passes of the training, at most; None: as many as the net's training takes
    by default. ablation_images: so many of the raster test set are fitted once for each thing switched off.
    weights: recognition weights to use in place of training. train, validation, test_raster, test_cycles:
    folders of datasets to use in place of making them; their count and seed are their own.

    Raises UserError for a number out of range, and for no methods.
    """

    scale: Scale
    train_images: int
    epochs: int | None
    validation_images: int
    test_images: int
    cycles_images: int
    ablation_images: int
    seed: int = 0
    net: Net = "vig"
    methods: tuple[str, ...] = METHODS
    weights: Path | None = None
    train: Path | None = None
    validation: Path | None = None
    test_raster: Path | None = None
    test_cycles: Path | None = None

    def __post_init__(self) -> None:
        least = {"train_images": LEAST_TRAINING, "epochs": 1, "seed": 0}
        least |= dict.fromkeys(("validation_images", "test_images", "cycles_images", "ablation_images"), 1)
        for name, smallest in least.items():
            value = getattr(self, name)
            if value is not None and value < smallest:
                option = "--" + name.replace("_", "-")
                raise UserError(f"expected {option} of at least {smallest}; got {value}")
        unknown = [method for method in self.methods if method not in METHODS]
        if unknown or not self.methods:
            came = ", ".join(unknown) or "none"
            raise UserError(f"expected methods among {', '.join(METHODS)}; got {came}")

    @staticmethod
    def of(scale: Scale, **chosen: Any) -> Settings:
        """A scale's settings with those of `chosen` that are not None in their place."""
        return replace(SCALES[scale], **{name: value for name, value in chosen.items() if value is not None})

    def to_json(self) -> dict[str, Any]:
        """Plain data: paths as strings."""
        told = asdict(self) | {"methods": list(self.methods)}
        return {name: str(value) if isinstance(value, Path) else value for name, value in told.items()}


SCALES: dict[Scale, Settings] = {
    "tiny": Settings("tiny", 200, 2, 50, 20, 6, 2),
    "small": Settings("small", 6000, 12, 500, 200, 40, 50),
    "paper": Settings("paper", 10000, None, 1000, 1000, 1000, 200),
}
"""tiny is for a machine's own test of itself, small for an hour on two cores, paper is the paper's."""
