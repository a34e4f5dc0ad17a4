"""sheet.jpg of a run."""

from pathlib import Path

import numpy as np
from PIL import Image

from vig_app.report.folder_page import write_thumbnail
from vig_app.report.sheet import PER_SHEET, TILE, write_sheets


def test_sheets_are_in_review_order(tmp_path: Path) -> None:
    """Frames by verdict, in the order of the tiles; two sheets of 200, no stale third."""

    def row(name: str, verdict: str | None, confidence: float | None) -> dict[str, object]:
        error = None if verdict else f"{name}: no\npicture"
        return {"photo": name, "folder": name, "error": error, "verdict": verdict, "confidence": confidence}

    few = [
        row("t.png", "trusted", 0.9), row("a.png", "ambiguous", 0.5), row("l.png", "ambiguous", 0.2),
        row("e\n.png", None, None), row("f.png", "failed", 0.0), row("r.png", "reverted", None),
    ]  # fmt: skip
    for photo in few[:3]:
        (tmp_path / str(photo["folder"])).mkdir()
        write_thumbnail(tmp_path / str(photo["folder"]), np.full((300, 500, 3), 200, np.uint8))
    (tmp_path / "sheet-3.jpg").touch()
    assert write_sheets(tmp_path, few) == [tmp_path / "sheet.jpg"]
    sheet = np.asarray(Image.open(tmp_path / "sheet.jpg")).astype(int)
    frames = [sheet[8 + line, 20 + across] for line in (0, 208) for across in (0, 174, 348)]
    frames = [np.asarray(frame) for frame in frames]
    colours = [(110, 119, 129), (207, 34, 46), (207, 34, 46), (191, 135, 0), (191, 135, 0), (45, 164, 78)]
    assert np.abs(np.array(frames) - colours).max() < 12
    assert np.abs(sheet[10 + 208 + TILE // 2, 10 + TILE // 2] - 200).max() < 5  # the picture of l.png
    many = [row(f"{number}.png", "trusted", 0.9) for number in range(PER_SHEET + 1)]
    assert [path.name for path in write_sheets(tmp_path, many)] == ["sheet.jpg", "sheet-2.jpg"]
    assert not (tmp_path / "sheet-3.jpg").exists()
