"""The contents of a picture: assets with their poses, and the object."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vig.scene import ObjectClass
from vig.scene.light import COSINE_LOBE, Y00, Y1, Y2, Y20
from vig_native import engine
from vig_world.raster.packed import PackedAsset
from vig_world.raster.pyramid import TextureLevels

HARMONICS = np.array([Y00, Y1, Y1, Y1, Y2, Y2, Y20, Y2, Y2 / 2], np.float64)
"""Factor of each polynomial of the basis, see `vig.scene.light.sh_basis`."""


@dataclass(frozen=True, eq=False)
class Item:
    """An asset in the world.

    Attributes:
        rotation: (3, 3), world from the asset's frame.
        translation: (3,), metres.
        owner: Number that `depth` gives its pixels, 0 or more.
        finishes: Texture and metres per repeat of each slot of the asset; slots without one show their own
            texture.
        is_support: Room and furniture, which cast no shadow map and count as support where they hide the
            object; other items are props.
    """

    packed: PackedAsset
    rotation: np.ndarray
    translation: np.ndarray
    owner: int = 0
    finishes: Mapping[str, tuple[TextureLevels, float]] = field(default_factory=dict)
    is_support: bool = False

    @cached_property
    def native(self) -> Any:
        """Return the same item in the native library."""
        finishes: list[tuple[np.ndarray, tuple[int, int], float] | None] = []
        for slot in self.packed.slots if self.finishes else ():
            levels, metres = self.finishes.get(slot, (None, 1.0))
            finishes.append(None if levels is None else (levels.texels, levels.log_size, 1 / metres))
        pose = (np.ascontiguousarray(array, np.float64) for array in (self.rotation, self.translation))
        return engine.item(self.packed.native, *pose, self.owner, self.is_support, finishes)


@dataclass(frozen=True, eq=False)
class Target:
    """The object at the origin, shaded per vertex as the model does.

    Attributes:
        packed: Its geometry, with the irradiance of each vertex.
        vertices: (V, 3) float32 metres.
        albedo: (3,) float32.
    """

    packed: PackedAsset
    vertices: np.ndarray
    albedo: np.ndarray

    @staticmethod
    def of(
        object_class: ObjectClass, vertices: np.ndarray, shape: ArrayLike, albedo: ArrayLike, light: ArrayLike
    ) -> "Target":
        """Return the object (V, 3) near the model's shape (K,), of albedo (3,) linear RGB, in SH light (9,).

        Its colour at a vertex is albedo * max(0, sum_l L_l (A_l Y_l(n) + transfer_l)): with self-shadow and
        interreflection where the class has them (`ObjectClass.transfer`).
        """
        vertices, coefficients = np.ascontiguousarray(vertices, np.float32), np.asarray(light)
        added = None
        if object_class.transfer is not None and coefficients.any():
            table = object_class.transfer
            weights = np.append(1.0, shape).astype(np.float32)
            change = (weights @ table.reshape(len(table), -1)).reshape(-1, table.shape[2])
            added = np.ascontiguousarray(change @ coefficients.astype(np.float32), np.float32)
        irradiance = (coefficients * COSINE_LOBE * HARMONICS).astype(np.float32)
        faces = np.ascontiguousarray(object_class.shape_model.faces, np.int32)
        packed = PackedAsset(engine.lit_asset(faces, vertices, added, irradiance), ())
        return Target(packed, vertices, np.asarray(albedo, np.float32))

    @cached_property
    def native(self) -> Any:
        """Return the same object in the native library."""
        return Item(self.packed, np.eye(3), np.zeros(3)).native
