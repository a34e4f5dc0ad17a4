"""Fewer triangles by clustering vertices; closed or open; seen from both sides."""

from dataclasses import replace

import numpy as np

from vig_world.assets.own.load import MeshPiece
from vig_world.mesh import face_edges, stack_meshes


def simplified(pieces: list[MeshPiece], most: int) -> list[MeshPiece]:
    """Return the pieces with at most `most` faces together: vertices that share a cell of a grid become one.

    The grid is the finest found that gives few enough faces. Faces without area are dropped always.
    """
    pieces = [solid for piece in pieces if len((solid := without_empty(piece)).faces)]
    total = sum(len(piece.faces) for piece in pieces)
    if total <= most:
        return pieces
    points = np.concatenate([piece.vertices for piece in pieces])
    low, size = points.min(0), float(np.ptp(points, axis=0).max())
    cells, best = 64.0, None
    for _ in range(6):
        trial = [_cluster(piece, low, size / cells) for piece in pieces]
        count = sum(len(piece.faces) for piece in trial)
        if count <= most and (best is None or count > sum(len(piece.faces) for piece in best)):
            best = trial
        if 0.85 * most <= count <= most:
            break
        cells = max(cells * np.sqrt(0.92 * most / max(count, 1)), 2.0)
    return [piece for piece in best or trial if len(piece.faces)]


def without_empty(piece: MeshPiece) -> MeshPiece:
    """Return the piece without triangles that have no area, and without vertices that no triangle uses."""
    a, b, c = (piece.vertices[piece.faces[:, i]] for i in range(3))
    area = (np.cross(b - a, c - a) ** 2).sum(1)
    longest = np.maximum(((b - a) ** 2).sum(1), ((c - a) ** 2).sum(1))
    faces = piece.faces[area > 1e-12 * longest**2]
    used, faces = np.unique(faces, return_inverse=True)
    return replace(piece, vertices=piece.vertices[used], faces=faces.reshape(-1, 3), uv=piece.uv[used])


def _cluster(piece: MeshPiece, low: np.ndarray, cell: float) -> MeshPiece:
    grid = np.floor((piece.vertices - low) / cell).astype(np.int64)
    place = (grid[:, 0] * 2**40) + (grid[:, 1] * 2**20) + grid[:, 2]
    _, place = np.unique(place, return_inverse=True)
    # Vertices of one place stay apart where their texture coordinates are of different sixteenths.
    chart = np.floor(piece.uv * 16).astype(np.int64) @ [1, 4096]
    _, group = np.unique(place * 2**26 + chart % 2**26, return_inverse=True)
    count = int(group.max()) + 1

    def means(values: np.ndarray, index: np.ndarray) -> np.ndarray:
        size = np.bincount(index)
        return np.stack([np.bincount(index, column) / size for column in values.T], axis=1)

    points, uv = means(piece.vertices, place), means(piece.uv, group).astype(np.float32)
    home = np.empty(count, np.int64)
    home[group] = place  # all of a group lie in one place, so that no cracks open
    faces, where = group[piece.faces], place[piece.faces]
    apart = (where != np.roll(where, 1, axis=1)).all(1)
    faces, where = faces[apart], np.sort(where[apart], axis=1)
    _, first = np.unique(where @ [2**42, 2**21, 1], return_index=True)  # two sides of a thin sheet: one stays
    return without_empty(replace(piece, vertices=points[home], faces=faces[np.sort(first)], uv=uv))


def signed_volume(pieces: list[MeshPiece]) -> float | None:
    """Return the volume within the pieces' surface, negative when inside out; None when it is not closed."""
    points, faces = stack_meshes(pieces)
    size = float(np.ptp(points, axis=0).max())
    _, place = np.unique(np.round(points / (1e-5 * size)).astype(np.int64), axis=0, return_inverse=True)
    corners = place.reshape(-1)[faces]
    ends = face_edges(corners).astype(np.int64)
    ends = ends[ends[:, 0] != ends[:, 1]]
    there, back = ends @ [len(points), 1], ends @ [1, len(points)]
    if not np.array_equal(np.sort(there), np.sort(back)):  # each edge as often one way as the other
        return None
    a, b, c = ((points - points.mean(0))[faces[:, i]] for i in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def outward(pieces: list[MeshPiece], most: int) -> list[MeshPiece]:
    """Return the pieces facing outwards, with at most `most` faces; open ones with their own back side."""
    pieces = simplified(pieces, most)
    volume = signed_volume(pieces) if pieces else None
    if volume:
        return [_flip(piece) for piece in pieces] if volume < 0 else pieces
    pieces = simplified(pieces, most // 2)
    result = []
    for piece in pieces:
        volume = signed_volume([piece])
        if volume:
            result.append(_flip(piece) if volume < 0 else piece)
        else:
            vertices, uv = (np.concatenate([each] * 2) for each in (piece.vertices, piece.uv))
            back = piece.faces[:, ::-1] + len(piece.vertices)
            result.append(replace(piece, vertices=vertices, faces=np.concatenate([piece.faces, back]), uv=uv))
    return result


def _flip(piece: MeshPiece) -> MeshPiece:
    return replace(piece, faces=piece.faces[:, ::-1])
