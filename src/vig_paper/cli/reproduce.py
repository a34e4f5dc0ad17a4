"""`vig reproduce`: the paper's section 5 in one command."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, fields
from typing import Any

from rich.console import Console

from vig.io.machine import machine
from vig.io.printing import end
from vig_paper.reproduction import RENDERERS, Run, RunFolder, reproduce
from vig_paper.reproduction.page import write_page
from vig_paper.reproduction.reached import reached, reached_block, reached_line, training_line
from vig_paper.settings import Reproduce, ReproductionSettings
from vig_train.cli.common import check_workers, command_line
from vig_train.evaluation.paper import compare, comparison_block
from vig_train.record import Record

SAME_NUMBERS = ("steps", "workers", "json")
"""Options that do not change the numbers."""


def reproduce_paper(chosen: Reproduce) -> int:
    """Do the remaining steps of a run and print its tables, or JSON; its folder comes last."""
    settings = ReproductionSettings.of(
        **{field.name: getattr(chosen, field.name) for field in fields(ReproductionSettings)}
    )
    check_workers(chosen.workers)
    folder = RunFolder(chosen.out)

    def report(line: str) -> None:
        if not chosen.json:
            print(line, flush=True)

    run = Run(folder, settings, not chosen.no_cycles, chosen.workers, report, not chosen.json)
    command = command_line("vig reproduce", chosen, skipped=SAME_NUMBERS)
    record = reproduce(run, write_page, chosen.steps, machine(), command)
    tables = {name: table for name in RENDERERS if (table := folder.read_table(name)) is not None}
    if chosen.json:
        print(json.dumps(summary(folder, record, tables), indent=2))
        return 0
    console = Console(width=None if sys.stdout.isatty() else 120)
    for renderer, table in tables.items():
        medians = reached(record.data["settings"], table)
        console.print((reached_block(medians) if medians else comparison_block(table)).rich())
        cells = compare(table)
        passed = sum(cell.passed for cell in cells)
        if medians:
            print(
                f"{renderer}: {reached_line(medians)}; {passed} of {len(cells)} are better than the paper's"
            )
        else:
            print(f"{renderer}: {passed} of {len(cells)} cells pass")
    print(training_line(record.data["settings"], settings.count("train_images")))
    if folder.page.exists():
        end(folder.root, f"reproduced: open {folder.page}")
    else:
        end(folder.root, "not all stages are done: the same command without --stages goes on to the page")
    return 0


def summary(folder: RunFolder, record: Record, tables: dict[str, Any]) -> dict[str, Any]:
    """Data that `--json` prints.

    `{"settings", "steps", "tables": {renderer: table.json}, "comparison": {renderer: [cell]}, "reached":
    {renderer: [median]}, "page", "folder"}`; cells are those of `vig_train.evaluation.paper.compare`, medians
    those of `vig_paper.reproduction.reached.reached`.
    """
    settings = record.data["settings"]
    return {
        "settings": settings,
        "steps": record.data["steps"],
        "tables": tables,
        "comparison": {name: [asdict(cell) for cell in compare(table)] for name, table in tables.items()},
        "reached": {name: [asdict(each) for each in reached(settings, t)] for name, t in tables.items()},
        "page": str(folder.page),
        "folder": str(folder.root),
    }
