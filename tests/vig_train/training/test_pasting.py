"""Cut-outs hide what they cover, no more than they may, and nothing else changes."""

import numpy as np
import pytest
import torch

from vig_train.training.pasting import MARGIN, MAX_HIDDEN, SIDE, CutoutLibrary, _beside


@pytest.fixture
def library() -> CutoutLibrary:
    """Red discs and blue squares."""
    place = torch.arange(SIDE) - (SIDE - 1) / 2
    disc = place.square()[:, None] + place.square() < (SIDE / 2 - MARGIN) ** 2
    square = (place.abs()[:, None] < SIDE / 2 - MARGIN) & (place.abs() < SIDE / 2 - MARGIN)
    rgba = torch.zeros(2, 4, SIDE, SIDE, dtype=torch.uint8)
    rgba[0, 0], rgba[0, 3], rgba[1, 2], rgba[1, 3] = 255, 255 * disc, 255, 255 * square
    return CutoutLibrary(rgba)


def scene(count: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Grey pictures, their object a rectangle to the left of the middle."""
    masks = torch.zeros(count, 2, 150, 150)
    masks[:, 0, 50:110, 20:90] = 1
    return torch.full((count, 3, 150, 150), 0.5), masks


def test_what_is_pasted_over_the_object_is_hidden(library: CutoutLibrary) -> None:
    images, masks = scene(64)
    pasted, changed = library.paste(images, masks, 1.0, np.random.default_rng(3))
    torch.testing.assert_close(changed.sum(1), masks.sum(1))
    hidden = changed[:, 1].sum((1, 2)) / masks[:, 0].sum((1, 2))
    assert hidden.max() <= MAX_HIDDEN and (hidden > 0.2).float().mean() > 0.4
    coloured = (pasted.amax(1) - pasted.amin(1)) > 0.1  # neither grey nor shadow
    strange = coloured & (masks[:, 0] > 0)
    assert (changed[:, 1][strange] > 0.5).float().mean() > 0.95
    assert not coloured[(changed[:, 1] < 0.01) & (masks[:, 0] > 0)].any()


def test_only_the_share_asked_for_changes(library: CutoutLibrary) -> None:
    images, masks = scene(400)
    pasted, _ = library.paste(images, masks, 0.5, np.random.default_rng(0))
    share = (pasted != images).flatten(1).any(1).float().mean()
    assert 0.4 < share < 0.6
    untouched, same = library.paste(images, masks, 0.0, np.random.default_rng(0))
    assert torch.equal(untouched, images) and torch.equal(same, masks)


def test_pictures_without_the_object_get_things_too(library: CutoutLibrary) -> None:
    images = torch.full((40, 3, 150, 150), 0.5)
    nothing = torch.zeros(40, 2, 150, 150)
    pasted, masks = library.paste(images, nothing, 1.0, np.random.default_rng(1))
    assert (pasted != images).flatten(1).any(1).float().mean() > 0.9 and not masks.any()


def test_a_shadow_stays_beside_what_casts_it() -> None:
    cover = torch.zeros(1, 1, 60, 60)
    cover[..., 40:, 40:] = 1
    dark = _beside(cover)
    assert dark[..., 50, 50] == 1 and dark[..., 37:40, 45].min() > 0
    assert not dark[..., :30, :].any() and not dark[..., :, :30].any()


def test_a_library_holds_things_of_the_split() -> None:
    drawn, others = (CutoutLibrary.draw(0, split, "teapot", None, 100).rgba for split in ("train", "test"))
    of_train, of_test = ({each.numpy().tobytes() for each in rgba} for rgba in (drawn, others))
    assert not of_train & of_test
    covered = drawn[:, 3] > 127
    assert len(drawn.flatten(1).float().mean(1).unique()) > 80  # many a thing
    assert covered.any((1, 2)).all() and not covered[:, :MARGIN].any() and not covered[:, :, :MARGIN].any()
