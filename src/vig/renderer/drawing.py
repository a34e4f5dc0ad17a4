"""Explanations drawn in arrays, by the native library alone; `vig.renderer.explained` is differentiable."""

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from vig.parallel import thread_count
from vig.scene import Camera, Latents, ObjectClass
from vig.scene.functions import numpy_of_tensor
from vig.scene.light import COSINE_LOBE, sh_basis
from vig_native import engine
from vig_renderer import NEAR
from vig_renderer.arrays import Array, like
from vig_renderer.defaults import with_default_settings
from vig_renderer.edges import edges_of, smooth_normals, weld_vertices


@dataclass(frozen=True, eq=False)
class Drawn:
    """A picture of H x W pixels.

    Attributes:
        rgb: (H, W, 3) linear.
        coverage: (H, W) the share of a pixel that the mesh covers.
        depth: (H, W) metres along the optical axis, inf where nothing is.
        normals: (H, W, 3) unit, world frame, 0 where nothing is.
        triangle_id: (H, W) int32, the face that is seen, or -1.
    """

    rgb: np.ndarray
    coverage: np.ndarray
    depth: np.ndarray
    normals: np.ndarray
    triangle_id: np.ndarray


def vertex_irradiance(
    latents: Latents, normals: Array, object_class: ObjectClass, self_shadow: bool = True
) -> Array:
    """Return vertices' irradiance, Eq. 1, with self-shadowing and interreflection if the class has a table.

    For one explanation (B = 1) and unit normals (V, 3) in the world frame: (V,), light that albedo 1
    reflects, not below 0; less by the class's `reflectance`. The table is `ObjectClass.transfer`;
    without `self_shadow` it is left out. Arrays or tensors, of the normals' dtype.
    """
    lobes = sh_basis(normals) * like(normals, COSINE_LOBE)
    if self_shadow and object_class.transfer is not None:
        transfer, shape = like(normals, object_class.transfer), like(normals, latents.shape[0])
        moved = (shape @ transfer[1:].reshape(len(shape), -1)).reshape(lobes.shape)
        lobes = lobes + (moved + transfer[0])
    shade = (lobes @ like(normals, latents.light[0])).clip(0.0, None)
    return like(normals, object_class.reflectance) * shade


@with_default_settings
def draw_latents(latents: Latents, object_class: ObjectClass, camera: Camera, samples: int = 1) -> Drawn:
    """Draw one explanation (B = 1), of arrays or tensors; samples x samples points a pixel."""
    latents = Latents.from_vector(numpy_of_tensor(latents.to_vector()))
    vertices = object_class.shape_model.vertices(latents.shape.astype(np.float32))[0]
    normals = smooth_normals(vertices, object_class.shape_model.faces)
    shade = vertex_irradiance(latents, normals, object_class)
    colours = latents.albedo[0].astype(np.float32) * shade[:, None]
    rotation, translation = camera.pose(latents.azimuth, latents.elevation)
    pose = rotation[0], translation[0], (camera.focal, camera.focal_y or camera.focal), (camera.cx, camera.cy)
    return draw_mesh(
        _mesh(object_class), vertices, normals, colours, pose, camera.width, camera.height, samples
    )


def draw_mesh(
    mesh: Any,
    vertices: np.ndarray,
    normals: np.ndarray | None,
    colours: np.ndarray,
    camera: tuple[Any, Any, Any, Any],
    width: int,
    height: int,
    samples: int = 1,
) -> Drawn:
    """Draw a mesh of `mesh_of` in the colours (V, 3) or (3,) of its vertices.

    camera: camera_from_world rotation (3, 3) and translation (3,), focal lengths (2,) and principal point
    (2,) in pixels.
    """
    given = vertices, None, None, normals, colours, None, None, None, *camera, None, None
    inputs = [None if each is None else np.ascontiguousarray(each, np.float32) for each in given]
    size, threads = (1, height, width), thread_count()
    scenes = engine.Scenes32([mesh], [None], [0], [0, 1], height, width, samples, NEAR, 1, False)
    points = np.empty((len(vertices), 3), np.float32)
    # 9: numbers of a vertex: normal, albedo, reflected light
    attributes = np.empty((len(vertices), 9), np.float32)
    rgb, coverage = np.empty((*size, 3), np.float32), np.empty(size, np.float32)
    if not scenes.place([inputs], points, attributes, threads):
        raise ValueError("what is drawn must be finite; got NaN or infinity")
    background, visible = np.zeros((1, 3), np.float32), np.empty((1, 1, height, width), np.float32)
    scenes.paint(background, rgb, coverage, visible, threads)
    if samples > 1:
        scenes = engine.Scenes32([mesh], [None], [0], [0, 1], height, width, 1, NEAR, 1, False)
        scenes.bind(points, attributes)
        scenes.find(False, threads)
    depth, seen_normals = np.empty(size, np.float32), np.empty((*size, 3), np.float32)
    object_id, triangle_id = (np.empty(size, np.int32) for _ in range(2))
    scenes.surface(depth, seen_normals, object_id, triangle_id)
    return Drawn(rgb[0], coverage[0], depth[0], seen_normals[0], triangle_id[0])


def mesh_of(faces: np.ndarray, vertices: np.ndarray | None = None) -> Any:
    """Return faces (F, 3) and their edges in the native library, as `vig_renderer.Topology.of` finds them.

    vertices: (V, 3); without them there are no edges, which `Drawn.triangle_id` does not need.
    """
    corners = np.ascontiguousarray(faces, np.int32)
    edges, count = np.zeros((0, 6), np.int32), int(corners.max(initial=-1)) + 1
    if vertices is not None:
        edges, count = edges_of(weld_vertices(vertices)[corners] if len(corners) else corners), len(vertices)
    return engine.mesh(corners, corners, np.ascontiguousarray(edges), count)


@functools.lru_cache(maxsize=8)
def _mesh(object_class: ObjectClass) -> Any:
    return mesh_of(object_class.shape_model.faces, object_class.shape_model.mean)
