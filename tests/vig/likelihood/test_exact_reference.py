"""The kernels' whole objective, edges included, beside the plain torch reference on random scenes."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from tests.vig.likelihood.reference import BLOCKS, faces_seen, occlusion_edges, shade, value_and_gradient
from vig.likelihood import Likelihood, Photos
from vig.likelihood.geometry import Geometry
from vig.scene import EXPOSURE_L00, Camera, ObjectClass, ShapeModel

MODES = 10
"""Components of every mesh here: those of the teapot, so that all share its compiled kernels."""

SCENES = 15
SIZES = ((48, 40), (64, 64), (40, 56))


def grid(rows: int, columns: int, closed: bool) -> np.ndarray:
    """Faces of a surface of rows x columns vertices that closes round its columns, and its rows if closed."""
    faces = []
    for i in range(rows if closed else rows - 1):
        for j in range(columns):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            c, d = (a + columns) % (rows * columns), (b + columns) % (rows * columns)
            faces += [(a, b, d), (a, d, c)]
    return np.array(faces)


def torus() -> tuple[np.ndarray, np.ndarray]:
    """Its hole and its own near side give edges in front of itself, and folds where they end."""
    turn, round_tube = np.meshgrid(np.arange(24), np.arange(12), indexing="ij")
    turn, round_tube = turn * (2 * np.pi / 24), round_tube * (2 * np.pi / 12)
    radius = 0.055 + 0.025 * np.cos(round_tube)
    points = np.stack(
        [radius * np.cos(turn), radius * np.sin(turn), 0.04 + 0.025 * np.sin(round_tube)], axis=-1
    )
    return points.reshape(-1, 3), grid(24, 12, closed=True)


def bowl() -> tuple[np.ndarray, np.ndarray]:
    """Open at both ends: its edges have no face beyond them."""
    height, turn = np.meshgrid(np.arange(8), np.arange(20), indexing="ij")
    turn = turn * (2 * np.pi / 20)
    radius = 0.07 - 0.005 * height
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0.01 * height], axis=-1)
    return points.reshape(-1, 3), grid(8, 20, closed=False)


def rods() -> tuple[np.ndarray, np.ndarray]:
    """Three closed spindles, one before the other."""
    along, turn = np.meshgrid(np.linspace(0.08, np.pi - 0.08, 9), np.arange(10), indexing="ij")
    turn = turn * (2 * np.pi / 10)
    radius = 0.02 * np.sin(along)
    points = np.stack(
        [radius * np.cos(turn), radius * np.sin(turn), 0.045 - 0.045 * np.cos(along)], -1
    ).reshape(-1, 3)
    faces = grid(9, 10, closed=False)
    shifts = np.array([[-0.045, 0.0, 0.0], [0.0, 0.02, 0.01], [0.04, -0.03, 0.0]])
    return np.concatenate([points + shift for shift in shifts]), np.concatenate(
        [faces + number * len(points) for number in range(3)]
    )


def toy(rng: np.random.Generator, mesh: tuple[np.ndarray, np.ndarray]) -> Geometry:
    """A mesh with random smooth components, half of the time with a random table of self-shadow, and likewise
    with random reflectances.
    """
    points, faces = 1.3 * mesh[0], mesh[1]
    volume = np.einsum("fi,fi->", points[faces[:, 0]], np.cross(points[faces[:, 1]], points[faces[:, 2]]))
    if volume < 0:
        faces = faces[:, ::-1]
    waves = rng.normal(0, 15, (MODES, 3)) @ points.T + rng.uniform(0, 2 * np.pi, (MODES, 1))
    basis = 0.002 * np.sin(waves)[:, :, None] * rng.normal(size=(MODES, 1, 3))
    count = len(points)
    model = ShapeModel(points, basis, faces, np.zeros(count, int), ("all",), np.full(MODES, 0.1))
    scale = np.full((MODES + 1, 1, 1), 0.01)
    scale[0] = 0.05
    transfer = scale * rng.normal(size=(MODES + 1, count, 9)) if rng.random() < 0.5 else None
    reflectance = rng.uniform(0.1, 1.0, count) if rng.random() < 0.5 else None
    return Geometry(model, np.float64, transfer=transfer, reflectance=reflectance)


@dataclass(frozen=True)
class RandomScene:
    """An object somewhere in a small image, the photo of a slightly other one, and a noise."""

    geometry: Geometry
    camera: Camera
    point: np.ndarray
    photo: np.ndarray
    log_prior: np.ndarray
    sigma: float

    def likelihood(self) -> Likelihood:
        return Likelihood(self.geometry, self.camera, Photos(self.photo[None], self.log_prior[None]))


def random_scene(seed: int, teapots: list[Geometry], target_height: float) -> RandomScene:
    rng = np.random.default_rng(900 + seed)
    geometry = teapots[seed % 2] if seed % 5 < 2 else toy(rng, (torus, bowl, rods)[seed % 3]())
    width, height = SIZES[seed % len(SIZES)]
    size = min(width, height)
    camera = Camera(width, height, 1.5 * size, width / 2, height / 2, target_height=target_height)
    layout = geometry.layout
    light = rng.normal(0, 0.5, 9)
    light[[0, 2]] += EXPOSURE_L00, 1.0
    truth = np.zeros(layout.size)
    blocks = {
        "shape": rng.normal(size=MODES).clip(-2, 2),
        "azimuth": rng.uniform(0, 2 * np.pi),
        "elevation": rng.uniform(0.05, 1.3),
        "albedo": rng.uniform(0.1, 0.9, 3),
        "light": light,
        "framing": rng.normal(0, (0.12, 0.12, 0.15, 0.1)),
    }
    for name, numbers in blocks.items():
        truth[layout[name]] = numbers
    spread = np.zeros(layout.size)
    spread[layout.indices("azimuth", "elevation", "albedo", "light")] = 0.05
    spread[layout["shape"]] = 0.3
    spread[layout["framing"]] = 0.02
    point = truth + rng.normal(size=layout.size) * spread
    tiles = rng.uniform(0.05, 0.95, (height // 8, width // 8, 3))
    backdrop = np.kron(tiles, np.ones((8, 8, 1)))
    blank = RandomScene(geometry, camera, truth, backdrop, np.zeros_like(backdrop), 0.03)
    seen = blank.likelihood().at(
        truth[None], np.zeros(1, np.int32), np.array([blank.sigma]), derivatives=False, images=True
    )
    colour = seen.irradiance[0, ..., None] * truth[layout["albedo"]]
    photo = np.where(seen.coverage[0, ..., None] > 0.5, colour, backdrop)
    photo[height // 2 :, width // 3 : width // 2] = backdrop[height // 2 :, width // 3 : width // 2]
    photo = (photo + rng.normal(0, 0.02, photo.shape)).clip(0, 1)
    log_prior = np.log(rng.dirichlet((5, 2, 3), (height, width)))
    return RandomScene(geometry, camera, point, photo, log_prior, float(rng.uniform(0.03, 0.15)))


@pytest.fixture(scope="module")
def scenes(teapot: ObjectClass) -> list[RandomScene]:
    """Of teapots without and with self-shadow and of other meshes."""
    assert teapot.transfer is not None and teapot.shape_model.modes == MODES
    teapots = [
        Geometry(teapot.shape_model, np.float64),
        Geometry(teapot.shape_model, np.float64, transfer=teapot.transfer.astype(np.float64)),
    ]
    return [random_scene(seed, teapots, teapot.target_height) for seed in range(SCENES)]


@pytest.mark.parametrize("seed", range(SCENES))
def test_value_and_gradient_are_the_references(seed: int, scenes: list[RandomScene]) -> None:
    scene = scenes[seed]
    found = scene.likelihood().at(scene.point[None], np.zeros(1, np.int32), np.array([scene.sigma]))
    value, gradient = value_and_gradient(
        scene.geometry, scene.camera, scene.point, scene.photo, scene.log_prior, scene.sigma
    )
    assert found.value == pytest.approx(value, rel=1e-9)
    known = scene.geometry.layout.indices(*BLOCKS)
    error = np.abs(found.gradient[0] - gradient) / (np.abs(gradient) + 1e-3 * np.abs(gradient).max())
    assert error[known].max() <= 1e-6, dict(zip(scene.geometry.layout.labels, error.tolist(), strict=True))


def test_the_random_scenes_have_every_kind_of_edge(scenes: list[RandomScene]) -> None:
    """Silhouettes, folds, edges in front of the object itself and of open surfaces, cut by the border."""
    folds, borders, cut = 0, 0, 0
    for scene in scenes:
        shaded = shade(scene.geometry, scene.camera, torch.from_numpy(scene.point))
        ends, fold = occlusion_edges(scene.geometry, shaded.screen)
        seen = faces_seen(scene.geometry, shaded.screen, scene.camera) >= 0
        assert 0.02 < seen.double().mean() < 0.9 and len(ends) > 10
        folds += int((fold < 0).any())
        borders += int((scene.geometry.edges[:, 3] < 0).any())
        cut += int(seen[[0, -1]].any() or seen[:, [0, -1]].any())
    assert folds >= 6 and borders >= 4 and cut >= 3, (folds, borders, cut)
