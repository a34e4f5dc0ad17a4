"""Paint, plaster, tiles, brick, stone, concrete and other fillings of plain colour."""

import numpy as np

from vig_world.assets.textures.colours import colour, near, neutral, partner
from vig_world.assets.textures.colours import shade as shaded
from vig_world.assets.textures.fields import Array, cells, mix, noise
from vig_world.assets.textures.kinds import kind

_BRICKS = np.array(
    [[0.42, 0.14, 0.08], [0.55, 0.30, 0.18], [0.60, 0.57, 0.52], [0.25, 0.12, 0.09]], np.float32
)


@kind(metres=(0.6, 1.5), needs_base=True)
def paint(rng: np.random.Generator, size: int, base: Array) -> Array:
    """Return one colour, a little uneven."""
    return base * (1 + rng.uniform(0.01, 0.05) * noise(rng, size, 1.6))[..., None]


@kind(metres=(0.6, 1.5))
def plaster(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return whitewash with the marks of the trowel."""
    if base is None:
        base = shaded([0.74, 0.71, 0.65], rng, 0.2)
    return (
        base * (1 + 0.03 * noise(rng, size, 1.5) + rng.uniform(0.01, 0.05) * noise(rng, size, 0.7))[..., None]
    )


@kind(metres=(0.8, 1.6))
def concrete(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Cast concrete: clouds, and pores."""
    if base is None:
        base = shaded(np.full(3, rng.uniform(0.2, 0.5)) * [1, 0.98, 0.94], rng, 0.1)
    grain = noise(rng, size, 0.6)
    shade = 1 + rng.uniform(0.05, 0.12) * noise(rng, size, 1.7) + 0.04 * grain
    return base * np.where(grain > 2.6, 0.6 * shade, shade)[..., None]


@kind(metres=(0.5, 1.2), needs_base=True)
def tiles(rng: np.random.Generator, size: int, base: Array) -> Array:
    """Return square tiles, all alike or in two colours, and grout."""
    n = int(rng.integers(2, 7))
    value, joint = cells(rng, size, n, n, 0.0, rng.uniform(0.008, 0.02))
    shade = 1 + rng.uniform(0.0, 0.12) * value + rng.uniform(0.0, 0.05) * noise(rng, size)
    image = base * shade[..., None]
    if rng.uniform() < 0.2:
        image = mix(image, near(base, rng, 0.4), (value > 0.5).astype(np.float32))
    grout = rng.uniform(0.1, 0.8) * np.ones(3, np.float32)
    return mix(image, grout, joint.astype(np.float32))


@kind(metres=(0.7, 1.2))
def brick(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return a brick wall in running bond, bare or painted over."""
    clay = shaded(_BRICKS[rng.integers(len(_BRICKS))], rng, 0.25) if base is None else base
    rows = 2 * int(rng.integers(3, 7))
    value, joint = cells(rng, size, rows, rows // 2, 0.5, rng.uniform(0.012, 0.022))
    shade = 1 + rng.uniform(0.1, 0.35) * value + 0.1 * noise(rng, size, 0.8)
    mortar = rng.uniform(0.25, 0.7) * np.array([1, 0.96, 0.9], np.float32)
    return mix(clay * shade[..., None], mortar * (1 + 0.05 * noise(rng, size))[..., None],
               joint.astype(np.float32))  # fmt: skip


@kind(metres=(0.5, 1.2))
def marble(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return veined stone."""
    if base is None:
        base = shaded(np.full(3, rng.choice([0.08, 0.4, 0.75, 0.8]), np.float32), rng, 0.15)
    vein = shaded(np.full(3, 0.75 if base.mean() < 0.25 else 0.2), rng, 0.3)
    field = noise(rng, size, 1.9) + 0.15 * noise(rng, size, 1.0)
    patches = np.clip(0.5 + 0.5 * noise(rng, size, 2.0), 0, 1)
    weight = np.exp(-np.abs(field) / rng.uniform(0.03, 0.12)) * patches
    return mix(base * (1 + 0.08 * field)[..., None], vein, np.clip(weight * 0.9, 0, 1))


@kind(metres=(0.25, 0.5))
def granite(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return stone of three kinds of grains."""
    if base is None:
        base = shaded(np.full(3, rng.choice([0.1, 0.3, 0.5])) * [1.05, 1.0, 0.95], rng, 0.15)
    field, grain = noise(rng, size, 0.7), noise(rng, size, 0.5)
    image = mix(base * (1 + 0.1 * grain)[..., None], near(base * 1.7, rng, 0.2), (field > 0.8) * 0.8)
    return mix(image, np.full(3, 0.04, np.float32), (grain > 1.2) * rng.uniform(0.4, 0.9))


@kind(metres=(0.3, 0.7))
def terrazzo(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return chips of several stones in a ground."""
    base = neutral(rng) if base is None else base
    image = base * (1 + 0.03 * noise(rng, size))[..., None]
    for _ in range(rng.integers(2, 4)):  # each kind of chip: the peaks of its own band of noise
        band = noise(rng, size, 3.0, cutoff=round(rng.uniform(0.12, 0.25) * size))
        chip = near(base, rng, 0.5) if rng.uniform() < 0.5 else partner(base, rng)
        image = mix(image, chip, np.clip(3 * (band - rng.uniform(1.1, 1.7)), 0, 1))
    return image


@kind(metres=(0.2, 0.6), needs_base=True)
def speckle(rng: np.random.Generator, size: int, base: Array) -> Array:
    """Return a colour broken up by grains of a near one, or a glaze with dark spots."""
    spotted = rng.uniform() < 0.5
    grain = noise(rng, size, 0.4 if spotted else round(rng.uniform(0.3, 0.9), 1))
    if spotted:
        spots = np.clip(2 * (grain - rng.uniform(2.2, 2.8)), 0, 1)
        return mix(base * (1 + 0.02 * grain)[..., None], 0.3 * base, spots)
    return mix(base, near(base, rng, 0.6), np.clip(0.5 + rng.uniform(0.2, 0.6) * grain, 0, 1))


@kind(metres=(0.4, 1.0))
def linoleum(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return streaked flooring of two near tones, perhaps in large squares."""
    base = near(colour(rng) * 0.6 + 0.1, rng) if base is None else base
    streaks = np.clip(0.5 + 0.5 * noise(rng, size, 1.1, stretch=3.0), 0, 1)
    image = mix(base, near(base, rng, 0.35), streaks)
    if rng.uniform() < 0.4:
        value, _ = cells(rng, size, 2, 2, 0.0, 0.0)
        image = image * (1 + 0.12 * value)[..., None]
    return image


@kind(metres=(0.3, 0.6))
def cork(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    """Return pressed cork: brown crumbs of many tones."""
    base = shaded([0.45, 0.27, 0.13], rng, 0.25) if base is None else base
    crumbs = noise(rng, size, 2.0, cutoff=round(size / 8))
    image = base * (1 + 0.18 * crumbs)[..., None]
    return mix(image, 0.25 * base, (noise(rng, size, 0.8) > 1.7) * 0.8)
