"""What a package index is given."""

import tomllib
import zlib
from pathlib import Path

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
