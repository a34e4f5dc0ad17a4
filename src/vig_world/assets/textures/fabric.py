"""Woven, plaited and patterned coverings: cloth, stripes, wickerwork, leather, wallpaper."""

import numpy as np

from vig_world.assets.textures.colours import colour, near, partner
from vig_world.assets.textures.colours import shade as shaded
from vig_world.assets.textures.fields import Array, blossom, grid, mix, noise
from vig_world.assets.textures.kinds import kind


def _threads(rng: np.random.Generator, size: int) -> Array:
    """Return the shade of woven threads, about 1."""
    v, u = grid(size)
    count = max(1, size // int(rng.choice([4, 4, 6, 8])))
    weave = np.sin(np.pi * 2 * count * u) * np.sin(np.pi * 2 * count * v)
    return 1 + rng.uniform(0.04, 0.16) * weave + 0.07 * noise(rng, size, 0.5)


@kind(metres=(0.15, 0.5), needs_base=True)
def cloth(rng: np.random.Generator, size: int, base: Array) -> Array:
    """Return plain, striped or checked cloth in two colours that go together."""
    second = partner(base, rng)
    bands = np.repeat(rng.uniform(size=16) < 0.35, -(-size // 16))[:size].astype(np.float32)
    style = rng.integers(4)
    if style < 2:
        return base * _threads(rng, size)[..., None]
    weight = bands[None, :] * np.ones((size, 1)) if style == 2 else 0.5 * (bands[None, :] + bands[:, None])
    return mix(base, second, weight) * _threads(rng, size)[..., None]


@kind(metres=(0.3, 0.8), needs_base=True)
def stripes(rng: np.random.Generator, size: int, base: Array) -> Array:
    """Return cloth or paper with stripes of up to four colours along v, thin beside broad."""
    colours = np.stack([base, partner(base, rng), near(base, rng, 0.4), partner(base, rng)])
    widths = rng.integers(1, 5, 14) ** 2
    order = np.where(np.arange(14) % 2, rng.integers(1, 4, 14), 0)
    row = np.repeat(order, widths)
    image = colours[row[(np.arange(size) * len(row)) // size]] * np.ones((size, 1, 1), np.float32)
    return image * _threads(rng, size)[..., None]


@kind(metres=(0.1, 0.25))
def weave(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return wickerwork or rattan: strands that go over and under each other."""
    base = shaded(np.array([[0.45, 0.29, 0.14], [0.58, 0.44, 0.26], [0.24, 0.13, 0.06], [0.6, 0.57, 0.5]])[
        rng.integers(4)], rng) if base is None else base  # fmt: skip
    v, u = grid(size)
    n = 2 * int(rng.integers(3, 8))
    x, y = u * n, v * n
    level = (np.floor(x) + np.floor(y)) % 2 == 0
    x, y = x % 1 - 0.5, y % 1 - 0.5
    across, along = np.where(level, y, x), np.where(level, x, y)
    shade = np.sqrt(np.maximum(1 - (1.9 * across) ** 2, 0.02)) * (1 - 0.9 * along**2)
    tones = rng.uniform(-1, 1, (n, n)).astype(np.float32)
    thread = tones[np.floor(v * n).astype(int), np.floor(u * n).astype(int)]
    return base * (shade * (1 + 0.15 * thread + 0.05 * noise(rng, size, 0.5)))[..., None]


@kind(metres=(0.2, 0.4))
def leather(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Hide with fine creases."""
    base = shaded(np.array([[0.22, 0.09, 0.04], [0.05, 0.045, 0.04], [0.42, 0.24, 0.12], [0.26, 0.05, 0.04]])[
        rng.integers(4)], rng, 0.2) if base is None else base  # fmt: skip
    creases = np.exp(-np.abs(noise(rng, size, 2.0, cutoff=round(size / 10))) / 0.12)
    return base * (1 - 0.3 * creases + 0.08 * noise(rng, size, 1.6))[..., None]


@kind(metres=(0.4, 1.0), needs_base=True)
def wallpaper(rng: np.random.Generator, size: int, base: Array) -> Array:
    """Return stripes or a repeated motif, mostly in a near colour."""
    v, u = grid(size)
    second = near(base, rng, 0.4) if rng.uniform() < 0.6 else partner(base, rng)
    n = int(rng.integers(3, 11))
    pattern = (np.cos(2 * np.pi * n * u) > rng.uniform(-0.6, 0.8)) * np.ones_like(v)
    if rng.uniform() < 0.5:  # a repeated motif instead of plain stripes
        rows = 2 * int(rng.integers(2, 5))
        x = (u * rows + 0.5 * (np.floor(v * rows) % 2)) % 1 - 0.5
        y = (v * rows) % 1 - 0.5
        radius = rng.uniform(0.15, 0.4) * (1 + 0.4 * np.cos(rng.integers(3, 7) * np.arctan2(y, x)))
        pattern = np.hypot(x, y) < radius
    return mix(base, second, pattern.astype(np.float32)) * (1 + 0.02 * noise(rng, size))[..., None]


@kind(metres=(0.4, 0.9))
def floral(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return flowers scattered on a quiet ground."""
    base = shaded([0.72, 0.68, 0.58], rng, 0.2) if base is None else base
    petal, leaf = partner(base, rng), near([0.16, 0.24, 0.12], rng, 0.4)
    heart = near([0.65, 0.42, 0.08], rng, 0.3)
    half = size // 2
    image = np.broadcast_to(base, (half, half, 3)).astype(np.float32)
    for _ in range(rng.integers(3, 7)):
        side = int(rng.integers(half // 4, half // 2 + 1))
        motif = blossom(side, rng, int(rng.integers(4, 8)), int(rng.integers(0, 4)))
        rows = (rng.integers(half) + np.arange(side)) % half
        columns = (rng.integers(half) + np.arange(side)) % half
        window = image[rows[:, None], columns]
        for cover, tint in zip(motif, (leaf, near(petal, rng, 0.2), heart), strict=True):
            window = mix(window, tint, cover if rng.uniform() < 0.5 else cover[:, ::-1])
        image[rows[:, None], columns] = window
    image = np.tile(image, (2, 2, 1))
    image[:, half:] = np.roll(image[:, half:], half // 2, axis=0)  # half drop
    image = np.concatenate([image, image[: size - len(image)]]) if len(image) < size else image
    image = np.concatenate([image, image[:, : size - image.shape[1]]], axis=1)
    return image * (1 + 0.03 * noise(rng, size, 0.8))[..., None]


@kind(metres=(0.3, 1.0), needs_base=True)
def checker(rng: np.random.Generator, size: int, base: Array) -> Array:
    """Return a chequered board of two colours."""
    v, u = grid(size)
    n = int(rng.integers(1, 7))
    odd = (np.floor(2 * n * u) + np.floor(2 * n * v)) % 2
    second = partner(base, rng) if rng.uniform() < 0.8 else colour(rng)
    return mix(base, second, odd) * (1 + 0.03 * noise(rng, size))[..., None]
