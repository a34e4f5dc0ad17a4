"""Print what an extra of pyproject.toml installs, but vig, which would be compiled once more: NAME."""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]


def requirements(extra: str) -> list[str]:
    """The packages of an extra and of those that it names."""
    found = []
    for each in PROJECT["optional-dependencies"][extra]:
        named = re.fullmatch(r"vig\[(.*)\]", each)
        found += sum(map(requirements, named[1].split(",")), []) if named else [each]
    return found


if __name__ == "__main__":
    print("\n".join(requirements(sys.argv[1])))
