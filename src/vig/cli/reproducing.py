"""`vig reproduce`: the paper's section 5 in one command."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import fields

from rich.console import Console

from vig.cli.doctor import machine
from vig.cli.main import Reproduce
from vig.evaluation import compare
from vig.report.comparison import comparison_table
from vig.report.page import write_page
from vig.reproduction import TIERS, Run, RunFolder, Settings, read_table, reproduce


def reproduce_paper(chosen: Reproduce) -> int:
    """Do what is left of a run and print its tables, or JSON; its folder comes last."""
    overridden = {field.name: getattr(chosen, field.name) for field in fields(Settings)}
    settings = Settings.of(**overridden)
    folder = RunFolder(chosen.out)

    def say(line: str) -> None:
        if not chosen.json:
            print(line, flush=True)

    run = Run(folder, settings, not chosen.no_cycles, chosen.workers, say, not chosen.json)
    record = reproduce(run, write_page, chosen.stages, machine(), command_line(chosen))
    ...


def command_line(chosen: Reproduce) -> str:
    """The command that asks for these settings: `vig reproduce --scale ... --out ...`."""
    words = ["vig", "reproduce"]
    for field in fields(Reproduce):
        value = getattr(chosen, field.name)
        if value == field.default or field.name == "json":
            continue
        words.append("--" + field.name.replace("_", "-"))
        if isinstance(value, tuple):
            words += value
        elif value is not True:
            words.append(str(value))
    return shlex.join(words)
