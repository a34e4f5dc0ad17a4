"""What a package index is given."""

import tomllib
import zlib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_the_wheel_has_less_than_25_mb() -> None:
    """23.0 MB as measured; the files are compressed as a wheel's are. Assets that code can make stay out."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = settings["tool"]["scikit-build"]["wheel"]["packages"]
    files = [path for package in packages for path in (ROOT / package).rglob("*") if path.is_file()]
    left_out = {"__pycache__", "cmake"}
    sizes = {p: len(zlib.compress(p.read_bytes())) for p in files if left_out.isdisjoint(p.parts)}
    largest = sorted(sizes, key=lambda path: -sizes[path])[:5]
    told = ", ".join(f"{path.relative_to(ROOT)} {sizes[path] / 1e6:.1f} MB" for path in largest)
    assert 1e6 < sum(sizes.values()) < 25e6, told
