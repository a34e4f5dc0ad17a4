"""Renders a scene with the rasteriser."""

from __future__ import annotations

import numpy as np
import torch

from vig.renderer.explained import vertex_irradiance
from vig.scene import Latents, ObjectClass
from vig_world.assets.panoramas.mirror import mirror
from vig_world.assets.target import target_vertices
from vig_world.dataset.spec import Coat, SceneSpec
from vig_world.library import Library
from vig_world.mesh import vertex_normals
from vig_world.renderers.coated import appearance_of
from vig_world.renderers.picture import Picture
from vig_world.renderers.raster import Item, Target, draw
from vig_world.renderers.raster.draw import SAMPLES
from vig_world.renderers.view import View


def render(library: Library, spec: SceneSpec, object_class: ObjectClass) -> Picture:
    """Render a scene with the rasteriser, 150 x 150; see `draw`."""
    vertices = target_vertices(spec, object_class)
    target = Target.of(object_class, vertices, spec.shape, spec.albedo, spec.light)
    view = View.of_scene(spec, object_class)
    colour = None if spec.coat is None else _coated(library, spec, spec.coat, object_class, vertices, view)
    return draw(items_of(library, spec), target, view, spec.light, colour)


def _coated(
    library: Library, spec: SceneSpec, coat: Coat, object_class: ObjectClass, vertices: np.ndarray, view: View
) -> np.ndarray:
    """Mean colour (H, W, 3) of the object at each pixel, of its coat in the scene's light."""
    model = object_class.shape_model
    latents = Latents.from_vector(torch.from_numpy(spec.latents())[None])
    normals = torch.from_numpy(vertex_normals(vertices, model.faces)).float()
    irradiance = vertex_irradiance(latents, normals, object_class).numpy()
    mirrored = mirror(library.radiance(spec.panorama), spec.panorama_angle, library.ground_albedo(spec.room))
    finer = view.scaled(SAMPLES)
    look = appearance_of(coat, model, vertices, model.faces, irradiance, finer, mirrored)
    colour, _ = look.averaged(SAMPLES)
    return colour


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
