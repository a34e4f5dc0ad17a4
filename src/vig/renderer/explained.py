"""Explanations drawn: latents of a class before a camera as scenes of the renderer."""

import functools
from dataclasses import fields

import torch

from vig.renderer.drawing import vertex_irradiance
from vig.scene import Camera, Latents, ObjectClass
from vig_renderer.defaults import with_default_settings
from vig_renderer.rendering import render
from vig_renderer.scene import MeshObject, Pinhole, Rendering, Scene
from vig_renderer.shading import smooth_normals
from vig_renderer.topology import Topology


@with_default_settings
def scene_of(latents: Latents, object_class: ObjectClass, camera: Camera, self_shadow: bool = True) -> Scene:
    """Return one explanation (B = 1) before a camera as a scene; vertex colours: albedo times irradiance."""
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
    """Return the latents as tensors, differentiable if they were tensors."""
    return Latents(*(torch.as_tensor(getattr(latents, each.name)) for each in fields(latents)))


@functools.lru_cache(maxsize=8)
def _topology(object_class: ObjectClass) -> Topology:
    return Topology.of(object_class.shape_model.faces, object_class.shape_model.mean)
