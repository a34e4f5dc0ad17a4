"""report.html: one file that shows an explanation in a browser, without a server or the network."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from PIL import Image

from vig.explanation import Explanation
from vig.parallel import on_one_core
from vig.photo.images import coded
from vig.renderer import Rendering, render, render_latents, scene_of
from vig.renderer.shading import smooth_normals
from vig.scene import Latents, srgb8_from_linear, srgb_from_linear
from vig_app.report import words
from vig_app.report.html import filled, jpeg_url

PAGE_SIDE = 768
"""Pixels of the longer side of a page's pictures."""
VIEW_SIDE = 300
"""Of the pictures of views and of steps of the fit."""
STEPS = 8
"""Steps of the fit that a page shows at most."""


def page_of(
    explanation: Explanation, photo: str, described: dict[str, Any], overlay: np.ndarray, panels: np.ndarray
) -> str:
    """HTML of an explanation's page.

    Args:
        explanation: What it shows.
        photo: What the photo is called there.
        described: What explanation.json holds.
        overlay: `explanation.overlay()`, which the folder has as well.
        panels: `explanation.panels()`, likewise.
    """
    height, width = explanation.picture.shape[:2]
    scale = min(1.0, PAGE_SIDE / max(height, width))
    size = round(width * scale), round(height * scale)

    def reduced(picture: np.ndarray) -> np.ndarray:
        return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS, reducing_gap=2.0))

    reduced_photo, part_albedo = reduced(coded(explanation.picture)), explanation.part_albedo
    hidden = reduced((explanation.amodal & ~explanation.mask).view(np.uint8) * np.uint8(255))
    part_names = explanation.object_class.shape_model.part_names
    background = srgb_from_linear(explanation.window.crop(explanation.picture, VIEW_SIDE)[0])
    poses, path = _views(explanation), list(_steps(explanation))
    pictures = _shown(explanation, background, poses + path)
    views, steps = pictures[: len(poses)], pictures[len(poses) :]
    return filled(
        "page.html",
        name=photo,
        described=described,
        badge=words.badge(described),
        summary=words.summary(described),
        photo=reduced_photo,
        whole=_with_hidden_part(explanation, part_albedo, reduced_photo, hidden, scale),
        outline=reduced(overlay),
        panels=panels,
        rows=words.table_rows(described),
        colours=[(name, words.css_colour(rgb)) for name, rgb in zip(part_names, part_albedo, strict=True)],
        views=views,
        views_note=words.views_note(described),
        data={
            "views": [{"azimuth": view.azimuth, "elevation": view.elevation} for view in views],
            "steps": [vars(step) | {"picture": jpeg_url(step.picture)} for step in steps],
            "model": _model(explanation, part_albedo, described["light"]),
        },
    )


@dataclass(frozen=True)
class ShownView:
    """A view and its picture: `words` say which, angles are in radians, picture (H, W, 3) uint8 shows it."""

    words: str
    azimuth: float
    elevation: float
    picture: np.ndarray


@dataclass(frozen=True)
class Pose:
    """What a picture shows: `words` say which, latents (B = 1) and framing (4,) place the object."""

    words: str
    latents: Latents
    framing: torch.Tensor


def _views(explanation: Explanation) -> list[Pose]:
    """The fit and its alternatives."""
    fit = explanation.fit
    first = Pose("this fit: " + words.view_words(fit.latents, fit.confidence), fit.latents, fit.framing)
    return [first] + [
        Pose(words.view_words(view.latents, view.probability), view.latents, view.framing)
        for view in fit.alternatives
    ]


def _steps(explanation: Explanation) -> Iterable[Pose]:
    """Some steps of the fit that moved, the first and the last among them."""
    path = explanation.fit.descent
    moved = torch.cat([torch.tensor([True]), (path[1:] != path[:-1]).any(1)]).nonzero()[:, 0]
    for number in moved[np.unique(np.linspace(0, len(moved) - 1, STEPS).round().astype(int))].tolist():
        latents = Latents.from_vector(path[number : number + 1, :-4])
        text = f"step {number} of {len(path) - 1}: {words.view_words(latents, math.nan)}"
        yield Pose(text, latents, path[number, -4:])


def _shown(explanation: Explanation, photo: np.ndarray, poses: Sequence[Pose]) -> list[ShownView]:
    """Poses in front of the window's photo (h, w, 3) in [0, 1] sRGB, drawn at once."""
    object_class = explanation.object_class
    standard = object_class.camera(camera_distance_ratio=explanation.camera_distance_ratio)

    def draw() -> Rendering:
        cameras = [
            standard.framed(*pose.framing.tolist()).scaled(VIEW_SIDE / standard.width) for pose in poses
        ]
        return render(
            [
                scene_of(pose.latents, object_class, camera)
                for pose, camera in zip(poses, cameras, strict=True)
            ]
        )

    drawn, shown = on_one_core(draw), []
    for pose, rgb, share in zip(poses, drawn.rgb.numpy(), drawn.coverage.numpy()[..., None], strict=True):
        # Both encoded before they are mixed, as screens would.
        object_colour = srgb_from_linear(rgb / np.maximum(share, 1e-6))
        picture = (255 * (photo + share * (object_colour - photo))).clip(0, 255).round().astype(np.uint8)
        shown.append(
            ShownView(pose.words, float(pose.latents.azimuth), float(pose.latents.elevation), picture)
        )
    return shown


def _with_hidden_part(
    explanation: Explanation, part_albedo: np.ndarray, photo: np.ndarray, hidden: np.ndarray, scale: float
) -> np.ndarray:
    """A photo (h, w, 3) uint8 with the object drawn in where it is hidden, (h, w) uint8."""
    latents, object_class = explanation.fit.latents, explanation.object_class
    model, albedo = object_class.shape_model, latents.albedo[0].numpy()
    camera = replace(explanation.camera.scaled(scale), width=photo.shape[1], height=photo.shape[0])
    drawn = on_one_core(partial(render_latents, latents, object_class, camera))
    albedo_of_part = part_albedo[model.parts[model.faces[drawn.triangle_id[0].numpy(), 0]]]
    coverage = drawn.coverage[0].numpy()[..., None]
    linear = drawn.rgb[0].numpy() / np.maximum(coverage, 1e-6) * albedo_of_part / np.maximum(albedo, 1e-3)
    share = coverage * hidden[..., None] / 255
    colour = srgb8_from_linear(linear.clip(0, 1)).astype(np.float32)
    whole: np.ndarray = photo + share * (colour - photo)
    return whole.round().astype(np.uint8)


def _model(explanation: Explanation, part_albedo: np.ndarray, light: list[float]) -> dict[str, Any]:
    """The object as the page draws it in 3-D: place, normal and colour of each corner of its triangles."""
    model, vertices = explanation.object_class.shape_model, explanation.vertices
    normals = smooth_normals(torch.from_numpy(vertices), torch.from_numpy(model.faces)).numpy()
    corners, extent = model.faces.ravel(), np.ptp(vertices, axis=0)
    colours = part_albedo[model.parts[model.faces[:, 0]]]
    return {
        "place": _base64(vertices[corners]),
        "normal": _base64(normals[corners]),
        "colour": _base64(np.repeat(colours, 3, axis=0)),
        "count": len(corners),
        "target": (vertices.min(0) + extent / 2).tolist(),
        "size": float(extent.max()),
        "light": light,
        "azimuth": float(explanation.latents.azimuth),
        "elevation": float(explanation.latents.elevation),
    }


def _base64(array: np.ndarray) -> str:
    """An array as little-endian float32."""
    return base64.b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode()
