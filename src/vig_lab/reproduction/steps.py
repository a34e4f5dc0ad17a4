"""The steps of a run: what each takes, makes, and does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from vig_lab.reproduction import stages
from vig_lab.reproduction.folder import TIERS
from vig_lab.reproduction.record import Record
from vig_lab.reproduction.stages import Run

STAGES = ("data", "train", "calibrate", "evaluate", "ablations", "figures", "page")
"""The stages in their order. data, evaluate and figures have a step for each dataset or tier."""


@dataclass(frozen=True)
class Step:
    """One thing to be done.

    name: its stage, and what it is about. work: does it. needs: the steps whose products it takes. product:
    what it leaves; None when nothing. shows: steps whose products it takes when they are there.
    """

    name: str
    work: Callable[[], object]
    needs: tuple[str, ...] = ()
    product: Path | None = None
    shows: tuple[str, ...] = ()

    @property
    def stage(self) -> str:
        """The stage that it belongs to."""
        return self.name.split()[0]

    def done(self, record: Record) -> bool:
        """Whether it has ended well and its product is still there."""
        return record.complete(self.name) and (self.product is None or self.product.exists())


def steps_of(run: Run, tiers: tuple[str, ...], write_page: Callable[[Path], object]) -> list[Step]:
    """The steps of a run over these tiers, in the order in which they are done."""
    folder, names = run.folder, [TIERS[tier] for tier in tiers]
    if run.settings.weights is not None:  # they are taken as they are
        model = [Step("train", partial(stages.take_weights, run), (), folder.weights)]
    else:
        names = ["train", "validation", *names]
        model = [
            Step("train", partial(stages.train, run), ("data train",), folder.weights),
            Step("calibrate", partial(stages.calibrate, run), ("train", "data validation")),
        ]
    ready = model[-1].name
    made = [
        Step(f"data {name}", partial(stages.make_data, run, name), (), run.dataset_folder(name) / "info.json")
        for name in names
    ]
    evaluations = [
        Step(
            f"evaluate {tier}",
            partial(stages.evaluate, run, tier),
            (ready, f"data {TIERS[tier]}"),
            folder.tables(tier),
        )
        for tier in tiers
    ]
    ablations = Step("ablations", partial(stages.ablate, run), (ready, "data test_raster"), folder.ablations)
    figures = [
        Step(
            f"figures {tier}",
            partial(stages.draw_figures, run, tier),
            (f"evaluate {tier}",),
            folder.figures(tier),
        )
        for tier in tiers
    ]
    page = Step(
        "page",
        partial(write_page, folder.root),
        tuple(step.name for step in evaluations),
        folder.page,
        ("ablations", *(step.name for step in figures)),
    )
    return [*made, *model, *evaluations, ablations, *figures, page]


def following(step: Step, steps: list[Step]) -> list[str]:
    """The names of all steps that take a step's product, or the product of one that does."""
    found = {step.name}
    for other in steps:  # in order, so that once through is enough
        if found & {*other.needs, *other.shows}:
            found.add(other.name)
    return sorted(found - {step.name})
