"""Renders a scene with the rasteriser."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from vig.scene import ObjectClass, srgb8_from_linear
from vig_world.assets.panoramas.light import mirror
from vig_world.assets.target import target_vertices
from vig_world.dataset.spec import Coat, Placed, Room, SceneSpec
from vig_world.library import Library
from vig_world.raster.draw import Colouring, SurfaceSamples, draw
from vig_world.raster.items import Item, Target
from vig_world.raster.picture import Picture
from vig_world.raster.view import View
from vig_world.renderers.coated import colour_points


def render(
    library: Library,
    spec: SceneSpec,
    object_class: ObjectClass,
    view: View | None = None,
    normals: bool = False,
) -> Picture:
    """Render a scene with the rasteriser, 150 x 150 or as another view of the object's frame; see `draw`."""
    vertices = target_vertices(spec, object_class)
    target = Target.of(object_class, vertices, spec.shape, spec.albedo, spec.light)
    view = View.of_scene(spec, object_class) if view is None else view
    colouring = None if spec.coat is None else _colour_object(library, spec, spec.coat, object_class, view)
    return draw(
        items_of(library, spec.props, spec.room, finished=True), target, view, spec.light, colouring, normals
    )


def _colour_object(
    library: Library, spec: SceneSpec, coat: Coat, object_class: ObjectClass, view: View
) -> Colouring:
    """Return the object's colours, of its coat in the scene's light."""
    mirrored = mirror(library.radiance(spec.panorama), spec.panorama_angle, library.ground_albedo(spec.room))

    def colouring(at: SurfaceSamples) -> np.ndarray:
        model, eye = object_class.shape_model, view.eye
        return colour_points(coat, model, at.points, at.normals, at.irradiance, at.vertices, eye, mirrored)[0]

    return colouring


def with_surroundings(picture: Picture, library: Library, spec: SceneSpec, view: View) -> Picture:
    """Return the picture with the scene's panorama where there is nothing, such as behind a window, as a path
    tracer has it.

    In the square that scenes are composed for there is something everywhere.
    """
    rows, columns = np.nonzero(~np.isfinite(picture.depth))
    if not len(rows):
        return picture
    camera = view.camera
    x, y = (columns + 0.5 - camera.cx) / camera.focal, (rows + 0.5 - camera.cy) / camera.focal
    rays = np.column_stack([x, y, np.ones_like(x)]) @ view.rotation
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    radiance = library.radiance(spec.panorama)
    arriving = mirror(radiance, spec.panorama_angle, library.ground_albedo(spec.room))(rays, 0.0)
    image = picture.image.copy()
    image[rows, columns] = srgb8_from_linear(arriving)
    return replace(picture, image=image)


def items_of(
    library: Library, props: Iterable[Placed], room: Room | None = None, finished: bool = False
) -> list[Item]:
    """Return a furnished room, where there is one, and props: owners 0, 1, 2 ...

    finished: Whether the room is covered as its finishes say.
    """
    items = []
    if room is not None:
        covers = room.finishes if finished else ()
        finishes = {slot: (library.pyramid(each.kind, each.asset), each.metres) for slot, each in covers}
        pose = (room.rotation(), np.array(room.origin))
        items.append(Item(library.plan(room.layout).packed, *pose, finishes=finishes, is_support=True))
    for number, placed in enumerate(props, 1):
        packed = library.pack_prop(placed.family, placed.asset)
        items.append(Item(packed, placed.matrix(), np.array(placed.position), number))
    return items
