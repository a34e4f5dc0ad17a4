"""How an object with a coat looks, point by point: its albedo in the model's light, and what it mirrors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vig.scene import ShapeModel
from vig_world.assets.coats import DIELECTRIC, albedo_of
from vig_world.dataset.spec import Coat
from vig_world.mesh import vertex_normals
from vig_world.renderers.rasterize import rasterize
from vig_world.renderers.view import View

Mirrored = Callable[[np.ndarray, float], np.ndarray]
"""Radiance (N, 3) from unit directions (N, 3) towards which a mirror of some roughness looks."""


@dataclass(frozen=True)
class Appearance:
    """An object as a camera sees it, alone, N of its samples covered.

    Attributes:
        on: (H, W) bool, the samples that show it.
        colour: (N, 3) linear RGB.
        normal: (N, 3) unit, towards the eye.
        albedo: (N, 3).
    """

    on: np.ndarray
    colour: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray

    def averaged(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Mean colour (h, w, 3) and coverage (h, w), float32, of pixels of `samples` x `samples` samples."""
        sums = np.zeros((*self.on.shape, 4), np.float32)
        sums[self.on] = np.concatenate([self.colour, np.ones((len(self.colour), 1))], axis=1)
        parts = [sums[i::samples, j::samples] for i in range(samples) for j in range(samples)]
        mean = np.add.reduce(parts) / len(parts)
        cover = mean[..., 3]
        return mean[..., :3] / np.maximum(cover, 1e-6)[..., None], cover


def appearance_of(
    coat: Coat,
    model: ShapeModel,
    vertices: np.ndarray,
    faces: np.ndarray,
    irradiance: np.ndarray,
    view: View,
    mirrored: Mirrored,
    reflectance: float = 1.0,
) -> Appearance:
    """An object's look.

    Args:
        coat: What covers it.
        model: Whose vertices and parts these are.
        vertices: (V, 3) metres.
        faces: (F, 3), some of the model's.
        irradiance: (V,) over pi, see `vig.renderer.explained.vertex_irradiance`.
        view: Its camera, a pixel for each sample.
        mirrored: What glaze and metal mirror.
        reflectance: Of metal, times its colour.
    """
    fragments = rasterize(vertices, faces, view.rotation, view.translation, view.camera)
    on = fragments.face >= 0
    corners, weights = faces[fragments.face[on]], fragments.barycentric[on]
    table = np.concatenate([vertices, vertex_normals(vertices, model.faces), irradiance[:, None]], axis=1)
    rows = np.add.reduce([weights[:, corner, None] * table[corners[:, corner]] for corner in range(3)])
    points, normal, light = rows[:, :3], rows[:, 3:6], np.maximum(rows[:, 6:], 0)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
    albedo = albedo_of(coat, points, model.parts[corners[:, 0]], float(model.mean[:, 2].max()))
    towards = view.eye - points
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    facing = (normal * towards).sum(1, keepdims=True)
    normal = np.where(facing < 0, -normal, normal)
    facing = np.abs(facing)
    colour = albedo * light
    if coat.metal or coat.gloss:
        radiance = mirrored(2 * facing * normal - towards, coat.roughness)
        if coat.metal:
            # What lights a mirror is about what lights a matt surface.
            colour = reflectance * albedo * radiance
        else:
            fresnel = DIELECTRIC + (1 - DIELECTRIC) * (1 - facing) ** 5
            colour = colour * (1 - 0.5 * fresnel) + coat.gloss * fresnel * radiance
    return Appearance(on, colour, normal, albedo)
