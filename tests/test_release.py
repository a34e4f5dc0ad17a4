"""A release: versions that agree, links that work on a package index, a workflow without a password."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
FILES = ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "README.md")
REPOSITORY = "https://example.org/someone/vig"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """The files of a release, of version 9.8.7."""
    for name in FILES:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    for name, before, after in (
        ("pyproject.toml", r'(?m)^version = ".*"', 'version = "9.8.7"'),
        ("CITATION.cff", r"(?m)^version: .*", "version: 9.8.7"),
        ("CHANGELOG.md", r"(?m)^## \[Unreleased\]", "## [9.8.7] - 2030-01-02"),
    ):
        changed, count = re.subn(before, after, (tmp_path / name).read_text())
        assert count == 1
        (tmp_path / name).write_text(changed)
    return tmp_path


def release(root: Path, tag: str) -> tuple[int, str]:
    tool = ROOT / "tools" / "release.py"
    command = [sys.executable, str(tool), tag, REPOSITORY + "/", "--root", str(root)]
    ended = subprocess.run(command, capture_output=True, text=True)
    return ended.returncode, ended.stderr


def links(text: str) -> list[str]:
    return re.findall(r"\]\(([^)\s]+)\)", text)


def test_links_and_pictures_of_a_release_are_full_addresses_of_what_is_there(checkout: Path) -> None:
    assert release(checkout, "v9.8.7") == (0, "")
    text, before = ((root / "README.md").read_text() for root in (checkout, ROOT))
    assert len(links(text)) == len(links(before)) > 10 and "<img" not in text
    for link, was in zip(links(text), links(before), strict=True):
        kind, _, path = link.removeprefix(f"{REPOSITORY}/").partition("/v9.8.7/")
        assert path == was and kind == ("raw" if was.endswith(".jpg") else "blob"), link
        assert (ROOT / path.partition("#")[0]).is_file(), link
    project = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]
    assert project["urls"]["Homepage"] == REPOSITORY and "Changelog" in project["urls"]
    assert project["scripts"] == {"vig": "vig_app.cli.main:main"}
    assert f"repository-code: {REPOSITORY}\n" in (checkout / "CITATION.cff").read_text()


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("pyproject.toml", "9.8.7", "9.8.7.dev0"),
        ("CITATION.cff", "9.8.7", "9.8.6"),
        ("CHANGELOG.md", "[9.8.7] - 2030-01-02", "[9.8.7]"),
    ],
)
def test_a_tag_that_a_file_disagrees_with_is_refused(
    name: str, before: str, after: str, checkout: Path
) -> None:
    path = checkout / name
    path.write_text(path.read_text().replace(before, after, 1))
    was = {each: (checkout / each).read_bytes() for each in FILES}
    code, told = release(checkout, "v9.8.7")
    assert code == 1 and told.startswith(name) and told.count("\n") == 1
    assert was == {each: (checkout / each).read_bytes() for each in FILES}


def read_yaml(path: str) -> Any:
    return pytest.importorskip("yaml").safe_load((ROOT / path).read_text())


def test_the_citation_is_of_the_last_release_and_complete() -> None:
    cited = read_yaml("CITATION.cff")
    last = re.search(r"^## \[(\d[\d.]*)\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert last is not None and (cited["version"], str(cited["date-released"])) == last.groups()
    assert {"cff-version", "message", "title", "authors", "license", "abstract", "references"} <= set(cited)
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert cited["keywords"] == settings["keywords"] and cited["license"] == settings["license"]


def test_the_workflow_publishes_what_was_built_and_tried_without_a_password() -> None:
    text = (ROOT / ".github/workflows/release.yml").read_text()
    workflow = read_yaml(".github/workflows/release.yml")
    jobs = workflow["jobs"]
    assert workflow[True] == {"push": {"tags": ["v*"]}}  # YAML 1.1 reads "on" as a truth value
    assert "secrets." not in text and "password:" not in text
    assert [job.get("needs") for job in jobs.values()] == [None, "build", "try"]
    assert workflow["permissions"] == {"contents": "read"}
    assert [name for name, job in jobs.items() if "id-token" in job.get("permissions", {})] == ["publish"]
    assert jobs["publish"]["environment"]["name"] == "pypi"
    commands = [step.get("run", "") for job in jobs.values() for step in job["steps"]]
    assert any("tools/release.py" in command for command in commands)
    tried = jobs["try"]["strategy"]["matrix"]["python"]
    classifiers = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["classifiers"]
    assert all(f"Programming Language :: Python :: {version}" in classifiers for version in tried)
