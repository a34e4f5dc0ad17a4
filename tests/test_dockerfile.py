"""The Dockerfile's steps as far as they can be checked without an engine; tools/dockerfile.py does them."""

import json
import re
import shlex
import sys
import tomllib
from importlib import util
from pathlib import Path, PurePosixPath
from typing import Any

import pytest

from vig_app.cli.common import verbs_of_packages
from vig_app.cli.main import VERBS
from vig_app.cli.main import _parse_arguments as parsed

ROOT = Path(__file__).parents[1]


def load_tool() -> Any:
    spec = util.spec_from_file_location("dockerfile", ROOT / "tools" / "dockerfile.py")
    assert spec is not None and spec.loader is not None
    tool = util.module_from_spec(spec)
    sys.modules["dockerfile"] = tool
    spec.loader.exec_module(tool)
    return tool


dockerfile = load_tool()
STEPS = dockerfile.read_steps()


def test_what_is_copied_is_there_and_let_through() -> None:
    sources = [
        source
        for step in STEPS
        if step.name == "COPY"
        for stage, sources, _ in [dockerfile.copied(step)]
        if stage is None
        for source in sources
    ]
    assert {"src", "pyproject.toml", "README.md", "LICENSE", "constraints.txt"} <= set(sources)
    for source in sources:
        assert (ROOT / source).exists() and dockerfile.let_through(source), source
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    assert {line[1:] for line in ignored if line.startswith("!")} == set(sources)


def test_what_the_wheel_needs_is_copied() -> None:
    """Files that pyproject.toml names outside the packages."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    files = [project["readme"], *project["license-files"]]
    copied = {source for step in STEPS if step.name == "COPY" for source in dockerfile.copied(step)[1]}
    assert len(files) > 1
    for file in files:
        assert copied & {file, *map(str, PurePosixPath(file).parents)}, file


def test_the_container_runs_as_a_user_of_its_own() -> None:
    names = [step.name for step in STEPS]
    users = [step.words for step in STEPS if step.name == "USER"]
    assert users == ["vig"] and names.index("USER") < names.index("ENTRYPOINT")
    last_stage = len(names) - names[::-1].index("FROM")
    made = next(step for step in STEPS[last_stage:] if "useradd" in step.words)
    assert "--uid 1000" in made.words and names.index("USER") > STEPS.index(made)


def commands() -> list[list[str]]:
    """Of vig: the default command, and those of the comments."""
    last = {step.name: json.loads(step.words) for step in STEPS if step.name in ("ENTRYPOINT", "CMD")}
    assert last["ENTRYPOINT"] == ["vig"]
    text = (ROOT / "Dockerfile").read_text()
    runs = re.findall(r"^# +docker run .*? vig(?: (.*))?$", text, re.MULTILINE)
    assert len(runs) == 3
    return [last["CMD"], *(shlex.split(line.split("  ")[0]) or last["CMD"] for line in runs)]


@pytest.mark.parametrize("command", commands(), ids=" ".join)
def test_commands_of_the_container_parse(command: list[str]) -> None:
    chosen = parsed([*VERBS, *verbs_of_packages()], command)
    assert getattr(chosen, "no_open", True) or command[0] == "view"


def test_the_viewer_can_be_reached_from_outside_the_container_alone() -> None:
    view = next(command for command in commands() if command[0] == "view")
    assert view[-2:] == ["--host", "0.0.0.0"]
    assert "--publish 127.0.0.1:8080:8080" in (ROOT / "Dockerfile").read_text()
    assert any(step.name == "EXPOSE" and step.words == "8080" for step in STEPS)


def test_paths_of_the_image_lie_in_the_imitations_folder(tmp_path: Path) -> None:
    image = dockerfile.Imitation(tmp_path, {"INDEX": "https://other"})
    for line in ("ARG INDEX=https://index", "ENV PATH=/opt/vig/bin:$PATH", "WORKDIR /work"):
        image.do(dockerfile.Step(*line.split(maxsplit=1)))
    image.do(dockerfile.Step("RUN", 'touch here /work/there && echo "$INDEX" > /tmp/index'))
    assert {path.name for path in (tmp_path / "work").iterdir()} == {"here", "there"}
    assert (tmp_path / "tmp" / "index").read_text() == "https://other\n"
    assert image.environment["PATH"].startswith(f"{tmp_path}/opt/vig/bin:")
