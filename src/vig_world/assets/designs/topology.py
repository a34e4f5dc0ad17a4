"""Faces and mirror permutation of closed surfaces lofted over rings of vertices."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class Loft:
    """A closed surface lofted over consecutive rings; a ring of one vertex is a pole.

    `counts` (one per ring): neighbours are equal, or one is twice the other, or one is a pole.
    Vertex j of a ring of n lies at angle 2 pi j / n; seen from the last ring, angles grow counter-clockwise.
    """

    counts: tuple[int, ...]

    @property
    def starts(self) -> np.ndarray:
        """Return the index of each ring's first vertex, and the vertex count at the end: (rings + 1,)."""
        return np.concatenate([[0], np.cumsum(self.counts)])

    def faces(self) -> np.ndarray:
        """Return outward counter-clockwise triangles, (F, 3) int32; `mirror` maps them onto each other."""
        triangles: list[tuple[int, int, int]] = []
        starts = self.starts
        for i, (lower, upper) in enumerate(pairwise(self.counts)):
            if lower <= upper:
                triangles += band(int(starts[i]), lower, int(starts[i + 1]), upper)
            else:
                flipped = band(int(starts[i + 1]), upper, int(starts[i]), lower)
                triangles += [(a, c, b) for a, b, c in flipped]
        return np.array(triangles, np.int32)

    def mirror(self) -> np.ndarray:
        """Return the index of each vertex's mirror image in y, (V,) int32: a ring's angle j goes to -j."""
        rings = [start + (-np.arange(n)) % n for start, n in zip(self.starts[:-1], self.counts, strict=True)]
        return np.concatenate(rings).astype(np.int32)


def symmetric(vertices: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Return vertices (V, 3) as float32 and as their mean with their mirror image in y, of numbers (V,)."""
    vertices = vertices.astype(np.float32)
    return 0.5 * (vertices + vertices[mirror] * np.array([1.0, -1.0, 1.0], np.float32))


def band(low: int, m: int, high: int, n: int) -> list[tuple[int, int, int]]:
    """Return triangles between a ring of m vertices from index `low` and one of n >= m from `high` above."""

    def a(j: int) -> int:
        return low + j % m

    def b(j: int) -> int:
        return high + j % n

    if m == 1:
        return [(low, b(j + 1), b(j)) for j in range(n)]
    if n == 2 * m:
        return [
            triangle
            for j in range(m)
            for triangle in (
                (a(j), b(2 * j + 1), b(2 * j)),
                (a(j), a(j + 1), b(2 * j + 1)),
                (a(j + 1), b(2 * j + 2), b(2 * j + 1)),
            )
        ]
    if m != n:
        raise ValueError(f"neighbouring rings must be equal, doubled or a pole; got {m} and {n} vertices")
    triangles = []
    for j in range(n):
        if 2 * j < n:  # the diagonals of the two halves are mirror images
            triangles += [(a(j), a(j + 1), b(j + 1)), (a(j), b(j + 1), b(j))]
        else:
            triangles += [(a(j), a(j + 1), b(j)), (a(j + 1), b(j + 1), b(j))]
    return triangles
