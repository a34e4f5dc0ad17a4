"""The renderer for users: scenes in, images out, differentiable in every continuous input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import torch
from torch import Tensor

from vig_renderer import general, native
from vig_renderer.internals import differentiates_forward
from vig_renderer.packing import PackedScenes, pack
from vig_renderer.scene import Rendering, Scene


def render(
    scenes: Scene | Sequence[Scene],
    shading: Literal["vertex", "pixel"] = "vertex",
    samples: int = 1,
) -> Rendering:
    """Draw a batch of scenes, each with objects of its own; all images of one size.

    shading: light is reflected at the vertices and interpolated (the paper's), or reflected at every pixel by
    the interpolated normal. samples: colours, coverage and masks are the means over samples x samples points
    a pixel, each blended at occlusion edges in turn; 1 for fits, 3 or more for pictures and datasets.

    Colour is albedo x texture x reflected light, linear RGB, unclipped. Gradients (torch.autograd, forward
    mode too) reach vertices, poses, camera, albedo, textures and their coordinates, normals, lights and
    background, silhouettes included. ids have none. Raises ValueError for shapes, types and non-finite
    numbers that cannot be drawn.
    """
    if shading not in ("vertex", "pixel"):
        raise ValueError(f"shading must be 'vertex' or 'pixel'; got {shading!r}. Choose one.")
    if not isinstance(samples, int) or samples < 1:
        raise ValueError(f"samples must be a whole number of 1 or more; got {samples}. Take 1 for fits.")
    packed = pack([scenes] if isinstance(scenes, Scene) else scenes)
    columns = (general.LIT if shading == "vertex" else general.ALBEDO).stop
    if packed.background.device.type == "cpu" and not differentiates_forward(packed.tensors):
        return _native(packed, samples, columns)
    packed.check_numbers()
    points, attributes, lights = general.place(packed, columns, *packed.inputs)
    rgb, coverage, visible = general.paint(
        packed, samples, points, attributes, lights, packed.background, *packed.textures
    )
    return Rendering.lazily(
        rgb,
        coverage,
        visible,
        lambda: _full_masks(packed, visible, lambda: general.alone(packed, samples, points)[0]),
        lambda: general.surface(packed, points, attributes),
    )


def jacobian(function: Callable[[Tensor], Tensor], latents: Tensor) -> tuple[Tensor, Tensor]:
    """Value (...) of a function of P numbers, and its Jacobian (..., P), by forward differentiation.

    function: renders, say, from a vector of latents (P,) and returns one tensor. One pass per number: for few
    numbers and many pixels, as in Gauss-Newton. torch.func.jvp gives a single direction.
    """
    if latents.ndim != 1:
        raise ValueError(f"latents must be one vector (P,); got {tuple(latents.shape)}")
    value, columns = function(latents), []
    # Forward mode: one pass gives all pixels' derivative by one number.
    for direction in torch.eye(len(latents), dtype=latents.dtype, device=latents.device):
        columns.append(torch.func.jvp(function, (latents,), (direction,))[1])
    return value, torch.stack(columns, dim=-1) if columns else value.new_zeros(*value.shape, 0)


def _native(packed: PackedScenes, samples: int, columns: int) -> Rendering:
    points, attributes, lights = native.run(native.Place(packed, columns), *packed.inputs)
    stage = native.Paint(packed, samples)
    inputs = points, attributes, lights, packed.background, *packed.textures
    rgb, coverage, visible = native.run(stage, *inputs)
    face = stage.face if samples == 1 else None
    return Rendering.lazily(
        rgb,
        coverage,
        visible,
        lambda: _full_masks(
            packed, visible, lambda: native.run(native.Paint(packed, samples, alone=True), points)[0]
        ),
        lambda: native.run(native.Surface(packed, face), points, attributes),
    )


def _full_masks(packed: PackedScenes, visible: Tensor, alone: Callable[[], Tensor]) -> Tensor:
    """Coverage of each object as if it were alone: (B, O, H, W)."""
    images, most, height, width = visible.shape
    if most <= 1:
        return visible
    row = torch.tensor(packed.image, device=visible.device) * most
    row = row + torch.tensor(packed.place, device=visible.device)
    full = visible.new_zeros(images * most, height, width)
    return full.index_copy(0, row, alone()).view(images, most, height, width)
