"""Assets and the object, packed for the raster renderer."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vig_native import engine
from vig_world.asset_cache import packed_text, unpacked_text
from vig_world.assets.things import Material
from vig_world.mesh import Mesh, vertex_normals
from vig_world.raster.pyramid import TextureLevels
from vig_world.raster.shadows import ambient_occlusion, surface_points

# Kinds with little specular reflection. At roughness 1 nothing reflects specularly.
MATT = ("cloth", "earth", "paper", "paint", "wallpaper", "brick")


@dataclass(frozen=True, eq=False)
class PackedAsset:
    """An asset in the memory of native code; some 50 kB for a prop.

    Attributes:
        native: Data that drawing reads.
        slots: Names of the finishes of its parts, in their order.
    """

    native: Any
    slots: tuple[str, ...]

    @staticmethod
    def of(parts: Sequence[tuple[Mesh, Material]]) -> "PackedAsset":
        """Pack meshes with their materials, see `pack`."""
        return PackedAsset.from_arrays(pack(parts))

    @staticmethod
    def from_arrays(arrays: dict[str, np.ndarray]) -> "PackedAsset":
        """Return the asset that `pack` gave."""
        own = [name for name in arrays if name.startswith("asset_")]
        native = {name.removeprefix("asset_"): arrays[name] for name in own}
        return PackedAsset(engine.asset(**native), tuple(unpacked_text(arrays["slots"])))


def pack(parts: Sequence[tuple[Mesh, Material]]) -> dict[str, np.ndarray]:
    """Return the arrays of an asset: `slots`, and the input of native code's `make_asset`.

    Meshes are in a frame of their own, metres, and need texture coordinates, metres where there is a slot.

    Raises:
        ValueError: Without parts.
    """
    if not parts:
        raise ValueError("an asset needs one part or more; got none")
    slots: list[str] = []
    textures: dict[int, tuple[int, TextureLevels]] = {}
    table, materials, positions, attributes, corners = [], [], [], [], []
    vertex = face = texel = 0
    for mesh, material in parts:
        if mesh.uv is None:
            raise ValueError("a part of an asset needs texture coordinates; got none")
        if id(material.texture) not in textures:
            textures[id(material.texture)] = texel, TextureLevels.of(material.texture)
            texel += len(textures[id(material.texture)][1].texels)
        if material.slot and material.slot not in slots:
            slots.append(material.slot)
        positions.append(mesh.vertices)
        attributes.append(np.hstack([vertex_normals(mesh.vertices, mesh.faces), mesh.uv]))
        corners.append(mesh.faces + vertex)
        vertex, face = vertex + len(mesh.vertices), face + len(mesh.faces)
        start, levels = textures[id(material.texture)]
        table.append((face, start, *levels.log_size, slots.index(material.slot) if material.slot else -1))
        mirror = (0.008 if material.kind in MATT else 0.04) * (1 - material.roughness)
        metal = 0.8 if material.kind == "metal" else 0.0
        materials.append((material.roughness, mirror, metal, material.emission))
    vertices, faces = np.concatenate(positions).astype(np.float32), np.concatenate(corners).astype(np.int32)
    middle = (vertices.min(0).astype(np.float64) + vertices.max(0)) / 2
    # Assets of more than 1.2 m get ambient occlusion, smaller ones cast shadows, a point for 1.2 square cm.
    is_room = np.linalg.norm(vertices - middle, axis=1).max() > 1.2
    ambient = ambient_occlusion(vertices, faces) if is_room else {}
    points = np.zeros((0, 4), np.float32) if is_room else surface_points(vertices, faces, 1.2e-4)
    arrays = {
        "vertices": vertices,
        "attributes": np.concatenate(attributes).astype(np.float32),
        "faces": faces,
        "parts": np.array(table, np.int32),
        "materials": np.array(materials, np.float32),
        "texels": np.concatenate([levels.texels for _, levels in textures.values()]),
        "points": points,
        **ambient,
    }
    return {"slots": packed_text(slots)} | {f"asset_{name}": array for name, array in arrays.items()}
