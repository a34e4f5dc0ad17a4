"""What an explanation's page shows: its pictures at the sizes of a page, its views, the steps of its fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from PIL import Image

from vig.explanation import Explanation
from vig.parallel import on_one_core
from vig.photo.images import coded
from vig.renderer import render_latents
from vig.renderer.shading import smooth_normals
from vig.scene import Latents, srgb8_from_linear, srgb_from_linear
from vig_app.report.page import Page, Seen, html

PAGE_SIDE = 768
"""Pixels of the longer side of a page's pictures."""
VIEW_SIDE = 300
"""Of the pictures of views and of steps of the fit."""
STEPS = 8
"""Steps of the fit that a page shows at most."""


def page_of(found: Explanation, photo: str, described: dict[str, Any]) -> str:
    """HTML of an explanation's page.

    `photo` is what the photo is called there, `described` what explanation.json holds.
    """
    model = found.object_class.shape_model
    height, width = found.picture.shape[:2]
    scale = min(1.0, PAGE_SIDE / max(height, width))
    small = round(width * scale), round(height * scale)

    def shrunk(picture: np.ndarray) -> np.ndarray:
        return np.asarray(Image.fromarray(picture).resize(small, Image.Resampling.LANCZOS, reducing_gap=2.0))

    small_photo, colours = shrunk(coded(found.picture)), found.part_albedo
    hidden = shrunk((found.amodal & ~found.mask).view(np.uint8) * np.uint8(255))
    vertices = torch.from_numpy(found.vertices)
    return html(
        Page(
            name=photo,
            described=described,
            photo=small_photo,
            whole=_whole(found, small_photo, hidden, scale),
            outline=shrunk(found.overlay()),
            panels=found.panels(),
            views=_views(found),
            steps=_steps(found),
            vertices=found.vertices,
            normals=smooth_normals(vertices, torch.from_numpy(model.faces)).numpy(),
            faces=model.faces,
            colours=colours[model.parts[model.faces[:, 0]]],
            parts=tuple(zip(model.part_names, colours, strict=True)),
        )
    )


def _whole(found: Explanation, photo: np.ndarray, hidden: np.ndarray, scale: float) -> np.ndarray:
    """A photo (h, w, 3) uint8 with the object drawn in where it is hidden, (h, w) uint8."""
    model, albedo = found.object_class.shape_model, found.fit.latents.albedo[0].numpy()
    camera = replace(found.camera.scaled(scale), width=photo.shape[1], height=photo.shape[0])
    drawn = on_one_core(partial(render_latents, found.fit.latents, found.object_class, camera))
    of_part = found.part_albedo[model.parts[model.faces[drawn.triangle_id[0].numpy(), 0]]]
    share = drawn.coverage[0].numpy()[..., None]
    own = drawn.rgb[0].numpy() / np.maximum(share, 1e-6) * of_part / np.maximum(albedo, 1e-3)
    share = share * hidden[..., None] / 255
    whole: np.ndarray = photo + share * (srgb8_from_linear(own.clip(0, 1)).astype(np.float32) - photo)
    return whole.round().astype(np.uint8)


def _drawn(found: Explanation, views: Sequence[tuple[str, Latents, torch.Tensor]]) -> tuple[Seen, ...]:
    """Views in front of the photo; of each what it is called, its latents (B = 1) and its framing (4,)."""
    photo = srgb_from_linear(found.window.crop(found.picture, VIEW_SIDE)[0])
    standard, seen = found.object_class.camera(camera_distance_ratio=found.camera_distance_ratio), []
    for words, latents, framing in views:
        camera = standard.framed(*framing.tolist()).scaled(VIEW_SIDE / standard.width)
        drawn = on_one_core(partial(render_latents, latents, found.object_class, camera))
        share = drawn.coverage[0].numpy()[..., None]
        # Both encoded before they are mixed, as screens would.
        own = srgb_from_linear(drawn.rgb[0].numpy() / np.maximum(share, 1e-6))
        picture = (255 * (photo + share * (own - photo))).clip(0, 255).round().astype(np.uint8)
        seen.append(Seen(words, float(latents.azimuth), float(latents.elevation), picture))
    return tuple(seen)


def _views(found: Explanation) -> tuple[Seen, ...]:
    """The fit and its alternatives."""
    fit = found.fit
    views = [("this fit: " + _words(fit.latents, fit.confidence), fit.latents, fit.framing)]
    for other in fit.alternatives:
        views.append((_words(other.latents, other.probability), other.latents, other.framing))
    return _drawn(found, views)


def _steps(found: Explanation) -> tuple[Seen, ...]:
    """Some steps of the fit that moved, the first and the last among them."""
    path = found.fit.descent
    moved = torch.cat([torch.tensor([True]), (path[1:] != path[:-1]).any(1)]).nonzero()[:, 0]
    steps = []
    for number in moved[np.unique(np.linspace(0, len(moved) - 1, STEPS).round().astype(int))].tolist():
        latents = Latents.from_vector(path[number : number + 1, :-4])
        words = f"step {number} of {len(path) - 1}: {_words(latents, math.nan)}"
        steps.append((words, latents, path[number, -4:]))
    return _drawn(found, steps)


def _words(latents: Latents, probability: float) -> str:
    azimuth, elevation = (math.degrees(float(angle)) for angle in (latents.azimuth, latents.elevation))
    sure = "" if math.isnan(probability) else f", {probability:.0%}"
    return f"azimuth {azimuth % 360:.0f}°, elevation {elevation:.0f}°{sure}"
