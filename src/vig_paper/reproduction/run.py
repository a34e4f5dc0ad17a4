"""A whole reproduction: its steps in order, each done once."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from vig.io.errors import UserError
from vig_paper.reproduction import work
from vig_paper.reproduction.folder import RENDERERS, duration
from vig_paper.reproduction.page import write_page
from vig_paper.reproduction.work import Run
from vig_paper.settings import STEP_KINDS
from vig_train.record import Record


@dataclass(frozen=True)
class Step:
    """One step of a run."""

    name: str
    """Its kind, one of `STEP_KINDS`, and the dataset or renderer it is about."""
    work: Callable[[], object]
    needs: tuple[str, ...] = ()
    """Names of the steps whose products it takes."""
    product: Path | None = None
    """The file or folder that it leaves, if any."""
    shows: tuple[str, ...] = ()
    """Names of steps whose products it takes where they exist."""

    @property
    def kind(self) -> str:
        """Return one of `STEP_KINDS`."""
        return self.name.split()[0]

    def done(self, record: Record) -> bool:
        """Return whether it was completed and its product still exists."""
        return record.complete(self.name) and (self.product is None or self.product.exists())


def steps_of(run: Run, renderers: tuple[str, ...]) -> list[Step]:
    """Return the steps of a run over these renderers' test photos, in the order in which they are done."""
    folder, names = run.folder, [RENDERERS[renderer] for renderer in renderers]
    if run.settings.weights is not None:  # they are used with the calibration they come with
        model = [Step("train", partial(work.take_weights, run), (), folder.weights)]
    else:
        names = ["train", "validation", *names]
        model = [
            Step("train", partial(work.train, run), ("data train",), folder.weights),
            Step("calibrate", partial(work.calibrate, run), ("train", "data validation")),
        ]
    ready = model[-1].name
    steps = [
        Step(f"data {name}", partial(work.make_data, run, name), (), run.dataset_folder(name) / "info.json")
        for name in names
    ] + model
    for renderer in renderers:
        needs = ready, f"data {RENDERERS[renderer]}"
        work_of = partial(work.evaluate, run, renderer)
        steps.append(Step(f"evaluate {renderer}", work_of, needs, folder.tables(renderer)))
    steps.append(Step("ablations", partial(work.ablate, run), (ready, "data test_raster"), folder.ablations))
    for renderer in renderers:
        work_of = partial(work.draw_figures, run, renderer)
        steps.append(
            Step(f"figures {renderer}", work_of, (f"evaluate {renderer}",), folder.figures(renderer))
        )
    evaluated, drawn = (tuple(f"{kind} {name}" for name in renderers) for kind in ("evaluate", "figures"))
    page = Step("page", partial(write_page, folder.root), evaluated, folder.page, ("ablations", *drawn))
    return [*steps, page]


def dependent_steps(step: Step, steps: list[Step]) -> list[str]:
    """Return the names of all steps that take a step's product, or the product of one that does."""
    dependent = {step.name}
    for candidate in steps:  # they are in order, so that one pass is enough
        if dependent & {*candidate.needs, *candidate.shows}:
            dependent.add(candidate.name)
    return sorted(dependent - {step.name})


def reproduce(
    run: Run, kinds: Iterable[str] = STEP_KINDS, machine: Mapping[str, Any] | None = None, command: str = ""
) -> Record:
    """Do the steps of these kinds that are not yet done.

    A run that was killed goes on where it stopped. A step that is done is skipped; one whose product has been
    removed is done again, and so are those that take it.

    Args:
        run: See `Run`.
        kinds: Some of `STEP_KINDS`.
        machine: Recorded when a run begins.
        command: Recorded when a run begins.

    Returns:
        The record, `run.json`.

    Raises:
        UserError: An unknown kind; no workers; the folder holds a run of other settings; a step needs one
            that has not been done; errors of a step itself.
    """
    chosen = set(kinds)
    unknown = sorted(chosen - set(STEP_KINDS))
    if unknown or not chosen:
        raise UserError(f"expected stages among {', '.join(STEP_KINDS)}; got {', '.join(unknown) or 'none'}")
    if run.workers is not None and run.workers < 1:
        raise UserError(f"expected --workers of at least 1; got {run.workers}")
    record = Record.open(run.folder.record, run.settings, machine or {}, command)
    steps = steps_of(run, run.renderers())
    by_name = {step.name: step for step in steps}
    for step in steps:
        if step.kind not in chosen:
            continue
        if step.done(record):
            run.report(f"{step.name}: already done, in {duration(record.seconds(step.name))}")
            continue
        missing = [name for name in step.needs if not by_name[name].done(record)]
        if missing:
            raise UserError(
                f"expected {' and '.join(missing)} done before {step.name}; choose those stages, too, or all."
            )
        record.forget([step.name, *dependent_steps(step, steps)])
        run.report(f"{step.name}: begun")
        with record.time_step(step.name):
            step.work()
        run.report(f"{step.name}: done, in {duration(record.seconds(step.name))}")
    return record
