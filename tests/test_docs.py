"""The documentation keeps up with the code: links lead somewhere, imports work, names and commands exist."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("src/**/*.md")])
CURRENT = [page for page in PAGES if page.name != "CHANGELOG.md"]
"""Pages whose names are those of the code; a changelog names what is gone, too."""


def each(pages: list[Path]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("page", pages, ids=lambda page: str(page.relative_to(ROOT)))


def python_blocks(text: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def unresolved(name: str) -> bool:
    """Whether a dotted name is neither a module nor what hangs on one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(found, part):
                return True
            found = getattr(found, part)
        return False
    return True


def import_statements(block: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield ast.unparse(node)


@each(PAGES)
def test_links_and_pictures_are_there(page: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text())
    files = [link.partition("#")[0] for link in links if not re.match(r"[a-z]+:|#", link)]
    assert [name for name in files if not (page.parent / name).exists()] == []


@each(CURRENT)
def test_names_of_the_packages_in_code_quotes_exist(page: Path) -> None:
    quoted = re.findall(r"`(vig(?:_world|_lab)?(?:\.\w+)+)[`(]", page.read_text())
    files = {name for name in quoted if name.endswith((".toml", ".md"))} | {"vig.verbs"}
    assert sorted({name for name in quoted if name not in files and unresolved(name)}) == []


@each(CURRENT)
def test_files_and_modules_that_commands_name_exist(page: Path) -> None:
    text = page.read_text()
    modules = re.findall(r"python -m ((?:vig\w*|benchmarks)(?:\.\w+)*)", text)
    files = re.findall(r"\b((?:src|tests|tools|examples|benchmarks)/[\w/.]*\w\.(?:py|png|json))\b", text)
    assert [module for module in modules if find_spec(module.removesuffix(".NAME")) is None] == []
    assert [name for name in files if "NAME" not in name and not (ROOT / name).exists()] == []


@each([page for page in CURRENT if python_blocks(page.read_text())])
def test_code_blocks_import_what_there_is(page: Path) -> None:
    for block in python_blocks(page.read_text()):
        for statement in import_statements(block):
            exec(statement, {})


@pytest.mark.slow
@pytest.mark.parametrize("page", ["README.md", "docs/choosing.md"])
def test_code_blocks_run(page: str, tmp_path: Path) -> None:
    (tmp_path / "src").symlink_to(ROOT / "src")
    for block in python_blocks((ROOT / page).read_text()):
        done = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert done.stdout


@pytest.mark.parametrize("name", ["fit_pose_and_light", "make_examples"])
def test_examples_answer_to_help(name: str, tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "examples" / f"{name}.py"), "--help"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "usage" in done.stdout


def test_what_a_package_index_shows_needs_no_other_file() -> None:
    """The long description has no relative link or picture, which a package index cannot show."""
    text = (ROOT / "docs" / "package.md").read_text()
    assert 'readme = "docs/package.md"' in (ROOT / "pyproject.toml").read_text()
    assert re.findall(r"\]\(", text) == []
