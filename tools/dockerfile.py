"""The steps of the Dockerfile, checked without a Docker engine.

`python tools/dockerfile.py --run [--build-arg NAME=VALUE]` does them one by one in a temporary folder,
where each absolute path of the image lies: pip installs what the image would, and `vig demo` runs. It takes
some minutes and 0.5 GB.
"""

import argparse
import glob
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("opt", "source", "work", "home", "tmp")
"""Of the image, at its root, that steps name."""
AS_ROOT = """
useradd() { mkdir -p "$HOME"; }
install() { shift 5; mkdir -p "$@"; }
"""
"""What only an image's root can do, for a shell: `install --directory --owner NAME --mode MODE FOLDER...`."""


@dataclass(frozen=True)
class Step:
    """An instruction, such as COPY, and the rest of its line, continued ones joined."""

    name: str
    words: str


def read_steps(path: Path = ROOT / "Dockerfile") -> list[Step]:
    """The instructions of a Dockerfile in order."""
    lines = [line for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    return [Step(*line.split(maxsplit=1)) for line in joined.splitlines()]


def copied(step: Step) -> tuple[str | None, list[str], str]:
    """The stage that a COPY takes from, or None for the checkout, its sources and where they go."""
    words = shlex.split(step.words)
    stage = words.pop(0).removeprefix("--from=") if words[0].startswith("--from=") else None
    return stage, words[:-1], words[-1]


def let_through(source: str, path: Path = ROOT / ".dockerignore") -> bool:
    """Whether .dockerignore, which excludes all but what it names, names a file or a folder of it."""
    lines = path.read_text().splitlines()
    return "*" in lines and f"!{source.rstrip('/')}" in lines


class Imitation:
    """An image in a folder: paths of its root lie there."""

    def __init__(self, root: Path, arguments: dict[str, str]) -> None:
        self.root = root
        self.arguments = arguments
        self.environment = {**os.environ, "HOME": str(root / "home/vig")}
        self.folder = root

    def placed(self, text: str) -> str:
        """Text whose absolute paths are those within the folder."""
        return re.sub(rf"(?<![\w./])/({'|'.join(FOLDERS)})\b", rf"{self.root}/\1", text)

    def do(self, step: Step) -> None:
        """Do one instruction."""
        print(f"{step.name} {step.words}", flush=True)
        if step.name == "ARG":
            name, _, value = step.words.partition("=")
            self.environment[name] = self.arguments.get(name, value)
        elif step.name == "ENV":
            for word in shlex.split(step.words):
                name, _, value = self.placed(word).partition("=")
                for known in re.findall(r"\$(\w+)", value):
                    value = value.replace(f"${known}", self.environment[known])
                self.environment[name] = value
        elif step.name == "WORKDIR":
            self.folder = Path(self.placed(step.words))
            self.folder.mkdir(parents=True, exist_ok=True)
        elif step.name == "COPY":
            self._copy(*copied(step))
        elif step.name == "RUN":
            command = AS_ROOT + self.placed(step.words)
            (self.root / "tmp").mkdir(exist_ok=True)
            subprocess.run(["bash", "-ec", command], cwd=self.folder, env=self.environment, check=True)

    def _copy(self, stage: str | None, sources: list[str], target: str) -> None:
        if stage is not None:  # the next stage has this alone of the one before
            kept = [self.placed(source) for source in sources]
            for path in self.root.iterdir():
                if not any(Path(keep).is_relative_to(path) for keep in kept):
                    shutil.rmtree(path)
            self.folder = self.root
            return
        place = self.folder / self.placed(target)
        for source in sources:
            if (ROOT / source).is_dir():
                shutil.copytree(ROOT / source, place, dirs_exist_ok=True)
            else:
                place.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / source, place)


def run(arguments: dict[str, str]) -> None:
    """Do all steps, then the image's own command, in a temporary folder; say how large the image would be."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as tools:
        image = Imitation(Path(folder), arguments)
        base = Path(sys.base_prefix) / "bin" / f"python{sys.version_info[0]}.{sys.version_info[1]}"
        Path(tools, "python").symlink_to(base)  # that of the base image
        image.environment["PATH"] = f"{tools}:{os.environ['PATH']}"
        steps = read_steps()
        for step in steps:
            image.do(step)
        last = {step.name: shlex.split(step.words.strip("[]").replace(",", " ")) for step in steps}
        command = [*last["ENTRYPOINT"], *last["CMD"]]
        subprocess.run(command, cwd=image.folder, env=image.environment, check=True)
        used = subprocess.run(["du", "-sm", *glob.glob(f"{folder}/opt")], capture_output=True, text=True)
        print(f"the image has {used.stdout.split()[0]} MB beyond its base")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", action="store_true", help="do the steps")
    parser.add_argument("--build-arg", action="append", default=[], metavar="NAME=VALUE")
    chosen = parser.parse_args()
    if chosen.run:
        run(dict(each.split("=", 1) for each in chosen.build_arg))
    else:
        print("\n".join(f"{step.name} {step.words}" for step in read_steps()))


if __name__ == "__main__":
    main()
