"""Neighbours that agree: exact on images small enough to try every mask, and what each term is for."""

import itertools
import math

import numpy as np
import pytest
import scipy

from tests.support import assert_close
from tests.vig.likelihood.mixture import mixture
from vig.likelihood import NEVER, SPATIAL, SpatialMask, spatial_posterior
from vig.likelihood.spatial import NEIGHBOURS, graph_cut, links, mean_field, messages, visible_log_odds
from vig.scene.functions import sigmoid


def scene(seed: int, height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random colours (1, H, W, 3), log odds and coverage, about three pixels in four."""
    rng = np.random.default_rng(seed)
    photo = rng.uniform(0.2, 0.4, (1, height, width, 3))
    log_odds = rng.normal(0, 2, (1, height, width))
    return photo, log_odds, rng.uniform(size=(1, height, width)) < 0.75


def tied(photo: np.ndarray, covered: np.ndarray, given: SpatialMask) -> np.ndarray:
    return links(photo, covered, np.ones_like(covered), given)


def log_posterior(h: np.ndarray, log_odds: np.ndarray, weights: np.ndarray) -> float:
    """The module's first equation up to its constant, pair by pair. h (H, W) with 0 beyond the silhouette."""
    total = (log_odds[0] * h).sum()
    for index, (down, right) in enumerate(NEIGHBOURS):
        for y, x in itertools.product(range(h.shape[0]), range(h.shape[1])):
            if 0 <= y + down < h.shape[0] and 0 <= x + right < h.shape[1]:
                total -= weights[0, index, y, x] * (h[y, x] != h[y + down, x + right])
    return total


def every_mask(covered: np.ndarray) -> list[np.ndarray]:
    inside = covered[0]
    masks = []
    for values in itertools.product((0, 1), repeat=int(inside.sum())):
        h = np.zeros(inside.shape, int)
        h[inside] = values
        masks.append(h)
    return masks


@pytest.mark.parametrize("seed", range(3))
def test_the_cut_is_the_most_probable_of_all_masks(seed: int) -> None:
    photo, log_odds, covered = scene(seed, 3, 4)
    weights = tied(photo, covered, SpatialMask(coupling=1.5, rim=0.7, contrast=0.2))
    best = max(log_posterior(h, log_odds, weights) for h in every_mask(covered))
    cut = graph_cut(log_odds, covered, weights)
    assert not (cut & ~covered).any()
    # The capacities are whole thousandths of a nat: a mask within as many thousandths as there are terms.
    assert log_posterior(cut[0].astype(int), log_odds, weights) == pytest.approx(best, abs=0.05)


def scipys_cut(log_odds: np.ndarray, covered: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The same by the maximum flow of a sparse graph, of one image."""
    inside = covered[0]
    height, width = inside.shape
    # What is beyond the silhouette is hidden: its links add to what a pixel says by itself.
    alone = log_odds + messages(np.full_like(log_odds, 0.5), covered, weights)
    own = np.rint(1000 * alone[0]).astype(np.int32)
    source, sink = height * width, height * width + 1
    edges = {(source, p): c for p, c in enumerate(own.clip(0).ravel()) if inside.ravel()[p]}
    edges |= {(p, sink): c for p, c in enumerate((-own).clip(0).ravel()) if inside.ravel()[p]}
    for (down, right), weight in zip(NEIGHBOURS, weights[0], strict=True):
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


@pytest.mark.parametrize("seed", range(2))
def test_the_cut_of_a_larger_image_is_that_of_scipys_maximum_flow(seed: int) -> None:
    photo, log_odds, covered = scene(seed, 40, 30)
    weights = tied(photo, covered, SpatialMask(coupling=1.0, rim=0.2, contrast=0.1))
    cut = graph_cut(log_odds, covered, weights)[0]
    assert np.array_equal(cut, scipys_cut(log_odds, covered, weights))
    assert 0.1 < cut.mean() < 0.9


@pytest.mark.parametrize("seed", range(2))
def test_mean_field_solves_its_equation_and_nears_the_marginals(seed: int) -> None:
    photo, log_odds, covered = scene(seed, 3, 4)
    weights = tied(photo, covered, SpatialMask(coupling=0.4, rim=0.3, contrast=0.2))
    q = mean_field(sigmoid(log_odds), log_odds, covered, weights, 100)
    fixed = sigmoid(log_odds + messages(q, covered, weights))
    assert_close(q[covered], fixed[covered])
    assert not q[~covered].any()
    masks = np.stack(every_mask(covered))
    weight = np.exp([log_posterior(h, log_odds, weights) for h in masks])
    exact = (weight[:, None, None] * masks).sum(0) / weight.sum()
    alone = sigmoid(log_odds)[0] * covered[0]
    assert np.abs(q[0] - exact).max() < 0.5 * np.abs(alone - exact).max()


def test_a_message_is_the_sum_over_eight_neighbours() -> None:
    """In a flat photo straight neighbours weigh `coupling` each, diagonal ones that over sqrt(2)."""
    covered = np.ones((1, 5, 5), bool)
    weights = tied(np.full((1, 5, 5, 3), 0.3, np.float32), covered, SpatialMask(coupling=2.0))
    everywhere = messages(np.ones((1, 5, 5), np.float32), covered, weights)[0]
    assert everywhere[2, 2] == pytest.approx(4 * 2 + 4 * 2 / math.sqrt(2))
    assert everywhere[0, 0] == pytest.approx(2 * 2 + 2 / math.sqrt(2))
    assert np.abs(messages(np.full((1, 5, 5), 0.5, np.float32), covered, weights)).max() == 0


def test_an_edge_of_the_photo_weakens_what_crosses_it() -> None:
    photo = np.full((1, 1, 3, 3), 0.5, np.float32)
    photo[:, :, 2] = 0.2
    weights = tied(photo, np.ones((1, 1, 3), bool), SpatialMask(coupling=2.0, contrast=0.1))
    assert weights[0, 0, 0, 0] == pytest.approx(2.0)
    assert 0 < weights[0, 0, 0, 1] < 0.01
    assert weights[0, 0, 0, 2] == 0


def test_the_rim_ties_pixels_to_what_is_beyond_and_unknown_ones_tie_nothing() -> None:
    photo = np.full((1, 1, 4, 3), 0.5, np.float32)
    covered = np.array([[[True, True, False, False]]])
    weights = tied(photo, covered, SpatialMask(coupling=3.0, rim=0.5))
    assert weights[0, 0, 0].tolist() == pytest.approx([3.0, 0.5, 0.0, 0.0])
    everywhere = messages(np.ones((1, 1, 4), np.float32), covered, weights)[0, 0]
    assert everywhere[:2].tolist() == pytest.approx([3.0, 2.5])
    known = np.array([[[True, False, True, True]]])
    assert not links(photo, covered, known, SpatialMask()).any()


def test_log_odds_are_a_ratio_of_densities_of_linear_colour() -> None:
    """Its visible part integrates to 1 over linear colours, so that it compares with the hidden density."""
    grid = (np.indices((60, 60, 60)).reshape(3, -1).T + 0.5) / 60
    # The narrow Gaussians fall between the grid's colours, the widest reaches beyond sRGB's cube.
    scales = (0.03, 0.1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vig.likelihood.spatial.RESIDUAL_SCALES", scales)
        density = np.exp(visible_log_odds(grid, np.full(3, 0.3), np.zeros(3)))
    assert density.mean() == pytest.approx(1.0, abs=0.02)


def blob() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A disc half hidden by another colour, and a fit with specks: photo, fit, prior, disc, truth.

    On its specks the fit has the occluder's colour where the disc is hidden, and a wrong one elsewhere.
    """
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:60, :60]
    disc = (x - 30) ** 2 + (y - 30) ** 2 < 20**2
    hidden = x < 26
    occluder = np.float32([0.9, 0.1, 0.05])
    photo = np.where((disc & ~hidden)[..., None], 0.4, occluder)
    photo = photo + rng.normal(0, 0.01, photo.shape).astype(np.float32)
    specks = rng.uniform(size=(60, 60)) < 0.1
    wrong = np.where(hidden[..., None], occluder, np.float32([0.9, 0.9, 0.4]))
    fit = np.where(specks[..., None], wrong, 0.4)
    prior = SPATIAL.log_prior(60, 60).astype(np.float32)
    return photo[None], fit[None], prior[None], disc[None], (disc & ~hidden)[None]


def test_pixels_go_with_neighbours_of_their_colour() -> None:
    photo, fit, prior, disc, truth = blob()
    alone = np.where(disc, mixture(photo, fit, prior, 0.1)[1], 0.0) > 0.5
    visible = spatial_posterior(photo, fit, prior, disc, SPATIAL.mask)
    assert visible.shape == (1, 60, 60) and visible.dtype == np.float32
    assert ((visible >= 0) & (visible <= 1)).all() and not visible[~disc].any()

    def iou(mask: np.ndarray) -> float:
        return (mask & truth).sum() / (mask | truth).sum()

    assert iou(alone) < 0.93 and iou(visible > 0.5) > 0.98
    quick = spatial_posterior(photo, fit, prior, disc, SpatialMask(exact_start=False))
    assert iou(alone) < iou(quick > 0.5) and not np.array_equal(quick, visible)


def test_without_coupling_each_pixel_stands_by_itself() -> None:
    photo, fit, prior, disc, _ = blob()
    visible = spatial_posterior(photo, fit, prior, disc, SpatialMask(coupling=0.0, rim=0.0, sweeps=20))
    expected = np.where(disc, sigmoid(visible_log_odds(photo, fit, prior)), 0.0)
    assert_close(visible, expected, atol=1e-5, rtol=0)


def test_a_batch_is_its_images_one_by_one() -> None:
    photo, fit, prior, disc, _ = blob()
    moved = np.roll(disc, 9, 2)
    both = spatial_posterior(
        *(np.concatenate([x, x]) for x in (photo, fit, prior)), np.concatenate([disc, moved]), SPATIAL.mask
    )
    for index, covered in enumerate((disc, moved)):
        assert_close(both[index], spatial_posterior(photo, fit, prior, covered, SPATIAL.mask)[0])


def test_nothing_covered_and_nothing_known() -> None:
    photo, fit, prior, disc, _ = blob()
    assert not spatial_posterior(photo, fit, prior, np.zeros_like(disc), SPATIAL.mask).any()
    unknown = prior.copy()
    unknown[:, :, 30:] = [NEVER, 0.0, 0.0]
    visible = spatial_posterior(photo, fit, unknown, disc, SPATIAL.mask)
    assert np.isfinite(visible).all() and not visible[:, :, 30:].any()
    other = photo.copy()
    other[:, :, 30:] = 0.9
    assert np.array_equal(spatial_posterior(other, fit, unknown, disc, SPATIAL.mask), visible)
