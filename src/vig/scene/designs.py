"""Designs held out of a class's shape model: the objects of validation and test scenes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import torch

if TYPE_CHECKING:
    from vig.scene.object_class import ObjectClass

NO_DESIGN = -1


@dataclass(frozen=True, eq=False)
class HeldOutDesigns:
    """D shapes in correspondence with a class's model, which was not made from them.

    names: (D,) of each. splits: (D,) the only split of datasets whose objects are of this design. vertices:
    (D, V, 3) float32, metres, standing on z = 0.
    """

    names: tuple[str, ...]
    splits: tuple[str, ...]
    vertices: np.ndarray

    def numbers(self, split: str) -> list[int]:
        """The numbers of a split's designs."""
        return [number for number, of in enumerate(self.splits) if of == split]


def shape_vertices(coefficients: np.ndarray, design: int, object_class: ObjectClass) -> np.ndarray:
    """Vertices (V, 3) float32 at coefficients (K,), plus a held-out design's deviation from the model.

    design: its number in `object_class.designs`, or `NO_DESIGN`.
    """
    return _vertices(tuple(np.asarray(coefficients).tolist()), design, object_class)


@lru_cache(maxsize=8)
def _vertices(coefficients: tuple[float, ...], design: int, object_class: ObjectClass) -> np.ndarray:
    model = object_class.shape_model
    vertices = model.vertices(torch.tensor([coefficients], dtype=torch.float32))[0].numpy()
    if design != NO_DESIGN:
        vertices = vertices + nearest_shape(object_class, design)[1]
        vertices[:, 2] -= vertices[:, 2].min()
    vertices.setflags(write=False)
    return vertices


@lru_cache(maxsize=64)
def nearest_shape(object_class: ObjectClass, design: int) -> tuple[np.ndarray, np.ndarray]:
    """The model's coefficients (K,) nearest to a held-out design, and what it deviates by, (V, 3) float32."""
    designs, model = object_class.designs, object_class.shape_model
    if designs is None or not 0 <= design < len(designs.vertices):
        count = 0 if designs is None else len(designs.vertices)
        raise ValueError(
            f"expected one of the {count} held-out designs of '{object_class.name}'; got {design}"
        )
    vertices = designs.vertices[design]
    coefficients = model.coefficients(vertices[None])
    nearest = model.vertices(torch.from_numpy(coefficients))[0].numpy()
    return coefficients[0], (vertices - nearest).astype(np.float32)
