"""Blender's materials from the plain numbers of a scene's header."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np


def pictures(arrays: dict[str, np.ndarray]) -> dict[str, bpy.types.Image]:
    """Return every array `texture_*` as an image."""
    return {name: float_image(name, array) for name, array in arrays.items() if name.startswith("texture_")}


def float_image(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """Return linear RGB (H, W, 3), row 0 on top, as an image of Blender, used as it is."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    return image


def make(
    name: str, about: dict[str, Any], images: dict[str, bpy.types.Image], one_sided: bool
) -> bpy.types.Material:
    """Return a material as `vig_world.renderers.cycles.appearance` has it; one-sided ones have no back."""
    result = bpy.data.materials.new(name)
    result.use_nodes = True
    result.cycles.emission_sampling = "NONE"  # panes and shades are large and dim: to aim at them adds noise
    nodes, links = result.node_tree.nodes, result.node_tree.links
    nodes.clear()
    lambertian = about["lambertian"]
    shader = nodes.new("ShaderNodeBsdfDiffuse" if lambertian else "ShaderNodeBsdfPrincipled")
    colour = shader.inputs["Color" if lambertian else "Base Color"]
    if about["texture"] is None:
        colour.default_value = (*about["colour"], 1.0)
    else:
        picture = nodes.new("ShaderNodeTexImage")
        picture.image = images[about["texture"]]
        links.new(picture.outputs["Color"], colour)
        if about["relief"] > 0:
            bump = nodes.new("ShaderNodeBump")
            bump.inputs["Distance"].default_value = about["relief"]
            links.new(picture.outputs["Color"], bump.inputs["Height"])
            links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    shader.inputs["Roughness"].default_value = about["roughness"]
    if not lambertian:
        for key, value in about["principled"].items():
            shader.inputs[key].default_value = value
        shader.inputs["Emission Strength"].default_value = about["emission"]
        glow = shader.inputs["Emission Color"]
        glow.default_value = colour.default_value
        if colour.is_linked and about["emission"] > 0:
            links.new(picture.outputs["Color"], glow)
    surface = shader.outputs["BSDF"]
    if one_sided:
        nothing, mix = nodes.new("ShaderNodeBsdfTransparent"), nodes.new("ShaderNodeMixShader")
        links.new(nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], mix.inputs["Fac"])
        links.new(surface, mix.inputs[1])
        links.new(nothing.outputs["BSDF"], mix.inputs[2])
        surface = mix.outputs["Shader"]
    links.new(surface, nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return result
