"""Pictures by the native library as functions of torch with first derivatives: see vig_native/scenes.h.

It draws each layer on one thread, on as many as torch has where there are several, and needs no torch
operation. The functions are described in `general.py`, which also has their second derivatives.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from vig_renderer import general
from vig_renderer.internals import transforms
from vig_renderer.packing import INPUTS, PackedScenes

Tensors = Sequence[Any]  # tensors, None where there is none
Stage = Any
"""`Draw`, `FullMasks` or `Surface`: a function of tensors, its way back, and the same in plain torch."""


def _arrays(tensors: Iterable[Tensor | None]) -> list[np.ndarray | None]:
    return [None if each is None else each.detach().numpy() for each in tensors]


def _per_object(flat: Sequence[Any]) -> list[list[Any]]:
    return [list(flat[start : start + len(INPUTS)]) for start in range(0, len(flat), len(INPUTS))]


class _Native(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, stage: Stage, *inputs: Tensor | None) -> tuple[Tensor, ...]:
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*inputs)
        ctx.stage = stage
        results: tuple[Tensor, ...] = stage.forward(
            *(each if each is None else each.contiguous() for each in inputs)
        )
        if isinstance(stage, Surface):
            ctx.mark_non_differentiable(*results[2:])
        return results

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor | None) -> Any:
        inputs, needed = ctx.saved_tensors, ctx.needs_input_grad[1:]
        if torch.is_grad_enabled() or transforms(*cotangents):
            return None, *_differentiable(ctx.stage, inputs, needed, cotangents)
        given = [each if each is None else each.contiguous() for each in cotangents]
        return None, *ctx.stage.backward(inputs, needed, given)


def _differentiable(stage: Stage, inputs: Tensors, needed: Sequence[bool], cotangents: Tensors) -> Tensors:
    """Return the backward pass as torch's own operations, which have second derivatives and batches."""
    twice = torch.is_grad_enabled()
    with torch.enable_grad():
        results = stage.general(*inputs)
    pairs = [
        (result, cotangent)
        for result, cotangent in zip(results, cotangents, strict=True)
        if cotangent is not None and result.requires_grad
    ]
    wanted = [each for each, need in zip(inputs, needed, strict=True) if need]
    if not pairs:
        return [None] * len(inputs)
    outputs, given = zip(*pairs, strict=True)
    found = iter(torch.autograd.grad(outputs, wanted, given, create_graph=twice, allow_unused=True))
    return [next(found) if need else None for need in needed]


def run(stage: Stage, *inputs: Tensor | None) -> tuple[Tensor, ...]:
    """Return the results of a stage by native code. A graph keeps copies of inference tensors."""
    apply: Callable[..., tuple[Tensor, ...]] = _Native.apply
    if torch.is_grad_enabled():
        inputs = tuple(each.clone() if each is not None and each.is_inference() else each for each in inputs)
    try:
        return apply(stage, *inputs)
    except MemoryError as error:
        raise MemoryError("too little memory for the images; draw fewer, or with fewer samples") from error


def _zeros(inputs: Sequence[Any], needed: Sequence[bool]) -> list[Tensor | None]:
    form = torch.contiguous_format
    return [
        torch.zeros_like(each, memory_format=form) if need else None
        for each, need in zip(inputs, needed, strict=True)
    ]


class Draw:
    """See `general.draw`. Raises ValueError for inputs that are not finite."""

    def __init__(self, packed: PackedScenes, samples: int, columns: int, near: float):
        self.packed, self.samples, self.columns, self.near = packed, samples, columns, near

    def general(self, background: Tensor, *inputs: Tensor | None) -> tuple[Tensor, ...]:
        return general.draw(self.packed, self.samples, self.columns, self.near, background, *inputs)

    def forward(self, background: Tensor, *inputs: Tensor | None) -> tuple[Tensor, ...]:
        packed, vertices = self.packed, sum(self.packed.vertex_counts)
        images, height, width = packed.size
        self.scenes, threads = packed.in_library(self.samples, self.near), torch.get_num_threads()
        points, attributes = background.new_empty(vertices, 3), background.new_empty(vertices, self.columns)
        rgb, coverage = background.new_empty(*packed.size, 3), background.new_empty(packed.size)
        visible = background.new_empty(images, packed.most_objects, height, width)
        finite = self.scenes.place(_per_object(_arrays(inputs)), *_arrays((points, attributes)), threads)
        if not finite or len(set(packed.image)) < images or not np.isfinite(background.numpy()).all():
            packed.check_numbers()  # also of the cameras of scenes without objects
        self.scenes.paint(*_arrays((background, rgb, coverage, visible)), threads)
        return rgb, coverage, visible, points, attributes

    def backward(self, inputs: Tensors, needed: Sequence[bool], cotangents: Tensors) -> Tensors:
        vertices, like = sum(self.packed.vertex_counts), self.packed.background
        on_points, on_attributes = (
            like.new_zeros(vertices, columns) if given is None else given.clone()
            for columns, given in zip((3, self.columns), cotangents[3:], strict=True)
        )
        on = _zeros(inputs, needed)
        arrays = _arrays((*cotangents[:3], on_points, on_attributes, on[0]))
        self.scenes.back(*arrays, _per_object(_arrays(on[1:])), torch.get_num_threads())
        return on


class FullMasks:
    """See `general.full_masks`."""

    def __init__(self, packed: PackedScenes, samples: int, near: float):
        self.packed, self.samples, self.near = packed, samples, near

    def general(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        return general.full_masks(self.packed, self.samples, self.near, *inputs)

    def forward(self, points: Tensor) -> tuple[Tensor, ...]:
        self.scenes = self.packed.in_library(self.samples, self.near, alone=True)
        masks = points.new_empty(len(self.packed.image), 1, *self.packed.size[1:])
        self.scenes.bind(points.detach().numpy(), None)
        self.scenes.paint(None, None, None, masks.numpy(), torch.get_num_threads())
        return (masks[:, 0],)

    def backward(self, inputs: Tensors, needed: Sequence[bool], cotangents: Tensors) -> Tensors:
        on, on_masks = torch.zeros_like(inputs[0], memory_format=torch.contiguous_format), cotangents[0]
        if on_masks is not None:
            arrays = None, None, on_masks[:, None].detach().numpy(), on.numpy(), None, None
            self.scenes.back(*arrays, [], torch.get_num_threads())
        return [on]


class Surface:
    """See `general.surface`. scenes: those that were painted with one sample a pixel; None to draw anew."""

    def __init__(self, packed: PackedScenes, near: float, scenes: Any = None):
        self.packed, self.near, self.scenes = packed, near, scenes

    def general(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        return general.surface(self.packed, self.near, *inputs)

    def forward(self, points: Tensor, attributes: Tensor) -> tuple[Tensor, ...]:
        if self.scenes is None:
            self.scenes = self.packed.in_library(1, self.near)
            self.scenes.bind(points.detach().numpy(), attributes.detach().numpy())
            self.scenes.find(False, torch.get_num_threads())
        size = self.packed.size
        depth, normals = points.new_empty(size), points.new_empty(*size, 3)
        ids = [points.new_empty(size, dtype=torch.int32) for _ in range(2)]
        self.scenes.surface(*_arrays((depth, normals, *ids)))
        return (depth, normals, *ids)

    def backward(self, inputs: Tensors, needed: Sequence[bool], cotangents: Tensors) -> Tensors:
        on = _zeros(inputs, [True, True])
        self.scenes.surface_back(*_arrays((*cotangents[:2], *on)))
        return on
