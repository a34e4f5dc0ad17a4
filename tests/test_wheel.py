"""What a package index is given."""

import tomllib
import zlib
from pathlib import Path

import pytest

from tests.support import run_vig
from vig_app.cli import common
from vig_app.cli.common import ExitCode
from vig_native import ISA

ROOT = Path(__file__).parents[1]


def test_the_wheel_has_less_than_25_mb() -> None:
    """One for a single instruction set; the files are compressed as a wheel's are."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["scikit-build"]["wheel"]
    packages = settings["packages"]
    files = [path for package in packages for path in (ROOT / package).rglob("*") if path.is_file()]
    excluded = {path for pattern in settings["exclude"] for path in (ROOT / "src").glob(pattern)}

    def is_shipped(path: Path) -> bool:
        if path.suffix == ".so" and not path.name.startswith(f"_{ISA}."):
            return False
        return "__pycache__" not in path.parts and excluded.isdisjoint([path, *path.parents])

    sizes = {path: len(zlib.compress(path.read_bytes())) for path in files if is_shipped(path)}
    largest = sorted(sizes, key=lambda path: -sizes[path])[:5]
    told = ", ".join(f"{path.relative_to(ROOT)} {sizes[path] / 1e6:.1f} MB" for path in largest)
    assert 1e6 < sum(sizes.values()) < 25e6, told


def test_the_papers_package_stays_in_the_clone(capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["scikit-build"]["wheel"][
        "packages"
    ]
    assert sorted(packages) == sorted(
        f"src/{path.name}" for path in (ROOT / "src").iterdir() if path.name != "vig_paper"
    )
    monkeypatch.setattr(common, "find_spec", lambda name: name != "vig_paper" or None)
    assert run_vig("reproduce", "--scale", "tiny") == ExitCode.MISTAKE
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "expected a clone" in said
