"""Finite catalogues of textures, props and lights, apart for the train and test splits.

An asset is a pure function of (split, catalogue, number), not of the dataset's seed, so that no asset of
the test split ever occurs in training, and a worker can keep what it has made.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import torch

from vig.scene import EXPOSURE_L00, Mesh, grey, project_panorama, rotate_z
from vig.synthesis.fixtures import HOLDERS
from vig.synthesis.panoramas import panorama
from vig.synthesis.props import FAMILIES, Prop
from vig.synthesis.spec import SPLITS, Split, Surface
from vig.synthesis.textures import texture

PROPS_PER_FAMILY = {"train": 64, "test": 24}
SURFACES_PER_KIND = {"train": 96, "test": 32}
PANORAMAS = {"train": 200, "test": 70}
TEXTURE_SIZE = 128
MOST_ALBEDO = 0.85
"""Finishes of rooms are darkened by this, so that lit ones are seldom overexposed."""


def asset_rng(split: Split, catalogue: str, number: int) -> np.random.Generator:
    """The generator that makes asset `number` of a catalogue, such as `prop/mug`, of a split."""
    entropy = [SPLITS.index(split), zlib.crc32(catalogue.encode()), number]
    return np.random.default_rng(np.random.SeedSequence(entropy))


@lru_cache(maxsize=4096)
def prop(split: Split, family: str, number: int) -> Prop:
    """Member `number` of a prop family or of the holders."""
    make: Callable[[np.random.Generator], Prop] = {**FAMILIES, **HOLDERS}[family]
    return make(asset_rng(split, f"prop/{family}", number))


@lru_cache(maxsize=4096)
def prop_mesh(split: Split, family: str, number: int) -> Mesh:
    """All parts of a prop as one mesh without texture coordinates."""
    parts = [mesh for mesh, _ in prop(split, family, number).parts]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in parts[:-1]])
    faces = [mesh.faces + start for mesh, start in zip(parts, starts, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in parts]), np.concatenate(faces).astype(np.int32))


@lru_cache(maxsize=512)
def surface(split: Split, finish: Surface) -> np.ndarray:
    """The texture (TEXTURE_SIZE, TEXTURE_SIZE, 3), linear RGB, of a finish; less gaudy than props are."""
    rng = asset_rng(split, f"surface/{finish.kind}", finish.asset)
    image = texture(finish.kind, rng, TEXTURE_SIZE)
    luminance = image.mean(axis=2, keepdims=True)
    return MOST_ALBEDO * (luminance + rng.uniform(0.1, 1.0) * (image - luminance))


def radiance(split: Split, number: int) -> np.ndarray:
    """Panorama `number` of a split: (64, 128, 3) linear radiance at the paper's exposure."""
    image = panorama(asset_rng(split, "panorama", number))
    return image * (EXPOSURE_L00 / grey(project_panorama(image))[0])


@lru_cache(maxsize=1024)
def _panorama_light(split: Split, number: int) -> np.ndarray:
    return grey(project_panorama(radiance(split, number)))


def light(split: Split, number: int, angle: float) -> np.ndarray:
    """SH light (9,) of a panorama turned by `angle` radians about +Z, at the paper's exposure."""
    return rotate_z(torch.from_numpy(_panorama_light(split, number)), angle).numpy()
