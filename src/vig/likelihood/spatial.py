"""A spatial model of occlusion: neighbouring pixels of the object are hidden, or visible, together.

Under Eq. 3 each covered pixel is visible (h = 1) or hidden (h = 0) on its own. Here

    log p(h | c) = sum_i h_i u_i - sum_(i,j) w_ij [h_i != h_j] + constant

over the eight neighbours j of each pixel i: u_i is Eq. 3's log odds of i being visible, and

    w_ij = coupling / distance_ij * exp(-|c_i - c_j|^2 / (2 contrast^2)),

so that a change from visible to hidden is cheap only across an edge of the photo (colours c in sRGB). Pixels
beyond the silhouette do not show the object: h_j = 0 there, at the strength `rim` in place of `coupling`, as
an occluder continues beside the object. Mean field approximates the posterior by independent q_i with

    logit q_i = u_i + sum_j w_ij (2 q_j - 1).
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

from vig.photo.masks import box_of
from vig.scene import srgb_from_linear
from vig.scene.functions import sigmoid
from vig_native import engine

NEVER = -1e30  # stands for log 0 in a prior: finite, so that no infinity meets another

NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Steps (down, right) to half of a pixel's eight neighbours; the other half are the same links backwards."""

RESIDUAL_SCALES = (0.01, 0.03, 0.1, 0.3)
"""Standard deviations in sRGB, equally likely, of a visible pixel's distance from a finished fit."""

CAPACITY_PER_NAT = 1000  # units of capacity a nat: rounding costs a thousandth of a nat


@dataclass(frozen=True)
class SpatialMask:
    """Settings of the spatial model of occlusion.

    Attributes:
        coupling: Nats lost where of two pixels of one colour one is visible and the other hidden.
        rim: The same for a visible pixel beside one beyond the silhouette.
        contrast: Standard deviation, a distance of colours in sRGB, over which the coupling fades.
        sweeps: Updates of all pixels.
        exact_start: Whether these begin at the most probable mask, else at the mask of each pixel alone.
    """

    coupling: float = 10.0
    rim: float = 2.0
    contrast: float = 0.1
    sweeps: int = 5
    exact_start: bool = True

    def __post_init__(self) -> None:
        if not (self.coupling >= 0 and self.rim >= 0):
            raise ValueError(f"coupling and rim must be at least 0 nats; got {self.coupling}, {self.rim}")
        if not self.contrast > 0:
            raise ValueError(f"contrast must be a positive distance of sRGB colours; got {self.contrast}")
        if self.sweeps < 1:
            raise ValueError(f"sweeps must be at least 1; got {self.sweeps}")


def visible_log_odds(observed: np.ndarray, rendered: np.ndarray, log_prior: np.ndarray) -> np.ndarray:
    """Return the log odds of pixels being visible, not hidden under a finished fit: Eq. 3 with wider tails.

    observed, rendered (..., 3) linear RGB; log_prior (..., 3) as `PixelModel.log_prior`; result (...). In
    place of one Gaussian of linear colour stands a mixture over `RESIDUAL_SCALES` of Gaussians of sRGB: the
    residual of a fit is small in most places and large in few, and grows with brightness.
    """
    square = ((srgb_from_linear(observed) - srgb_from_linear(rendered)) ** 2).sum(-1)
    normals = [
        -square / (2 * scale**2) - 3 * math.log(scale * math.sqrt(2 * math.pi)) for scale in RESIDUAL_SCALES
    ]
    density = functools.reduce(np.logaddexp, normals) - math.log(len(RESIDUAL_SCALES))
    # The hidden component is a density of linear colour: sRGB's slope there converts.
    slope = (1 / 2.4 - 1) * np.log(np.maximum(observed, 0.0031308)) + math.log(1.055 / 2.4)
    return np.asarray(log_prior[..., 0] - log_prior[..., 1] + density + slope.sum(-1))


def links(photo: np.ndarray, covered: np.ndarray, photographed: np.ndarray, model: SpatialMask) -> np.ndarray:
    """Return weights w_ij (N, 4, H, W) between each pixel and its neighbour a step of `NEIGHBOURS` away.

    photo (N, H, W, 3) linear RGB; covered (N, H, W) bool; photographed (N, H, W) bool, pixels that are
    of the photo at all. Zero where the neighbour is outside the image, where either was not photographed,
    and between pixels that are both beyond the silhouette.
    """
    colours = srgb_from_linear(photo)
    weights = np.zeros((len(photo), len(NEIGHBOURS), *photo.shape[1:3]), colours.dtype)
    for index, step in enumerate(NEIGHBOURS):
        here, there = _ends(step, *photo.shape[1:3])
        square = ((colours[:, *here] - colours[:, *there]) ** 2).sum(-1)
        inside, beside = covered[:, *here], covered[:, *there]
        # Both covered: an edge of the mask; one covered: the silhouette, beyond which h = 0.
        strength = model.coupling * (inside & beside) + model.rim * (inside ^ beside)
        strength = strength * (photographed[:, *here] & photographed[:, *there])
        fading = np.exp(-square / (2 * model.contrast**2)) / math.hypot(*step)
        weights[:, index][:, *here] = strength * fading
    return weights


def messages(visible: np.ndarray, covered: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return sum_j w_ij (2 q_j - 1): nats (N, H, W) in favour of a pixel being visible, from its neighbours.

    visible (N, H, W): q; covered (N, H, W) bool; weights from `links`.
    """
    return _gather(np.where(covered, 2 * visible - 1, visible.dtype.type(-1)), weights)


def mean_field(
    start: np.ndarray, log_odds: np.ndarray, covered: np.ndarray, weights: np.ndarray, sweeps: int
) -> np.ndarray:
    """Return posterior q (N, H, W) of covered pixels being visible, this module's last equation; 0 elsewhere.

    start (N, H, W): q before the first sweep; log_odds (N, H, W): u, of each pixel by itself; covered
    (N, H, W) bool; weights from `links`.
    """
    nothing = start.dtype.type(0)
    visible: np.ndarray = np.where(covered, start, nothing)
    for _ in range(sweeps):
        # Parallel updates of a mean field may oscillate: they are damped.
        update = sigmoid(log_odds + messages(visible, covered, weights))
        # 0.5: share of the old q that an update keeps: simultaneous updates oscillate without it
        visible = np.where(covered, visible + (1 - 0.5) * (update - visible), nothing)
    return visible


def graph_cut(log_odds: np.ndarray, covered: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the most probable h (N, H, W) bool, exactly: a minimum cut between visible and hidden.

    Arguments as in `mean_field`, on the CPU. The result is the h of them with the fewest visible pixels.
    Capacities are whole numbers of 1 / `CAPACITY_PER_NAT` nats.
    """
    alone = _capacity(log_odds + _gather(np.where(covered, 0.0, -1.0).astype(log_odds.dtype), weights))
    strengths = _capacity(weights)
    links = np.zeros((len(alone), 2 * len(NEIGHBOURS), *alone.shape[1:]), alone.dtype)
    for index, step in enumerate(NEIGHBOURS):
        here, there = _ends(step, *alone.shape[1:])
        both = strengths[:, index][:, *here] * (covered[:, *here] & covered[:, *there])
        links[:, 2 * index][:, *here] = links[:, 2 * index + 1][:, *there] = both
    return np.asarray(engine.minimum_cut(np.ascontiguousarray(covered), alone, links))


def _capacity(nats: np.ndarray) -> np.ndarray:
    """Return whole numbers of capacity, int32."""
    most_capacity = 1 << 29  # capacity that decides a pixel
    rounded = np.round(CAPACITY_PER_NAT * nats.astype(np.float64)).clip(-most_capacity, most_capacity)
    return np.ascontiguousarray(rounded, np.int32)


def spatial_posterior(
    observed: np.ndarray,
    rendered: np.ndarray,
    log_prior: np.ndarray,
    covered: np.ndarray,
    model: SpatialMask,
    decorated: np.ndarray | None = None,
) -> np.ndarray:
    """Return posterior (N, H, W) of pixels being visible in finished fits of N photos; 0 off the silhouette.

    observed, rendered (N, H, W, 3) linear RGB; log_prior (N, H, W, 3) as `PixelModel.log_prior`; covered
    (N, H, W) bool. A log prior of `NEVER` for visible means that a pixel was not photographed: it ties no
    others. The mean field starts at the most probable h, the best of its optima. Only the window that holds
    covered pixels is worked on. decorated (H, W), in [0, 1): the share of the log prior's second component
    that is visible with a colour of its own.
    """
    result = np.zeros_like(rendered[..., 0])
    if (box := box_of(np.any(covered, axis=0, keepdims=True)[0])) is not None:
        x, y, width, height = box
        # Rows and columns with anything covered in any image, and one pixel more all round.
        window = slice(max(y - 1, 0), y + height + 1), slice(max(x - 1, 0), x + width + 1)
        photo, fit, prior, inside = (each[:, *window] for each in (observed, rendered, log_prior, covered))
        log_odds = visible_log_odds(photo, fit, prior)
        if decorated is not None:
            # The share d of the prior's second component is visible: odds (p + d q) / ((1 - d) q).
            share = decorated[window].astype(log_odds.dtype)
            with np.errstate(divide="ignore"):  # where all of it is, the odds are infinite
                log_odds = np.logaddexp(log_odds, np.log(np.maximum(share, 1e-12))) - np.log1p(-share)
        log_odds = log_odds.astype(result.dtype)
        weights = links(photo, inside, prior[..., 0] > NEVER / 2, model).astype(result.dtype)
        exact = model.exact_start
        start = graph_cut(log_odds, inside, weights).astype(result.dtype) if exact else sigmoid(log_odds)
        result[:, *window] = mean_field(start, log_odds, inside, weights, model.sweeps)
    return result


def _gather(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return sum_j w_ij x_j over the neighbours j of each pixel: values x (N, H, W), weights from `links`."""
    total = np.zeros_like(values)
    for index, step in enumerate(NEIGHBOURS):
        here, there = _ends(step, *values.shape[1:])
        weight = weights[:, index][:, *here]
        total[:, *here] += weight * values[:, *there]
        total[:, *there] += weight * values[:, *here]
    return total


def _ends(step: tuple[int, int], height: int, width: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Return windows of pixels that have a neighbour a step away, and of these neighbours, in one order."""
    pairs = []
    for move, size in zip(step, (height, width), strict=True):
        low, high = slice(0, max(size - abs(move), 0)), slice(abs(move), size)
        pairs.append((low, high) if move >= 0 else (high, low))
    (rows, rows_there), (columns, columns_there) = pairs
    return (rows, columns), (rows_there, columns_there)
