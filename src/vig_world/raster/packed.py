"""Assets and the object, packed for the raster renderer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vig_world.asset_cache import packed_text, unpacked_text
from vig_world.assets.props.material import Material
from vig_world.mesh import Mesh, vertex_normals
from vig_world.raster.pyramid import TextureLevels
from vig_world.raster.records import CLUSTER, HEADER, PART, address
from vig_world.raster.shadows import ambient_occlusion, surface_points

ROOM_SIZE = 1.2
"""Metres; assets of a larger radius get ambient occlusion, smaller ones cast shadows."""

CLUSTER_FACES = 64
MOST_SHARED = 2.0
"""Vertices that all clusters of a mesh project, over those that it has, up to which it is divided."""
POINT_AREA = 1.2e-4
"""Square metres of surface for each point that stands for it in shadows."""

# Kinds with little specular reflection. At roughness 1 nothing reflects specularly.
MATT = ("cloth", "earth", "paper", "paint", "wallpaper", "brick")


@dataclass(frozen=True, eq=False)
class PackedAsset:
    """An asset as one block of memory that the native code reads; some 50 kB for a prop.

    Attributes:
        data: (N,) bytes, see `records.HEADER`.
        counts: Counts of parts, vertices and faces.
        slots: Names of the finishes that its parts take, in their order.
    """

    data: np.ndarray
    counts: tuple[int, int, int]
    slots: tuple[str, ...]

    @cached_property
    def address(self) -> int:
        """Where `data` lies in memory."""
        return address(self.data)

    def arrays(self) -> dict[str, np.ndarray]:
        """Itself as arrays by name, for `from_arrays`."""
        return {"data": self.data, "form": packed_text([self.counts, self.slots])}

    @staticmethod
    def from_arrays(arrays: dict[str, np.ndarray]) -> PackedAsset:
        """The asset whose `arrays` these are."""
        (parts, vertices, faces), slots = unpacked_text(arrays["form"])
        return PackedAsset(arrays["data"], (parts, vertices, faces), tuple(slots))

    @staticmethod
    def of(parts: Sequence[tuple[Mesh, Material]]) -> PackedAsset:
        """Pack meshes with their materials, in a frame of their own, metres.

        Meshes need texture coordinates, metres for materials with a slot.

        Raises:
            ValueError: Without parts.
        """
        if not parts:
            raise ValueError("an asset needs one part or more; got none")
        table = np.zeros(len(parts), PART)
        slots: list[str] = []
        pyramids: dict[int, tuple[int, TextureLevels]] = {}
        positions, attributes, corners, clusters, texels = [], [], [], [], []
        vertex = face = cluster = texel = 0
        for row, (mesh, material) in zip(table, parts, strict=True):
            if mesh.uv is None:
                raise ValueError("a part of an asset needs texture coordinates; got none")
            if id(material.texture) not in pyramids:
                pyramid = TextureLevels.of(material.texture)
                pyramids[id(material.texture)] = texel, pyramid
                texels.append(pyramid.texels)
                texel += len(pyramid.texels)
            start, pyramid = pyramids[id(material.texture)]
            row["texels"], row["log_size"] = start, pyramid.log_size
            if material.slot and material.slot not in slots:
                slots.append(material.slot)
            row["slot"] = slots.index(material.slot) if material.slot else -1
            row["roughness"], row["emission"] = material.roughness, material.emission
            row["mirror"] = (0.008 if material.kind in MATT else 0.04) * (1 - material.roughness)
            row["metal"] = 0.8 if material.kind == "metal" else 0.0
            row["sphere"] = bounding_sphere(mesh.vertices)
            row["vertices"] = vertex, vertex + len(mesh.vertices)
            row["faces"] = face, face + len(mesh.faces)
            positions.append(mesh.vertices)
            attributes.append(np.hstack([vertex_normals(mesh.vertices, mesh.faces), mesh.uv]))
            corners.append(mesh.faces + vertex)
            clusters.append(clustered(mesh.vertices, mesh.faces))
            clusters[-1]["vertices"] += vertex
            clusters[-1]["faces"] += face
            row["clusters"] = cluster, cluster + len(clusters[-1])
            cluster += len(clusters[-1])
            vertex, face = vertex + len(mesh.vertices), face + len(mesh.faces)
        everything = np.concatenate(positions).astype(np.float32)
        faces = np.concatenate(corners).astype(np.int32)
        sphere = bounding_sphere(everything)
        is_room = sphere[3] > ROOM_SIZE
        blocks = {
            "clusters": np.concatenate(clusters),
            "positions": np.ascontiguousarray(everything.T),
            "attributes": np.concatenate(attributes).astype(np.float32),
            "corners": faces,
            "points": np.zeros((0, 4), np.float32)
            if is_room
            else surface_points(everything, faces, POINT_AREA),
            "texels": np.concatenate(texels),
        }
        if is_room:
            blocks["occlusion"] = ambient_occlusion(everything, faces)
        data = assembled(table, sphere, blocks)
        return PackedAsset(data, (len(table), len(everything), len(faces)), tuple(slots))


def bounding_sphere(vertices: np.ndarray) -> tuple[float, float, float, float]:
    """Centre and radius of a sphere round points (V, 3)."""
    centre = (vertices.min(0).astype(np.float64) + vertices.max(0)) / 2
    radius = np.sqrt(((vertices - centre) ** 2).sum(1).max())
    return (*centre.tolist(), float(radius) * 1.0001 + 1e-6)


def clustered(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Divide faces (F, 3) of vertices (V, 3) into CLUSTER records; one where neighbours have distant numbers.

    Each cluster's vertices are projected anew: numbers that are spread over the mesh would cost more than the
    faces that are left out.
    """
    starts = np.arange(0, max(len(faces), 1), CLUSTER_FACES)
    if len(faces) and len(starts) > 1:
        first, end = np.minimum.reduceat(faces.min(1), starts), np.maximum.reduceat(faces.max(1), starts) + 1
        if (end - first).sum() > MOST_SHARED * len(vertices):
            starts = starts[:1]
    clusters = np.zeros(len(starts), CLUSTER)
    for cluster, start in zip(clusters, starts.tolist(), strict=True):
        stop = len(faces) if len(starts) == 1 else min(start + CLUSTER_FACES, len(faces))
        used = faces[start:stop]
        cluster["faces"] = start, stop
        if used.size:
            cluster["vertices"] = used.min(), used.max() + 1
            cluster["sphere"] = bounding_sphere(vertices[used.ravel()])
    return clusters


def assembled(table: np.ndarray, sphere: Sequence[float], blocks: dict[str, np.ndarray]) -> np.ndarray:
    """Header, parts and blocks one after the other, each at a multiple of 64 bytes."""
    header = np.zeros(1, HEADER)
    header["sphere"] = sphere
    header["part_count"], header["vertex_count"] = len(table), blocks["positions"].shape[1]
    header["face_count"], header["point_count"] = len(blocks["corners"]), len(blocks["points"])
    starts, end = {}, 0
    for name, block in {"header": header, "parts": table, **blocks}.items():
        starts[name] = end
        end += -(-block.nbytes // 64) * 64
    for name in HEADER.names or ():
        if name in starts:
            header[name] = starts[name]
    table["texels"] = starts["texels"] + 4 * table["texels"]
    data = np.zeros(end, np.uint8)
    for name, block in {"header": header, "parts": table, **blocks}.items():
        data[starts[name] : starts[name] + block.nbytes] = np.ascontiguousarray(block).view(np.uint8).ravel()
    return data
