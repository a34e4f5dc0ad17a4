"""The prior of being visible, learned from masks."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from vig.likelihood import ROBUST, PixelModel, log_prior_of, visible_map, visible_share
from vig.likelihood.alpha import MAP_PRIOR_COUNT


def masks(count: int = 400) -> tuple[torch.Tensor, torch.Tensor]:
    """Objects everywhere but in the first column; visible 80 % in the upper half, 40 % in the lower."""
    rng = np.random.default_rng(0)
    amodal = torch.ones(count, 8, 6, dtype=torch.bool)
    amodal[:, :, 0] = False
    rate = np.where(np.arange(8) < 4, 0.8, 0.4)[:, None]
    return torch.from_numpy(rng.uniform(size=(count, 8, 6)) < rate) & amodal, amodal


def test_the_share_is_visible_pixels_over_covered_ones() -> None:
    amodal = torch.tensor([[[1, 1, 1, 1]], [[0, 0, 0, 1]]], dtype=torch.bool)
    visible = torch.tensor([[[1, 1, 1, 0]], [[1, 0, 0, 0]]], dtype=torch.bool)  # one pixel beyond its object
    assert visible_share(visible, amodal) == pytest.approx(3 / 5)
    assert visible_share(0.5 * amodal.double(), amodal.double()) == pytest.approx(0.5)


def test_the_map_knows_where_objects_are_hidden() -> None:
    visible, amodal = masks()
    found = visible_map(visible, amodal)
    assert found.shape == (8, 6) and found.dtype == torch.float64
    assert found[:4, 1:].mean().item() == pytest.approx(0.8, abs=0.02)
    assert found[4:, 1:].mean().item() == pytest.approx(0.4, abs=0.02)
    torch.testing.assert_close(found[:, 0], torch.full((8,), visible_share(visible, amodal)).double())
    one = visible_map(torch.ones(1, 1, 2), torch.tensor([[[1.0, 0.0]]]))
    assert one.max() <= 1 and MAP_PRIOR_COUNT > 0


def test_a_flat_map_is_the_pixel_models_prior() -> None:
    torch.testing.assert_close(
        log_prior_of(torch.full((5, 7), 0.55, dtype=torch.float64)), ROBUST.log_prior(5, 7)
    )
    sure = log_prior_of(torch.ones(2, 2))
    torch.testing.assert_close(sure, PixelModel(0.03, 1.0).log_prior(2, 2))
    assert log_prior_of(torch.tensor([[0.25]]))[0, 0].tolist() == pytest.approx(
        [math.log(0.25), math.log(0.75), 0]
    )


def test_misuse_is_refused() -> None:
    with pytest.raises(ValueError, match="cover something"):
        visible_share(torch.zeros(1, 2, 2), torch.zeros(1, 2, 2))
    with pytest.raises(ValueError, match=r"got \(2, 2\) and \(1, 2, 2\)"):
        visible_share(torch.zeros(2, 2), torch.zeros(1, 2, 2))
    for bad in (torch.zeros(2, 2), torch.full((2, 2), 1.5), torch.full((3,), 0.5)):
        with pytest.raises(ValueError, match="map"):
            log_prior_of(bad)
