"""Conversion from a file's axes and units to Z up and metres, standing on z = 0 and centred."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from vig_world.assets.own.load import MeshPiece
from vig_world.assets.own.settings import FileSettings
from vig_world.mesh import face_normals

_UPRIGHT = {  # rows: the file's axes that become x, y, z
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
}


@dataclass(frozen=True)
class SizedKind:
    """Props or furniture: its name, and the range of its largest side in metres."""

    noun: str
    least: float
    most: float
    furniture: bool


def stand(
    pieces: list[MeshPiece], settings: FileSettings, suffix: str, kind: SizedKind
) -> tuple[list[MeshPiece], list[str]]:
    """Turn pieces upright and scale them to metres; also return the guesses made, as sentences.

    Raises:
        ValueError: With the size, when no usual unit makes it one of this kind.
    """
    guesses = []
    up: str | None = settings.up
    if up is None:
        up, sure = ("y", True) if suffix in (".glb", ".gltf") else _guess_up(pieces, suffix, kind)
        if not sure:
            guesses.append(f'took {up} for its upward axis (set by up = "{up}")')
    pieces = _turn(pieces, np.array(_UPRIGHT[up], np.float64))
    if settings.turn:
        c, s = np.cos(np.deg2rad(settings.turn)), np.sin(np.deg2rad(settings.turn))
        pieces = _turn(pieces, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]))
    points = np.concatenate([piece.vertices for piece in pieces])
    size = float(np.ptp(points, axis=0).max())
    scale = settings.scale
    units = {1.0: "metres", 0.001: "millimetres", 0.01: "centimetres"}
    if scale is None:
        middle = np.sqrt(kind.least * kind.most)
        fitting = [unit for unit in units if kind.least <= size * unit <= kind.most]
        if not fitting:
            raise ValueError(
                f"a {kind.noun} of {kind.least:g} to {kind.most:g} m; its largest side is {size:.4g} units, "
                "which is none in metres, centimetres or millimetres"
            )
        scale = 1.0 if 1.0 in fitting else min(fitting, key=lambda unit: abs(np.log(size * unit / middle)))
        if scale != 1.0:
            guesses.append(f"took its units for {units[scale]} (set by scale = {scale:g})")
    elif not kind.least <= size * scale <= kind.most:
        raise ValueError(
            f"a {kind.noun} of {kind.least:g} to {kind.most:g} m; by its scale it is {size * scale:.4g} m"
        )
    return [replace(piece, vertices=piece.vertices * scale) for piece in pieces], guesses


def _turn(pieces: list[MeshPiece], rotation: np.ndarray) -> list[MeshPiece]:
    return [replace(piece, vertices=piece.vertices @ rotation.T) for piece in pieces]


def _guess_up(pieces: list[MeshPiece], suffix: str, kind: SizedKind) -> tuple[str, bool]:
    """Return which of y and z points up, by the side on which it can stand, and whether that is certain."""
    steady = {up: _base(_turn(pieces, np.array(_UPRIGHT[up], np.float64))) for up in ("z", "y")}
    standing = [up for up, share in steady.items() if share > 0.1]  # of the footprint
    if len(standing) == 1:
        return standing[0], True
    if not kind.furniture:
        return "z", True  # small things may also lie
    tops = {up: _level(_turn(pieces, np.array(_UPRIGHT[up], np.float64))) for up in ("z", "y")}
    for up, other in (("z", "y"), ("y", "z")):
        if tops[up] > 3.0 * tops[other]:
            return up, True
    return ("y" if suffix == ".obj" else "z"), False  # the convention of most programs


def _base(pieces: list[MeshPiece]) -> float:
    """Return the share of the footprint that touches the ground; 0 where the centre is not above it."""
    points = np.concatenate([piece.vertices for piece in pieces])
    height = points[:, 2] - points[:, 2].min()
    centre = (points.min(0) + points.max(0))[:2] / 2
    # 0.02: height, of the largest side, that counts as the base
    low = points[height <= 0.02 * np.ptp(points, axis=0).max()][:, :2]
    try:
        base, whole = ConvexHull(low), ConvexHull(points[:, :2])
    except (QhullError, ValueError):  # fewer than three points, or all in a line
        return 0.0
    inside = (base.equations[:, :2] @ centre + base.equations[:, 2] <= 0).all()
    return float(base.volume / whole.volume) if inside else 0.0


def _level(pieces: list[MeshPiece]) -> float:
    """Return the area of the faces that look straight up."""
    normals = np.concatenate([face_normals(piece.vertices, piece.faces) for piece in pieces])
    length = np.linalg.norm(normals, axis=1)
    return float(length[normals[:, 2] > 0.98 * length].sum() / 2)
