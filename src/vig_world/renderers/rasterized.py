"""Renders a scene with the rasteriser."""

from __future__ import annotations

import numpy as np

from vig.dataset.spec import SceneSpec
from vig.scene import ObjectClass
from vig_world.assets.target import target_vertices
from vig_world.library import Library
from vig_world.renderers.picture import Picture
from vig_world.renderers.raster import Item, Target, draw
from vig_world.renderers.view import View


def render(library: Library, spec: SceneSpec, object_class: ObjectClass) -> Picture:
    """Render a scene with the rasteriser, 150 x 150; see `draw`."""
    vertices = target_vertices(spec, object_class)
    target = Target.of(object_class, vertices, spec.shape, spec.albedo, spec.light)
    view = View.of(object_class, spec.azimuth, spec.elevation)
    return draw(items_of(library, spec), target, view, spec.light)


def items_of(library: Library, spec: SceneSpec) -> list[Item]:
    """The furnished room, covered as the spec says, and the props: owners 0, 1, 2 ..."""
    finishes = {
        slot: (library.pyramid(finish.kind, finish.asset), finish.metres)
        for slot, finish in spec.room.finishes
    }
    room = library.packed_layout(spec.room.layout)
    pose = (spec.room.rotation(), np.array(spec.room.origin))
    items = [Item(room, *pose, finishes=finishes, is_support=True)]
    for number, placed in enumerate(spec.props):
        packed = library.packed(placed.family, placed.asset)
        items.append(Item(packed, placed.matrix(), np.array(placed.position), number + 1))
    return items
