"""tools/mutations.toml fits the code: a mutation that is not found breaks nothing and shows nothing."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_every_mutation_is_of_a_text_that_occurs_once_and_has_its_tests() -> None:
    stale = []
    for mutation in tomllib.loads((ROOT / "tools/mutations.toml").read_text())["mutation"]:
        path = ROOT / "src" / mutation["file"]
        count = path.read_text().count(mutation["old"]) if path.is_file() else 0
        tests = [word.split("::")[0] for word in mutation["tests"].split() if word.startswith("tests")]
        if count != 1 or not tests or not all((ROOT / name).exists() for name in tests):
            stale.append(f"{mutation['file']}: {mutation['old'][:60]!r} occurs {count} times; {tests}")
    assert not stale, "\n".join(stale)
