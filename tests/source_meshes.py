"""Meshes with materials, as a user's files have them."""

import numpy as np
import trimesh

from vig_world.assets.own.load import MeshPiece
from vig_world.assets.source_meshes import SourceMesh

RED, BLACK = (0.7, 0.05, 0.05), (0.01, 0.01, 0.01)


def piece(mesh: trimesh.Trimesh, colour: tuple[float, float, float], opacity: float = 1.0) -> MeshPiece:
    uv = np.zeros((len(mesh.vertices), 2), np.float32)
    texture = np.array(colour, np.float32)[None, None]
    return MeshPiece(np.array(mesh.vertices), np.array(mesh.faces), uv, texture, opacity)


def box(extents: tuple[float, float, float], at: tuple[float, float, float]) -> trimesh.Trimesh:
    made = trimesh.creation.box(extents)
    made.apply_translation(at)
    return made


def two_boxes(template: np.ndarray, split: str = "train") -> SourceMesh:
    """A red box with a black one as its front."""
    pieces = [
        piece(box((0.3, 0.2, 0.2), (-0.05, 0, 0.1)), RED),
        piece(box((0.1, 0.2, 0.2), (0.15, 0, 0.1)), BLACK),
    ]
    return SourceMesh.of(pieces, np.eye(3), np.zeros(3), template, -1, split)
