"""The latents of one object in one image, and their order in a vector."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property

from vig.scene.light import L_COUNT
from vig_renderer.arrays import Array, is_tensor, namespace

SHAPE_LIMIT = 3.0  # shape coefficients stay within this many standard deviations


@dataclass(frozen=True)
class Block:
    """A named run of neighbouring numbers.

    Attributes:
        name: Name by which other code asks for it, such as `azimuth`.
        size: Number of its numbers; 0 for a block that this class or fit does without.
        lower: Least value of each number; one for all, or `size` of them.
        upper: Greatest value of each; a number whose bounds are equal is held.
        labels: A name for each number, as written in tables; `name`, or `name_0`, `name_1`, ... by default.
        deviation: Standard deviation of each number's Gaussian prior about 0; None when it has none, or one
            that the class or the recognition model states.
        weighted: Whether an objective's `prior_weight` applies to that prior.
    """

    name: str
    size: int
    lower: float | tuple[float, ...] = -math.inf
    upper: float | tuple[float, ...] = math.inf
    labels: tuple[str, ...] = ()
    deviation: float | tuple[float, ...] | None = None
    weighted: bool = True

    def __post_init__(self) -> None:
        if self.size < 0:
            raise ValueError(
                f"block '{self.name}' must have 0 or more numbers; got {self.size}. Give its size."
            )
        for what in ("lower", "upper", "labels", "deviation"):
            value = getattr(self, what)
            if isinstance(value, tuple) and value and len(value) != self.size:
                raise ValueError(
                    f"{what} of block '{self.name}' must be {self.size}; got {len(value)}. Give one for each."
                )

    def hold(self, value: float = 0.0) -> Block:
        """Return the same block with every number kept at `value`."""
        return replace(self, lower=value, upper=value)


@dataclass(frozen=True)
class LatentLayout:
    """The slice of each block of latents in a vector of P numbers: `layout["azimuth"]`.

    The only place that defines offsets: no other code counts columns.
    """

    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        names = [block.name for block in self.blocks]
        if len(set(names)) != len(names):
            raise ValueError(f"blocks must have different names; got {', '.join(names)}. Rename one.")

    @cached_property
    def _slices(self) -> dict[str, slice]:
        slices, start = {}, 0
        for block in self.blocks:
            slices[block.name] = slice(start, start + block.size)
            start += block.size
        return slices

    @cached_property
    def size(self) -> int:
        """Return P, the number of numbers in a vector."""
        return sum(block.size for block in self.blocks)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Return a name for each number, as written in tables."""
        names: list[str] = []
        for block in self.blocks:
            alone = (block.name,) if block.size == 1 else ()
            counted = tuple(f"{block.name}_{number}" for number in range(block.size))
            names += block.labels or alone or counted
        return tuple(names)

    def __contains__(self, name: str) -> bool:
        return name in self._slices

    def __getitem__(self, name: str) -> slice:
        """Return a block's slice. Raises KeyError, which lists the blocks, when it is absent."""
        if name not in self._slices:
            held = ", ".join(self._slices)
            raise KeyError(f"expected one of the blocks {held}; got '{name}'. Add it with `with_blocks`.")
        return self._slices[name]

    def at(self, name: str) -> int:
        """Return the place of a block's first number."""
        return int(self[name].start)

    def count(self, name: str) -> int:
        """Return the number of a block's numbers, 0 when it is absent."""
        return self._slices[name].stop - self._slices[name].start if name in self else 0

    def indices(self, *names: str) -> list[int]:
        """Return the places of all numbers of these blocks, block by block."""
        return [place for name in names for place in range(self[name].start, self[name].stop)]

    def with_blocks(self, *blocks: Block) -> LatentLayout:
        """Return this layout with blocks appended; one whose name exists replaces that block."""
        new = {block.name: block for block in blocks}
        own = tuple(new.pop(block.name, block) for block in self.blocks)
        return LatentLayout((*own, *new.values()))

    def without(self, *names: str) -> LatentLayout:
        """Return this layout without some of its blocks."""
        for name in names:
            self[name]
        return LatentLayout(tuple(block for block in self.blocks if block.name not in names))

    def block(self, name: str) -> Block:
        """Return a block by its name."""
        self[name]
        return next(block for block in self.blocks if block.name == name)

    def split(self, vector: Array) -> dict[str, Array]:
        """Return the blocks of vectors (..., P) by name, each (..., size). ValueError on another width."""
        if vector.ndim < 1 or vector.shape[-1] != self.size:
            blocks = " + ".join(f"{block.size} {block.name}" for block in self.blocks)
            received = tuple(vector.shape)
            raise ValueError(
                f"latents must be (..., {self.size}) for {blocks}; got {received}. Take their layout."
            )
        return {name: vector[..., place] for name, place in self._slices.items()}

    def join(self, parts: Mapping[str, Array]) -> Array:
        """Return the inverse of `split`: vectors (..., P) of all blocks, each (..., size)."""
        sizes = {name: part.shape[-1] for name, part in parts.items()}
        wanted = {block.name: block.size for block in self.blocks}
        if sizes != wanted:
            raise ValueError(f"expected blocks of sizes {wanted}; got {sizes}. Name each block once.")
        columns = [parts[block.name] for block in self.blocks]
        return namespace(columns[0]).concatenate(columns, axis=-1)

    def prior_deviations(self) -> dict[str, tuple[tuple[float, ...], bool]]:
        """Return the blocks with a Gaussian prior about 0: deviation of each number, and `Block.weighted`."""
        return {
            block.name: (tuple(_each(block.deviation, block.size)), block.weighted)
            for block in self.blocks
            if block.deviation is not None
        }

    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the least and greatest value of each of the P numbers."""
        lower = tuple(value for block in self.blocks for value in _each(block.lower, block.size))
        upper = tuple(value for block in self.blocks for value in _each(block.upper, block.size))
        return lower, upper


def _each(value: float | tuple[float, ...], size: int) -> Iterable[float]:
    return value if isinstance(value, tuple) else (value,) * size


LIGHT_LABELS = tuple(f"light_{degree}_{order}" for degree in range(3) for order in range(-degree, degree + 1))

FRAMING = Block(
    "framing",
    4,
    (-0.4, -0.4, -1.0, -0.4),
    (0.4, 0.4, 1.0, 0.4),
    ("shift_x", "shift_y", "log_scale", "roll"),
    deviation=(0.1, 0.1, 0.3, 0.05),
    weighted=False,
)
"""Shift of the image in its widths, right and down, the log of its magnification, and its clockwise turn
about the principal point, radians."""


@cache
def latent_layout(modes: int) -> LatentLayout:
    """Return the latents of a scene with K shape components, as datasets and tables have them: P = K + 14."""
    return LatentLayout(
        (
            Block(
                "shape",
                modes,
                -SHAPE_LIMIT,
                SHAPE_LIMIT,
                tuple(f"shape_{mode}" for mode in range(modes)),
                deviation=1.0,
            ),
            Block("azimuth", 1),
            Block("elevation", 1, 0.0, math.pi / 2),
            Block("albedo", 3, 0.0, 1.0, ("albedo_r", "albedo_g", "albedo_b")),
            Block("light", L_COUNT, labels=LIGHT_LABELS),
        )
    )


def layout_of_width(width: int) -> LatentLayout:
    """Return the latents of a scene from how many numbers they have, P = K + 14. ValueError for too few."""
    modes = width - latent_layout(0).size
    if modes < 0:
        raise ValueError(f"latents must be K + {latent_layout(0).size} numbers; got {width}")
    return latent_layout(modes)


@cache
def regressed_layout(modes: int) -> LatentLayout:
    """Return the layout of numbers that a network regresses: latents without azimuth, which it classifies."""
    return latent_layout(modes).without("azimuth")


@cache
def point_layout(modes: int) -> LatentLayout:
    """Return the layout of a fit's points: the latents, then the framing of the image."""
    return latent_layout(modes).with_blocks(FRAMING)


@dataclass(frozen=True)
class Latents:
    """Inferred quantities, batched over B images.

    Attributes:
        shape: (B, K) standard deviations along the shape model's components.
        azimuth: (B,) radians.
        elevation: (B,) radians.
        albedo: (B, 3) linear RGB in [0, 1].
        light: (B, 9) SH coefficients of incident radiance in the world frame.
    """

    shape: Array
    azimuth: Array
    elevation: Array
    albedo: Array
    light: Array

    def __post_init__(self) -> None:
        shapes = {
            name: tuple(value.shape) if hasattr(value, "shape") else f"a {type(value).__name__}"
            for name, value in vars(self).items()
        }
        if len({is_tensor(value) for value in vars(self).values()}) > 1:
            told = ", ".join(f"{name} {type(value).__name__}" for name, value in vars(self).items())
            raise ValueError(f"latents must be all arrays or all tensors; got {told}. Convert the others.")
        first = shapes["shape"]
        count, modes = first if isinstance(first, tuple) and len(first) == 2 else (None, None)
        wanted = ((count, modes), (count,), (count,), (count, 3), (count, L_COUNT))
        if tuple(shapes.values()) != wanted:
            raise ValueError(
                "latents must be arrays shape (B, K), azimuth (B,), elevation (B,), albedo (B, 3),"
                f" light (B, {L_COUNT}); got {', '.join(f'{name} {size}' for name, size in shapes.items())}."
                " Give each one row an image."
            )

    def __len__(self) -> int:
        return len(self.azimuth)

    def __getitem__(self, index: slice | Array) -> Latents:
        return Latents(*(getattr(self, field.name)[index] for field in fields(self)))

    def to_vector(self) -> Array:
        """Return all latents as (B, P) in the order of `vig.scene.latents.latent_layout`."""
        parts = {field.name: getattr(self, field.name) for field in fields(self)}
        columns = {name: part if part.ndim == 2 else part[:, None] for name, part in parts.items()}
        return latent_layout(self.shape.shape[1]).join(columns)

    @staticmethod
    def from_vector(vector: Array) -> Latents:
        """Return the inverse of `to_vector`; K follows from the width. Raises ValueError on a wrong shape."""
        if vector.ndim != 2 or vector.shape[1] < latent_layout(0).size:
            wanted, received = f"(B, K + {latent_layout(0).size})", tuple(vector.shape)
            raise ValueError(f"latents must be {wanted}; got {received}. Give a row an image.")
        parts = layout_of_width(vector.shape[1]).split(vector)
        parts |= {name: parts[name][:, 0] for name in ("azimuth", "elevation")}
        return Latents(**parts)
