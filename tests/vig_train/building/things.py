"""Meshes as people have them: boxes with a fin, in any pose, unit and topology."""

from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

KINDS = ("off", "stl", "obj", "ply", "glb", "off")


def finned(width: float, height: float, fin: float) -> trimesh.Trimesh:
    """A box that carries a fin on +X, of two parts that overlap; it stands on z = 0."""
    body = trimesh.creation.box((width, 0.7 * width, height))
    blade = trimesh.creation.box((fin + 0.1, 0.12, 0.5 * height))
    blade.apply_translation((width / 2 + fin / 2 - 0.05, 0, 0.1 * height))
    mesh = trimesh.util.concatenate([body, blade])
    mesh.apply_translation((0, 0, height / 2))
    return mesh


def folder_of_finned(folder: Path) -> Path:
    """Six boxes with fins, in files of several kinds: one lies, one is tilted, units differ; and a ball."""
    folder.mkdir()
    rng = np.random.default_rng(4)
    for number in range(6):
        mesh = finned(*(base * rng.uniform(0.85, 1.15) for base in (1.0, 1.5, 0.45)))
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("x", -90, degrees=True).as_matrix()  # Y up, as most files
        if number == 2:
            turn[:3, :3] = Rotation.from_euler("xyz", (20, 35, 50), degrees=True).as_matrix()
        if number == 4:
            turn[:3, :3] = np.eye(3)
        mesh.apply_transform(turn)
        mesh.apply_scale((1.0, 25.4, 0.01)[number % 3])
        mesh.apply_translation(rng.normal(size=3))
        mesh.export(folder / f"{number}.{KINDS[number]}")
    trimesh.creation.icosphere(subdivisions=3).export(folder / "ball.off")
    (folder / "notes.obj").write_text("to do: model this\n")
    return folder
