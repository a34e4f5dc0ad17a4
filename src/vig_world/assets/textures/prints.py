"""Printed matter: labels, covers, pages of text, newspapers, pictures. None of it tiles."""

import numpy as np

from vig_world.assets.textures.colours import accent, colour, near, neutral, partner, shade
from vig_world.assets.textures.fields import Array, blossom, ellipse, grid, mix, noise
from vig_world.assets.textures.kinds import kind
from vig_world.assets.textures.lettering import paragraph, title

_WHITE, _BLACK = np.array([0.82, 0.81, 0.78], np.float32), np.array([0.03, 0.03, 0.035], np.float32)


def _ink(rng: np.random.Generator, paper: Array) -> Array:
    """Return a colour in which to write on `paper` (3,)."""
    plain = _BLACK if paper.mean() > 0.25 else _WHITE
    tint = 0.4 * accent(rng) if paper.mean() > 0.25 else accent(rng) + 0.25
    return tint if rng.uniform() < 0.4 and abs(tint.mean() - paper.mean()) > 0.2 else plain


def _lay(image: Array, mask: Array, top: int, left: int, fill: Array) -> None:
    """Paint `fill` through the mask (h, w) from row `top` and column `left`, cut at the image's edges."""
    window = image[max(top, 0) : top + mask.shape[0], max(left, 0) : left + mask.shape[1]]
    mask = mask[max(-top, 0) :, max(-left, 0) :][: window.shape[0], : window.shape[1]]
    window += (fill - window) * mask[..., None]


def _write(
    rng: np.random.Generator, image: Array, top: float, height: float, ink: Array, centred: bool
) -> None:
    """Write a word across the image, centred or from the left, `top` and `height` shares of its height."""
    size = len(image)
    mask = title(rng, int(0.84 * size), int(height * size))
    left = (size - mask.shape[1]) // 2 if centred else int(0.08 * size)
    _lay(image, mask, int(top * size), left, ink)


def scenery(rng: np.random.Generator, size: int) -> Array:
    """Return a landscape, (size, size, 3): a sky, ridges that grow darker, perhaps a sun and water."""
    v, u = grid(size)
    sky = near(
        np.array([[0.35, 0.50, 0.66], [0.66, 0.52, 0.40], [0.6, 0.6, 0.58]])[rng.integers(3)], rng, 0.3
    )
    land = near(
        np.array([[0.10, 0.17, 0.07], [0.28, 0.20, 0.10], [0.12, 0.16, 0.20]])[rng.integers(3)], rng, 0.4
    )
    image = sky * (1 + 0.5 * v[..., None]) * np.ones((size, size, 1), np.float32)
    if rng.uniform() < 0.4:
        disc = ellipse(u, v, (rng.uniform(0.2, 0.8), rng.uniform(0.15, 0.4)), (0.07, 0.07))
        image = mix(image, near([0.85, 0.66, 0.35], rng), disc)
    ridges = 0.06 * noise(rng, size, 1.8)[:3]
    for ridge, horizon, share in zip(ridges, (0.42, 0.58, 0.76), (0.45, 0.75, 1.0), strict=True):
        image[v > (horizon + ridge)[None, :]] = sky + (land - sky) * share
    return image * (1 + 0.08 * noise(rng, size, 0.9))[..., None]


def _still_life(rng: np.random.Generator, size: int) -> Array:
    """Paint round things on a table, or a flower, with light from a side."""
    v, u = grid(size)
    ground = colour(rng)
    image = ground * (1.1 - 0.4 * v[..., None]) * np.ones((size, size, 1), np.float32)
    image[v[:, 0] > rng.uniform(0.6, 0.75)] *= rng.uniform(0.5, 0.8)
    if rng.uniform() < 0.4:
        for cover, tint in zip(
            blossom(size, rng, int(rng.integers(4, 9)), 4),
            (near([0.1, 0.2, 0.08], rng), partner(ground, rng), near([0.6, 0.4, 0.06], rng)),
            strict=True,
        ):
            image = mix(image, tint, cover)
        return image
    tint = accent(rng)
    for _ in range(rng.integers(1, 5)):
        radius, x, y = rng.uniform(0.1, 0.24), rng.uniform(0.2, 0.8), rng.uniform(0.45, 0.72)
        shade = 1.2 - 0.8 * np.hypot(u - x + 0.5 * radius, v - y + 0.5 * radius) / (1.6 * radius)
        image = mix(
            image, near(tint, rng, 0.3) * shade[..., None], ellipse(u, v, (x, y), (radius, radius * 0.95))
        )
    return image


def _abstract(rng: np.random.Generator, size: int) -> Array:
    """Return fields, discs and bars of colours that go together."""
    v, u = grid(size)
    base = neutral(rng)
    image = base * np.ones((size, size, 1), np.float32)
    for _ in range(rng.integers(3, 6)):
        centre = (rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9))
        radii = (rng.uniform(0.08, 0.4), rng.uniform(0.05, 0.4))
        image = mix(image, partner(base, rng), ellipse(u, v, centre, radii, rng.uniform(0, 3)))
    return image * (1 + 0.04 * noise(rng, size, 0.8))[..., None]


@kind(metres=(0.2, 0.5), periodic=False)
def picture(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return a picture: landscape, still life or abstract, with a passe-partout of colour `base` if given."""
    draw = (scenery, _still_life, _abstract)[rng.integers(3)]
    image = np.clip(draw(rng, size), 0.02, 0.95).astype(np.float32)
    if base is not None:
        edge = max(1, size // 8)
        image[:edge] = image[-edge:] = base
        image[:, :edge] = image[:, -edge:] = base
    return image


@kind(metres=(0.2, 0.4), periodic=False)
def print_(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return a label, a packet's face or a cover: bands of colour, picture or emblem, a name, small print."""
    base = (shade(_WHITE, rng, 0.1) if rng.uniform() < 0.4 else colour(rng)) if base is None else base
    v, u = grid(size)
    second = partner(base, rng)
    image = np.empty((size, size, 3), np.float32)
    image[:] = base
    style = rng.integers(5)
    name_at = rng.uniform(0.07, 0.14)
    paper = base
    if style == 0:  # a band with the name in it
        name_at = rng.uniform(0.1, 0.5)
        image[int((name_at - 0.05) * size) : int((name_at + 0.24) * size)] = paper = second
    elif style == 1:  # a picture below, or over all of it
        if rng.uniform() < 0.4:
            image[:] = picture(rng, size, None)
            paper = image[: size // 4].mean((0, 1))
        else:
            n, wide = size // 2, int(rng.choice([size // 2, 3 * size // 4, size]))
            window = picture(rng, n, None)[:, np.arange(wide) * n // wide]
            top, left = int(rng.uniform(0.34, 0.45) * size), (size - wide) // 2
            image[top : top + n, left : left + wide] = window
    elif style == 2:  # an emblem
        centre, radius = (0.5, rng.uniform(0.48, 0.62)), rng.uniform(0.16, 0.26)
        for share, tint in ((1.0, second), (0.88, base), (0.8, partner(base, rng))):
            image = mix(image, tint, ellipse(u, v, centre, (share * radius, share * radius)))
        cover = blossom(size // 4, rng, int(rng.integers(3, 9)), 2)
        at = (int((centre[1] - 0.125) * size), size // 2 - size // 8)
        _lay(image, np.maximum(cover[0], cover[1]), *at, near(base, rng, 0.2))
    elif style == 3:  # two fields along a slanted or curved edge
        edge = (
            rng.uniform(0.35, 0.65)
            + rng.uniform(-0.3, 0.3) * (u - 0.5)
            + 0.08 * np.sin(6 * u + rng.uniform(0, 6))
        )
        image = mix(image, second, (v > edge).astype(np.float32))
    else:  # a border
        n = round(size * rng.uniform(0.03, 0.07))
        image[n : 2 * n, n:-n] = image[-2 * n : -n, n:-n] = second
        image[n:-n, n : 2 * n] = image[n:-n, -2 * n : -n] = second
        name_at = rng.uniform(0.2, 0.3)
    ink, centred = _ink(rng, paper), bool(rng.uniform() < 0.7)
    _write(rng, image, name_at, rng.uniform(0.12, 0.2), ink, centred)
    if rng.uniform() < 0.6:
        _write(rng, image, name_at + 0.2, 0.06, ink, centred)
    low = image[int(0.8 * size)].mean(0)
    if rng.uniform() < 0.75:
        lines = paragraph(rng, int(rng.uniform(0.4, 0.8) * size), int(rng.uniform(0.08, 0.2) * size), 3)
        _lay(image, 0.85 * lines, int(0.78 * size), int(0.1 * size), _BLACK if low.mean() > 0.25 else _WHITE)
    return image


@kind(metres=(0.3, 0.5), periodic=False)
def news(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return a newspaper's page: a headline over three to five columns, some with a picture."""
    return page(rng, size, shade([0.62, 0.60, 0.55], rng, 0.08) if base is None else base, (3, 4, 5))


@kind(metres=(0.2, 0.3), periodic=False)
def page(
    rng: np.random.Generator, size: int, base: Array | None, layouts: tuple[int, ...] = (1, 1, 2, 3)
) -> Array:
    """Return a page of text on paper, a letter or a page of a book.

    Args:
        layouts: Numbers of columns that it may have.
    """
    base = shade([0.80, 0.78, 0.72], rng, 0.08) if base is None else base
    image = np.empty((size, size, 3), np.float32)
    image[:] = base
    edge, top = round(0.08 * size), round(0.08 * size)
    inner = size - 2 * edge
    columns = int(rng.choice(layouts))
    if columns > 2 or rng.uniform() < 0.5:
        head = title(rng, int(inner * rng.uniform(0.5, 1)), round(size * rng.uniform(0.06, 0.14)))
        _lay(image, head, top, edge, _BLACK)
        top += round(1.5 * len(head))
    gap = round(0.04 * size)
    width = (inner - (columns - 1) * gap) // columns
    letter = 3 if size <= 96 or columns > 1 else int(rng.integers(3, 5))
    for column in range(columns):
        start, left = top, edge + column * (width + gap)
        if columns > 1 and rng.uniform() < 0.5:
            photo = scenery(rng, 32).mean(-1, keepdims=True) if rng.uniform() < 0.6 else scenery(rng, 32)
            rows = min(round(0.8 * width), size - edge - start)
            scaled = photo[np.arange(rows) * 32 // rows][:, np.arange(width) * 32 // width]
            image[start : start + rows, left : left + width] = scaled
            start += rows + 3
        if size - edge - start > letter:
            text = paragraph(rng, width, size - edge - start, letter, 0.85)
            _lay(image, 0.8 * text, start, left, _BLACK)
    return image
