"""Seeded scenes for the renderer's tests."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import torch
import trimesh

from vig_renderer import DirectionalLight, MeshObject, Pinhole, Scene, Topology, pyramid


def soup(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles that pierce each other, some before, some across and some behind the eye's plane."""
    centre = rng.uniform((-0.3, -0.3, -0.2), (0.3, 0.3, 0.9), (count, 1, 3))
    points = centre + rng.uniform(0.02, 0.2, (count, 1, 1)) * rng.normal(size=(count, 3, 3))
    return points.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def screen_points(points: np.ndarray, focal: float, centre: tuple[float, float]) -> torch.Tensor:
    """Homogeneous screen points of points in the camera frame, float64."""
    depth = points[:, 2:]
    return torch.from_numpy(np.concatenate([points[:, :2] * focal + np.array(centre) * depth, depth], axis=1))


@dataclass(frozen=True)
class World:
    """The continuous inputs of one random scene, and the scene made of them.

    Two objects, one before the other, some of it outside the image; textured and with vertex colours.
    """

    inputs: dict[str, torch.Tensor]
    build: Callable[[dict[str, torch.Tensor]], Scene]

    @property
    def scene(self) -> Scene:
        return self.build(self.inputs)


SHAPES = [
    trimesh.creation.icosphere(subdivisions=1, radius=0.09),
    trimesh.creation.box((0.13, 0.1, 0.15)),
    trimesh.creation.torus(0.08, 0.03, major_sections=12, minor_sections=8),
    trimesh.creation.cone(0.07, 0.16, sections=9),
]
TOPOLOGIES = [Topology.of(mesh.faces, mesh.vertices) for mesh in SHAPES]


def rotation_matrix(rng: np.random.Generator) -> np.ndarray:
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turned * np.sign(np.linalg.det(turned))


def random_world(rng: np.random.Generator, size: int = 32, dtype: torch.dtype = torch.float64) -> World:
    front, back = rng.integers(0, len(SHAPES), 2)
    vertices = [SHAPES[i].vertices for i in (front, back)]
    numbers = {
        "front vertices": vertices[0],
        "front rotation": rotation_matrix(rng),
        "front translation": np.array([*rng.uniform(-0.1, 0.1, 2), 0.4]),
        "front albedo": rng.uniform(0.2, 0.8, 3),
        "front light": rng.normal(0, 0.3, 9) + np.eye(9)[0] * 2,
        "texture": rng.uniform(0.2, 1, (9, 14, 3)),
        "texture coordinates": rng.uniform(-1, 2, (len(vertices[0]), 2)),
        "back vertices": vertices[1],
        "back translation": np.array([*rng.uniform(-0.1, 0.1, 2), 0.7]),
        "back albedo": rng.uniform(0.2, 0.8, (len(vertices[1]), 3)),
        "back light": rng.normal(0, 0.3, (9, 3)) + np.eye(9)[:, :1] * 2,
        "lamp direction": rng.normal(size=3),
        "lamp radiance": rng.uniform(0.1, 0.5, 3),
        "focal": np.array([1.4, 1.5]) * size,
        "centre": np.array([0.5, 0.5]) * size + rng.uniform(-6, 6, 2),
        "camera rotation": np.eye(3),
        "camera translation": rng.normal(0, 0.01, 3),
        "background": rng.uniform(0, 1, (size, size, 3)),
    }

    def build(values: dict[str, torch.Tensor]) -> Scene:
        first = MeshObject(
            values["front vertices"],
            TOPOLOGIES[front],
            values["front albedo"],
            values["front rotation"],
            values["front translation"],
            values["front light"],
            pyramid(values["texture"]),
            values["texture coordinates"],
        )
        second = MeshObject(
            values["back vertices"],
            TOPOLOGIES[back],
            values["back albedo"],
            translation=values["back translation"],
            light=values["back light"],
        )
        camera = Pinhole(
            size,
            size,
            values["focal"],
            values["centre"],
            values["camera rotation"],
            values["camera translation"],
        )
        lamp = DirectionalLight(values["lamp direction"], values["lamp radiance"])
        return Scene([first, second], camera, lamp, values["background"])

    return World({name: torch.tensor(value, dtype=dtype) for name, value in numbers.items()}, build)


@pytest.fixture
def world() -> Callable[..., World]:
    """Makes random scenes: world(rng, size, dtype)."""
    return random_world


@pytest.fixture
def triangles() -> Callable[..., tuple[torch.Tensor, torch.Tensor]]:
    """Makes screen points (3 n, 3) float64 and faces (n, 3) of a random soup: triangles(rng, n)."""

    def make(rng: np.random.Generator, count: int = 40) -> tuple[torch.Tensor, torch.Tensor]:
        points, faces = soup(rng, count)
        return screen_points(points, 40.0, (16.2, 11.9)), torch.from_numpy(faces).int()

    return make
