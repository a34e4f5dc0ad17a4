"""examples/vig.ipynb runs from top to bottom, and shows what it says."""

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

NOTEBOOK = Path(__file__).parents[1] / "examples" / "vig.ipynb"
CELLS = json.loads(NOTEBOOK.read_text())["cells"]
CODE = ["".join(cell["source"]) for cell in CELLS if cell["cell_type"] == "code"]


def shown(source: str, names: dict[str, Any]) -> Any:
    """Run a cell's code; returns the value of its last expression, which a notebook shows."""
    lines = [line for line in source.splitlines() if not line.startswith("%")]
    statements = ast.parse("\n".join(lines)).body
    last = statements.pop() if statements and isinstance(statements[-1], ast.Expr) else None
    exec(compile(ast.Module(statements, []), NOTEBOOK.name, "exec"), names)
    if isinstance(last, ast.Expr):
        return eval(compile(ast.Expression(last.value), NOTEBOOK.name, "eval"), names)
    return None


def test_it_is_stored_without_results_and_installs_vig_first() -> None:
    assert all(cell["outputs"] == [] for cell in CELLS if cell["cell_type"] == "code")
    assert CODE[0].splitlines()[-1] == "%pip install --quiet .."
    assert not any("%" in line[:1] for source in CODE[1:] for line in source.splitlines())


@pytest.mark.slow
def test_it_runs_from_top_to_bottom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    pictures = [value for source in CODE if isinstance(value := shown(source, names), Image.Image)]
    printed = capsys.readouterr().out
    assert "explanation.json" in printed and (tmp_path / "result" / "report.html").exists()
    assert names["off"] < 10 and names["iou"] > 0.9  # 5.6 degrees and 0.95
    assert len(pictures) == 5 and all(np.asarray(picture).std() > 5 for picture in pictures)
    # Light from the left makes the left half brighter than light from above does.
    left, above, red = np.split(np.asarray(pictures[-1]).astype(float), 3, axis=1)
    half = left.shape[1] // 2
    assert left[:, :half].mean() - above[:, :half].mean() > left[:, half:].mean() - above[:, half:].mean()
    assert (red[..., 0] - red[..., 1]).max() > 60
