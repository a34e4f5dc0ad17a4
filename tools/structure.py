"""Prints how a source tree is built: sizes, constants and comments of each package, circles of imports.

    python tools/structure.py [SRC] [--photo PHOTO]

SRC is the folder that holds the packages, `src` by default. With --photo, one photo is explained, by the
library and then by `vig fit`, and the files of SRC are counted of which a function's code runs, in whatever
thread; those of the library are listed in the order in which they are first entered.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import io
import statistics
import subprocess
import sys
import tempfile
import threading
import tokenize
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import FrameType

COLUMNS = (
    "package", "files", "lines", "native lines", "median file", "longest file", "most arguments",
    "longest function", "constants", "comments per 1000",
)  # fmt: skip

WAYS = ("the library", "vig fit")


@dataclass(frozen=True)
class SourceFile:
    """One Python file: its lines, lines with a comment, module constants, and its functions."""

    path: Path
    lines: int
    comments: int
    constants: int
    functions: list[tuple[int, int, str]]
    """Arguments, lines and name of each."""

    @staticmethod
    def of(path: Path) -> SourceFile:
        text = path.read_text()
        tree = ast.parse(text)
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        comments = sum(token.type == tokenize.COMMENT for token in tokens)
        constants = sum(isinstance(node, ast.Assign | ast.AnnAssign) for node in tree.body)
        functions = []
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                count = len(node.args.posonlyargs) + len(node.args.args) + len(node.args.kwonlyargs)
                functions.append((count, (node.end_lineno or 0) - node.lineno + 1, node.name))
        return SourceFile(path, len(text.splitlines()), comments, constants, functions)


def circle(root: Path) -> str:
    """The first circle of imports at the top of modules, or "none"."""
    names = {".".join(p.relative_to(root).with_suffix("").parts): p for p in root.rglob("*.py")}
    names = {name.removesuffix(".__init__"): path for name, path in names.items()}
    graph: dict[str, set[str]] = {name: set() for name in names}
    for name, path in names.items():
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                full = [f"{node.module}.{alias.name}" for alias in node.names]
            else:
                full = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            targets = {each if each in names else each.rpartition(".")[0] for each in full}
            graph[name] |= {t for t in targets if t in names and t != name and not name.startswith(f"{t}.")}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        return " -> ".join(error.args[1])
    return "none"


def row(package: Path) -> list[str]:
    """The numbers of a package, in the order of `COLUMNS`."""
    files = [SourceFile.of(path) for path in sorted(package.rglob("*.py"))]
    native = [path.read_text().splitlines() for path in package.rglob("*.cc")]
    lines, native_lines = sum(file.lines for file in files), sum(map(len, native))
    comments = sum(file.comments for file in files)
    comments += sum("//" in line for text in native for line in text)
    longest = max(files, key=lambda file: file.lines)
    functions = [(*each, file.path.relative_to(package)) for file in files for each in file.functions]
    most, long = max(functions), max(functions, key=lambda each: each[1])
    median = statistics.median(file.lines for file in files if file.path.name != "__init__.py")
    return [
        package.name,
        f"{len(files)}",
        f"{lines}",
        f"{native_lines}",
        f"{median:.0f}",
        f"{longest.path.relative_to(package)} ({longest.lines})",
        f"{most[2]} in {most[3]} ({most[0]})",
        f"{long[2]} in {long[3]} ({long[1]})",
        f"{sum(file.constants for file in files)}",
        f"{1000 * comments / (lines + native_lines):.0f}",
    ]


def report(root: Path) -> None:
    print(f"| {' | '.join(COLUMNS)} |")
    print("| --- | ---: | ---: | ---: | ---: | --- | --- | --- | ---: | ---: |")
    for package in sorted(path for path in root.iterdir() if (path / "__init__.py").is_file()):
        print(f"| {' | '.join(row(package))} |")
    print(f"\nimports in a circle: {circle(root)}")


def importing(frame: FrameType | None) -> bool:
    """Whether the code runs as part of a module's import, which no photo passes."""
    while frame is not None and "importlib" not in frame.f_code.co_filename:
        if frame.f_code.co_name == "<module>" and frame.f_globals.get("__name__") != "__main__":
            return True
        frame = frame.f_back
    return frame is not None


@contextlib.contextmanager
def entered_files(root: Path) -> Iterator[list[Path]]:
    """The files under a folder of which a function runs within the block, in all threads, in their order."""
    prefix, names, entered = f"{root.resolve()}/", set[str](), list[Path]()

    def watch(frame: FrameType, event: str, argument: object) -> None:
        name = frame.f_code.co_filename
        if event == "call" and name not in names and name.startswith(prefix) and not importing(frame):
            names.add(name)
            entered.append(Path(name).relative_to(root.resolve()))

    threading.setprofile(watch)  # of threads that start from now on
    sys.setprofile(watch)
    try:
        yield entered
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]


def command_line() -> Callable[[list[str]], None]:
    """`main` of the command line, of this version or of one before the application had its own package."""
    try:
        from vig_app.cli.main import main
    except ImportError:
        from vig.cli.main import main
    return main


def follow(photo: Path, by: str) -> None:
    """Explain a photo by "the library" or by "vig fit", and count the files that it passes."""
    import vig

    with tempfile.TemporaryDirectory() as folder, entered_files(Path(vig.__file__).parents[1]) as files:
        if by == "the library":
            vig.Explainer().explain(photo).to_dict()
        else:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
                command_line()(["fit", str(photo), "--out", f"{folder}/out"])
    print(f"\n{photo.name} passes {len(files)} files in {by}:")
    print("\n".join(map(str, files)))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", nargs="?", type=Path, default=Path("src"))
    parser.add_argument("--photo", type=Path)
    parser.add_argument("--by", choices=WAYS, help="only follow the photo this way")
    settings = parser.parse_args()
    if settings.by:
        follow(settings.photo, settings.by)
        return
    report(settings.source)
    for way in (
        WAYS if settings.photo else ()
    ):  # in a process of its own: what one keeps the other would not enter
        command = [sys.executable, __file__, "--photo", str(settings.photo), "--by", way]
        print(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


if __name__ == "__main__":
    main()
