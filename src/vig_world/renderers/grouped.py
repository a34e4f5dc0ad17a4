"""Renders scenes of several objects with the rasteriser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vig.scene import ObjectClass, linear_from_srgb
from vig_world.composition.group import GroupSpec
from vig_world.library import Library
from vig_world.renderers.rasterized import render
from vig_world.renderers.view import View

FINER = 2
"""Pixels drawn along a side of each pixel of the image, so that the edges between objects are blended."""


@dataclass(frozen=True)
class GroupPicture:
    """A rendered group of N objects.

    Attributes:
        linear: (H, W, 3) float32 linear RGB.
        amodal: (N, H, W) bool, each object alone.
        visible: (N, H, W) bool, each as seen.
        before: (N, N) bool, whether object i hides some of object j, `HIDES` pixels or more.
    """

    linear: np.ndarray
    amodal: np.ndarray
    visible: np.ndarray
    before: np.ndarray


HIDES = 12
"""Pixels of one object that another must hide to be before it."""


def render_group(
    library: Library, spec: GroupSpec, classes: Sequence[ObjectClass], width: int, height: int
) -> GroupPicture:
    """Render a group: each object in its own frame with room and props, then the nearest of them.

    On the room lie the darkest shadows of any; objects cast none on each other.
    """
    by_name = {each.name: each for each in classes}
    views = [view.scaled(FINER) for view in spec.views(classes, width, height)]
    drawn = [
        render(library, member.scene, by_name[member.class_name], view)
        for member, view in zip(spec.members, views, strict=True)
    ]
    depths = np.stack([np.where(one.visible, one.depth, np.inf) for one in drawn])
    pictures = np.stack([linear_from_srgb(one.image.astype(np.float32) / 255) for one in drawn])
    owner = np.where(np.isfinite(depths).any(0), depths.argmin(0), -1)
    darkest = np.take_along_axis(pictures, pictures.sum(-1).argmin(0)[None, ..., None], 0)[0]
    linear = np.where((owner < 0)[..., None], darkest, 0)
    for number, picture in enumerate(pictures):
        linear = np.where((owner == number)[..., None], picture, linear)
    amodal = np.stack([_halved(one.amodal) >= 0.5 for one in drawn])
    visible = np.stack([_halved(owner == number) >= 0.5 for number in range(len(drawn))]) & amodal
    inside = np.stack([one.visible for one in drawn])
    before = np.array([
        [(inside[i] & inside[j] & (depths[i] < depths[j])).sum() >= FINER**2 * HIDES for j in range(len(drawn))]
        for i in range(len(drawn))
    ])  # fmt: skip
    return GroupPicture(_halved(linear).astype(np.float32), amodal, visible, before)


def _halved(image: np.ndarray) -> np.ndarray:
    """The mean over cells of FINER x FINER pixels of an image (H, W) or (H, W, C)."""
    height, width = image.shape[0] // FINER, image.shape[1] // FINER
    cells = image.reshape(height, FINER, width, FINER, *image.shape[2:])
    mean: np.ndarray = cells.mean(axis=(1, 3))
    return mean


__all__ = ["GroupPicture", "View", "render_group"]
