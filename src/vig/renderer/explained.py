"""Explanations drawn: latents of a class before a camera as scenes of the renderer."""

from __future__ import annotations

import functools
from dataclasses import fields

import torch

from vig.scene import Camera, Latents, ObjectClass
from vig.scene.light import COSINE_LOBE, sh_basis
from vig_renderer.defaults import with_default_settings
from vig_renderer.rendering import render
from vig_renderer.scene import MeshObject, Pinhole, Rendering, Scene
from vig_renderer.shading import smooth_normals
from vig_renderer.topology import Topology


def vertex_irradiance(
    latents: Latents, normals: torch.Tensor, object_class: ObjectClass, self_shadow: bool = True
) -> torch.Tensor:
    """Irradiance of the vertices, Eq. 1, with self-shadowing and interreflection where the class has a table.

    For one explanation (B = 1) and unit normals (V, 3) in the world frame: (V,), what a surface of albedo 1
    reflects, not below 0; less where the class's `reflectance` says so. The table is `ObjectClass.transfer`;
    without `self_shadow` it is left out.
    """
    latents = _tensors(latents)
    lobes = sh_basis(normals) * normals.new_tensor(COSINE_LOBE)
    if self_shadow and object_class.transfer is not None:
        transfer = torch.from_numpy(object_class.transfer).to(normals)
        lobes = lobes + torch.einsum("k,kvl->vl", latents.shape[0].to(normals), transfer[1:]) + transfer[0]
    reflectance = torch.from_numpy(object_class.reflectance).to(normals)
    shade: torch.Tensor = reflectance * (lobes @ latents.light[0].to(normals)).clamp_min(0.0)
    return shade


@with_default_settings
def scene_of(latents: Latents, object_class: ObjectClass, camera: Camera, self_shadow: bool = True) -> Scene:
    """One explanation (B = 1) before a camera as a scene: vertex colours are albedo times irradiance."""
    latents = _tensors(latents)
    vertices = object_class.shape_model.vertices(latents.shape)[0]
    topology = _topology(object_class)
    normals = smooth_normals(vertices, topology.faces)
    shade = vertex_irradiance(latents, normals, object_class, self_shadow)
    colours = latents.albedo[0].to(shade) * shade[:, None]
    eye = Pinhole.on_sphere(camera, latents.azimuth[0].to(shade), latents.elevation[0].to(shade))
    return Scene([MeshObject(vertices, topology, colours, normals=normals)], eye)


@with_default_settings
def render_latents(
    latents: Latents, object_class: ObjectClass, camera: Camera, self_shadow: bool = True, samples: int = 1
) -> Rendering:
    """Draw B explanations, a picture each; see `render`."""
    latents, count = _tensors(latents), len(latents)
    scenes = [
        scene_of(latents[index : index + 1], object_class, camera, self_shadow) for index in range(count)
    ]
    return render(scenes, samples=samples)


def _tensors(latents: Latents) -> Latents:
    """The same as tensors, which may be differentiated if they were ones."""
    return Latents(*(torch.as_tensor(getattr(latents, each.name)) for each in fields(latents)))


@functools.lru_cache(maxsize=8)
def _topology(object_class: ObjectClass) -> Topology:
    return Topology.of(object_class.shape_model.faces, object_class.shape_model.mean)
