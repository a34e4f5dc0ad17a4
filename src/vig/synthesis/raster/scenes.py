"""A spec as a picture."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from vig.scene import ObjectClass
from vig.synthesis import assets
from vig.synthesis.picture import Picture
from vig.synthesis.props.material import Material
from vig.synthesis.raster.draw import draw
from vig.synthesis.raster.items import Item, Target
from vig.synthesis.raster.packed import Packed
from vig.synthesis.room import room_meshes
from vig.synthesis.spec import SceneSpec, Split
from vig.synthesis.view import View


def render(spec: SceneSpec, object_class: ObjectClass) -> Picture:
    """The raster tier's picture of a scene, 150 x 150; see `draw`."""
    parts = []
    for _, mesh, finish in room_meshes(spec.room):
        texture = assets.surface(spec.split, finish)
        parts.append((mesh, Material(texture, finish.kind, 0.6)))
    here = np.eye(3), np.zeros(3)
    items = [Item(Packed.of(parts), *here, is_support=True)]
    for number, placed in enumerate(spec.props):
        rotation = Rotation.from_rotvec(placed.rotation).as_matrix()
        packed = _prop(spec.split, placed.family, placed.asset)
        items.append(Item(packed, rotation, np.array(placed.position), number + 1))
    target = Target.of(object_class, spec.shape, spec.albedo, spec.light)
    view = View.of(object_class, spec.azimuth, spec.elevation)
    return draw(items, target, view, spec.light)


@lru_cache(maxsize=4096)
def _prop(split: Split, family: str, number: int) -> Packed:
    return Packed.of(assets.prop(split, family, number).parts)
