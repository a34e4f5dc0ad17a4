"""Breaks the code in small ways, one at a time, and says which breakages no test notices.

    python tools/mutations.py [--only TEXT] [--jobs 2] [--list FILE]

tools/mutations.toml holds the mutations: a file, a text that occurs in it once, what takes its place, and the
tests that should fail. Each is tried in a copy of the tree, the native library compiled anew where its code
is broken: that needs CMake, ninja and `pip install nanobind`. Run by hand: it takes some 20 minutes. Exits 1
when more than `MAX_SURVIVORS` survive, or when a text is not found once.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue

from vig_native import ISA

ROOT = Path(__file__).parents[1]
MAX_SURVIVORS = 3
PATIENCE = 600
"""Seconds that the tests of one mutation may take."""
COPIED = ("src", "tests", "tools", "benchmarks", "docs", "examples", "pyproject.toml")


def copy_of_tree() -> Path:
    """A copy of what tests need."""
    copy = Path(tempfile.mkdtemp(prefix="mutations-"))
    for name in COPIED:
        source = ROOT / name
        shutil.copytree(source, copy / name) if source.is_dir() else shutil.copy(source, copy / name)
    # An editable installation finds its own sources first, whatever the path says.
    (copy / "src/sitecustomize.py").write_text(
        "import sys\nsys.meta_path = [f for f in sys.meta_path if 'ScikitBuild' not in type(f).__name__]\n"
    )
    return copy


def compile_library(copy: Path) -> None:
    """Compile what changed of the native library, for the instruction set in use, into a copy of the tree."""
    build, source = copy / "build", copy / "src/vig_native"
    options = [f"-DPython_EXECUTABLE={sys.executable}", f"-DVIG_ISAS={ISA}", "-G", "Ninja"]
    for command in (["cmake", "-S", source / "cmake", "-B", build, *options], ["cmake", "--build", build]):
        subprocess.run(command, capture_output=True, check=True)
    for library in build.glob("_*.so"):
        shutil.copy(library, source)


def outcome(copy: Path, mutation: dict[str, str]) -> str:
    """`killed`, `SURVIVED`, `SLOW` (no verdict in time) or what is wrong with the mutation itself."""
    path = copy / "src" / mutation["file"]
    whole = path.read_text() if path.is_file() else ""
    if whole.count(mutation["old"]) != 1:
        return f"INVALID: the text occurs {whole.count(mutation['old'])} times"
    native = mutation["file"].startswith("vig_native")
    path.write_text(whole.replace(mutation["old"], mutation["new"]))
    try:
        if native:
            compile_library(copy)
        code = exit_code(copy, mutation["tests"])
    except subprocess.TimeoutExpired:
        return "SLOW"
    except subprocess.CalledProcessError:
        return "INVALID: it does not compile"
    finally:
        path.write_text(whole)
        if native:
            compile_library(copy)
    return {0: "SURVIVED", 1: "killed"}.get(code, f"INVALID: pytest ended with {code}")


def exit_code(copy: Path, tests: str) -> int:
    """Run tests in a copy of the tree."""
    environment = os.environ | {"PYTHONPATH": "src", "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    options = ["-x", "-q", "-p", "no:cacheprovider"]
    command = [sys.executable, "-m", "pytest", *options, *tests.split()]
    return subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, timeout=PATIENCE
    ).returncode


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="mutations whose file or text holds this")
    parser.add_argument("--jobs", type=int, default=2, help="how many at a time")
    parser.add_argument("--list", type=Path, help="write the outcomes here, too")
    given = parser.parse_args()
    every = tomllib.loads((ROOT / "tools" / "mutations.toml").read_text())["mutation"]
    chosen = [each for each in every if given.only in each["file"] or given.only in each["old"]]
    copies: Queue[Path] = Queue()
    for _ in range(given.jobs):
        copies.put(copy_of_tree())

    def tried(mutation: dict[str, str]) -> str:
        copy = copies.get()
        try:
            return outcome(copy, mutation)
        finally:
            copies.put(copy)

    def clean(tests: str) -> bool:
        copy = copies.get()
        try:
            return exit_code(copy, tests) == 0
        finally:
            copies.put(copy)

    runs = sorted({each["tests"] for each in chosen})
    with ThreadPoolExecutor(given.jobs) as pool:
        broken = [tests for tests, passed in zip(runs, pool.map(clean, runs), strict=True) if not passed]
    if broken:  # what fails without a mutation says nothing of one
        print("INVALID: these tests fail as the code is:", *broken, sep="\n  ")
        return 1
    print(f"{len(runs)} sets of tests pass as the code is", flush=True)
    told, counts = [], dict.fromkeys(("killed", "SURVIVED", "SLOW", "INVALID"), 0)
    with ThreadPoolExecutor(given.jobs) as pool:
        for mutation, result in zip(chosen, pool.map(tried, chosen), strict=True):
            counts[result.split(":")[0]] += 1
            change = f"{mutation['old'].strip()[:60]!r} -> {mutation['new'].strip()[:60]!r}"
            reason = f" ({mutation['reason']})" if "reason" in mutation else ""
            told.append(f"{result:9} {mutation['file']}: {change}{reason}")
            print(told[-1], flush=True)
    told.append(", ".join(f"{count} {name}" for name, count in counts.items()))
    print(told[-1])
    if given.list:
        given.list.write_text("\n".join(told) + "\n")
    while not copies.empty():
        shutil.rmtree(copies.get())
    return int(counts["SURVIVED"] + counts["SLOW"] > MAX_SURVIVORS or counts["INVALID"] > 0)


if __name__ == "__main__":
    sys.exit(main())
