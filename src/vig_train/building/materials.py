"""A class's dark part: one that the materials of most of its meshes make dark."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from vig_train.building.surface import neighbour_mean, vertex_areas
from vig_world.assets.source_meshes import SourceMesh
from vig_world.mesh import face_normals

SAMPLES = 60_000  # points on a mesh at which its material is looked up
NEAREST = 5  # number of nearest points that decide on a vertex of the template
GLASS_RATIO = 0.15  # luminance over the body's that glass counts as: something dark is seen through it
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # weights of linear RGB (BT.709)
BODY_SHARE = 0.6
"""Share of the surface, from the darkest on, at whose end is the luminance that others are compared with."""


def dark_part(
    meshes: Sequence[SourceMesh], vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, float] | None:
    """Return which template vertices (V,) bool are dark on most meshes, and their relative reflectance.

    Args:
        meshes: In the class's frame; the template lies on each.
        vertices: (V, 3) of the template.
        faces: (F, 3) of the template.

    Returns:
        None where nothing, too little or most of the surface is dark, or too few meshes have materials.
    """
    # Two meshes with materials are too few for a class; one is enough for a class made of it alone.
    if not meshes or 1 < len(meshes) < 3:
        return None
    areas = vertex_areas(vertices, faces)
    ratios = np.stack([_ratios(mesh, areas) for mesh in meshes])
    dark_ratio = 0.4  # a place is dark from this share of the luminance at `BODY_SHARE` down
    # Averaged with its neighbours', so that a part has no holes.
    dark_share = neighbour_mean(faces, len(vertices)) @ (ratios < dark_ratio).mean(0)
    # A vertex belongs to the dark part that is dark on .6 of the meshes.
    dark = dark_share >= 0.6
    share = areas[dark].sum() / areas.sum()
    area_bounds = 0.03, 0.6  # shares of the surface between which a dark part is one
    if not area_bounds[0] <= share <= area_bounds[1]:
        return None
    of_dark = ratios[:, dark]
    return dark, float(np.clip(np.median(of_dark[of_dark < dark_ratio]), 0.03, 1.0))


def _ratios(mesh: SourceMesh, areas: np.ndarray) -> np.ndarray:
    """Return luminance (V,) of a mesh's materials at the template's vertices, over that at `BODY_SHARE`."""
    normals = face_normals(mesh.vertices.astype(np.float64), mesh.faces)
    size = np.linalg.norm(normals, axis=1)
    rng = np.random.default_rng(np.random.SeedSequence([len(mesh.faces), 5]))
    face = np.repeat(np.arange(len(size)), rng.multinomial(SAMPLES, size / size.sum()))
    weights = rng.dirichlet(np.ones(3), len(face))
    points = np.einsum("nk,nkd->nd", weights, mesh.vertices[mesh.faces[face]])
    uv = np.einsum("nk,nkd->nd", weights, mesh.uv[mesh.faces[face]])
    luminance = np.empty(len(face))
    for number, texture in enumerate(mesh.textures):
        mine = mesh.material[face] == number
        height, width = texture.shape[:2]
        column = np.floor(uv[mine, 0] * width).astype(int) % width
        row = np.floor((1 - uv[mine, 1]) * height).astype(int) % height
        luminance[mine] = texture[row, column] @ LUMINANCE
        # Glass.
        if mesh.opacity[number] < 0.9:
            luminance[mine] = np.nan
    _, nearest = cKDTree(points).query(mesh.registered, NEAREST)
    seen = luminance[nearest]
    glass = np.isnan(seen).mean(1) > 0.5
    at = np.nanmedian(np.where(glass[:, None], 0.0, seen), axis=1)
    order = np.argsort(at)
    middle = at[order][np.searchsorted(np.cumsum(areas[order]), BODY_SHARE * areas.sum())]
    return np.where(glass, GLASS_RATIO, at / max(middle, 1e-3))
