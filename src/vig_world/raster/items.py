"""The contents of a picture: assets with their poses, and the object."""

from __future__ import annotations

import functools
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from vig.scene import ObjectClass
from vig.scene.light import COSINE_LOBE, Y00, Y1, Y2, Y20
from vig_world.raster.native import workspace
from vig_world.raster.packed import PackedAsset, assembled
from vig_world.raster.pyramid import TextureLevels
from vig_world.raster.records import CLUSTER, FINISH, ITEM, PART, TARGET, address

HARMONICS = np.array([Y00, Y1, Y1, Y1, Y2, Y2, Y20, Y2, Y2 / 2], np.float64)
"""What each polynomial of the basis is multiplied by, see `vig.scene.light.sh_basis`."""


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


@dataclass(frozen=True, eq=False)
class Target:
    """The object at the origin, shaded per vertex as the model does.

    Attributes:
        packed: Its geometry, with the irradiance of each vertex.
        vertices: (V, 3) float32 metres.
        albedo: (3,).
    """

    packed: PackedAsset
    vertices: np.ndarray
    albedo: np.ndarray

    @staticmethod
    def of(
        object_class: ObjectClass,
        vertices: np.ndarray,
        shape: ArrayLike,
        albedo: ArrayLike,
        light: ArrayLike,
    ) -> Target:
        """The object (V, 3) near the model's shape (K,), of albedo (3,) linear RGB, in SH light (9,).

        Its colour at a vertex is albedo * max(0, sum_l L_l (A_l Y_l(n) + transfer_l)): with self-shadow and
        interreflection where the class has them (`ObjectClass.transfer`).
        """
        template = _template(object_class)
        vertices = np.ascontiguousarray(vertices, np.float32)
        added = None
        if object_class.transfer is not None and np.any(light):
            table = object_class.transfer
            weights = np.append(1.0, shape).astype(np.float32)
            change = (weights @ table.reshape(len(table), -1)).reshape(-1, table.shape[2])
            added = change @ np.asarray(light, np.float32)
        data = template.data.copy()
        record = workspace.record("target", TARGET)
        record["asset"], record["vertices"] = address(data), address(vertices)
        record["added"] = 0 if added is None else address(added)
        record["irradiance"] = np.asarray(light) * COSINE_LOBE * HARMONICS
        workspace.launch("light", "target")
        return Target(replace(template, data=data), vertices, np.asarray(albedo, np.float32))


ANYWHERE = 1e6
"""Metres: the radius of a sphere that is always in the frame."""


@functools.lru_cache(maxsize=4)
def _template(object_class: ObjectClass) -> PackedAsset:
    """The object's asset, yet without shape and light."""
    count, faces = len(object_class.shape_model.mean), object_class.shape_model.faces
    part = np.zeros(1, PART)
    part["vertices"], part["faces"], part["slot"] = (0, count), (0, len(faces)), -1
    part["clusters"] = 0, 1
    whole = np.array([((0, 0, 0, ANYWHERE), (0, count), (0, len(faces)))], CLUSTER)
    blocks = {
        "clusters": whole,
        "positions": np.zeros((3, count), np.float32),
        "attributes": np.zeros((count, 5), np.float32),
        "corners": np.ascontiguousarray(faces, np.int32),
        "points": np.zeros((count, 4), np.float32),
        "texels": np.zeros(1, np.uint32),
    }
    return PackedAsset(assembled(part, (0, 0, 0, 0), blocks), (1, count, len(faces)), ())


_ROW = struct.Struct("=12d2q4i")
"""An ITEM, field by field."""
assert _ROW.size == ITEM.itemsize
_AT_ORIGIN = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def item_table(items: Sequence[Item], target: Target | None) -> tuple[np.ndarray, list[np.ndarray]]:
    """The ITEM records (N,) of a target, if any, and items; and the arrays that must outlive them."""
    arrays: list[np.ndarray] = []
    rows = [] if target is None else [_ROW.pack(*_AT_ORIGIN, target.packed.address, 0, 0, 1, 0, 0)]
    for item in items:
        finishes = 0
        if item.finishes and item.packed.slots:
            arrays.append(_finishes(item))
            finishes = address(arrays[-1])
        pose = (*item.rotation.ravel().tolist(), *item.translation.tolist())
        rows.append(_ROW.pack(*pose, item.packed.address, finishes, item.owner, 0, item.is_support, 0))
    return np.frombuffer(bytearray().join(rows), ITEM), arrays


def _finishes(item: Item) -> np.ndarray:
    finishes = np.zeros(len(item.packed.slots), FINISH)
    for row, slot in zip(finishes, item.packed.slots, strict=True):
        if slot in item.finishes:
            pyramid, metres = item.finishes[slot]
            row["texels"], row["log_size"] = address(pyramid.texels), pyramid.log_size
            row["repeats"] = 1 / metres
    return finishes
