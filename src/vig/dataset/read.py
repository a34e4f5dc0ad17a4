"""Reads a dataset folder as numpy arrays."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from vig.dataset.format import COLUMNS, DEPTH_SCALE, TABLE, complete_split, image_paths, read_info
from vig.dataset.spec import SceneSpec
from vig.errors import UserError
from vig.scene import IMAGE_SIZE
from vig.scene.light import L_COUNT


@dataclass(frozen=True)
class Dataset:
    """One split of a dataset, N samples; pictures are read when first asked for.

    latents: (N, P) float32 in the order of `vig.scene.Latents.to_vector`. occlusion: (N,) float32,
    1 - visible / alone pixels within the frame. target_occlusion: (N,) what was asked for. cause: what hides.
    truncated: (N,) bool, the frame cuts the object off. design: (N,) the further design whose deviation from
    the model the object has, see `vig_world.assets.target`; -1 for none.
    """

    folder: Path
    latents: np.ndarray
    names: tuple[str, ...]
    occlusion: np.ndarray
    target_occlusion: np.ndarray
    cause: tuple[str, ...]
    truncated: np.ndarray
    design: np.ndarray

    def __len__(self) -> int:
        return len(self.latents)

    def first(self, count: int) -> Dataset:
        """The first `count` samples, all when there are fewer."""
        of_each = ("latents", "occlusion", "target_occlusion", "cause", "truncated", "design")
        return replace(self, **{name: getattr(self, name)[:count] for name in of_each})

    def read(self, kind: str, indices: Iterable[int] | None = None) -> np.ndarray:
        """Pictures of one kind of the samples `indices` (all by default).

        kind: `rgb` gives (n, H, W, 3) uint8 sRGB; `depth` (n, H, W) float32 metres, inf where unknown; `mask`
        (the object alone) and `mask_visib` (n, H, W) bool. Raises UserError for a missing or damaged file.
        """
        chosen = range(len(self)) if indices is None else indices
        with ThreadPoolExecutor(2) as pool:
            pictures = list(pool.map(lambda i: _picture(image_paths(self.folder, int(i))[kind]), chosen))
        stack = np.stack(pictures) if pictures else np.empty((0, IMAGE_SIZE, IMAGE_SIZE), np.uint8)
        if kind == "rgb":
            return stack
        if kind == "depth":
            return np.where(stack > 0, stack * np.float32(DEPTH_SCALE / 1000), np.float32(np.inf))
        return stack > 127

    @cached_property
    def images(self) -> np.ndarray:
        """All photos, (N, H, W, 3) uint8 sRGB."""
        return self.read("rgb")

    @cached_property
    def amodal(self) -> np.ndarray:
        """All masks of the object alone, (N, H, W) bool."""
        return self.read("mask")

    @cached_property
    def visible(self) -> np.ndarray:
        """All masks of what is seen of the object, (N, H, W) bool."""
        return self.read("mask_visib")

    def specs(self) -> list[SceneSpec]:
        """The scene of every sample. Raises UserError when the file is missing or damaged."""
        path = self.folder / "specs.jsonl"
        try:
            lines = path.read_text().splitlines()[: len(self)]
            return [SceneSpec.from_json(line) for line in lines]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise _damaged(path, error) from error


def read_dataset(path: str | Path, split: str | None = "train") -> Dataset:
    """Open one split of a dataset made by `make_dataset`; None takes the only one there is, or train.

    Raises UserError when there is no such dataset or split, it is not complete, or it is damaged.
    """
    root = Path(path)
    split = complete_split(root, split)
    count = read_info(root)["splits"][split]["count"]
    table_path = root / split / TABLE
    table = read_table(root, split)
    try:
        names = tuple(name for name in table.column_names if name not in COLUMNS)
        latents = np.stack([table[name].to_numpy() for name in names], axis=1).astype(np.float32)
        dataset = Dataset(
            folder=root / split,
            latents=latents,
            names=names,
            occlusion=table["occlusion"].to_numpy().astype(np.float32),
            target_occlusion=table["target_occlusion"].to_numpy().astype(np.float32),
            cause=tuple(table["cause"].to_pylist()),
            truncated=table["truncated"].to_numpy(zero_copy_only=False),
            design=table["design"].to_numpy(),
        )
    except (OSError, KeyError, ValueError, pa.ArrowException) as error:
        raise _damaged(table_path, error) from error
    if len(dataset) != count or len(names) < L_COUNT + 5:
        found = f"{len(dataset)} rows of {len(names)} latents"
        raise UserError(f"'{table_path}' is damaged: {found}. Make it again.")
    return dataset


def read_table(root: Path, split: str) -> pa.Table:
    """All columns of a split's latents.parquet. Raises UserError when it is missing or damaged."""
    path = root / split / TABLE
    try:
        return pq.read_table(path)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise _damaged(path, error) from error


def describe_split(path: str | Path, split: str) -> dict[str, Any]:
    """What a split is like: occlusion_deciles (10 counts), rejections by reason and per sample."""
    settings = read_info(Path(path))["splits"][split]
    counts, _ = np.histogram(read_table(Path(path), split)["occlusion"].to_numpy(), 10, (0, 1))
    told = {name: settings[name] for name in ("rejections", "rejections_per_sample")}
    return {"occlusion_deciles": counts.tolist(), **told}


def _picture(path: Path) -> np.ndarray:
    try:
        with Image.open(path) as image:
            return np.asarray(image)
    except (OSError, ValueError, SyntaxError) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> UserError:
    return UserError(f"'{path}' is missing or damaged ({type(error).__name__}); make the dataset again.")
