"""`vig reproduce`: the paper's section 5 in one command."""

import json
import sys
from dataclasses import asdict, fields
from math import inf

from rich.console import Console

from vig.io.machine import machine
from vig.io.printing import end
from vig_paper.reproduction import RENDERERS, Run, RunFolder, reproduce
from vig_paper.reproduction.page import training_line
from vig_paper.settings import Reproduce, ReproductionSettings
from vig_train.cli.common import check_ranges, command_line
from vig_train.evaluation.paper import compare, comparison_block

SAME_NUMBERS = ("steps", "workers", "json")  # options that do not change the numbers


def reproduce_paper(chosen: Reproduce) -> int:
    """Do the remaining steps of a run and print its tables, or JSON; its folder comes last.

    JSON's "comparison" has the cells of `vig_train.evaluation.paper.compare`, by renderer.
    """
    settings = ReproductionSettings.of(
        **{field.name: getattr(chosen, field.name) for field in fields(ReproductionSettings)}
    )
    check_ranges(chosen, workers=(1, inf))
    folder = RunFolder(chosen.out)

    def report(line: str) -> None:
        if not chosen.json:
            print(line, flush=True)

    run = Run(folder, settings, not chosen.no_cycles, chosen.workers, report, not chosen.json)
    command = command_line("vig reproduce", chosen, skipped=SAME_NUMBERS)
    record = reproduce(run, chosen.steps, machine(), command)
    tables = {name: table for name in RENDERERS if (table := folder.read_table(name)) is not None}
    recorded = record.data["settings"]
    cells = {name: compare(table) for name, table in tables.items()}
    if chosen.json:
        summary = {
            "settings": recorded,
            "steps": record.data["steps"],
            "tables": tables,
            "comparison": {name: [asdict(cell) for cell in of_table] for name, of_table in cells.items()},
            "page": str(folder.page),
            "folder": str(folder.root),
        }
        print(json.dumps(summary, indent=2))
        return 0
    console = Console(width=None if sys.stdout.isatty() else 120)
    for name, table in tables.items():
        passed = f"{sum(cell.passed for cell in cells[name])} of {len(cells[name])}"
        console.print(comparison_block(table).rich())
        print(f"{name}: {passed} cells pass")
    print(training_line(recorded, settings.count("train_images")))
    if folder.page.exists():
        end(folder.root, f"reproduced: open {folder.page}")
    else:
        end(folder.root, "not all stages are done: the same command without --stages goes on to the page")
    return 0
