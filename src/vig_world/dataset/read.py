"""Reads a dataset folder as numpy arrays."""

import io
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError

from vig.io.checks import decode, read_bytes, read_json, reading
from vig.photo import Window
from vig.scene import IMAGE_SIZE, srgb8_from_linear
from vig_world import World
from vig_world.dataset.format import (
    COLUMNS,
    MAX_DEPTH,
    MAX_SAMPLES,
    PICTURE_MODES,
    REMEDY,
    SCENE,
    STANDARD_SIZE,
    TABLE,
    Size,
    complete_split,
    image_paths,
    inside,
    most_bytes,
    read_info,
)
from vig_world.dataset.spec import SceneSpec


@dataclass(frozen=True)
class Dataset:
    """One split of a dataset, N samples; pictures are read when first asked for.

    latents: (N, P) float32 in the order of `vig.scene.Latents.to_vector`. occlusion: (N,) float32,
    1 - visible / alone pixels within the frame. target_occlusion: (N,) as requested. cause: the occluder.
    truncated: (N,) bool, the frame cuts the object off. design: (N,) the further design whose deviation from
    the model the object has, see `vig_world.assets.target`; -1 for none. finish: `matt`, `glossy`, `painted`
    or `metal`. roll: (N,) clockwise turn of the image, radians. world: of all scenes, see
    `vig_world.WORLDS`. size: of the image files. normals: whether there are any. cut: whether pictures are
    those of `at_network_size`.
    """

    folder: Path
    latents: np.ndarray
    names: tuple[str, ...]
    occlusion: np.ndarray
    target_occlusion: np.ndarray
    cause: tuple[str, ...]
    truncated: np.ndarray
    design: np.ndarray
    finish: tuple[str, ...]
    roll: np.ndarray
    world: World
    size: Size = STANDARD_SIZE
    normals: bool = False
    cut: bool = False

    def __len__(self) -> int:
        return len(self.latents)

    def first(self, count: int) -> "Dataset":
        """Return the first `count` samples, all when there are fewer."""
        of_all = ("folder", "names", "world", "size", "normals", "cut")
        of_each = [field.name for field in fields(self) if field.name not in of_all]
        return replace(self, **{name: getattr(self, name)[:count] for name in of_each})

    def at_network_size(self) -> "Dataset":
        """Return the same samples with pictures of 150 x 150 pixels, the size of networks' inputs.

        The middle square of other sizes, for which the scene was composed, is resampled; occlusion is
        then that within the square.
        """
        if self.cut or self.size == STANDARD_SIZE:
            return self
        cut = replace(self, cut=True)
        seen, alone = (cut.read(kind).sum((1, 2)) for kind in ("mask_visib", "mask"))
        return replace(cut, occlusion=(1 - seen / np.maximum(alone, 1)).astype(np.float32))

    def read(self, kind: str, indices: Iterable[int] | None = None) -> np.ndarray:
        """Return pictures of one kind of the samples `indices` (all by default).

        kind: `rgb` gives (n, H, W, 3) uint8 sRGB; `depth` (n, H, W) float32 metres, inf where unknown, as it
        is beyond the range of its image; `mask` (the object alone) and `mask_visib` (n, H, W) bool; `normal`
        (n, H, W, 3) float32 in the camera's frame, 0 where unknown, of datasets that have `normals`. Raises
        UserError for a missing or damaged file.
        """
        chosen = range(len(self)) if indices is None else list(indices)
        with ThreadPoolExecutor(2) as pool:
            pictures = list(pool.map(lambda i: self._picture(int(i), kind), chosen))
        stack = np.stack(pictures) if pictures else np.empty((0, *self.size[::-1]), np.uint8)
        if kind == "rgb":
            return stack
        if kind == "normal":
            return np.where(stack.any(-1, keepdims=True), stack / np.float32(127.5) - 1, np.float32(0))
        if kind == "depth":
            known = (stack > 0) & (stack < MAX_DEPTH)
            metres = (self.depth_scales[np.array(chosen, int)] / 1000).astype(np.float32)
            return np.where(known, stack * metres[:, None, None], np.float32(np.inf))
        return stack > 127

    @cached_property
    def depth_scales(self) -> np.ndarray:
        """Return millimetres of a unit of each depth image, (N,); UserError where they cannot be read."""
        path = self.folder / SCENE / "scene_camera.json"
        with reading(path, "the cameras of a dataset", REMEDY):
            # bytes of each sample's entry
            table = read_json(inside(self.folder, path.relative_to(self.folder)), 1024 * MAX_SAMPLES)
            cameras = decode(dict[str, dict[str, Any]], table)
            scales = [decode(float, cameras[str(i)]["depth_scale"]) for i in range(len(self))]
            if not all(scale > 0 for scale in scales):
                raise ValueError("a depth_scale is not above 0")
            return np.array(scales)

    def _picture(self, index: int, kind: str) -> np.ndarray:
        picture = _picture(self.folder, index, kind, self.size)
        return _middle_square(picture, kind) if self.cut else picture

    @cached_property
    def images(self) -> np.ndarray:
        """Return all photos, (N, H, W, 3) uint8 sRGB."""
        return self.read("rgb")

    @cached_property
    def amodal(self) -> np.ndarray:
        """Return all masks of the object alone, (N, H, W) bool."""
        return self.read("mask")

    @cached_property
    def visible(self) -> np.ndarray:
        """Return all masks of visible pixels of the object, (N, H, W) bool."""
        return self.read("mask_visib")

    def specs(self) -> list[SceneSpec]:
        """Return the scene of every sample. Raises UserError when the file is missing or damaged."""
        path = self.folder / "specs.jsonl"
        with reading(path, "the scenes of a dataset", REMEDY):
            lines = read_specs(
                self.folder, read_info(self.folder.parent)["splits"][self.folder.name]["count"]
            )
            return [SceneSpec.from_json(line) for line in lines[: len(self)]]


def read_dataset(path: str | Path, split: str | None = "train") -> Dataset:
    """Open one split of a dataset made by `make_dataset`; None takes the only one there is, or train.

    Raises UserError when there is no such dataset or split, it is not complete, or it is damaged.
    """
    root = Path(path)
    from vig_world.dataset.table import read_table

    split = complete_split(root, split)
    table = read_table(root, split, texts=False)
    settings = read_info(root)["splits"][split]
    with reading(root / split / TABLE, "the table of a dataset", REMEDY):
        names = tuple(name for name in table.column_names if name not in COLUMNS)
        dataset = Dataset(
            folder=root / split,
            latents=np.stack([table[name].to_numpy() for name in names], axis=1).astype(np.float32),
            names=names,
            occlusion=table["occlusion"].to_numpy().astype(np.float32),
            target_occlusion=table["target_occlusion"].to_numpy().astype(np.float32),
            cause=tuple(table["cause"].to_pylist()),
            truncated=table["truncated"].to_numpy(zero_copy_only=False),
            design=table["design"].to_numpy(),
            finish=tuple(table["finish"].to_pylist()),
            roll=table["roll"].to_numpy(),
            world=settings["world"],
            size=tuple(settings["size"]),
            normals=settings["normals"],
        )
        for shares in (dataset.occlusion, dataset.target_occlusion):
            if not ((shares >= 0) & (shares <= 1)).all():
                raise ValueError("occlusion must be from 0 to 1")
        if not np.isfinite(dataset.latents).all():
            raise ValueError("latents must be finite")
    return dataset


def read_specs(folder: Path, count: int) -> list[str]:
    """Return the lines of a split's specs.jsonl, for `count` samples. OSError or ValueError when damaged."""
    data = read_bytes(inside(folder, "specs.jsonl"), 65_536 * count)  # bytes of each sample's spec
    lines = data.decode().splitlines()
    if len(lines) != count:
        raise ValueError(f"it has {len(lines)} lines for {count} samples")
    return lines


def decode_picture(data: bytes, kind: str, size: Size) -> np.ndarray:
    """Return pixels of an image file. ValueError, before decoding, when size or mode are not its kind's."""
    try:
        opened = Image.open(io.BytesIO(data), formats=("PNG",))
    except UnidentifiedImageError:
        raise ValueError("an unreadable picture") from None
    with opened as image:
        if (image.size, image.mode) != (size, PICTURE_MODES[kind]):
            found = f"{image.size[0]} x {image.size[1]} {image.mode}"
            raise ValueError(f"{found}, not {size[0]} x {size[1]} {PICTURE_MODES[kind]}")
        return np.asarray(image)


def _picture(folder: Path, index: int, kind: str, size: Size) -> np.ndarray:
    path = image_paths(folder, index, normals=True)[kind]
    with reading(path, "a picture of the dataset", REMEDY):
        return decode_picture(image_bytes(folder, path, size), kind, size)


def image_bytes(folder: Path, path: Path, size: Size) -> bytes:
    """Return the content of an image file in the folder of a split; UserError where it cannot be read."""
    with reading(path, "a picture of the dataset", REMEDY):
        return read_bytes(inside(folder, path.relative_to(folder)), most_bytes(size))


def _middle_square(picture: np.ndarray, kind: str) -> np.ndarray:
    """Return the largest square in the middle of a picture, resampled to `IMAGE_SIZE`: photos in linear
    light, masks where half or more of a pixel is covered, of others the nearest pixel.
    """
    height, width = picture.shape[:2]
    side = min(height, width)
    left, top = (width - side) / 2, (height - side) / 2
    if kind == "rgb":
        return srgb8_from_linear(Window(left, top, side).crop(picture)[0])
    if kind.startswith("mask"):
        area = (left, top, left + side, top + side)
        method = Image.Resampling.BOX if side > IMAGE_SIZE else Image.Resampling.BILINEAR
        return np.asarray(Image.fromarray(picture).resize((IMAGE_SIZE, IMAGE_SIZE), method, area))
    at = ((np.arange(IMAGE_SIZE) + 0.5) * side / IMAGE_SIZE).astype(int)
    return picture[(at + int(top))[:, None], at + int(left)]
