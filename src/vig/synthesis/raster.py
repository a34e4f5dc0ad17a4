"""The raster tier: a scene as an image, rasterised and shaded with its nine light coefficients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from vig.render import rasterize
from vig.scene import IMAGE_SIZE, Mesh, ObjectClass, irradiance, srgb8_from_linear
from vig.synthesis.build import Instance, build
from vig.synthesis.picture import CANVAS, Picture
from vig.synthesis.shadow import ground_shade
from vig.synthesis.spec import SceneSpec
from vig.synthesis.texturing import sample_texture
from vig.synthesis.view import View

SUPERSAMPLING = 2
NEAR = 0.02
"""Metres; surfaces of the room are cut off here."""


def render(spec: SceneSpec, object_class: ObjectClass) -> Picture:
    """Render a scene at 300 x 300 and average to 150 x 150 in linear light.

    The object is shaded exactly as the model does: per vertex, albedo times `irradiance`, no shadows on it.
    Everything else has textures and interpolated normals; the surface that things stand on is darker
    under them. Clipped to [0, 1].
    """
    view = View.of(object_class, spec.azimuth, spec.elevation, IMAGE_SIZE * SUPERSAMPLING)
    instances = [_clipped(instance, view) for instance in build(spec, object_class)]
    linear, owner, depth = _shade(spec, instances, view)
    target = instances[0].mesh
    whole = _samples(np.isfinite(view.widened(CANVAS).depth(target.vertices, target.faces)))
    half = SUPERSAMPLING**2 / 2
    canvas = np.add.reduce(whole, dtype=np.uint8) >= half
    room = np.array([i.name != "target" and not i.name.startswith("prop") for i in instances] + [False])
    behind_room = np.add.reduce(_samples(room[owner]), dtype=np.uint8) >= half
    amodal = canvas[IMAGE_SIZE : 2 * IMAGE_SIZE, IMAGE_SIZE : 2 * IMAGE_SIZE]
    return Picture(
        image=srgb8_from_linear(np.add.reduce(_samples(linear)) / SUPERSAMPLING**2),
        depth=np.minimum.reduce(_samples(depth)),
        amodal=amodal,
        visible=np.add.reduce(_samples(owner == 0), dtype=np.uint8) >= half,
        by_support=amodal & behind_room,
        canvas=canvas,
        light=np.array(spec.light, np.float32),
    )


def _samples(image: np.ndarray) -> list[np.ndarray]:
    """The images (H, W, ...) of each of a pixel's samples."""
    offsets = range(SUPERSAMPLING)
    return [image[row::SUPERSAMPLING, column::SUPERSAMPLING] for row in offsets for column in offsets]


def _shade(
    spec: SceneSpec, instances: list[Instance], view: View
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Linear colours (H, W, 3), which instance is seen (H, W; -1 none), and depth (H, W) metres."""
    meshes = [instance.mesh for instance in instances]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    owners = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    fragments = rasterize(vertices, faces, view.rotation, view.translation, view.camera, cull=True)

    seen = np.nonzero(fragments.face.ravel() >= 0)[0]
    face = fragments.face.ravel()[seen]
    order = np.argsort(face, kind="stable")  # pixels of one instance come together
    seen, face = seen[order], face[order]
    owner = owners[face]
    bounds = np.searchsorted(owner, np.arange(len(instances) + 1))
    corners = faces[face]
    weights = np.take(fragments.barycentric.reshape(-1, 3), seen, axis=0)
    depth = fragments.depth.ravel()[seen]

    shown = np.zeros(len(vertices), bool)
    shown[corners] = True
    normals = np.concatenate([instance.normals for instance in instances])[shown].astype(np.float32)
    attributes = np.empty((len(vertices), 3), np.float32)
    attributes[:, :2] = np.concatenate([mesh.uv for mesh in meshes])
    light = torch.tensor(spec.light, dtype=torch.float32)
    attributes[shown, 2] = irradiance(light, torch.from_numpy(normals)).numpy()
    values = _interpolated(attributes, corners, weights)

    colours = np.empty((len(seen), 3), np.float32)
    solids = [instance for instance in instances if instance.is_target or instance.name.startswith("prop")]
    for instance, start, end in zip(instances, bounds[:-1], bounds[1:], strict=True):
        if start == end:
            continue
        part = slice(start, end)
        texels = instance.texels * depth[part] / view.camera.focal
        colours[part] = sample_texture(instance.texture, values[part, :2], texels)
        if instance.name == ("table" if spec.room.table else "floor"):
            ground = _interpolated(vertices[:, :2], corners[part], weights[part])
            values[part, 2] *= ground_shade(solids, ground, np.array(spec.light))
    colours *= values[:, 2:]
    linear = np.zeros((fragments.face.size, 3), np.float32)
    linear[seen] = colours.clip(0.0, 1.0)
    owner_image = np.full(fragments.face.size, -1, np.int32)
    owner_image[seen] = owner
    size = fragments.face.shape
    return linear.reshape(*size, 3), owner_image.reshape(size), fragments.depth


def _interpolated(attributes: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Attributes (V, C) at N pixels: (N, C), given their faces' corners (N, 3) and weights (N, 3)."""
    values = np.take(attributes, corners[:, 0], axis=0) * weights[:, :1]
    values += np.take(attributes, corners[:, 1], axis=0) * weights[:, 1:2]
    values += np.take(attributes, corners[:, 2], axis=0) * weights[:, 2:]
    return values


def _clipped(instance: Instance, view: View) -> Instance:
    """The instance without what lies behind or too near the eye; only surfaces of the room reach there."""
    mesh = instance.mesh
    ahead = (mesh.vertices - view.eye) @ view.forward - NEAR
    if (ahead >= 0).all():
        return instance
    attributes = np.concatenate([mesh.vertices, mesh.uv, instance.normals], axis=1)
    polygons = [_cut(attributes[face], ahead[face]) for face in mesh.faces]
    polygons = [polygon for polygon in polygons if len(polygon) >= 3]
    starts = np.cumsum([0] + [len(polygon) for polygon in polygons])
    faces = [
        [start, start + k, start + k + 1]
        for start, polygon in zip(starts, polygons, strict=False)
        for k in range(1, len(polygon) - 1)
    ]
    kept = np.concatenate([*polygons, attributes[:0]])
    clipped = Mesh(
        kept[:, :3].astype(np.float32),
        np.array(faces, np.int32).reshape(-1, 3),
        kept[:, 3:5].astype(np.float32),
    )
    return replace(instance, mesh=clipped, normals=kept[:, 5:])


def _cut(polygon: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """The part of a convex polygon (N, C) where `ahead` (N,), linear over it, is not negative."""
    kept = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if ahead[i] >= 0:
            kept.append(polygon[i])
        if (ahead[i] >= 0) != (ahead[j] >= 0):
            t = ahead[i] / (ahead[i] - ahead[j])
            kept.append(polygon[i] + t * (polygon[j] - polygon[i]))
    return np.array(kept).reshape(-1, polygon.shape[1])
