from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.io.errors import UserError
from vig_world.dataset import Dataset
from vig_world.generation.show import CAPTION, MARGIN, SCALE, chosen, contact_sheet, histograms

SIDE = round(SCALE * 150)


def test_samples_are_chosen_evenly_from_seen_to_hidden() -> None:
    occlusion = np.linspace(0, 0.9, 91)[::-1]
    indices = chosen(occlusion, 10)
    np.testing.assert_allclose(occlusion[indices], np.linspace(0, 0.9, 10), atol=1e-9)
    assert sorted(chosen(occlusion, 1000)) == list(range(91))


@pytest.mark.parametrize("tint", [True, False])
def test_the_sheet_holds_the_samples_side_by_side(tint: bool, dataset: Dataset, tmp_path: Path) -> None:
    sheet = np.asarray(Image.open(contact_sheet(dataset, tmp_path / "sheet.png", 9, tint)))
    assert sheet.shape == (MARGIN + 2 * (SIDE + CAPTION), MARGIN + 8 * (SIDE + MARGIN), 3)
    ninth = chosen(dataset.occlusion, 9)[8]
    shown = sheet[MARGIN + SIDE + CAPTION :, MARGIN:][:SIDE, :SIDE].astype(float)
    photo = Image.fromarray(dataset.images[ninth]).resize((SIDE, SIDE), Image.Resampling.LANCZOS)
    hidden = dataset.amodal[ninth] & ~dataset.visible[ninth]
    changed = np.abs(shown - np.asarray(photo)).sum() / hidden.sum()
    assert changed > 50 if tint else changed == 0


def test_a_sheet_of_nothing_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="count must be at least 1"):
        contact_sheet(dataset, tmp_path / "sheet.png", 0)


def test_histograms_are_a_picture_of_six_panels(made: Path, tmp_path: Path) -> None:
    drawn = Image.open(histograms(made, "train", tmp_path / "histograms.png"))
    assert drawn.size == (1320, 726)
    halves = np.asarray(drawn.convert("L")).reshape(2, 363, 3, 440)
    assert (halves < 128).mean(axis=(1, 3)).min() > 0.005  # ink in each
