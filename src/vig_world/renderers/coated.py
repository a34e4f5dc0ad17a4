"""Appearance of an object with a coat, point by point: its albedo in the model's light, and reflections."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vig.scene import ShapeModel
from vig_world.assets.coats import DIELECTRIC, albedo_of
from vig_world.dataset.spec import Coat
from vig_world.raster.rasterize import rasterize
from vig_world.raster.view import View

Mirrored = Callable[[np.ndarray, float], np.ndarray]
"""Radiance (N, 3) from unit directions (N, 3) towards which a mirror of some roughness looks."""


@dataclass(frozen=True)
class Appearance:
    """An object as a camera sees it, alone, N of its samples covered.

    Attributes:
        on: (H, W) bool, the samples that show it.
        colour: (N, 3) linear RGB.
        normal: (N, 3) unit, towards the camera.
        albedo: (N, 3).
    """

    on: np.ndarray
    colour: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray

    def average(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Return mean colour (h, w, 3) and coverage (h, w), float32, of pixels of `samples`^2 samples."""
        sums = np.zeros((*self.on.shape, 4), np.float32)
        sums[self.on] = np.concatenate([self.colour, np.ones((len(self.colour), 1))], axis=1)
        mean = sums[::samples, ::samples]
        for place in range(1, samples**2):
            mean = mean + sums[place // samples :: samples, place % samples :: samples]
        mean /= samples**2
        cover = mean[..., 3]
        return mean[..., :3] / np.maximum(cover, 1e-6)[..., None], cover


def appearance_of(
    coat: Coat,
    model: ShapeModel,
    vertices: np.ndarray,
    faces: np.ndarray,
    normals: np.ndarray,
    irradiance: np.ndarray,
    view: View,
    mirrored: Mirrored,
    reflectance: float = 1.0,
) -> Appearance:
    """Return an object's look; coat, model, mirrored and reflectance as for `colour_points`.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3), some of the model's.
        normals: (V, 3) unit.
        irradiance: (V,) over pi, see `vig.renderer.drawing.vertex_irradiance`.
        view: Its camera, a pixel for each sample.
    """
    fragments = rasterize(vertices, faces, view.rotation, view.translation, view.camera)
    on = fragments.face >= 0
    places = np.flatnonzero(on)
    corners = faces.T.take(fragments.face.ravel()[places], axis=1)
    weights = fragments.barycentric.reshape(-1, 3).take(places, axis=0).T
    table = np.concatenate([vertices.T, normals.T, irradiance[None]])
    rows = sum(weights[corner] * table.take(corners[corner], axis=1) for corner in range(3))
    look = colour_points(
        coat, model, rows[:3], rows[3:6], rows[6], corners[0], view.eye, mirrored, reflectance
    )
    return Appearance(on, *look)


def colour_points(
    coat: Coat,
    model: ShapeModel,
    points: np.ndarray,
    normals: np.ndarray,
    irradiance: np.ndarray,
    vertices: np.ndarray,
    eye: np.ndarray,
    mirrored: Mirrored,
    reflectance: float = 1.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the appearance of N points of an object.

    Args:
        coat: Its covering.
        model: Shape model of the parts.
        points: (3, N) metres, world.
        normals: (3, N), of any length.
        irradiance: (N,) over pi.
        vertices: (N,), the model's nearest to each point.
        eye: Camera (3,), metres, world.
        mirrored: Radiance that glaze and metal reflect.
        reflectance: Reflectance of metal, times its colour.

    Returns:
        Colour (N, 3) linear RGB, unit normal (N, 3) towards the camera, albedo (N, 3).
    """
    normals = normals / (_length(normals) + 1e-9)
    albedo = albedo_of(coat, points.T, model.parts[vertices], float(model.mean[:, 2].max())).T
    towards = eye.astype(points.dtype)[:, None] - points
    towards /= _length(towards)
    facing = _dot(normals, towards)
    normals = np.where(facing < 0, -normals, normals)
    colour = albedo * np.maximum(irradiance, 0)
    if coat.metal or coat.gloss:
        facing = np.abs(facing)
        radiance = mirrored((2 * facing * normals - towards).T, coat.roughness).T
        if coat.metal:
            # A mirror and a matt surface get about the same light.
            colour = reflectance * albedo * radiance
        else:
            fresnel = fresnel_of(facing)
            colour = colour * (1 - 0.5 * fresnel) + coat.gloss * fresnel * radiance
    return colour.T, normals.T, albedo.T


def fresnel_of(facing: np.ndarray) -> np.ndarray:
    """Return reflectance (N,) of glaze at cosines (N,) between normal and sight (Schlick 1994)."""
    graze = 1 - facing
    return DIELECTRIC + (1 - DIELECTRIC) * (graze * graze) ** 2 * graze


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return products (N,) of vectors (3, N)."""
    x, y, z = a * b
    return x + y + z


def _length(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths (N,) of vectors (3, N)."""
    return np.sqrt(_dot(vectors, vectors))
