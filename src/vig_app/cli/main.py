"""The command line: `vig VERB`."""

import difflib
import gc
import io
import json
import os
import re
import signal
import sys
import traceback
from contextlib import redirect_stderr
from itertools import takewhile
from typing import Any

import tyro

from vig import __version__
from vig.io.errors import UserError
from vig_app.cli import common
from vig_app.cli.common import ExitCode, Verb, format_help, verbs_of_packages
from vig_app.cli.options import FitCommand
from vig_app.cli.speed import extra_of

VERBS = (
    Verb("demo", common.Demo, "vig_app.cli.demo:demo"),
    Verb("fit", FitCommand, "vig_app.cli.fit:fit"),
    Verb("export", common.ExportCommand, "vig_app.cli.results:export"),
    Verb("view", common.ViewCommand, "vig_app.cli.view:view"),
    Verb("serve", common.ServeCommand, "vig_app.cli.serve:serve"),
    Verb("gallery", common.Gallery, "vig_app.cli.results:gallery"),
    Verb("bop", common.BopCommand, "vig_app.cli.bop:bop"),
    Verb("doctor", common.Doctor, "vig_app.cli.doctor:run_doctor"),
    Verb("schema", common.SchemaCommand, "vig_app.cli.results:print_schema"),
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
    # While modules are loaded little becomes garbage; looking for it takes a twentieth of a short command.
    gc.set_threshold(20_000, 20, 50)
    for stream in (sys.stdout, sys.stderr):  # a name of a file may have letters that a terminal has not
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
    arguments = sys.argv[1:] if arguments is None else arguments
    for at in reversed(range(len(arguments) - 1)):  # a parser takes -z for an option of its own
        if arguments[at] in ("--up", "--front") and re.fullmatch("-[xyzXYZ]", arguments[at + 1]):
            arguments = [*arguments[:at], "=".join(arguments[at : at + 2]), *arguments[at + 2 :]]
    if arguments == ["--version"]:
        print(f"vig {__version__}")
        sys.exit(0)
    # Those of packages are looked for where they may be meant: it takes longer than to read a photo.
    others = () if arguments and arguments[0] in {verb.name for verb in VERBS} else verbs_of_packages()
    verbs = {verb.settings: verb for verb in (*VERBS, *others)}
    try:
        _check_verb({verb.name for verb in verbs.values()}, arguments)
        chosen = _parse_arguments(list(verbs.values()), arguments)
        sys.exit(verbs[type(chosen)].run(chosen))
    except UserError as error:
        code, line = ExitCode.MISTAKE, str(error)
    except BrokenPipeError:  # the reader of the output has exited, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(ExitCode.INCOMPLETE)
    except KeyboardInterrupt as stop:  # by Ctrl-C, or the signal that it names
        by_sigterm = stop.args[:1] == (signal.SIGTERM,)
        code = ExitCode.TERMINATED if by_sigterm else ExitCode.INTERRUPTED
        line = "interrupted; what is finished stays"
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and (extra := extra_of(error.name or "")):
            code = ExitCode.MISTAKE
            if " ".join(arguments).startswith(("train", "class train", "calibrate", "reproduce")):
                extra = "train"  # whichever of its packages is missing
            line = f"expected the package {error.name}; it is not installed. Run pip install 'vig[{extra}]'."
        else:
            traceback.print_exc()
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            code, line = ExitCode.FAULT, f"a fault of vig, please report it with `vig doctor`: {reason}"
    print(f"vig: {line}", file=sys.stderr)
    if "--json" in arguments:
        print(json.dumps({"error": line}))
    sys.exit(code)


def _check_verb(names: set[str], arguments: list[str]) -> None:
    """Raise UserError where the arguments begin with no verb, with the most similar one."""
    for depth in (1, 2):
        given = " ".join(arguments[:depth])
        if given in names or len(arguments) < depth or arguments[depth - 1].startswith("-"):
            return
        if given == "reproduce":
            raise UserError(
                "expected a clone of vig's repository for `vig reproduce`, whose package vig_paper is not in"
                " the wheel. Run pip install --editable '.[train]' in a clone."
            )
        known = sorted({" ".join(name.split()[:depth]) for name in names})
        if given not in known:
            alike = difflib.get_close_matches(given, known, 1)
            remedy = f"Did you mean vig {alike[0]}?" if alike else "vig --help lists them."
            verbs = [name for name in known if depth == 1 or name.split()[0] == arguments[0]]
            raise UserError(f"expected a verb, {', '.join(verbs)}; got '{given}'. {remedy}")


def _parse_arguments(verbs: list[Verb], arguments: list[str]) -> Any:
    """Return the settings of the verb that the arguments name; UserError where it does not take them."""
    app = tyro.extras.SubcommandApp()
    groups: dict[str, tyro.extras.SubcommandApp] = {}
    for verb in verbs:
        group, _, name = verb.name.rpartition(" ")
        if group and group not in groups:
            groups[group] = tyro.extras.SubcommandApp()
        settings = format_help(verb.settings) if {"-h", "--help"} & {*arguments} else verb.settings
        (groups[group] if group else app).command(name=name)(settings)
    for group, inner in groups.items():
        app.command(inner, name=group, help=GROUPS[group])
    complaint = io.StringIO()
    try:
        with redirect_stderr(complaint):  # it prints and exits where it cannot parse them
            return app.cli(
                prog="vig",
                description="Explain objects in photos, even where they are hidden. Version: vig --version."
                ' Tab completion in bash: eval "$(vig --tyro-print-completion bash)".',
                args=arguments,
                config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes, tyro.conf.DisallowNone),
            )
    except SystemExit as ended:
        if not ended.code:
            raise
    lines = complaint.getvalue().splitlines()[1:]  # the first is the title of a box
    words = " ".join(re.sub("[\u2500-\u257f]|-{9,}", " ", " ".join(lines)).split())
    if wrong := re.search(r"Error parsing (\S+?): .*?matching (\S+) .*?from \[(.*?)\]\.", words):
        option, kind, given = wrong.groups()
        words = f"expected {option} {kind}; got {given}."
    words = re.sub(r" Perhaps you meant: (\S+).*", r". Did you mean \1?", words)
    words = re.sub(r" (For full helptext|Argument helptext|Available subcommands).*", "", words)
    named = " ".join(takewhile(lambda word: not word.startswith("-"), arguments[:1]))
    raise UserError(" ".join(f"{words} See vig {named} --help.".split()))
