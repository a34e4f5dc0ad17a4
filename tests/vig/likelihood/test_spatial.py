"""Neighbours that agree: exact on images small enough to try every mask, and what each term is for."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
import scipy
import torch

from tests.tensors import wrap
from vig.likelihood import NEVER, SPATIAL, SpatialMask, mixture, spatial_posterior
from vig.likelihood.spatial import NEIGHBOURS, graph_cut, links, mean_field, messages, visible_log_odds

mixture, spatial_posterior, graph_cut, links, mean_field, messages, visible_log_odds = map(
    wrap, (mixture, spatial_posterior, graph_cut, links, mean_field, messages, visible_log_odds)
)
SPATIAL = wrap(SPATIAL)


def model(**settings: Any) -> SpatialMask:
    return SpatialMask(**settings)


def scene(seed: int, height: int, width: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Random colours (1, H, W, 3), log odds and coverage, about three pixels in four."""
    rng = np.random.default_rng(seed)
    photo = torch.from_numpy(rng.uniform(0.2, 0.4, (1, height, width, 3)))
    log_odds = torch.from_numpy(rng.normal(0, 2, (1, height, width)))
    return photo, log_odds, torch.from_numpy(rng.uniform(size=(1, height, width)) < 0.75)


def tied(photo: torch.Tensor, covered: torch.Tensor, given: SpatialMask) -> torch.Tensor:
    return links(photo, covered, torch.ones_like(covered), given)


def log_posterior(h: np.ndarray, log_odds: torch.Tensor, weights: torch.Tensor) -> float:
    """The module's first equation up to its constant, pair by pair. h (H, W) with 0 beyond the silhouette."""
    total = float((log_odds[0].numpy() * h).sum())
    for index, (down, right) in enumerate(NEIGHBOURS):
        for y, x in itertools.product(range(h.shape[0]), range(h.shape[1])):
            if 0 <= y + down < h.shape[0] and 0 <= x + right < h.shape[1]:
                total -= float(weights[0, index, y, x]) * (h[y, x] != h[y + down, x + right])
    return total


def every_mask(covered: torch.Tensor) -> list[np.ndarray]:
    inside = covered[0].numpy()
    masks = []
    for values in itertools.product((0, 1), repeat=int(inside.sum())):
        h = np.zeros(inside.shape, int)
        h[inside] = values
        masks.append(h)
    return masks


@pytest.mark.parametrize("seed", range(6))
def test_the_cut_is_the_most_probable_of_all_masks(seed: int) -> None:
    photo, log_odds, covered = scene(seed, 3, 4)
    weights = tied(photo, covered, model(coupling=1.5, rim=0.7, contrast=0.2))
    best = max(log_posterior(h, log_odds, weights) for h in every_mask(covered))
    cut = graph_cut(log_odds, covered, weights)
    assert not (cut & ~covered).any()
    # The capacities are whole thousandths of a nat: a mask within as many thousandths as there are terms.
    assert log_posterior(cut[0].numpy().astype(int), log_odds, weights) == pytest.approx(best, abs=0.05)


def scipys_cut(log_odds: torch.Tensor, covered: torch.Tensor, weights: torch.Tensor) -> np.ndarray:
    """The same by the maximum flow of a sparse graph, of one image."""
    inside = covered[0].numpy()
    height, width = inside.shape
    # What is beyond the silhouette is hidden: its links add to what a pixel says by itself.
    alone = log_odds + messages(torch.full_like(log_odds, 0.5), covered, weights)
    own = np.rint(1000 * alone[0].double().numpy()).astype(np.int32)
    source, sink = height * width, height * width + 1
    edges = {(source, p): c for p, c in enumerate(own.clip(0).ravel()) if inside.ravel()[p]}
    edges |= {(p, sink): c for p, c in enumerate((-own).clip(0).ravel()) if inside.ravel()[p]}
    for (down, right), weight in zip(NEIGHBOURS, weights[0].double().numpy(), strict=True):
        for y, x in itertools.product(range(height - down), range(max(0, -right), width - max(0, right))):
            if inside[y, x] and inside[y + down, x + right]:
                one, other = y * width + x, (y + down) * width + x + right
                edges[one, other] = edges[other, one] = np.rint(1000 * weight[y, x])
    capacities = np.array([*edges.values()], np.int32)
    graph = scipy.sparse.csr_array((capacities, tuple(np.array([*edges]).T)), shape=(sink + 1, sink + 1))
    residual = graph - scipy.sparse.csgraph.maximum_flow(graph, source, sink).flow
    residual.eliminate_zeros()
    reached = scipy.sparse.csgraph.breadth_first_order(residual, source, return_predecessors=False)
    visible = np.zeros(sink + 1, bool)
    visible[reached] = True
    return visible[:source].reshape(height, width)


@pytest.mark.parametrize("seed", range(4))
def test_the_cut_of_a_larger_image_is_that_of_scipys_maximum_flow(seed: int) -> None:
    photo, log_odds, covered = scene(seed, 40, 30)
    weights = tied(photo, covered, model(coupling=1.0, rim=0.2, contrast=0.1))
    cut = graph_cut(log_odds, covered, weights)[0].numpy()
    assert np.array_equal(cut, scipys_cut(log_odds, covered, weights))
    assert 0.1 < cut.mean() < 0.9


@pytest.mark.parametrize("seed", range(3))
def test_mean_field_solves_its_equation_and_nears_the_marginals(seed: int) -> None:
    photo, log_odds, covered = scene(seed, 3, 4)
    weights = tied(photo, covered, model(coupling=0.4, rim=0.3, contrast=0.2))
    q = mean_field(log_odds.sigmoid(), log_odds, covered, weights, 100)
    fixed = (log_odds + messages(q, covered, weights)).sigmoid()
    torch.testing.assert_close(q[covered], fixed[covered])
    assert not q[~covered].any()
    masks = np.stack(every_mask(covered))
    weight = np.exp([log_posterior(h, log_odds, weights) for h in masks])
    exact = (weight[:, None, None] * masks).sum(0) / weight.sum()
    alone = log_odds.sigmoid()[0].numpy() * covered[0].numpy()
    assert np.abs(q[0].numpy() - exact).max() < 0.5 * np.abs(alone - exact).max()


def test_a_message_is_the_sum_over_eight_neighbours() -> None:
    """In a flat photo straight neighbours weigh `coupling` each, diagonal ones that over sqrt(2)."""
    covered = torch.ones(1, 5, 5, dtype=torch.bool)
    weights = tied(torch.full((1, 5, 5, 3), 0.3), covered, model(coupling=2.0))
    everywhere = messages(torch.ones(1, 5, 5), covered, weights)[0]
    assert everywhere[2, 2].item() == pytest.approx(4 * 2 + 4 * 2 / math.sqrt(2))
    assert everywhere[0, 0].item() == pytest.approx(2 * 2 + 2 / math.sqrt(2))
    assert messages(torch.full((1, 5, 5), 0.5), covered, weights).abs().max() == 0


def test_an_edge_of_the_photo_weakens_what_crosses_it() -> None:
    photo = torch.full((1, 1, 3, 3), 0.5)
    photo[:, :, 2] = 0.2
    weights = tied(photo, torch.ones(1, 1, 3, dtype=torch.bool), model(coupling=2.0, contrast=0.1))
    assert weights[0, 0, 0, 0].item() == pytest.approx(2.0)
    assert 0 < weights[0, 0, 0, 1].item() < 0.01
    assert weights[0, 0, 0, 2] == 0


def test_the_rim_ties_pixels_to_what_is_beyond_and_unknown_ones_tie_nothing() -> None:
    photo = torch.full((1, 1, 4, 3), 0.5)
    covered = torch.tensor([[[True, True, False, False]]])
    weights = tied(photo, covered, model(coupling=3.0, rim=0.5))
    assert weights[0, 0, 0].tolist() == pytest.approx([3.0, 0.5, 0.0, 0.0])
    assert messages(torch.ones(1, 1, 4), covered, weights)[0, 0].tolist()[:2] == pytest.approx([3.0, 2.5])
    known = torch.tensor([[[True, False, True, True]]])
    assert not links(photo, covered, known, model()).any()


def test_log_odds_are_a_ratio_of_densities_of_linear_colour() -> None:
    """Its visible part integrates to 1 over linear colours, so that it compares with the hidden density."""
    rendered = torch.tensor([0.3, 0.3, 0.3], dtype=torch.float64)
    count = 120
    axis = torch.from_numpy(np.linspace(0, 1, count + 1)[:-1] + 0.5 / count)
    grid = torch.cartesian_prod(axis, axis, axis)
    prior = torch.zeros(len(grid), 3, dtype=torch.float64)
    # The narrow Gaussians fall between the grid's colours, the widest reaches beyond sRGB's cube.
    scales = (0.03, 0.1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vig.likelihood.spatial.RESIDUAL_SCALES", scales)
        density = visible_log_odds(grid, rendered.expand(grid.shape), prior).exp()
    assert density.mean().item() == pytest.approx(1.0, abs=0.02)


def blob() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """A disc half hidden by another colour, and a fit with specks: photo, fit, prior, disc, truth.

    On its specks the fit has the occluder's colour where the disc is hidden, and a wrong one elsewhere.
    """
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:60, :60]
    disc = torch.from_numpy((x - 30) ** 2 + (y - 30) ** 2 < 20**2)
    hidden = torch.from_numpy(x < 26)
    occluder = torch.tensor([0.9, 0.1, 0.05])
    photo = torch.where((disc & ~hidden)[..., None], 0.4, occluder)
    photo = photo + torch.from_numpy(rng.normal(0, 0.01, photo.shape)).float()
    specks = torch.from_numpy(rng.uniform(size=(60, 60)) < 0.1)
    wrong = torch.where(hidden[..., None], occluder, torch.tensor([0.9, 0.9, 0.4]))
    fit = torch.where(specks[..., None], wrong, 0.4)
    prior = SPATIAL.log_prior(60, 60).float()
    return photo[None], fit[None], prior[None], disc[None], (disc & ~hidden)[None]


def test_pixels_go_with_neighbours_of_their_colour() -> None:
    photo, fit, prior, disc, truth = blob()
    alone = torch.where(disc, mixture(photo, fit, prior, 0.1)[1], 0.0) > 0.5
    visible = spatial_posterior(photo, fit, prior, disc, SPATIAL.mask)
    assert visible.shape == (1, 60, 60) and visible.dtype == torch.float32
    assert ((visible >= 0) & (visible <= 1)).all() and not visible[~disc].any()

    def iou(mask: torch.Tensor) -> float:
        return float((mask & truth).sum() / (mask | truth).sum())

    assert iou(alone) < 0.93 and iou(visible > 0.5) > 0.98
    quick = spatial_posterior(photo, fit, prior, disc, model(exact_start=False))
    assert iou(alone) < iou(quick > 0.5) and not torch.equal(quick, visible)


def test_without_coupling_each_pixel_stands_by_itself() -> None:
    photo, fit, prior, disc, _ = blob()
    visible = spatial_posterior(photo, fit, prior, disc, model(coupling=0.0, rim=0.0, sweeps=20))
    expected = torch.where(disc, visible_log_odds(photo, fit, prior).sigmoid(), 0.0)
    torch.testing.assert_close(visible, expected, atol=1e-5, rtol=0)


def test_a_batch_is_its_images_one_by_one() -> None:
    photo, fit, prior, disc, _ = blob()
    moved = disc.roll(9, 2)
    both = spatial_posterior(
        *(torch.cat([x, x]) for x in (photo, fit, prior)), torch.cat([disc, moved]), SPATIAL.mask
    )
    for index, covered in enumerate((disc, moved)):
        torch.testing.assert_close(
            both[index], spatial_posterior(photo, fit, prior, covered, SPATIAL.mask)[0]
        )


def test_nothing_covered_and_nothing_known() -> None:
    photo, fit, prior, disc, _ = blob()
    assert not spatial_posterior(photo, fit, prior, torch.zeros_like(disc), SPATIAL.mask).any()
    unknown = prior.clone()
    unknown[:, :, 30:] = torch.tensor([NEVER, 0.0, 0.0])
    visible = spatial_posterior(photo, fit, unknown, disc, SPATIAL.mask)
    assert torch.isfinite(visible).all() and not visible[:, :, 30:].any()
    other = photo.clone()
    other[:, :, 30:] = 0.9
    assert torch.equal(spatial_posterior(other, fit, unknown, disc, SPATIAL.mask), visible)


@pytest.mark.parametrize(
    "settings", [{"coupling": -1.0}, {"rim": -0.1}, {"contrast": 0.0}, {"sweeps": 0}, {"coupling": math.nan}]
)
def test_settings_out_of_range_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must be"):
        model(**settings)
