"""The user's own meshes as the studio draws them: their materials, some in other colours, lit."""

from dataclasses import dataclass

import numpy as np

from vig.scene.light import COSINE_LOBE, sh_basis
from vig_world.assets.coats import TEXTURES, any_colour, stock_texture
from vig_world.assets.source_meshes import SourceMesh
from vig_world.raster.rasterize import rasterize
from vig_world.raster.view import View
from vig_world.renderers.coated import Appearance, Mirrored, fresnel_of

DARK = 0.06  # albedo up to which a material counts as dark, such as tyres and windows: it mostly stays dark


@dataclass(frozen=True)
class Paint:
    """The materials of a mesh as one image shows them: textures, gloss of each, and whether it is drawn."""

    textures: list[np.ndarray]
    gloss: np.ndarray
    roughness: np.ndarray
    drawn: np.ndarray


def draw_paint(rng: np.random.Generator, mesh: SourceMesh, own: float) -> Paint:
    """Return materials of a mesh, a share `own` of the time as the file has them, else in other colours."""
    count = len(mesh.textures)
    textures, gloss, drawn = [], np.zeros(count), np.ones(count, bool)
    keep = rng.random() < own
    changed = 0.0 if keep else rng.choice([0.3, 0.6, 0.9])
    tint = np.exp(rng.normal(0, 0.25)) * np.exp(rng.normal(0, 0.1, 3))
    # In three of ten images glass lets the inside be seen; in the others it is dark.
    clear = rng.random() < 0.3
    shiny = rng.random()
    for number, texture in enumerate(mesh.textures):
        mean = texture.mean((0, 1))
        dark = mean.max() < DARK
        flat = texture.size == 3
        texture = texture * tint
        # Glass.
        if mesh.opacity[number] < 0.9:
            drawn[number] = not clear
            texture = np.full((1, 1, 3), np.exp(rng.uniform(np.log(0.01), np.log(0.15))), np.float32)
            gloss[number] = rng.uniform(0.5, 2.0)
        else:
            # Few dark materials, such as tyres, get another colour where others do.
            if rng.random() < (0.15 * (changed > 0) if dark else changed):
                if flat:
                    colour = (
                        any_colour(rng) if rng.random() < 0.9 else stock_texture(int(rng.integers(TEXTURES)))
                    )
                    texture = np.broadcast_to(colour, (1, 1, 3)) if colour.ndim == 1 else colour
                else:
                    texture = texture[..., rng.permutation(3)] * np.exp(rng.normal(0, 0.3, 3))
            gloss[number] = rng.choice([0.0, 0.5, 1.0]) if rng.random() < 0.5 else shiny
        textures.append(np.clip(texture, 0.004, 0.95).astype(np.float32))
    if not drawn.any():
        drawn[:] = True
    return Paint(textures, gloss, np.exp(rng.uniform(np.log(0.02), np.log(0.4), count)), drawn)


def appearance(
    mesh: SourceMesh, vertices: np.ndarray, paint: Paint, light: np.ndarray, view: View, mirrored: Mirrored
) -> Appearance:
    """Return how a mesh looks at vertices (V, 3), lit by spherical harmonics (9,) in the world's frame."""
    shown = paint.drawn[mesh.material]
    faces, material = mesh.faces[shown], mesh.material[shown]
    fragments = rasterize(vertices, faces, view.rotation, view.translation, view.camera)
    on = fragments.face >= 0
    face, weights = fragments.face[on], fragments.barycentric[on]
    corners = faces[face]
    point = np.einsum("nk,nkd->nd", weights, vertices[corners])
    normal = np.einsum("nk,nkd->nd", weights, mesh.normals[shown][face])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    towards = view.eye - point
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    facing = np.einsum("nk,nk->n", normal, towards)
    normal = np.where(facing[:, None] < 0, -normal, normal)
    facing = np.abs(facing)
    uv = np.einsum("nk,nkd->nd", weights, mesh.uv[corners])
    albedo = np.empty((len(face), 3), np.float32)
    of_face = material[face]
    for number, texture in enumerate(paint.textures):
        mine = of_face == number
        height, width = texture.shape[:2]
        u, v = uv[mine, 0], 1 - uv[mine, 1]
        albedo[mine] = texture[
            np.floor(v * height).astype(int) % height, np.floor(u * width).astype(int) % width
        ]
    lobes = sh_basis(normal) * np.asarray(COSINE_LOBE)
    colour = albedo * np.maximum(lobes @ light, 0)[:, None]
    radiance = np.empty_like(colour)
    for number in np.unique(of_face):
        mine = of_face == number
        radiance[mine] = mirrored(
            2 * facing[mine, None] * normal[mine] - towards[mine], float(paint.roughness[number])
        )
    fresnel = fresnel_of(facing)[:, None]
    gloss = paint.gloss[of_face][:, None]
    colour = colour * (1 - 0.5 * fresnel * (gloss > 0)) + gloss * fresnel * radiance
    return Appearance(on, colour, normal, albedo)
