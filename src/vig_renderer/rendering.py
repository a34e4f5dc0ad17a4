"""The renderer for users: scenes in, images out, differentiable in every continuous input."""

import math
from collections.abc import Callable, Sequence
from typing import Literal

import torch
from torch import Tensor

from vig_renderer import NEAR, general, native
from vig_renderer.internals import differentiates_forward, records
from vig_renderer.packing import PackedScenes, pack
from vig_renderer.scene import Rendering, Scene

UNSEEN = (
    "the renderer draws no scenes under vmap, linearize or another tracer, which hide their numbers; give"
    " `render` a list of scenes, and differentiate by torch.func.jvp, vjp or `jacobian`"
)


def render(
    scenes: Scene | Sequence[Scene],
    shading: Literal["vertex", "pixel"] = "vertex",
    samples: int = 1,
    near: float = NEAR,
) -> Rendering:
    """Draw a batch of scenes, each with objects of its own; all images of one size.

    shading: light is reflected at the vertices and interpolated (the paper's), or reflected at every pixel by
    the interpolated normal. samples: colours, coverage and masks are the means over samples x samples points
    a pixel, each blended at occlusion edges in turn; 1 for fits, 3 or more for pictures and datasets. near:
    metres along the optical axis; nothing nearer is drawn.

    Colour is albedo x texture x reflected light, linear RGB, unclipped. Gradients (torch.autograd, forward
    mode too) reach vertices, poses, camera, albedo, textures and their coordinates, normals, lights and
    background, silhouettes included. ids have none. Raises ValueError for shapes, types and non-finite
    numbers that cannot be drawn, NotImplementedError under vmap and where torch records, as for linearize.
    """
    if shading not in ("vertex", "pixel"):
        raise ValueError(f"shading must be 'vertex' or 'pixel'; got {shading!r}. Choose one.")
    if not isinstance(samples, int) or not 1 <= samples <= 4096:
        raise ValueError(f"samples must be a whole number from 1 to 4096; got {samples}. Take 1 for fits.")
    if not isinstance(near, int | float) or not 0 < near < math.inf:
        raise ValueError(f"near must be metres, above 0; got {near!r}. Leave it out for 1 cm.")
    if records():
        raise NotImplementedError(UNSEEN)
    packed = pack([scenes] if isinstance(scenes, Scene) else scenes)
    columns = (general.LIT if shading == "vertex" else general.ALBEDO).stop
    if not differentiates_forward(each for each in packed.tensors if each is not None):
        draw = native.Draw(packed, samples, columns, near)
        rgb, coverage, visible, points, attributes = native.run(draw, *packed.tensors)
        painted = draw.scenes if samples == 1 else None
        return Rendering.lazily(
            rgb,
            coverage,
            visible,
            lambda: _full_masks(
                packed, visible, lambda: native.run(native.FullMasks(packed, samples, near), points)[0]
            ),
            lambda: native.run(native.Surface(packed, near, painted), points, attributes),
        )
    try:
        packed.check_numbers()
    except RuntimeError as error:
        raise NotImplementedError(UNSEEN) from error
    rgb, coverage, visible, points, attributes = general.draw(
        packed, samples, columns, near, packed.background, *packed.tensors[1:]
    )
    return Rendering.lazily(
        rgb,
        coverage,
        visible,
        lambda: _full_masks(packed, visible, lambda: general.full_masks(packed, samples, near, points)[0]),
        lambda: general.surface(packed, near, points, attributes),
    )


def jacobian(function: Callable[[Tensor], Tensor], latents: Tensor) -> tuple[Tensor, Tensor]:
    """Return a function's value (...) of P numbers, and its Jacobian (..., P), by forward differentiation.

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


def _full_masks(packed: PackedScenes, visible: Tensor, alone: Callable[[], Tensor]) -> Tensor:
    """Return the coverage of each object as if it were alone: (B, O, H, W)."""
    images, most, height, width = visible.shape
    if most <= 1:
        return visible
    row = torch.tensor(packed.image, device=visible.device) * most
    row = row + torch.tensor(packed.place, device=visible.device)
    full = visible.new_zeros(images * most, height, width)
    return full.index_copy(0, row, alone()).view(images, most, height, width)
