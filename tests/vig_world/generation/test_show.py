from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFilter

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.dataset import Dataset
from vig_world.generation.keypoints import keypoints
from vig_world.generation.show import CAPTION, MARGIN, TILE, choose_samples, contact_sheet, histograms

SIDE = TILE[0]


def test_samples_are_chosen_evenly_from_seen_to_hidden() -> None:
    occlusion = np.linspace(0, 0.9, 91)[::-1]
    indices = choose_samples(occlusion, 10)
    np.testing.assert_allclose(occlusion[indices], np.linspace(0, 0.9, 10), atol=1e-9)
    assert sorted(choose_samples(occlusion, 1000)) == list(range(91))


@pytest.mark.parametrize("labels", [True, False])
def test_the_sheet_holds_the_samples_side_by_side(labels: bool, dataset: Dataset, tmp_path: Path) -> None:
    sheet = np.asarray(Image.open(contact_sheet(dataset, tmp_path / "sheet.png", 9, labels)))
    assert sheet.shape == (MARGIN + 2 * (SIDE + CAPTION), MARGIN + 8 * (SIDE + MARGIN), 3)
    ninth = choose_samples(dataset.occlusion, 9)[8]
    shown = sheet[MARGIN + SIDE + CAPTION :, MARGIN:][:SIDE, :SIDE].astype(float)
    photo = Image.fromarray(dataset.images[ninth]).resize((SIDE, SIDE), Image.Resampling.LANCZOS)
    hidden = dataset.amodal[ninth] & ~dataset.visible[ninth]
    changed = np.abs(shown - np.asarray(photo)).sum() / hidden.sum()
    assert changed > 50 if labels else changed == 0


def test_labels_lie_where_the_object_is(dataset: Dataset, teapot: ObjectClass, tmp_path: Path) -> None:
    """Against the sheet without them: the outline is round the mask, a dot on each point that is seen."""
    path = tmp_path / "sheet.png"
    sheets = [
        np.asarray(Image.open(contact_sheet(dataset, path, 1, labels, points))).astype(int)
        for labels, points in ((False, None), (True, None), (True, teapot))
    ]
    plain, outlined, full = (sheet[MARGIN:, MARGIN:][:SIDE, :SIDE] for sheet in sheets)
    first = int(choose_samples(dataset.occlusion, 1)[0])
    mask = Image.fromarray(dataset.visible[first]).resize((SIDE, SIDE), Image.Resampling.BILINEAR)
    seen = np.asarray(mask)
    near = np.asarray(Image.fromarray(seen).filter(ImageFilter.MaxFilter(9)))
    rows, columns = np.nonzero(seen)
    changed = (plain != outlined).any(-1)
    box = np.zeros_like(seen)
    box[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
    whole = dataset.amodal[first] & ~dataset.visible[first]
    hidden = np.asarray(Image.fromarray(whole).filter(ImageFilter.MaxFilter(5)).resize((SIDE, SIDE)))
    assert changed[near & ~seen & ~box].any() and not changed[~near & ~box & ~hidden].any()
    located = next(keypoints(dataset, teapot, [first]))
    for (x, y), visibility in zip(located.place * SIDE / 150, located.seen, strict=True):
        if visibility:
            assert (
                (full != outlined)
                .any(-1)[max(int(y) - 3, 0) : int(y) + 4, max(int(x) - 3, 0) : int(x) + 4]
                .any()
            )


def test_a_sheet_of_nothing_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="count must be at least 1"):
        contact_sheet(dataset, tmp_path / "sheet.png", 0)


def test_histograms_are_a_picture_of_six_panels(made: Path, tmp_path: Path) -> None:
    drawn = Image.open(histograms(made, "train", tmp_path / "histograms.png"))
    assert drawn.size == (1320, 726)
    halves = np.asarray(drawn.convert("L")).reshape(2, 363, 3, 440)
    assert (halves < 128).mean(axis=(1, 3)).min() > 0.005  # ink in each
