"""What a release needs before it is built: a version that all files agree on, and the project's links.

`python tools/release.py v0.3.0 https://github.com/OWNER/vig` refuses a tag that is not the version of
pyproject.toml, of CITATION.cff and of a section of CHANGELOG.md. It then adds the links of the repository to
pyproject.toml and CITATION.cff, and makes pictures and links of README.md, the package's description, full
addresses of that tag: relative ones lead nowhere on a package index. The checkout is built and thrown away.
"""

import argparse
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"(!?)(\[[^\]]*\])\((?![a-z]+:|#)([^)\s]+)\)")
"""A relative link of Markdown, or a picture."""


def faults(root: Path, version: str) -> list[str]:
    """Where files disagree with a version, a line each."""
    found = []
    declared = re.search(r'^version = "(.*)"$', (root / "pyproject.toml").read_text(), re.MULTILINE)
    if declared is None or declared[1] != version:
        found.append(f"pyproject.toml has the version {declared and declared[1]}, not {version}")
    cited = re.search(r"^version: (.*)$", (root / "CITATION.cff").read_text(), re.MULTILINE)
    if cited is None or cited[1] != version:
        found.append(f"CITATION.cff has the version {cited and cited[1]}, not {version}")
    if not re.search(rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d$", changes(root), re.MULTILINE):
        found.append(f"CHANGELOG.md has no section of {version} with its date")
    return found


def changes(root: Path) -> str:
    """The changelog."""
    return (root / "CHANGELOG.md").read_text()


def write_links(root: Path, tag: str, repository: str) -> None:
    """Put the links of a repository into the files of which the package's page is made."""
    tree = f"{repository}/blob/{tag}"
    description = root / "README.md"

    def full(link: re.Match[str]) -> str:
        kind = "raw" if link[1] else "blob"
        return f"{link[1]}{link[2]}({repository}/{kind}/{tag}/{link[3]})"

    description.write_text(LINK.sub(full, description.read_text()))
    project = root / "pyproject.toml"
    urls = {
        "Homepage": repository,
        "Documentation": f"{tree}/docs/index.md",
        "Changelog": f"{tree}/CHANGELOG.md",
        "Issues": f"{repository}/issues",
    }
    lines = "\n".join(f'{name} = "{url}"' for name, url in urls.items())
    settings = project.read_text().replace(
        "[project.scripts]", f"[project.urls]\n{lines}\n\n[project.scripts]", 1
    )
    project.write_text(settings)
    citation = root / "CITATION.cff"
    citation.write_text(
        citation.read_text().replace("license:", f"repository-code: {repository}\nlicense:", 1)
    )


def main() -> None:
    """Check and write; exits 1 where files disagree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tag", help="such as v0.3.0")
    parser.add_argument("repository", help="its address")
    parser.add_argument("--root", type=Path, default=ROOT, help="of the checkout")
    chosen = parser.parse_args()
    found = faults(chosen.root, chosen.tag.removeprefix("v"))
    if found:
        sys.exit("\n".join(found))
    write_links(chosen.root, chosen.tag, chosen.repository.rstrip("/"))


if __name__ == "__main__":
    main()
