"""The surface of one very object: its triangles with textures, as a file of its mesh states them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.checks import check_arrays, check_indices, read_tensors, reading
from vig.io.files import write_arrays
from vig.scene.light import linear_from_srgb, srgb8_from_linear
from vig_native import engine

FILE = "surface.safetensors"
_TABLE = {
    "vertices": ("float32", ("V", 3)),
    "faces": ("int32", ("F", 3)),
    "uv": ("float32", ("V", 2)),
    "texture_of_face": ("int32", ("F",)),
    "sizes": ("int32", ("T", 2)),
    "texels": ("uint8", ("N", 3)),
}


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles with textures.

    Attributes:
        vertices: (V, 3) float32, metres, in the frame of the class; doubled where texture coordinates differ.
        faces: (F, 3) int32.
        uv: (V, 2) float32, (0, 0) at a texture's bottom left; beyond [0, 1] it is repeated.
        texture_of_face: (F,) int32.
        sizes: (T, 2) int32, width and height of each texture.
        texels: (N, 3) uint8 sRGB of all textures, one after the other, line by line from the top.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    texture_of_face: np.ndarray
    sizes: np.ndarray
    texels: np.ndarray

    @staticmethod
    def of(pieces: Sequence[Any], class_from_mesh: np.ndarray) -> "Surface":
        """Return the surface of a mesh's pieces (`vertices`, `faces`, `uv`, `texture` in linear RGB).

        class_from_mesh: (4, 4) similarity.
        """
        starts = np.cumsum([0] + [len(piece.vertices) for piece in pieces[:-1]])
        vertices = np.concatenate([piece.vertices for piece in pieces])
        textures = [srgb8_from_linear(piece.texture) for piece in pieces]
        return Surface(
            (vertices @ class_from_mesh[:3, :3].T + class_from_mesh[:3, 3]).astype(np.float32),
            np.concatenate([p.faces + s for p, s in zip(pieces, starts, strict=True)]).astype(np.int32),
            np.concatenate([piece.uv for piece in pieces]).astype(np.float32),
            np.repeat(np.arange(len(pieces)), [len(piece.faces) for piece in pieces]).astype(np.int32),
            np.array([texture.shape[1::-1] for texture in textures], np.int32),
            np.concatenate([texture.reshape(-1, 3) for texture in textures]),
        )

    def save(self, folder: Path) -> None:
        """Write it into the folder of a class pack."""
        write_arrays(folder / FILE, {name: getattr(self, name) for name in _TABLE})

    @staticmethod
    def load(folder: Path) -> "Surface":
        """Read it from the folder of a class pack; UserError where it is damaged."""
        with reading(folder / FILE, "the surface of an object", "Make the pack again."):
            arrays, _ = read_tensors(folder / FILE)
            check_arrays(arrays, _TABLE)
            check_indices("faces", arrays["faces"], len(arrays["vertices"]))
            check_indices("texture_of_face", arrays["texture_of_face"], len(arrays["sizes"]))
            if int(arrays["sizes"].astype(np.int64).prod(1).sum()) != len(arrays["texels"]):
                raise ValueError("sizes must be those of the texels")
            return Surface(**{name: arrays[name] for name in _TABLE})

    @cached_property
    def one_colour(self) -> bool:
        """Return whether it looks the same all over."""
        return bool((self.texels == self.texels[0]).all())

    @cached_property
    def middle(self) -> np.ndarray:
        """Return the middle (3,) float32 of its bounds, metres."""
        return np.asarray((self.vertices.min(0) + self.vertices.max(0)) / 2)

    @cached_property
    def outermost(self) -> np.ndarray:
        """Return (n, 3) float32, the vertices that are the farthest out in one of 600 directions, metres."""
        return np.asarray(self.vertices[np.unique(np.argmax(self.vertices @ sphere(600).T, axis=0))])

    @cached_property
    def diameter(self) -> float:
        """Return the diagonal of its bounds, metres."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    def looks_same(self, turn: np.ndarray) -> bool:
        """Return whether it looks the same turned about its middle by a rotation (3, 3), print included."""
        points, normals, colours = self._samples
        cells = [self._cells(points, normals), self._cells(points @ turn.T, normals @ turn.T)]
        number = np.unique(np.stack(cells), return_inverse=True)[1].reshape(2, -1)
        count = np.stack([np.bincount(each, minlength=number.max() + 1) for each in number])
        both = count.min(0) >= 0.3 * count.max(0)
        total = [[np.bincount(each, colour, count.shape[1]) for colour in colours.T] for each in number]
        mean = np.log(np.array(total)[..., both] / count[:, None, both] + engine.MIN_COLOUR)
        weight = count[0, both] / count[0].sum()
        unlike = np.abs(mean[0] - mean[1]).max(0)
        # A carton of fine chequers, printed alike on two sides, has 1, .14 and .00; one of HOPE's with nearly
        # the same print .84, .26 and .06. The last number is for print that covers little.
        return bool(
            weight.sum() > 0.95 and np.sqrt(weight @ unlike**2) < 0.2 and weight[unlike > 0.5].sum() < 0.02
        )

    def _cells(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return numbers (N,) of cells: a sixteenth of the diameter wide, and which of six ways they face."""
        axis = np.abs(normals).argmax(1)
        facing = 2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0)
        # .3719: no plane of a symmetric thing lies between two cells
        place = np.floor(points / self.diameter * 16 + 16.3719).astype(np.int64)
        number: np.ndarray = place @ [4096, 64, 1] * 6 + facing
        return number

    @cached_property
    def _samples(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return random points of the surface: places about the middle, normals, linear RGB (40000, 3)."""
        corners = self.vertices[self.faces].astype(np.float64) - self.middle
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area, rng = np.linalg.norm(across, axis=1), np.random.default_rng(0)
        face = rng.choice(len(area), 40_000, p=area / area.sum())
        share = rng.dirichlet((1, 1, 1), len(face))[:, :, None]
        uv, texture = (share * self.uv[self.faces[face]]).sum(1) % 1, self.texture_of_face[face]
        size = self.sizes[texture].astype(np.int64)
        column, row = (np.stack([uv[:, 0], 1 - uv[:, 1]]) * size.T).astype(np.int64).clip(0, size.T - 1)
        start = np.cumsum([0, *self.sizes.astype(np.int64).prod(1)])[texture]
        colours = linear_from_srgb(self.texels[start + row * size[:, 0] + column] / np.float32(255))
        return (share * corners[face]).sum(1), across[face] / area[face, None], colours

    @cached_property
    def mesh(self) -> Any:
        """Return it for the native library, its middle at the origin."""
        # Vertices at one place are one, whatever their texture coordinates.
        rounded = np.round((self.vertices - self.middle) / self.diameter, 5)
        _, chosen, place = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
        positions, faces = self.vertices[chosen] - self.middle, place.ravel()[self.faces].astype(np.int32)
        corners = positions[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.zeros((len(positions), 3))
        for corner in range(3):
            np.add.at(normals, faces[:, corner], across)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
        levels, texels, first = [], [], 0
        starts = np.cumsum([0, *self.sizes.astype(np.int64).prod(1)])
        for number, (width, height) in enumerate(self.sizes.tolist()):
            picture = linear_from_srgb(self.texels[starts[number] : starts[number + 1]] / np.float32(255))
            for level in _pyramid(picture.reshape(height, width, 3)):
                levels.append((number, level.shape[1], level.shape[0], first))
                texels.append(level.ravel())
                first += level.size
        flat = self.uv[self.faces]
        flat = flat[:, 1:] - flat[:, :1]
        per_uv = self.sizes[self.texture_of_face].astype(np.float64).prod(1)
        on_texture = np.abs(flat[:, 0, 0] * flat[:, 1, 1] - flat[:, 0, 1] * flat[:, 1, 0]) * per_uv
        density = np.sqrt(on_texture / np.maximum(np.linalg.norm(across, axis=1), 1e-18))
        return engine.textured_mesh(
            np.ascontiguousarray(positions, np.float32),
            faces,
            normals.astype(np.float32),
            np.ascontiguousarray(self.uv[self.faces]),
            self.texture_of_face,
            np.array(levels, np.int64),
            np.concatenate(texels).astype(np.float32),
            np.log2(density.clip(1e-9, 1e9)).astype(np.float32),
            _is_closed(faces, corners),
        )


def sphere(count: int) -> np.ndarray:
    """Return directions (count, 3) all round, evenly: a Fibonacci sphere."""
    place = np.arange(count) + 0.5
    height, around = 1 - 2 * place / count, math.pi * (1 + math.sqrt(5)) * place
    level = np.sqrt(1 - height**2)
    return np.stack([level * np.cos(around), level * np.sin(around), height], 1)


def _pyramid(picture: np.ndarray) -> list[np.ndarray]:
    """Return a picture (H, W, 3) and its halves, down to one pixel a side."""
    levels = [picture]
    while max(levels[-1].shape[:2]) > 1:
        fine = levels[-1]
        height, width = (max(1, length // 2) for length in fine.shape[:2])
        rows = fine[: 2 * height].reshape(height, -1, *fine.shape[1:]).mean(1)
        levels.append(rows[:, : 2 * width].reshape(height, width, -1, 3).mean(2))
    return levels


def _is_closed(faces: np.ndarray, corners: np.ndarray) -> bool:
    """Return whether triangles enclose a volume that they look out of.

    faces: (F, 3), vertices of one place having one number; corners: (F, 3, 3) their places.
    """
    count = int(faces.max()) + 1
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    edges = edges[edges[:, 0] != edges[:, 1]]
    one_way, other_way = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    volume = (np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]).sum()
    # 0.002: share of edges without another face, as through slivers that a scan leaves
    return bool(volume > 0 and np.isin(other_way, one_way, invert=True).mean() < 0.002)
