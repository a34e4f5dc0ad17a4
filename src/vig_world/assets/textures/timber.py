"""Wood: boards, parquet squares, herringbone."""

import numpy as np

from vig_world.assets.textures.colours import shade as shaded
from vig_world.assets.textures.fields import Array, grid, noise
from vig_world.assets.textures.kinds import kind

_WOODS = np.array(
    [[0.55, 0.33, 0.16], [0.32, 0.16, 0.07], [0.66, 0.48, 0.28], [0.14, 0.07, 0.035], [0.40, 0.18, 0.085],
     [0.58, 0.50, 0.40], [0.48, 0.30, 0.16], [0.62, 0.42, 0.22]],
    np.float32,
)  # fmt: skip


def tone(rng: np.random.Generator) -> Array:
    """Return the albedo (3,) of a kind of wood."""
    return shaded(_WOODS[rng.integers(len(_WOODS))], rng, 0.25)


@kind(metres=(0.3, 1.0))
def wood(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return one to six boards side by side, the grain along v."""
    v, u = grid(size)
    base = tone(rng) if base is None else base
    planks = int(rng.choice([1, 1, 2, 3, 4, 6]))
    plank = np.floor(u * planks).astype(int)
    warp = noise(rng, size, 2.0, stretch=6.0)
    phase = rng.uniform(0, 9, planks).astype(np.float32)[plank]
    rings = np.sin(2 * np.pi * (rng.integers(3, 9) * u + 0.35 * warp + phase))
    pores = noise(rng, size, 0.5, stretch=16.0)
    shade = 1 + rng.uniform(0.04, 0.16) * rings * (0.7 + 0.3 * np.sign(rings)) + 0.06 * pores
    if rng.uniform() < 0.3:  # wear: paler where much used, or stained
        shade = shade * (1 + rng.uniform(-0.2, 0.15) * np.clip(noise(rng, size, 1.7), 0, 1.5))
    if planks > 1:
        shade = shade * (1 + rng.uniform(0.05, 0.2) * rng.uniform(-1, 1, planks).astype(np.float32)[plank])
        shade = np.where((u * planks) % 1 < 1.2 * planks / size, 0.45 * shade, shade)
        butt = (v - rng.uniform(0, 1, planks).astype(np.float32)[plank]) % 1 < 1.2 / size
        shade = np.where(butt, 0.5 * shade, shade)
    return base * np.maximum(shade, 0.15)[..., None]


def _lay_strips(
    rng: np.random.Generator, size: int, base: Array | None, along_v: Array, strip: Array, edge: Array
) -> Array:
    """Return strips of wood: which way each runs, a number in [-1, 1] of each, and where their joints are."""
    base = tone(rng) if base is None else base
    grain = noise(rng, size, 0.9, stretch=8.0)
    grain = np.where(along_v, grain, grain.T)
    shade = 1 + 0.08 * grain + rng.uniform(0.08, 0.22) * strip
    return base * np.where(edge, 0.55 * shade, shade)[..., None]


@kind(metres=(0.4, 0.9))
def parquet(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return squares of four or five strips, turned from square to square."""
    v, u = grid(size)
    squares, strips = 2 * int(rng.integers(1, 3)), int(rng.integers(4, 6))
    row, column = np.floor(v * squares).astype(int), np.floor(u * squares).astype(int)
    along_v = (row + column) % 2 == 0
    x, y = (u * squares) % 1, (v * squares) % 1
    across = np.where(along_v, x, y) * strips
    value = rng.uniform(-1, 1, (squares, squares, strips)).astype(np.float32)
    strip = value[row, column, np.minimum(across.astype(int), strips - 1)]
    thin = squares / size
    edge = (across % 1 < strips * thin) | (x < thin) | (y < thin)
    return _lay_strips(rng, size, base, along_v, strip, edge)


@kind(metres=(0.6, 1.2))
def herringbone(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return strips four times as long as wide, laid in steps."""
    v, u = grid(size)
    cells = 8 * int(rng.integers(1, 3))
    x, y = np.floor(u * cells).astype(int), np.floor(v * cells).astype(int)
    step = (x - y) % 8
    along_v = step >= 4
    first_x, first_y = np.where(along_v, x, x - step) % cells, np.where(along_v, y - (7 - step), y) % cells
    strip = rng.uniform(-1, 1, (cells, cells)).astype(np.float32)[first_y, first_x]
    thin = cells / size
    left, top = (u * cells) % 1 < thin, (v * cells) % 1 < thin
    edge = np.where(along_v, left | (top & (step == 7)), top | (left & (step == 0)))
    return _lay_strips(rng, size, base, along_v, strip, edge)
