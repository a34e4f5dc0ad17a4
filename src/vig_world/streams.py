"""Random numbers of the world: each generator is a pure function of its purpose."""

import zlib

import numpy as np

from vig_world.dataset.spec import SPLITS, Split


def asset_rng(split: Split, catalogue: str, number: int) -> np.random.Generator:
    """Return the generator that makes asset `number` of a catalogue, such as `prop/mug`, of a split."""
    entropy = [SPLITS.index(split), zlib.crc32(catalogue.encode()), number]
    return np.random.default_rng(np.random.SeedSequence(entropy))


def stream(seed: int, index: int, split: Split, purpose: int, draw: int = 0) -> np.random.Generator:
    """Return the generator of one purpose of one draw of a sample: a pure function of its arguments."""
    entropy, key = [seed, index, SPLITS.index(split), purpose], (draw,) if draw else ()
    return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=key))
