"""The command line: `vig VERB`."""

from __future__ import annotations

import io
import json
import os
import sys
import traceback
from typing import Any

import tyro

from vig import __version__
from vig.io.errors import UserError
from vig_app.cli.common import (
    Demo,
    Doctor,
    ExitCode,
    ExportCommand,
    FitCommand,
    Gallery,
    SchemaCommand,
    Verb,
    ViewCommand,
    verbs_of_packages,
)

VERBS = (
    Verb("demo", Demo, "vig_app.cli.demo:demo"),
    Verb("fit", FitCommand, "vig_app.cli.fit:fit"),
    Verb("export", ExportCommand, "vig_app.cli.export:export"),
    Verb("view", ViewCommand, "vig_app.cli.view:view"),
    Verb("gallery", Gallery, "vig_app.cli.gallery:gallery"),
    Verb("doctor", Doctor, "vig_app.cli.doctor:run_doctor"),
    Verb("schema", SchemaCommand, "vig_app.cli.schema:print_schema"),
)
GROUPS = {
    "class": "Make a class from a folder of meshes, and train its network.",
    "dataset": "Generate, check, look at and export datasets.",
}
"""Verbs that have verbs of their own."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exits with an `ExitCode`."""
    # Threads of torch that spin while they wait take the core of the one that they wait for: a step of a
    # training takes up to ten times as long on a busy machine. It is read when torch is loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    for stream in (sys.stdout, sys.stderr):  # a name of a file may have letters that a terminal has not
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments == ["--version"]:
        print(f"vig {__version__}")
        sys.exit(0)
    verbs = {verb.settings: verb for verb in (*VERBS, *verbs_of_packages())}
    try:
        chosen = _parsed(list(verbs.values()), arguments)
    except SystemExit as ended:
        if ended.code and "--json" in arguments:
            _print_error("expected arguments as --help lists them; standard error says which came")
        raise
    if isinstance(
        chosen, FitCommand | ViewCommand
    ):  # whose matrices are small: numpy's further threads would only spin
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        sys.exit(verbs[type(chosen)].run(chosen))
    except UserError as error:
        code, line = ExitCode.MISTAKE, str(error)
    except BrokenPipeError:  # the reader of the output has exited, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(ExitCode.INCOMPLETE)
    except KeyboardInterrupt:
        code, line = ExitCode.INTERRUPTED, "interrupted; what is finished stays"
    except Exception as error:
        traceback.print_exc()
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        code, line = ExitCode.FAULT, f"a fault of vig, please report it with `vig doctor`: {reason}"
    print(f"vig: {line}", file=sys.stderr)
    if chosen.json:
        _print_error(line)
    sys.exit(code)


def _print_error(line: str) -> None:
    """The JSON object of a command that came to no result."""
    print(json.dumps({"error": line}))


def _parsed(verbs: list[Verb], arguments: list[str]) -> Any:
    """The settings of the verb that the arguments name."""
    app = tyro.extras.SubcommandApp()
    groups: dict[str, tyro.extras.SubcommandApp] = {}
    for verb in verbs:
        group, _, name = verb.name.rpartition(" ")
        if group and group not in groups:
            groups[group] = tyro.extras.SubcommandApp()
        (groups[group] if group else app).command(name=name)(verb.settings)
    for group, inner in groups.items():
        app.command(inner, name=group, help=GROUPS[group])
    return app.cli(
        prog="vig",
        description="Explain objects in photos, even where they are hidden.",
        args=arguments,
        config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes),
    )
