"""Prints how a source tree is built: lines and files of each package, the longest, the median, circles.

    python tools/structure.py [SRC] [--photo PHOTO]

SRC is the folder that holds the packages, `src` by default. With --photo, one photo is explained and every
file of vig that it passes through is listed in the order in which it is first entered.
"""

from __future__ import annotations

import argparse
import ast
import statistics
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path


def lines(path: Path) -> int:
    return len(path.read_text().splitlines())


def functions(tree: ast.AST) -> list[tuple[int, int, str]]:
    """Arguments, lines and name of every function."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args
            count = len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs)
            found.append((count, (node.end_lineno or 0) - node.lineno + 1, node.name))
    return found


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


def report(root: Path) -> None:
    head = "package files lines native_lines median_file longest_file most_arguments longest_function"
    print(f"| {head.replace(' ', ' | ').replace('_', ' ')} |")
    print("| --- | ---: | ---: | ---: | ---: | --- | --- | --- |")
    for package in sorted(path for path in root.iterdir() if (path / "__init__.py").is_file()):
        files = sorted(package.rglob("*.py"))
        sizes = {path: lines(path) for path in files}
        native = sum(lines(path) for path in package.rglob("*.cc"))
        long = max(files, key=lambda path: sizes[path])
        all_functions = [
            (*each, path.relative_to(package))
            for path in files
            for each in functions(ast.parse(path.read_text()))
        ]
        most, longest = max(all_functions), max(all_functions, key=lambda each: each[1])
        median = statistics.median(size for path, size in sizes.items() if path.name != "__init__.py")
        print(
            f"| {package.name} | {len(files)} | {sum(sizes.values())} | {native} | {median:.0f}"
            f" | {long.relative_to(package)} ({sizes[long]}) | {most[2]} in {most[3]} ({most[0]})"
            f" | {longest[2]} in {longest[3]} ({longest[1]}) |"
        )
    print(f"\nimports in a circle: {circle(root)}")


def follow(photo: Path) -> None:
    """Explain a photo and list the files of vig whose code runs, in their order."""
    import vig

    explainer = vig.Explainer()
    home, seen = Path(vig.__file__).parent, []

    def watch(frame: object, event: str, argument: object) -> None:
        name = frame.f_code.co_filename  # type: ignore[attr-defined]
        if event == "call" and name.startswith(str(home)) and name not in seen:
            seen.append(name)

    import threading

    threading.setprofile_all_threads(watch) if hasattr(threading, "setprofile_all_threads") else None
    threading.setprofile(watch)
    sys.setprofile(watch)
    explanation = explainer.explain(photo)
    explanation.to_dict()
    sys.setprofile(None)
    print(f"\n{photo.name} passes through {len(seen)} files:")
    print("\n".join(str(Path(name).relative_to(home)) for name in seen))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", nargs="?", type=Path, default=Path("src"))
    parser.add_argument("--photo", type=Path)
    given = parser.parse_args()
    report(given.source)
    if given.photo:
        follow(given.photo)


if __name__ == "__main__":
    main()
