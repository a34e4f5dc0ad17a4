"""A whole reproduction: its steps one after another, each done once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from vig.errors import UserError
from vig_lab.reproduction.record import Record
from vig_lab.reproduction.stages import Run
from vig_lab.reproduction.steps import STAGES, following, steps_of


def reproduce(
    run: Run,
    write_page: Callable[[Path], object],
    stages: Iterable[str] = STAGES,
    machine: Mapping[str, Any] | None = None,
    command: str = "",
) -> Record:
    """Do what is not yet done of the chosen stages; returns the record, `run.json`.

    write_page: makes the page of a run's folder. machine, command: are recorded when a run begins.

    A run that was killed goes on where it stopped. A step that is done is passed over; one whose product has
    been removed is done again, and so are those that take it.

    Raises:
        UserError: an unknown stage; no workers; the folder holds a run of other settings; a chosen stage
            needs one that has not been done; what a stage itself refuses.
    """
    chosen = set(stages)
    unknown = sorted(chosen - set(STAGES))
    if unknown or not chosen:
        raise UserError(f"expected stages among {', '.join(STAGES)}; got {', '.join(unknown) or 'none'}")
    if run.workers is not None and run.workers < 1:
        raise UserError(f"expected --workers of at least 1; got {run.workers}")
    record = Record.open(run.folder.record, run.settings, machine or {}, command)
    steps = steps_of(run, run.tiers(), write_page)
    by_name = {step.name: step for step in steps}
    for step in steps:
        if step.stage not in chosen:
            continue
        if step.done(record):
            run.say(f"{step.name}: already done, in {duration(record.seconds(step.name))}")
            continue
        missing = [name for name in step.needs if not by_name[name].done(record)]
        if missing:
            raise UserError(
                f"expected {' and '.join(missing)} done before {step.name}; choose those stages, too, or all."
            )
        record.forget([step.name, *following(step, steps)])
        run.say(f"{step.name}: begun")
        with record.timed(step.name):
            step.work()
        run.say(f"{step.name}: done, in {duration(record.seconds(step.name))}")
    return record


def duration(seconds: float) -> str:
    """12.3 s, 4 min 10 s, 2 h 5 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"
