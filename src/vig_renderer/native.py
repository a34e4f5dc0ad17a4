"""The stages of a picture as native code, on the processor: one call for each, and one for its way back.

The code stands in `stages/`. It draws on one core and needs no torch operation, so that nothing depends on
torch's threads. What each stage does is said in `general.py`, which also has its second derivatives.
"""

import math
from array import array
from collections.abc import Callable, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, Protocol

import torch
import warp as wp
from torch import Tensor

from vig_renderer import general
from vig_renderer.device import initialise, kernel_module, native_code, scalar_type, start
from vig_renderer.harmonics import COSINE_LOBE, Y00, Y1, Y2, Y20
from vig_renderer.internals import transforms
from vig_renderer.once import make_once
from vig_renderer.packing import INPUTS, PackedScenes
from vig_renderer.raster import (
    DEPTH_STEPS,
    FACE_BITS,
    FACE_MASK,
    FARTHEST,
    KEYS_MARGIN,
    NEAR,
    NOTHING,
    PIXEL_BOX,
)

FOLDER = Path(__file__).with_name("stages")
CODE = {
    "place": ("arguments.cc", "place.cc"),
    "place_back": ("arguments.cc", "place_back.cc"),
    "paint": ("arguments.cc", "layers.cc", "find.cc", "colours.cc", "paint.cc"),
    "paint_back": ("arguments.cc", "layers.cc", "colours.cc", "paint_back.cc"),
    "surface": ("arguments.cc", "layers.cc", "surface.cc"),
    "surface_back": ("arguments.cc", "layers.cc", "surface_back.cc"),
}
"""The files of each kernel's code, one after the other."""

ARGUMENTS = {
    # Objects, vertices, columns of attributes; points (V, 3), attributes and lights (O, 34) and cotangents on
    # them, which come (on) and are made (to); world (V, 3), and raw: normals before they are of length one.
    "whole": "objects vertices columns",
    "real*": "points attributes lights on_points on_attributes on_lights to_points to_attributes to_lights"
    " world raw",
    # What a call says and is told: see the kernels.
    "whole*": "status fault",
    # Pictures: a layer each, of the objects from starts[layer] to starts[layer + 1].
    "whole ": "layers height width samples channels masks background_is_image background_numbers",
    "const whole*": "starts",
    # face (layers, grid): the one that is seen, numbered through, or -1. chosen (edges, 4): silhouette edges,
    # both ends and both faces. crossing (capacity, 8): edge, axis, line, low, sharers, layer, here, there.
    "int*": "face chosen crossing object_id triangle_id",
    # joints (V, 2): mean steepness of the silhouette edges that meet, and their number. steps (capacity,
    # channels): differences of the two pixels of a crossing.
    "real* ": "joints steps background rgb coverage visible depth normal"
    " on_rgb on_coverage on_visible on_depth on_normal to_background",
}
"""Fields of the table that a call passes, by type, in their order; 0 where a call has no such thing."""
PLACES = {name: place for place, name in enumerate(" ".join(ARGUMENTS.values()).split())}
STAGES = {back: [name for name in CODE if name.endswith("_back") is back] for back in (False, True)}
"""Of a picture and of its way back, which many programs never go: a kernel of its own each."""
NOT_FINITE, OUT_OF_RANGE, NO_MEMORY = 1, 2, 3
"""Faults, as in arguments.cc."""

FIRST_CAPACITY = 4096
"""Crossings for which there is space at first."""


@make_once
def _kernel(dtype: torch.dtype, back: bool) -> Any:
    """A kernel that runs a stage by its place in STAGES[back]; compiled at first use."""
    initialise()
    real = scalar_type(dtype)
    fields = "\n".join(f"{kind} {name};" for kind, names in ARGUMENTS.items() for name in names.split())
    constants = {
        "SLACK": -4.0 * torch.finfo(dtype).eps,
        "DEPTH_STEPS": float(DEPTH_STEPS),
        "FARTHEST": FARTHEST,
        "FACE_BITS": FACE_BITS,
        "FACE_MASK": FACE_MASK,
        "NOTHING": NOTHING,
        "KEYS_MARGIN": KEYS_MARGIN,
        "NEAR": NEAR,
        # A face hides a crossing where it is nearer by more than rounding.
        "NEARER": 1.0 - (1e-5 if dtype == torch.float32 else 1e-9),
        "SHORTEST": 1e-15,
        "PER_OCTAVE": 0.5 / math.log(2.0),
        "C0": Y00 * COSINE_LOBE[0],
        "C1": Y1 * COSINE_LOBE[1],
        "C2": Y2 * COSINE_LOBE[4],
        "C20": Y20 * COSINE_LOBE[4],
        "MARGIN": general.MARGIN,
    }
    preamble = native_code(FOLDER, real=real, **constants)

    def stage(name: str) -> Any:
        code = "\n".join((FOLDER / file).read_text(encoding="utf-8") for file in CODE[name])
        code = code.replace("FIELDS", fields)
        for file in (PIXEL_BOX, PIXEL_BOX.with_name("draw_faces.cc")):
            code = code.replace(f'#include "{file.name}"', file.read_text(encoding="utf-8"))

        def run(table: wp.uint64) -> None: ...

        run.__qualname__ = name  # the name of the function in C++
        return wp.func_native(snippet=f"{preamble}\n{code}")(run)

    place, paint, surface = map(stage, STAGES[back])

    @wp.kernel(module=kernel_module("picture_back" if back else "picture", dtype))  # type: ignore[untyped-decorator]
    def run_stage(number: wp.int32, table: wp.uint64) -> None:
        if number == 0:
            place(table)
        elif number == 1:
            paint(table)
        else:
            surface(table)

    return run_stage


def _call(name: str, packed: PackedScenes, rows: list[int], **fields: Tensor | int) -> None:
    """Run a kernel on contiguous tensors; rows: see `_rows`. Raises what `_refuse` does for its fault."""
    packed.check_unchanged()
    fault = array("q", [0])
    numbers = [0] * len(PLACES)
    numbers[PLACES["fault"]] = fault.buffer_info()[0]
    for field, value in fields.items():
        numbers[PLACES[field]] = value if isinstance(value, int) else value.data_ptr()
    table = array("q", numbers + rows)
    back = name.endswith("_back")
    inputs = [STAGES[back].index(name), table.buffer_info()[0]]
    start(_kernel(packed.background.dtype, back), 1, inputs)
    if fault[0]:
        _refuse(fault[0], packed)


def _refuse(fault: int, packed: PackedScenes) -> None:
    """The error of a fault: ValueError that names the input, or MemoryError."""
    if fault == NOT_FINITE:
        packed.check_numbers()
    if fault == OUT_OF_RANGE:
        packed.check_tables()
        raise ValueError("a table has numbers out of range. Write to none while scenes are drawn.")
    if fault == NO_MEMORY:
        images, height, width = packed.size
        raise MemoryError(
            f"too little memory for {images} images of {width} x {height}; draw fewer, or with fewer samples"
        )


def _rows(
    packed: PackedScenes,
    inputs: Sequence[Tensor | None] = (),
    on: Sequence[Tensor | None] = (),
    textures: Sequence[Tensor] = (),
    on_textures: Sequence[Tensor | None] = (),
) -> list[int]:
    """Of each object what `struct Object` of arguments.cc holds: addresses, then sizes."""
    rows: list[int] = []

    def add(tensors: Sequence[Tensor | None], first: int, count: int) -> None:
        if tensors and first >= 0:
            rows.extend(0 if each is None else each.data_ptr() for each in tensors[first : first + count])
        else:
            rows.extend((0,) * count)

    for n, (own, sizes) in enumerate(zip(packed.texture, packed.tables, strict=True)):
        for whole, two in ((inputs, textures), (on, on_textures)):
            add(whole, n * len(INPUTS), len(INPUTS))
            add(two, 2 * own, 2)
        rows += sizes
    return rows


class Stage(Protocol):
    """One step from tensors to tensors."""

    def general(self, *inputs: Any) -> tuple[Tensor, ...]:
        """The step in plain torch."""

    def forward(self, *inputs: Any) -> tuple[tuple[Tensor, ...], Any]:
        """Its results, and what `backward` needs of them."""

    def backward(
        self, kept: Any, inputs: Sequence[Any], needed: Sequence[bool], cotangents: Sequence[Tensor | None]
    ) -> Sequence[Tensor | None]:
        """Cotangents on the inputs that are needed."""


class _Native(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, stage: Stage, *inputs: Tensor | None) -> tuple[Tensor, ...]:
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*inputs)
        ctx.stage, ctx.sizes = stage, _sizes(inputs)
        results, ctx.kept = stage.forward(*(each if each is None else each.contiguous() for each in inputs))
        if isinstance(stage, Surface):
            ctx.mark_non_differentiable(*results[2:])
        return results

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor | None) -> Any:
        inputs, needed = ctx.saved_tensors, ctx.needs_input_grad[1:]
        if _sizes(inputs) != ctx.sizes:
            raise RuntimeError("an input of a rendering was exchanged before its backward pass. Render anew.")
        if torch.is_grad_enabled() or transforms(*cotangents):
            return None, *_differentiable(ctx.stage, inputs, needed, cotangents)
        plain = [each if each is None else each.contiguous() for each in inputs]
        given = [each if each is None else each.contiguous() for each in cotangents]
        return None, *ctx.stage.backward(ctx.kept, plain, needed, given)


def _sizes(inputs: Sequence[Tensor | None]) -> list[int]:
    """In bytes: what torch does not watch of what is saved, and `tensor.data = other` may change."""
    return [0 if each is None else each.nbytes for each in inputs]


def _differentiable(
    stage: Stage, inputs: Sequence[Any], needed: Sequence[bool], cotangents: Sequence[Tensor | None]
) -> list[Tensor | None]:
    """The way back as torch's own operations, of which there are second derivatives and batches."""
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
    """The results of a stage by native code. Of inference tensors a graph keeps copies."""
    apply: Callable[..., tuple[Tensor, ...]] = _Native.apply
    if torch.is_grad_enabled():
        inputs = tuple(each.clone() if each is not None and each.is_inference() else each for each in inputs)
    return apply(stage, *inputs)


def _made(inputs: Sequence[Any], needed: Sequence[bool]) -> list[Tensor | None]:
    return [torch.empty_like(each) if need else None for each, need in zip(inputs, needed, strict=True)]


def _given(names: Sequence[str], cotangents: Sequence[Tensor | None]) -> dict[str, Tensor]:
    return {name: each for name, each in zip(names, cotangents, strict=False) if each is not None}


class Place:
    """See `general.place`. Raises ValueError for inputs that are not finite."""

    def __init__(self, packed: PackedScenes, columns: int):
        self.packed, self.columns = packed, columns

    def general(self, *inputs: Tensor | None) -> tuple[Tensor, ...]:
        return general.place(self.packed, self.columns, *inputs)

    def forward(self, *inputs: Tensor | None) -> tuple[tuple[Tensor, ...], Any]:
        packed, count = self.packed, self.packed.first_vertex[-1]
        like = packed.background
        shapes = {"points": 3, "attributes": self.columns, "world": 3, "raw": 3}
        made = {name: like.new_empty(count, columns) for name, columns in shapes.items()}
        made["lights"] = like.new_empty(len(packed.topologies), 34)
        if len(set(packed.image)) < packed.size[0]:
            packed.check_numbers()  # of scenes without objects native code gets the background only
        textures = [each.contiguous() for each in packed.textures]
        background = packed.background.contiguous()
        rows = _rows(packed, inputs, textures=textures)
        _call(
            "place",
            packed,
            rows,
            **made,
            **self._sizes(),
            background=background,
            background_numbers=background.numel(),
        )
        kept = {name: tensor.detach() for name, tensor in made.items()}
        return (made["points"], made["attributes"], made["lights"]), kept

    def backward(
        self, kept: Any, inputs: Sequence[Any], needed: Sequence[bool], cotangents: Sequence[Tensor | None]
    ) -> Sequence[Tensor | None]:
        on = _made(inputs, needed)
        given = _given(("on_points", "on_attributes", "on_lights"), cotangents)
        _call("place_back", self.packed, _rows(self.packed, inputs, on), **kept, **self._sizes(), **given)
        return on

    def _sizes(self) -> dict[str, int]:
        return {
            "objects": len(self.packed.topologies),
            "vertices": self.packed.first_vertex[-1],
            "columns": self.columns,
        }


class Layers:
    """Pictures of all scenes, or of each object alone: what the stages that draw share."""

    def __init__(self, packed: PackedScenes, samples: int, alone: bool = False):
        self.packed, self.samples, self.is_alone = packed, samples, alone
        objects = len(packed.image)
        if alone:
            self.starts = array("q", range(objects + 1))
        else:
            counts = [0] * packed.size[0]
            for image in packed.image:
                counts[image] += 1
            self.starts = array("q", [0, *accumulate(counts)])
        self.masks = 1 if alone else packed.most_objects
        self.channels = self.masks + (0 if alone else 3)
        self.layers = len(self.starts) - 1

    def sizes(self, attributes: Tensor | None = None) -> dict[str, int]:
        """Fields of the table."""
        _, height, width = self.packed.size
        return {
            "objects": len(self.packed.topologies),
            "vertices": self.packed.first_vertex[-1],
            "columns": 0 if attributes is None else attributes.shape[1],
            "layers": self.layers,
            "height": height,
            "width": width,
            "samples": self.samples,
            "channels": self.channels,
            "masks": self.masks,
            "background_is_image": int(self.packed.background.shape[1:3] != (1, 1)),
            "starts": self.starts.buffer_info()[0],
        }

    def draw(
        self, points: Tensor, textures: Sequence[Tensor] = (), **fields: Tensor
    ) -> tuple[dict[str, Tensor], Any]:
        """Run the kernel `paint`: what it found, as fields that its way back needs, and its status."""
        packed = self.packed
        edges = sum(len(each.edges) for each in packed.topologies)
        grid = [side * self.samples + 2 * general.MARGIN for side in packed.size[1:]]
        made = {
            "face": points.new_empty(self.layers, *grid, dtype=torch.int32),
            "chosen": points.new_empty(edges, 4, dtype=torch.int32),
        }
        capacity = FIRST_CAPACITY * max(self.layers, 1)
        rows, sizes = _rows(packed, textures=textures), self.sizes(fields.get("attributes"))
        while True:
            made["crossing"] = points.new_empty(capacity, 8, dtype=torch.int32)
            made["steps"] = points.new_empty(capacity, self.channels)
            made["joints"] = points.new_empty(len(points), 2)
            status = array("q", [capacity, 0, 0])
            address = status.buffer_info()[0]
            _call("paint", packed, rows, points=points, status=address, **made, **sizes, **fields)
            if status[1] <= capacity:
                return made, status
            capacity = status[1]


class Paint(Layers):
    """See `general.paint`; `alone`: see `general.alone`."""

    def general(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        if self.is_alone:
            return general.alone(self.packed, self.samples, *inputs)
        return general.paint(self.packed, self.samples, *inputs)

    def forward(self, *inputs: Tensor) -> tuple[tuple[Tensor, ...], Any]:
        points, (images, height, width) = inputs[0], self.packed.size
        visible = points.new_empty(self.layers, self.masks, height, width)
        if self.is_alone:
            return (visible[:, 0],), self.draw(points, visible=visible)
        rgb, coverage = points.new_empty(images, height, width, 3), points.new_empty(images, height, width)
        fields = dict(zip(("attributes", "lights", "background"), inputs[1:4], strict=True))
        kept = made, _ = self.draw(points, inputs[4:], rgb=rgb, coverage=coverage, visible=visible, **fields)
        self.face = made["face"]
        return (rgb, coverage, visible), kept

    def backward(
        self, kept: Any, inputs: Sequence[Any], needed: Sequence[bool], cotangents: Sequence[Tensor | None]
    ) -> Sequence[Tensor | None]:
        names = ("points", "attributes", "lights", "background")
        on_names = ("on_visible",) if self.is_alone else ("on_rgb", "on_coverage", "on_visible")
        given = _given(on_names, cotangents)
        fields, textures = dict(zip(names, inputs, strict=False)), inputs[4:]
        made = {f"to_{name}": torch.empty_like(each) for name, each in fields.items()}
        if not (self.is_alone or needed[3]):
            made.pop("to_background")
        on = _made(textures, needed[4:])
        attributes = fields.get("attributes")
        rows = _rows(self.packed, textures=textures, on_textures=on)
        found, status = kept
        fields |= found | {"status": status.buffer_info()[0]}
        _call("paint_back", self.packed, rows, **fields, **made, **given, **self.sizes(attributes))
        return [*(made.get(f"to_{name}") for name in names[: len(inputs)]), *on]


class Surface(Layers):
    """See `general.surface`. face: as `Paint` found it on one sample a pixel."""

    def __init__(self, packed: PackedScenes, face: Tensor | None):
        super().__init__(packed, 1)
        self.channels, self.face = 0, face

    def general(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        return general.surface(self.packed, *inputs)

    def forward(self, points: Tensor, attributes: Tensor) -> tuple[tuple[Tensor, ...], Any]:
        face = self.draw(points)[0]["face"] if self.face is None else self.face
        size = self.packed.size
        depth, normals = points.new_empty(size), points.new_empty(*size, 3)
        ids = [points.new_empty(size, dtype=torch.int32) for _ in range(2)]
        made = {"depth": depth, "normal": normals, "object_id": ids[0], "triangle_id": ids[1]}
        fields = {"points": points, "attributes": attributes, "face": face, **made}
        _call("surface", self.packed, _rows(self.packed), **fields, **self.sizes(attributes))
        return (depth, normals, *ids), face

    def backward(
        self, kept: Any, inputs: Sequence[Any], needed: Sequence[bool], cotangents: Sequence[Tensor | None]
    ) -> Sequence[Tensor | None]:
        points, attributes = inputs
        given = _given(("on_depth", "on_normal"), cotangents)
        on = torch.empty_like(points), torch.empty_like(attributes)
        fields = {"points": points, "attributes": attributes, "face": kept, **given}
        fields |= {"to_points": on[0], "to_attributes": on[1]}
        _call("surface_back", self.packed, _rows(self.packed), **fields, **self.sizes(attributes))
        return on
